"""Cross-saturation: each axis's flux falls with the other axis's current.

The curve and its source are told in `saturation`. cross_drop is the share by which the inductance is lower at rated
current than at no current of the other axis: L_q at i_d = i_rated. Without the magnets' flux in psi_d a drop could
not be told from its mirror image.
"""

from estimator.physics.effect import Parameter, constant, no_shapes
from estimator.physics.saturation import FluxChange

EFFECT = FluxChange(
    "cross_saturation", "cross-saturation",
    (Parameter("cross_drop", "1", constant(0.15), constant(0.0), constant(0.6)),),
    no_shapes,
    "psi_d that falls with i_q squared, L_q that falls with i_d",
    ("q_axis_saturation", "d_axis_saturation"),
    bends=True,
    discrepancy=3e-5,
)
