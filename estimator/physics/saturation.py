"""The saturation curve that the effects of saturation share: current from flux linkage, by one energy.

    i_d = g_d psi_d + a_d psi_d^3 + e_d (psi_d - psi_m)^3 + c psi_d psi_q^2 - i_F
    i_q = g_q psi_q + a_q psi_q^3 + c psi_d^2 psi_q

psi_d holds the magnets' flux; i_d is zero at psi_m, that of the magnets, where i_F = g_d psi_m + a_d psi_m^3. It is
psi_f at the start: a drift or a step of it moves where on the curve the machine works, so that inductances rise as
magnets lose flux. A harmonic of the inductances adds inverse_6 / L_q cos 6 theta_e (psi - psi_m) to the current: what
bends and what turns with the rotor share one flux linkage. Z. Qu, T. Tuovinen, M. Hinkkanen, "Inclusion of magnetic
saturation in dynamic models of synchronous reluctance motors", ICEM 2012, exponents S = T = 2, U = V = 0. L_d and L_q
are those at no current and psi_f; a drop is the share by which an inductance is lower at rated current.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from estimator.arrays import Array, Vector
from estimator.kernel import kernel
from estimator.machine import Machine
from estimator.physics.effect import Effect, Sizes
from estimator.physics.magnet_flux import change_of
from estimator.physics.pulses import mean_of_pulses
from estimator.physics.rows import Rows, mean_between, slope_of
from estimator.physics.vectors import Stiffness

_FLUX_STEPS: Final = 12  # of Newton's method at most
_STEP_SQUARED: Final = 1e-7  # of the magnets' flux: such a step is followed by one of its square

EFFECTS: Final = ("d_axis_saturation", "q_axis_saturation", "cross_saturation")
"""The three, in the order of `curve_of`."""
SYMMETRIC: Final = "symmetric_d_axis_saturation"
"""In the place of the first: psi_d bends around that of the magnets."""
SATURATIONS: Final = (*EFFECTS, SYMMETRIC)
HARMONIC: Final = "inductance_harmonics"


class Curve(NamedTuple):
    """The curve's coefficients."""

    g_d: float  # 1/H
    g_q: float
    a_d: float  # A/Vs^3
    a_q: float
    c: float
    e_d: float


def curve_of(machine: Machine, i_rated: float, drops: tuple[float, float, float], symmetric: float = 0.0) -> Curve:
    """For drops of L_d along i_d, of L_q along i_q, of L_q along i_d, and of L_d along i_d alike for both signs."""
    L_d_drop, L_q_drop, cross_drop = drops
    L_d, L_q, psi_f = machine.L_d, machine.L_q, machine.psi_f
    added_d, added_q = (1.0 - L_d_drop) * L_d * i_rated, (1.0 - L_q_drop) * L_q * i_rated
    a_d = L_d_drop * i_rated / (3.0 * psi_f * added_d**2 + added_d**3)
    a_q = L_q_drop * i_rated / added_q**3
    c = cross_drop / (1.0 - cross_drop) / L_q / (2.0 * psi_f * added_d + added_d**2)
    e_d = symmetric * i_rated / ((1.0 - symmetric) * L_d * i_rated) ** 3
    return Curve(*map(float, (1.0 / L_d - 3.0 * a_d * psi_f**2, 1.0 / L_q - c * psi_f**2, a_d, a_q, c, e_d)))


def flux_of(curve: Curve, machine: Machine, i: Vector) -> Vector:
    """Flux linkage (Vs) at currents (A)."""
    return _on_curve(
        i, curve, float(machine.L_d), float(machine.L_q), np.full(i.shape, machine.psi_f), np.zeros(i.shape)
    )


@kernel
def _on_curve(i: Vector, curve: Curve, L_d: float, L_q: float, psi_m: Array, harmonic: Array) -> Vector:
    psi = np.empty(len(i), np.complex128)
    for k in range(len(i)):
        psi[k] = _flux_at(i[k], curve, L_d, L_q, psi_m[k], harmonic[k])
    return psi


