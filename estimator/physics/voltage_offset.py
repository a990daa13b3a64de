"""A constant is added to the voltage that is recorded: offsets of its report, on d and q.

    u recorded = u acting + offset_d + j offset_q

It stays what it is at every speed and current, and in the other direction of turning. Derived here.
"""

import numpy as np

from estimator.arrays import Vector
from estimator.physics.effect import AddedVoltage, Parameter, Sizes
from estimator.physics.inverter_voltage_error import bus
from estimator.physics.rows import Rows


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Added voltage, V."""
    return np.full(len(rows), complex(sizes[0], sizes[1]))


EFFECT = AddedVoltage(
    "voltage_offset", "an offset of the recorded voltage",
    (
        Parameter("offset_d", "V", lambda rows: 1e-3 * bus(rows)),
        Parameter("offset_q", "V", lambda rows: 1e-3 * bus(rows)),
    ),
    lambda _rows: ((),),
    "the same voltage at every speed and current",
    ("iron_loss", "magnet_flux_drift"),
    adds=voltage,
    by_speed=1e-7,  # at one speed it is psi_f
    discrepancy=5e-5,
)
