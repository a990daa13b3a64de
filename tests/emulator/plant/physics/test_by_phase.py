"""Effects whose sizes are told phase by phase, beside the phases' own equations: the right phase has the name."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from estimator.arrays import Vector
from estimator.machine import Machine
from estimator.physics.current_sensing import CurrentError
from estimator.physics.effect import Effect
from estimator.physics.library import BY_NAME
from estimator.physics.rows import Rows, rows_of
from estimator.physics.vectors import AXES
from estimator.samples import Samples

MACHINE = Machine(1.0, 2e-3, 3e-3, 0.1, 4, 6.0)
T_S = 1e-4
SIZES = 0.03, -0.05


def turning() -> Rows:
    n = 200
    t = np.arange(n) * T_S
    columns = [600.0 * t + 0.3, np.full(n, 600.0), 3.0 + np.cos(900.0 * t), 4.0 + np.sin(900.0 * t), 0.0 * t + 10.0,
               0.0 * t + 5.0]  # fmt: skip
    samples = Samples(*(np.asarray(column, np.float64) for column in columns), T_s=T_S)
    return rows_of([samples], MACHINE, 6.0)


def told(effect: Effect, rows: Rows) -> list[float]:
    assert effect.told is not None
    return [value for value, _ in effect.told(rows, SIZES).values()]


def vector(phases: Sequence[Any]) -> Vector:
    a, b, c = (quantity * axis for quantity, axis in zip(phases, AXES, strict=True))
    return np.asarray((2.0 / 3.0) * (a + b + c), np.complex128)


def test_unequal_resistances_drop_their_voltage_in_their_own_phase() -> None:
    rows, effect = turning(), BY_NAME["phase_resistance_imbalance"]
    current = rows.i_mean * rows.middle
    phases = [excess * (current * axis.conjugate()).real for excess, axis in zip(told(effect, rows), AXES, strict=True)]
    expected = rows.stationary(vector(phases))
    assert effect.voltage(rows, SIZES) == pytest.approx(expected, abs=1e-12)


def test_errors_of_current_sensors_are_in_their_own_phase() -> None:
    rows = turning()
    true = [(rows.i_s * axis.conjugate()).real for axis in AXES]
    for name in ("current_sensor_gain", "current_sensor_offset"):
        effect = BY_NAME[name]
        assert isinstance(effect, CurrentError)
        sizes = told(effect, rows)
        if name == "current_sensor_gain":
            measured = [gain * i for gain, i in zip(sizes, true, strict=True)]
        else:
            measured = [i + offset for i, offset in zip(true, sizes, strict=True)]
        i_s = vector(measured)
        seen = Samples(
            rows.theta_e, np.full(len(rows) + 1, 600.0), (i_s * rows.rotor.conj()).real, (i_s * rows.rotor.conj()).imag,
            np.append(rows.u.real, 0.0), np.append(rows.u.imag, 0.0), T_S,
        )  # fmt: skip
        error = effect.error(rows_of([seen], MACHINE, 6.0), SIZES)
        assert error == pytest.approx(i_s - rows.i_s, abs=1e-9), name