@kernel
def _flux_at(i: complex, curve: Curve, L_d: float, L_q: float, psi_m: float, harmonic: float) -> complex:
    """Flux linkage (Vs) at a current (A), by Newton's method."""
    a_d, a_q, c, e_d = curve.a_d, curve.a_q, curve.c, curve.e_d
    g_d, g_q = curve.g_d + harmonic, curve.g_q + harmonic
    i_F = (g_d + a_d * psi_m * psi_m) * psi_m
    d, q = psi_m + L_d * i.real, L_q * i.imag
    for _ in range(_FLUX_STEPS):
        added = d - psi_m
        miss_d = (g_d + a_d * d * d + c * q * q) * d - i_F - i.real + e_d * added * added * added
        miss_q = (g_q + a_q * q * q + c * d * d) * q - i.imag
        dd = g_d + 3.0 * a_d * d * d + c * q * q + 3.0 * e_d * added * added
        qq, dq = g_q + 3.0 * a_q * q * q + c * d * d, 2.0 * c * d * q
        over = 1.0 / (dd * qq - dq * dq)
        step_d, step_q = (qq * miss_d - dq * miss_q) * over, (dd * miss_q - dq * miss_d) * over
        # Far out, where the curve bends, a whole step would overshoot
        reach = 0.5 * (abs(d) + abs(q) + psi_m)
        d, q = d - min(max(step_d, -reach), reach), q - min(max(step_q, -reach), reach)
        if max(abs(step_d), abs(step_q)) < _STEP_SQUARED * psi_m:
            break
    return complex(d, q)


def saturated(rows: Rows, effects: Mapping[str, Sizes]) -> tuple[Vector, Stiffness]:
    """Flux linkages (Vs) at samples and their stiffness, with one or several of the three, or a harmonic or a change of
    the magnets' flux beside.
    """
    curve, (psi_m, harmonic) = _curve(rows, effects), _flux_beside(rows, effects)
    psi = _on_curve(rows.i, curve, float(rows.machine.L_d), float(rows.machine.L_q), psi_m, harmonic)
    a, b = np.empty(len(psi)), np.empty(len(psi), np.complex128)
    _add_stiffness(a, b, curve, psi, psi_m, harmonic)
    return psi, Stiffness(a, b)


@kernel
def _add_stiffness(a: Array, b: Vector, curve: Curve, psi: Vector, psi_m: Array, harmonic: Array) -> None:
    for k in range(len(psi)):
        a[k], b[k] = _stiffness_at(curve, psi[k], psi_m[k], harmonic[k])


@kernel
def _stiffness_at(curve: Curve, psi: complex, psi_m: float, harmonic: float) -> tuple[float, complex]:
    """d(i)/d(psi) at a flux linkage (Vs), of which magnets make psi_m, 1/H: see `Stiffness`."""
    d, q = psi.real, psi.imag
    dd = curve.g_d + 3.0 * curve.a_d * d * d + curve.c * q * q + 3.0 * curve.e_d * (d - psi_m) ** 2
    qq = curve.g_q + 3.0 * curve.a_q * q * q + curve.c * d * d
    return 0.5 * (dd + qq) + harmonic, complex(0.5 * (dd - qq), 2.0 * curve.c * d * q)


@kernel
def _mean_of_ripple(curve: Curve, psi: complex, psi_m: float, size: float, square: complex) -> complex:
    """Mean current (A) that a ripple of the flux linkage around psi (Vs) makes on a bent curve; of the ripple (Vs^2)
    see `Rows.power_of_pulses`.
    """
    a_d, a_q, c, d, q = curve.a_d, curve.a_q, curve.c, psi.real, psi.imag
    d_d, q_q, d_q = 0.5 * (size + square.real), 0.5 * (size - square.real), 0.5 * square.imag
    return complex(
        3.0 * (a_d * d + curve.e_d * (d - psi_m)) * d_d + 2.0 * c * q * d_q + c * d * q_q,
        c * q * d_d + 2.0 * c * d * d_q + 3.0 * a_q * q * q_q
    )


def curvature(rows: Rows, effects: Mapping[str, Sizes]) -> tuple[float, float, float, float]:
    """a_d, a_q, c and e_d of their curve, A/Vs^3."""
    curve = _curve(rows, effects)
    return curve.a_d, curve.a_q, curve.c, curve.e_d


