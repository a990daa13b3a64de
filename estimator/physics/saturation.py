"""The saturation curve that the three effects of saturation share: current from flux linkage, by one energy.

    i_d = g_d psi_d + a_d psi_d^3 + c psi_d psi_q^2 - i_F        i_q = g_q psi_q + a_q psi_q^3 + c psi_d^2 psi_q

psi_d holds the magnets' flux; i_d is zero at psi_m, that of the magnets, where i_F = g_d psi_m + a_d psi_m^3. It is
psi_f at the start: a drift or a step of it moves where on the curve the machine works, so that inductances rise as
magnets lose flux. A harmonic of the inductances adds inverse_6 / L_q cos 6 theta_e (psi - psi_m) to the current: what
bends and what turns with the rotor share one flux linkage. Z. Qu, T. Tuovinen, M. Hinkkanen, "Inclusion of magnetic
saturation in dynamic models of synchronous reluctance motors", ICEM 2012, exponents S = T = 2, U = V = 0. L_d and L_q
are those at no current and psi_f; a drop is the share by which an inductance is lower at rated current.
"""

from collections.abc import Collection, Mapping
from typing import Final, NamedTuple

import numpy as np

from estimator.kernel import kernel
from estimator.machine import Machine
from estimator.physics.effect import Sizes
from estimator.physics.magnet_flux import change_of
from estimator.physics.rows import Real, Rows, Stiffness, Vector

EFFECTS: Final = ("d_axis_saturation", "q_axis_saturation", "cross_saturation")
"""The three, in the order of `curve_of`."""
HARMONIC: Final = "inductance_harmonics"


class Curve(NamedTuple):
    """The curve's coefficients."""

    g_d: float  # 1/H
    g_q: float
    a_d: float  # A/Vs^3
    a_q: float
    c: float


def curve_of(machine: Machine, i_rated: float, drops: tuple[float, float, float]) -> Curve:
    """For drops of L_d along i_d, of L_q along i_q, and of L_q along i_d."""
    L_d_drop, L_q_drop, cross_drop = drops
    L_d, L_q, psi_f = machine.L_d, machine.L_q, machine.psi_f
    added_d, added_q = (1.0 - L_d_drop) * L_d * i_rated, (1.0 - L_q_drop) * L_q * i_rated
    a_d = L_d_drop * i_rated / (3.0 * psi_f * added_d**2 + added_d**3)
    a_q = L_q_drop * i_rated / added_q**3
    c = cross_drop / (1.0 - cross_drop) / L_q / (2.0 * psi_f * added_d + added_d**2)
    return Curve(*map(float, (1.0 / L_d - 3.0 * a_d * psi_f**2, 1.0 / L_q - c * psi_f**2, a_d, a_q, c)))


def flux_of(
    curve: Curve, machine: Machine, i: Vector, harmonic: Real | float = 0.0, change: Real | float = 0.0
) -> Vector:
    """Flux linkage (Vs) at currents (A); `harmonic`: of the inverse inductances, 1/H; `change`: of psi_f, Vs."""
    psi_m, harmonic = (np.broadcast_to(np.float64(x), i.shape) for x in (machine.psi_f + change, harmonic))
    start = psi_m + machine.L_d * i.real + 1j * machine.L_q * i.imag
    return _on_curve(i, start, curve, psi_m, harmonic)


@kernel
def _on_curve(i: Vector, start: Vector, curve: Curve, psi_m: Real, harmonic: Real) -> Vector:
    """Flux linkages at currents by Newton's method."""
    a_d, a_q, c = curve.a_d, curve.a_q, curve.c
    psi = np.empty(len(i), np.complex128)
    for k in range(len(i)):
        g_d, g_q, magnets = curve.g_d + harmonic[k], curve.g_q + harmonic[k], psi_m[k]
        i_F = (g_d + a_d * magnets * magnets) * magnets
        d, q = start[k].real, start[k].imag
        for _ in range(12):
            miss_d = (g_d + a_d * d * d + c * q * q) * d - i_F - i[k].real
            miss_q = (g_q + a_q * q * q + c * d * d) * q - i[k].imag
            dd, qq, dq = g_d + 3.0 * a_d * d * d + c * q * q, g_q + 3.0 * a_q * q * q + c * d * d, 2.0 * c * d * q
            det = dd * qq - dq * dq
            step_d, step_q = (qq * miss_d - dq * miss_q) / det, (dd * miss_q - dq * miss_d) / det
            # Far out, where the curve bends, a whole step would overshoot
            reach = 0.5 * (abs(d) + abs(q) + magnets)
            d, q = d - min(max(step_d, -reach), reach), q - min(max(step_q, -reach), reach)
            if max(abs(step_d), abs(step_q)) < 1e-12 * magnets:
                break
        psi[k] = complex(d, q)
    return psi


