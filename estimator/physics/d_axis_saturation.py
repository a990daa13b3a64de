"""Saturation along the d axis: L_d falls as i_d rises; psi_d bends.

The curve and its source are told in `saturation`. L_d_drop is the share by which the inductance is lower at rated
current than at no current. Without the magnets' flux in psi_d a drop could not be told from its mirror image.
"""

from estimator.physics.effect import Parameter, constant, no_shapes
from estimator.physics.saturation import FluxChange

EFFECT = FluxChange(
    "d_axis_saturation", "saturation along the d axis",
    (Parameter("L_d_drop", "1", constant(0.15), constant(0.0), constant(0.6)),),
    no_shapes,
    "L_d falls as i_d rises, in proportion to speed on the q axis and to the change of i_d on the d axis",
    ("symmetric_d_axis_saturation", "magnet_flux_drift", "cross_saturation"),
    bends=True,
    discrepancy=3e-5,
)
