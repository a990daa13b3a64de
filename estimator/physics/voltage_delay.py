"""The recorded voltage acted later, or earlier, than the recording says.

    u acting in period k = u recorded in row k - periods

A register read one period off; derived here.
"""

import numpy as np

from estimator.physics.effect import Effect, Parameter, Sizes, constant
from estimator.physics.rows import Rows, Vector


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Added voltage, V."""
    periods, _ = sizes
    return periods * _change(rows, sizes)


def _change(rows: Rows, sizes: Sizes) -> Vector:
    """The voltage (V) of each period less that of the one before or after it; none over a gap."""
    _, direction = sizes

    def change() -> Vector:
        step, none = np.diff(rows.u) * (rows.apart[:-1] == 1), np.zeros(1, np.complex128)
        return np.concatenate((none, step)) if direction > 0.0 else np.concatenate((-step, none))

    return rows.once(f"change of the voltage, {direction:+g}", change)


EFFECT = Effect(
    "voltage_delay", "a delay of the recorded voltage",
    (
        Parameter("periods", "1", constant(0.7), constant(0.25), constant(2.0)),
        Parameter("direction", "1", constant(1.0), constant(-1.0), constant(1.0), shape=True, discrete=True),
    ),
    voltage,
    lambda _rows: ((1.0,), (-1.0,)),
    "an error in proportion to how fast the voltage changes",
    ("angle_offset",),
    remembers=_change,
    misreads_voltage=True,
    told=lambda _rows, p: {"periods": (p[0] * p[1], "1")},
    missed=2e-5,
)
