"""Saturation and cross-saturation: currents that grow faster than the flux linkages.

The current is the gradient of one energy function of the flux linkages, so the relation is reciprocal
(d(i_d)/d(psi_q) = d(i_q)/d(psi_d)) whatever the sizes:

    i_d = g_d psi_d + a_d psi_d^3 + e_d (psi_d - psi_f)^3 + c psi_d psi_q^2 - i_F
    i_q = g_q psi_q + a_q psi_q^3 + c psi_d^2 psi_q

psi_d holds the magnets' flux too: a positive i_d saturates, a negative one relieves. i_F is what the magnets are
worth in current: i_d is zero at psi_f. Where the magnets saturate nothing, as in reluctance machines that they
assist, e_d in the place of a_d bends psi_d alike for both signs of i_d. After Z. Qu, T. Tuovinen, M. Hinkkanen,
"Inclusion of magnetic saturation in dynamic models of synchronous reluctance motors", ICEM 2012, with their exponents
S = T = 2, U = V = 0.

Shows as inductances that fall with current, and a psi_d that moves with i_q.
"""

from typing import Annotated, NamedTuple

import numpy as np

from emulator.bounds import Bound

_SHARE = Bound(low=0.0, high=0.7)


class Saturation(NamedTuple):
    """Sizes: by how much inductances fall at rated current, as shares of those at no current."""

    L_d_drop: Annotated[float, _SHARE] = 0.0  # (psi_d - psi_f) / i_d at i_d = i_rated
    L_q_drop: Annotated[float, _SHARE] = 0.0  # psi_q / i_q at i_q = i_rated
    cross_drop: Annotated[float, _SHARE] = 0.0  # L_q at i_d = i_rated, no i_q
    symmetric_drop: Annotated[float, _SHARE] = 0.0  # as L_d_drop, at i_d = -i_rated too


class Curve(NamedTuple):
    """What bends the lines from flux linkage to current."""

    a_d: float  # A/Vs3
    a_q: float  # A/Vs3
    c: float  # A/Vs3
    e_d: float  # A/Vs3


def saturation_curve(sizes: Saturation, L_d: float, L_q: float, psi_f: float, i_rated: float) -> Curve:
    """The curve whose inductances at no current are L_d and L_q (H), at a magnet flux psi_f (Vs).

    Raises ValueError naming the size that the machine cannot have: the energy would have no minimum.
    """
    delta_d = (1.0 - sizes.L_d_drop) * L_d * i_rated  # Vs, what i_rated adds on each axis
    delta_q = (1.0 - sizes.L_q_drop) * L_q * i_rated
    a_d = sizes.L_d_drop * i_rated / (3.0 * psi_f * delta_d**2 + delta_d**3)
    a_q = sizes.L_q_drop * i_rated / delta_q**3
    c = sizes.cross_drop / (1.0 - sizes.cross_drop) / L_q / (2.0 * psi_f * delta_d + delta_d**2)
    delta_e = (1.0 - sizes.symmetric_drop) * L_d * i_rated
    e_d = sizes.symmetric_drop * i_rated / delta_e**3
    curve = Curve(a_d, a_q, c, e_d)
    if 3.0 * a_d * psi_f**2 * L_d >= 1.0:
        raise ValueError(
            f"L_d_drop takes less for this motor, whose magnets alone would saturate it, got {sizes.L_d_drop:g}"
        )
    if c * psi_f**2 * L_q >= 1.0:
        raise ValueError(
            f"cross_drop takes less for this motor, whose magnets alone would saturate it, got {sizes.cross_drop:g}"
        )
    reach = np.linspace(-2.0, 2.0, 41)
    psi_d, psi_q = np.meshgrid(psi_f + reach * L_d * i_rated, reach * L_q * i_rated)
    g_d, g_q = slopes(curve, L_d, L_q, psi_f)
    dd = g_d + 3.0 * a_d * psi_d**2 + 3.0 * e_d * (psi_d - psi_f) ** 2 + c * psi_q**2
    qq = g_q + 3.0 * a_q * psi_q**2 + c * psi_d**2
    dq = 2.0 * c * psi_d * psi_q
    if not bool(np.all((dd > 0.0) & (dd * qq > dq**2))):
        raise ValueError(
            f"cross_drop takes less beside L_d_drop = {sizes.L_d_drop:g} and L_q_drop = {sizes.L_q_drop:g}: "
            f"current would not follow from flux any more, got {sizes.cross_drop:g}"
        )
    return curve


def slopes(curve: Curve, L_d: float, L_q: float, psi_f: float) -> tuple[float, float]:
    """g_d and g_q (1/H), so that the inductances at psi_f (Vs) and no current are L_d and L_q (H)."""
    return 1.0 / L_d - 3.0 * curve.a_d * psi_f**2, 1.0 / L_q - curve.c * psi_f**2
