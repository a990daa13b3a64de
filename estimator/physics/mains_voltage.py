"""A voltage of the mains' frequency between bridge and motor: coupled into the leads, or between grounds.

    u acting = u recorded + forth exp(j 2 pi f t) + back exp(-j 2 pi f t)        in the stationary frame

As the mean of each period: sin(x)/x less, x = pi f T_s. A hum of the current sensors looks like it where L_d = L_q: see
`current_sensor_hum`. Derived here.
"""

import cmath
import math

import numpy as np

from estimator.arrays import Vector
from estimator.physics.effect import AddedVoltage, Parameter, Sizes
from estimator.physics.mains import FREQUENCY, PARTS, TYPICAL, impedance, phasors, shapes, turning
from estimator.physics.rows import Rows


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Added voltage, V: less what acts, since it is not in what was recorded."""
    (forth, back), f = phasors(sizes), float(sizes[4])
    middle = turning(rows, f)[:-1] * (cmath.exp(1j * math.pi * f * rows.T_s) * float(np.sinc(f * rows.T_s)))
    return rows.stationary(-forth * middle - back * middle.conj())


def _told(_rows: Rows, sizes: Sizes) -> dict[str, tuple[float, str]]:
    """Along the longer axis of its ellipse, within a right angle of phase a."""
    forth, back = phasors(sizes)
    along = 0.5 * cmath.phase(forth * back)
    return {
        "frequency": (sizes[4], "Hz"), "amplitude": (abs(forth) + abs(back), "V"), "direction": (along, "rad"),
        "phase": (cmath.phase(forth * cmath.exp(-1j * along)), "rad"),
    }  # fmt: skip


def _typical(rows: Rows) -> float:
    """As much as a hum of the sensors looks like."""
    return TYPICAL(rows) * impedance(rows)


EFFECT = AddedVoltage(
    "mains_voltage", "a voltage of the mains' frequency",
    (*(Parameter(name, "V", _typical) for name in PARTS), FREQUENCY),
    shapes,
    "a line at the mains' frequency in the stationary frame, the same at every speed and current",
    ("current_sensor_hum",),
    adds=voltage,
    told=_told,
    discrepancy=1e-5,
)