def _curve(rows: Rows, effects: Mapping[str, Sizes]) -> Curve:
    d, q, cross, symmetric = (effects[name][0] if name in effects else 0.0 for name in SATURATIONS)
    return curve_of(rows.machine, rows.i_rated, (d, q, cross), symmetric)


def _flux_beside(rows: Rows, effects: Mapping[str, Sizes]) -> tuple[Array, Array]:
    """At samples: the magnets' flux, Vs, and a harmonic of the inverse inductances, 1/H."""
    harmonic = effects[HARMONIC][0] / rows.machine.L_q * rows.six.real if HARMONIC in effects else 0.0
    return np.full(len(rows.i), rows.machine.psi_f + change_of(rows, effects)), np.full(len(rows.i), harmonic)


def voltage_together(rows: Rows, effects: Mapping[str, Sizes]) -> Vector:
    """What saturations, a harmonic of the inductances and changes of the magnets' flux add to the voltage of constant
    inductances, V: not the sum of what each adds.
    """
    if not bends(effects):
        change = change_of(rows, effects)
        if not isinstance(change, np.ndarray) or not change.any():
            return np.zeros(len(rows), np.complex128)
        return rows.balance(change)
    m, none = rows.machine, np.zeros(0, np.complex128)
    pulses = (none, np.zeros(0), none) if rows.u_dc is None else (rows.moment_of_pulses, *rows.power_of_pulses)
    return _added(
        rows.i, rows.half, rows.u, rows.speed, rows.D, rows.i_mean, *pulses, float(rows.T_s), float(m.R_s),
        float(m.L_d), float(m.L_q), float(m.psi_f), _curve(rows, effects), *_flux_beside(rows, effects),
    )  # fmt: skip


@kernel
def _added(
    i: Vector, half: Vector, u: Vector, speed: Array, D: Array, i_mean: Vector, moment: Vector, size: Array,
    square: Vector, T_s: float, R_s: float, L_d: float, L_q: float, psi_f: float, curve: Curve, psi_m: Array,
    harmonic: Array,
) -> Vector:  # fmt: skip
    """Voltage (V) of each period that the curve adds to that of constant inductances, whose mean current is i_mean."""
    added = np.empty(len(half), np.complex128)
    psi_1 = _flux_at(i[0], curve, L_d, L_q, psi_m[0], harmonic[0])
    a_1, b_1 = _stiffness_at(curve, psi_1, psi_m[0], harmonic[0])
    more_1 = psi_1 - complex(psi_f + L_d * i[0].real, L_q * i[0].imag)
    for k in range(len(half)):
        psi_0, a_0, b_0, more_0 = psi_1, a_1, b_1, more_1
        i_1, after, before = i[k + 1], half[k], half[k].conjugate()
        psi_1 = _flux_at(i_1, curve, L_d, L_q, psi_m[k + 1], harmonic[k + 1])
        a_1, b_1 = _stiffness_at(curve, psi_1, psi_m[k + 1], harmonic[k + 1])
        more_1 = psi_1 - complex(psi_f + L_d * i_1.real, L_q * i_1.imag)
        s_0 = slope_of(i[k], u[k] * after, speed[k], R_s, psi_0, a_0, b_0)
        s_1 = slope_of(i_1, u[k] * before, speed[k + 1], R_s, psi_1, a_1, b_1)
        mean = mean_between(i[k], i_1, s_0, s_1, after, T_s)
        if len(moment) > 0:
            mean += mean_of_pulses(moment[k], D[k] / T_s, R_s, a_0, b_0)
            mean += _mean_of_ripple(
                curve, 0.5 * (after * psi_1 + before * psi_0), psi_m[k + 1], size[k], square[k]
            )
        added[k] = (after * more_1 - before * more_0) * (1.0 / T_s) + R_s * (mean - i_mean[k])
    return added


def bends(effects: Collection[str]) -> bool:
    """There is a saturation, or a harmonic of the inductances: flux linkages are no straight lines."""
    return any(name in effects for name in (*SATURATIONS, HARMONIC))


@dataclass(frozen=True, slots=True, kw_only=True)
class FluxChange(Effect):
    """Changes the machine's flux linkage: voltages of several do not add up, see `voltage_together`."""

    def voltage(self, rows: Rows, sizes: Sizes) -> Vector:
        """V of each period, alone."""
        return voltage_together(rows, {self.name: sizes})
