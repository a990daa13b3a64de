"""A constant voltage of each leg that the recorded voltage leaves out: unequal delays of its switches, duty offsets.

    u_k acting = u_k recorded + offset_k        offset_k = delay_k / T_s u_dc, less the mean of the three

The star point takes what the three have in common. As a vector it stands still in the stationary frame, and adds no
more at higher speeds or currents. An offset of the current sensors makes the voltage R_s i_offset there, and where
L_d = L_q nothing else: such a machine does not tell the two apart. With saliency the sensors' offset makes, besides,
what turns with twice the angle, in proportion to speed. With the bridge off only the sensors' is there. Derived here.
"""

import numpy as np

from estimator.arrays import Vector
from estimator.physics.effect import AddedVoltage, Parameter, Sizes, no_shapes
from estimator.physics.inverter_voltage_error import bus
from estimator.physics.rows import Rows
from estimator.physics.vectors import by_phase


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Added voltage, V: less the offset, since it is not in what was recorded."""
    return rows.stationary(np.full(len(rows), -complex(*sizes)))


EFFECT = AddedVoltage(
    "leg_voltage_offset", "constant voltages of the inverter's legs",
    tuple(Parameter(name, "V", lambda rows: 2e-3 * bus(rows)) for name in ("offset_alpha", "offset_beta")),
    no_shapes,
    "voltage that stands still in the stationary frame, the same at every speed and current",
    ("current_sensor_offset",),
    adds=voltage,
    told=lambda _rows, p: {f"offset_{k}": (x, "V") for k, x in zip("abc", by_phase(*p), strict=True)},
    discrepancy=1e-5,
)
