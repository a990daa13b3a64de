"""The recorded voltage acted later, or earlier, than the recording says.

    u acting in period k = u recorded in row k - periods

A register read one period off; derived here. One that is read a period early was turned by an angle that was foreseen
from the counts at the ends of its row, theta + 3/2 turn. A drive that foresees otherwise leaves some rounding.
"""

from typing import Final

import numpy as np

from estimator.arrays import Vector
from estimator.physics.effect import Parameter, Sizes, VoltageError, constant
from estimator.physics.rows import Rows

_FORESEEN: Final = 1.5  # times a count's variance, that may be left where the angle was foreseen otherwise


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Added voltage, V."""
    periods, _ = sizes
    return periods * _change_of_voltage(rows, sizes)


def _change_of_voltage(rows: Rows, sizes: Sizes) -> Vector:
    """The voltage (V) of each period less that of the one before or after it; none over a gap.

    Each was turned by rounded angles: one that is read late by those of the period in which it acted, one that is read
    early by those from which the drive foresaw it.
    """
    return rows.once(_change_by, sizes[1])


def _change_by(rows: Rows, direction: float) -> Vector:
    by = np.broadcast_to(np.asarray(rows.turned_by), rows.i.shape)
    together, none = rows.apart[:-1] == 1, np.zeros(1, np.complex128)
    if direction > 0.0:
        foreseen = np.exp(1j * (by[1:-1] - by[:-2]))
        return np.concatenate((none, (rows.u[1:] - rows.u[:-1] * foreseen) * together))
    moved = np.exp(0.5j * (by[:-2] - by[2:]))
    return np.concatenate(((rows.u[:-1] - rows.u[1:] * moved) * together, none))


def foreseen_energy(rows: Rows, sizes: Sizes) -> float:
    """What the angle's rounding leaves of voltages that are read early, as flux errors (Vs^2, summed over periods)."""
    periods, direction = sizes
    if direction < 0.0:
        return 0.0
    return _FORESEEN * rows.angle_step**2 / 12.0 * float(np.vdot(rows.u, rows.u).real) * (periods * rows.T_s) ** 2


EFFECT = VoltageError(
    "voltage_delay", "a delay of the recorded voltage",
    (
        Parameter("periods", "1", constant(0.7), constant(0.25), constant(2.0)),
        Parameter("direction", "1", constant(1.0), constant(-1.0), constant(1.0), shape=True, discrete=True),
    ),
    lambda _rows: ((1.0,), (-1.0,)),
    "an error in proportion to how fast the voltage changes",
    ("angle_offset",),
    error=voltage,
    remembers=_change_of_voltage,
    told=lambda _rows, p: {"periods": (p[0] * p[1], "1")},
    discrepancy=2e-5,
)