def stiffness(curve: Curve, psi: Vector, harmonic: Real | float = 0.0) -> Stiffness:
    """At flux linkages (Vs)."""
    dd, qq, dq = _bend(curve, psi)
    return Stiffness(0.5 * (dd + qq) + harmonic, 0.5 * (dd - qq) + 1j * dq)


def _bend(curve: Curve, psi: Vector) -> tuple[Real, Real, Real]:
    """d(i_d)/d(psi_d), d(i_q)/d(psi_q) and d(i_d)/d(psi_q), 1/H."""
    d, q = psi.real, psi.imag
    dd = curve.g_d + 3.0 * curve.a_d * d * d + curve.c * q * q
    qq = curve.g_q + 3.0 * curve.a_q * q * q + curve.c * d * d
    return dd, qq, 2.0 * curve.c * d * q


def mean_of_ripple(curve: Curve, rows: Rows, psi: Vector) -> Vector:
    """Mean current (A) of each period that a ripple of the flux linkage makes on a bent curve."""
    a_d, a_q, c = curve.a_d, curve.a_q, curve.c
    middle: Vector = 0.5 * (rows.half * psi[1:] + rows.half.conj() * psi[:-1])
    d, q = middle.real, middle.imag
    size, square = rows.power_of_pulses
    d_d, q_q, d_q = 0.5 * (size + square.real), 0.5 * (size - square.real), 0.5 * square.imag
    on_d = 3.0 * a_d * d * d_d + 2.0 * c * q * d_q + c * d * q_q
    return on_d + 1j * (c * q * d_d + 2.0 * c * d * d_q + 3.0 * a_q * q * q_q)


def saturated(rows: Rows, effects: Mapping[str, Sizes]) -> tuple[Vector, Stiffness]:
    """Flux linkages (Vs) at samples and their stiffness, with one or several of the three, or a harmonic or a change of
    the magnets' flux beside.
    """
    curve, harmonic = _curve(rows, effects), 0.0
    if HARMONIC in effects:
        harmonic = effects[HARMONIC][0] / rows.machine.L_q * rows.six.real
    psi = flux_of(curve, rows.machine, rows.i, harmonic, change_of(rows, effects))
    return psi, stiffness(curve, psi, harmonic)


def curvature(rows: Rows, effects: Mapping[str, Sizes]) -> tuple[float, float, float]:
    """a_d, a_q and c of their curve, A/Vs^3."""
    curve = _curve(rows, effects)
    return curve.a_d, curve.a_q, curve.c


def _curve(rows: Rows, effects: Mapping[str, Sizes]) -> Curve:
    d, q, cross = (effects[name][0] if name in effects else 0.0 for name in EFFECTS)
    return curve_of(rows.machine, rows.i_rated, (d, q, cross))


def together(rows: Rows, effects: Mapping[str, Sizes]) -> Vector:
    """What saturations, a harmonic of the inductances and changes of the magnets' flux add to the voltage of constant
    inductances, V: not the sum of what each adds.
    """
    if not bends(effects):
        change = change_of(rows, effects)
        if not isinstance(change, np.ndarray) or not change.any():
            return np.zeros(len(rows), np.complex128)
        return rows.balance(change)
    psi, g = saturated(rows, effects)
    more = rows.mean_current(psi, g) - rows.i_mean
    if rows.u_dc is not None:
        more = more + mean_of_ripple(_curve(rows, effects), rows, psi)
    return rows.balance(psi - rows.flux(rows.i)) + rows.machine.R_s * more


def bends(effects: Collection[str]) -> bool:
    """There is one of the three, or a harmonic of the inductances: flux linkages are no straight lines."""
    return any(name in effects for name in (*EFFECTS, HARMONIC))
