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


@pytest.mark.parametrize("left", ["", "a", "b", "c"])
def test_errors_of_current_sensors_are_in_their_own_phase(left: str) -> None:
    """`left`: the phase that is not measured, but what the others leave."""
    rows = turning()
    true = dict(zip("abc", [(rows.i_s * axis.conjugate()).real for axis in AXES], strict=True))
    for name in ("current_sensor_gain", "current_sensor_offset")[: 1 if left else 2]:
        effect = BY_NAME[name]
        assert isinstance(effect, CurrentError)
        assert effect.told is not None
        sizes = (*SIZES, float(" abc".index(left or " "))) if name == "current_sensor_gain" else SIZES
        measured = dict(true)
        for channel, (size, _) in effect.told(rows, sizes).items():
            i = true[channel[-1]]
            measured[channel[-1]] = size * i if name == "current_sensor_gain" else i + size
        if left:
            assert len(effect.told(rows, sizes)) == 2
            one, other = (i for phase, i in measured.items() if phase != left)
            measured[left] = -one - other
        i_s = vector([measured[phase] for phase in "abc"])
        seen = Samples(
            rows.theta_e, np.full(len(rows) + 1, 600.0), (i_s * rows.rotor.conj()).real, (i_s * rows.rotor.conj()).imag,
            np.append(rows.u.real, 0.0), np.append(rows.u.imag, 0.0), T_S,
        )  # fmt: skip
        error = effect.error(rows_of([seen], MACHINE, 6.0), sizes)
        assert error == pytest.approx(i_s - rows.i_s, abs=1e-9), name
