"""The angle is off by a constant: an encoder that was aligned badly.

    theta_measured = theta_e + offset: d and q are mixed, psi_f shows on both axes

At steady speed it looks like a voltage on the d axis that grows with speed. Derived here.
"""

from estimator.physics.angle_sensing import AngleError
from estimator.physics.effect import DEGREE, Parameter, Sizes, constant, no_shapes
from estimator.physics.rows import Rows


def _offset(_rows: Rows, sizes: Sizes) -> float:
    return sizes[0]


EFFECT = AngleError(
    "angle_offset", "an offset of the angle",
    (Parameter("offset", "rad", constant(3.0 * DEGREE), constant(-0.6), constant(0.6)),),
    no_shapes,
    "u_d in proportion to speed, and to changes of speed",
    ("iron_loss", "voltage_delay"),
    error=_offset,
    error_as_measured=_offset,
    bends=True,
    discrepancy=1e-8,
)
