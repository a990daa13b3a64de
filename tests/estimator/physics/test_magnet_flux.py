"""What is told of magnets that warm up."""

import pytest

from estimator.physics.library import BY_NAME
from tests.estimator.physics.equations import rows_without_noise, with_effect


def test_a_time_constant_is_told_in_seconds() -> None:
    rows = rows_without_noise(with_effect("magnet_heat", "servo_4nm"))
    told = BY_NAME["magnet_flux_drift"].told
    assert told is not None
    assert told(rows, (0.03, 0.6, 0.01)) == {
        "change": (0.03, "1"), "time_constant": (pytest.approx(0.6 * (rows.t[-1] - rows.t[0]), rel=1e-2), "s"),
    }  # fmt: skip
