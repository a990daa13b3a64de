"""Saturation along the d axis, alike for both signs of i_d: psi_d bends around the magnets' flux, not around none.

As in reluctance machines that magnets assist, whose ribs and bridges the magnets have saturated already. The curve and
its source are told in `saturation`. L_d_drop is the share by which the inductance is lower at rated current, of either
sign, than at no current. T. Tuovinen, M. Hinkkanen, "Adaptive full-order observer with high-frequency signal injection
for synchronous reluctance motor drives", IEEE J. Emerg. Sel. Topics Power Electron. 2, 2014.
"""

from estimator.physics.effect import Parameter, constant, no_shapes
from estimator.physics.saturation import SYMMETRIC, FluxChange

EFFECT = FluxChange(
    SYMMETRIC, "saturation along the d axis, alike for both signs of i_d",
    (Parameter("L_d_drop", "1", constant(0.15), constant(0.0), constant(0.6)),),
    no_shapes,
    "L_d falls as i_d grows, whatever its sign",
    ("d_axis_saturation", "cross_saturation"),
    bends=True,
    other_form_of="d_axis_saturation",
    discrepancy=3e-3,  # a cubic of the current that is as large at the rated one
)
