"""What a residual holds that no effect explains, in words: of noise nothing, of a voltage its form and its size."""

import numpy as np
import pytest

from estimator.arrays import Array, Vector
from estimator.diagnosis.likelihood.noise import filter_of, whitened
from estimator.diagnosis.unnamed.describe import describe
from estimator.machine import Machine
from estimator.online.flux_balance import TURN
from estimator.physics.rows import Rows, rows_of
from estimator.samples import Samples

T_S, N, NOISE = 1e-4, 8000, 1e-5  # s, rows, Vs
MACHINE = Machine(0.5, 2e-3, 3e-3, 0.1, n_p=3, i_rated=10.0)


@pytest.fixture(scope="module")
def rows() -> Rows:
    n, random = N + 1, np.random.default_rng(1)
    theta_e: Array = TURN * 40.0 * T_S * np.arange(n, dtype=np.float64)
    steps = np.repeat(random.normal(size=(n // 100 + 1, 2)), 100, axis=0)[:n]
    return rows_of([Samples(
        theta_e=theta_e, omega_e=np.full(n, TURN * 40.0), i_d=steps[:, 0], i_q=steps[:, 1],
        u_d=random.normal(size=n), u_q=24.0 + random.normal(size=n), T_s=T_S,
    )], MACHINE, 10.0)  # fmt: skip


def residual(rows: Rows, volts: Vector) -> Vector:
    """What a voltage (rotor frame) leaves in noise, Vs."""
    random = np.random.default_rng(2)
    noise = NOISE * (random.normal(size=N) + 1j * random.normal(size=N))
    return noise + whitened(volts, filter_of(rows, rows.machine))


def test_noise_holds_nothing(rows: Rows) -> None:
    assert describe(rows, residual(rows, np.zeros(N, np.complex128)), (NOISE, NOISE)) is None


@pytest.mark.parametrize("axis", [1.0, 1j])
def test_a_voltage_that_drifts_is_told_by_its_size(rows: Rows, axis: complex) -> None:
    """At one speed a line of the rotor's frequency, all but hidden by the machine, explains it, by far more volts."""
    volts: Vector = axis * np.linspace(-1.0, 1.0, N).astype(np.complex128)
    told = describe(rows, residual(rows, volts), (NOISE, NOISE))
    assert told is not None
    assert told.rms_V == pytest.approx(np.sqrt(1.0 / 3.0), rel=0.1)
    assert told.description.startswith("a drift of ")


def test_a_line_is_told_by_its_frequency(rows: Rows) -> None:
    volts = 0.5 * np.exp(1j * TURN * 137.0 * T_S * np.arange(N))
    told = describe(rows, residual(rows, volts * rows.middle.conj()), (NOISE, NOISE))
    assert told is not None
    assert told.rms_V == pytest.approx(0.5, rel=0.1)
    assert "137 Hz" in told.description
