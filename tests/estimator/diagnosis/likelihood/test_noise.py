"""How large the noise is, whatever is made of white one."""

from pathlib import Path

import numpy as np
import pytest

from emulator.conceal.recording import Choice
from estimator.diagnosis.likelihood.noise import noise_of, white_of
from tests.estimator.diagnosis.concealed_runs import rows_of

CHOICE = Choice(1200, ("none",), (0.0, 1.0), ("servo_4nm",), 2.0)


@pytest.mark.parametrize("samples", [1, 2, 3, 4])
def test_noise_of_means_of_samples_is_as_large_as_theirs(samples: int, tmp_path: Path) -> None:
    rows, _ = rows_of(CHOICE, 1, tmp_path)
    white = np.random.default_rng(1).normal(0.0, 1.0, len(rows) + samples - 1)
    mean = np.convolve(white, np.full(samples, 1.0 / samples), "valid")
    assert white_of(mean, rows, samples) == pytest.approx(samples**-0.5, rel=0.03)
    assert noise_of(mean + 1j * mean, None, rows, samples)[0] == white_of(mean, rows, samples)
