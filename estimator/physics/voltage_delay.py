"""The recorded voltage acted later, or earlier, than the recording says.

    u acting in period k = u recorded in row k - periods

A register read one period off; derived here.
"""

import numpy as np

from estimator.physics.effect import Effect, Parameter, Sizes, constant
from estimator.physics.rows import Rows, Vector


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Added voltage, V."""
    periods, direction = sizes
    change: Vector = np.diff(rows.u) * (rows.apart[:-1] == 1)  # none over a gap
    none = np.zeros(1, np.complex128)
    return periods * (np.concatenate((none, change)) if direction > 0.0 else np.concatenate((-change, none)))


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
    misreads_voltage=True,
    told=lambda _rows, p: {"periods": (p[0] * p[1], "1")},
    missed=2e-5,
)
