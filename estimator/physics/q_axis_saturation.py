"""Saturation along the q axis: L_q falls as abs(i_q) rises.

The curve and its source are told in `saturation`. L_q_drop is the share by which the inductance is lower at rated
current than at no current. Without the magnets' flux in psi_d a drop could not be told from its mirror image.
"""

from estimator.physics.effect import Parameter, constant, no_shapes
from estimator.physics.saturation import FluxChange

EFFECT = FluxChange(
    "q_axis_saturation", "saturation along the q axis",
    (Parameter("L_q_drop", "1", constant(0.15), constant(0.0), constant(0.6)),),
    no_shapes,
    "a cubic of i_q in u_d, in proportion to speed, and an L_q that falls with abs(i_q)",
    ("cross_saturation", "iron_loss"),
    bends=True,
    discrepancy=3e-5,
)
