"""The angle is off by a constant: an encoder that was aligned badly.

    theta_measured = theta_e + offset: d and q are mixed, psi_f shows on both axes

At steady speed it looks like a voltage on the d axis that grows with speed. Derived here.
"""

from estimator.arrays import Vector
from estimator.physics.angle_sensing import voltage_of_angle_error
from estimator.physics.effect import DEGREE, Effect, Parameter, Sizes, constant, no_shapes
from estimator.physics.rows import Rows


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Added voltage, V."""
    (offset,) = sizes
    return voltage_of_angle_error(rows, offset)


EFFECT = Effect(
    "angle_offset", "an offset of the angle",
    (Parameter("offset", "rad", constant(3.0 * DEGREE), constant(-0.6), constant(0.6)),),
    voltage,
    no_shapes,
    "u_d in proportion to speed, and to changes of speed",
    ("iron_loss", "voltage_delay"),
    angle_error=lambda _rows, sizes: sizes[0],
    bends=True,
    missed=1e-8,
)
