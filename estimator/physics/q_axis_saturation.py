"""Saturation along the q axis: L_q falls as abs(i_q) rises.

The curve and its source are told in `saturation`. L_q_drop is the share by which the inductance is lower at rated
current than at no current. Without the magnets' flux in psi_d a drop could not be told from its mirror image.
"""

from estimator.arrays import Vector
from estimator.physics.effect import Effect, Parameter, Sizes, constant, no_shapes
from estimator.physics.rows import Rows
from estimator.physics.saturation import voltage_together


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Added voltage, V."""
    return voltage_together(rows, {"q_axis_saturation": sizes})


EFFECT = Effect(
    "q_axis_saturation", "saturation along the q axis",
    (Parameter("L_q_drop", "1", constant(0.15), constant(0.0), constant(0.6)),),
    voltage,
    no_shapes,
    "a cubic of i_q in u_d, in proportion to speed, and an L_q that falls with abs(i_q)",
    ("cross_saturation", "iron_loss"),
    together=voltage_together,
    bends=True,
    missed=3e-5,
)
