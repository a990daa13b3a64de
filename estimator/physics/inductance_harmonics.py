"""Harmonics of the inductances: slots let them change with the rotor's angle.

    1/L(theta_e) = 1/L + inverse_6 / L_q cos 6 theta_e    on both axes

so that the flux linkage of a current is L i / (1 + inverse_6 L/L_q cos 6 theta_e); with saturation beside it, see
`saturation`. D. Hanselman, "Brushless Permanent Magnet Motor Design", 2nd ed., 2003, chapter 10.
"""

from estimator.arrays import Vector
from estimator.physics.effect import Parameter, Sizes, constant, no_shapes
from estimator.physics.rows import Rows
from estimator.physics.saturation import HARMONIC, FluxChange


def emf(rows: Rows, sizes: Sizes) -> Vector:
    """What a current that stays takes at samples, as inductances turn, V."""
    psi, g = rows.own_flux
    per_angle = -6.0 * sizes[0] / rows.machine.L_q * rows.six.imag
    return -rows.speed * g.flux(per_angle * (psi - rows.machine.psi_f * rows.psi_f_ratio))


EFFECT = FluxChange(
    HARMONIC, "harmonics of the inductances",
    (Parameter("inverse_6", "1", constant(0.05), constant(-0.3), constant(0.3)),),
    no_shapes,
    "ripple at 6 times the electrical frequency in proportion to current, with speed and with how fast current changes",
    ("flux_harmonics",),
    emf=emf,
    discrepancy=1e-4,
)
