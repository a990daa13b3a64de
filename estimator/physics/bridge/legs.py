"""The legs of a bridge in each control period: when they rise and fall, and what their pulses make of the currents."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array, Vector
from estimator.kernel import kernel, lean_kernel
from estimator.physics.bridge.period_course import A, B, C, Room, empty_room, rise_of
from estimator.physics.derived import Derived
from estimator.physics.rows import Rows
from estimator.physics.vectors import AXES


class Legs(NamedTuple):
    """What the legs do in each period, whatever the currents."""

    u_dc: Array  # V; of no length where it is not known: then each end's current counts for half a period
    duties: Array  # (n, 3)
    before: Array  # (n, 3): the duties of the period before
    order: NDArray[np.int8]  # (n, 3): the legs as they rise
    ripple: Vector  # (n, 3): A, stationary, when each leg rises
    middle: Vector  # exp(j theta_e) in the middle
    T_s: float  # s
    R_s: float  # ohm
    a: Array  # 1/H, stiffness of the straight lines that go on from here: see `rows.Stiffness`
    b: Vector  # 1/H, rotor frame
    psi_0: Vector  # Vs, at no current of these lines
    others: Vector  # V, stationary, what other effects add
    change: Vector  # V, by which that changes in a period
    D: Array  # rad, electrical, by which the rotor turns in each period
    room: Room


def legs_of(rows: Rows) -> Legs:
    """The legs of a recording's periods."""
    u_dc, middle, T_s = rows.u_dc, rows.middle, rows.T_s
    R_s, (g, psi_0) = float(rows.machine.R_s), rows.local_line
    a, b = g.a + rows.fast_stiffness, g.b
    R_s += rows.fast_resistance
    others, change = rows.once(_others), rows.once(_change_of_others)
    if u_dc is None:
        no_legs = np.zeros((0, 3))
        return Legs(
            np.zeros(0), no_legs, no_legs, no_legs.astype(np.int8), no_legs.astype(np.complex128), middle, T_s,
            R_s, a, b, psi_0, others, change, rows.D, empty_room(),
        )  # fmt: skip
    before, order, ripple = rows.once(DUTIES_BEFORE), rows.once(_ORDER), rows.once(_RIPPLE)
    return Legs(
        u_dc, rows.duties, before, order, ripple, middle, T_s, R_s, a, b, psi_0, others, change, rows.D, empty_room()
    )


def _others(rows: Rows) -> Vector:
    """What else changes the current within a period, V, stationary frame."""
    others = np.zeros(len(rows), np.complex128) if rows.others is None else rows.others * rows.middle
    return others - rows.fast_resistance * rows.i_mean * rows.middle if rows.fast_resistance > 0.0 else others


def _change_of_others(rows: Rows) -> Vector:
    """By how much what others add (V, stationary) changes in each period, by those next to it."""
    others, joined = rows.once(_others), rows.joined
    change = np.zeros_like(others)
    inner = joined[:-2] & joined[1:-1] & joined[2:]
    change[1:-1] = np.where(inner, 0.5 * (others[2:] - others[:-2]), 0.0)
    return change


def legs_at_rest(u_dc: Array, duties: Array, T_s: float, L: float) -> Legs:
    """The legs before a motor that stands, taken as leaving no rail at a period's start."""
    u_s = np.ascontiguousarray(2.0 / 3.0 * u_dc * (duties @ np.array(AXES)), np.complex128)
    middle = np.ones(len(duties), np.complex128)
    a, none, no_flux = np.full(len(duties), 1.0 / L), np.zeros(len(duties)), np.zeros(len(duties), np.complex128)
    ripple = _ripples(u_dc, duties, u_s, middle, T_s, a, no_flux)
    return Legs(
        u_dc, duties, duties, _leg_orders(duties), ripple, middle, T_s, 0.0, a, no_flux, no_flux, no_flux, no_flux,
        none, empty_room(),
    )  # fmt: skip


def _before(rows: Rows) -> Array:
    """The duties of the period before, (n, 3); of the same one where there was none."""
    duties, joined = rows.duties, rows.joined
    before = np.concatenate((duties[:1], duties[:-1]))
    return np.where(np.concatenate((joined[:1], joined[:-1]))[:, None], before, duties)


def _order(rows: Rows) -> NDArray[np.int8]:
    return _leg_orders(rows.duties)


def _ripple(rows: Rows) -> Vector:
    """A, stationary, when each leg rises, (n, 3)."""
    assert rows.u_dc is not None
    g, _ = rows.local_line
    a = g.a + rows.fast_stiffness
    return _ripples(rows.u_dc, rows.duties, rows.u * rows.middle, rows.middle, rows.T_s, a, g.b)


_PULSES = ("u", "u_dc", "theta_e", "half")
DUTIES_BEFORE: Final = Derived(_before, frozenset((*_PULSES, "joined")), 0)
"""The duties of the period before, (n, 3); of the same one where there was none."""
_ORDER: Final = Derived(_order, frozenset(_PULSES), 0)
_RIPPLE: Final = Derived(_ripple, frozenset((*_PULSES, "T_s", "parameters", "local", "fast_stiffness")), None)


@lean_kernel
def moved_in(legs: Legs, k: int, dead_time: float) -> float:
    """What the link's voltage makes of a current in a dead time, A."""
    return legs.u_dc[k] * (legs.a[k] + abs(legs.b[k])) * dead_time


@lean_kernel
def damping_of(legs: Legs, k: int) -> float:
    """R_s T_s / L."""
    return legs.R_s * legs.T_s * legs.a[k]


@lean_kernel
def bow_of(legs: Legs, k: int) -> complex:
    """What the current (A, stationary) is beside a straight line in the middle of a period: the magnets turn, and what
    others add changes.
    """
    bent = 0.125 * (legs.T_s * legs.change[k] * legs.middle[k].conjugate() - legs.D[k] * legs.D[k] * legs.psi_0[k])
    return _driven_slope(bent, legs.a[k], legs.b[k]) * legs.middle[k]


@lean_kernel
def _driven_slope(u: complex, a: float, b: complex) -> complex:
    """di/dt (A/s) that a voltage (V) drives, both in the rotor frame."""
    return a * u + b * u.conjugate()


@kernel
def _leg_orders(duties: Array) -> NDArray[np.int8]:
    """Legs in the order in which they rise."""
    order = np.empty(duties.shape, np.int8)
    for k in range(len(duties)):
        a, b, c = 0, 1, 2
        if duties[k, a] < duties[k, b]:
            a, b = b, a
        if duties[k, b] < duties[k, c]:
            b, c = c, b
        if duties[k, a] < duties[k, b]:
            a, b = b, a
        order[k, 0], order[k, 1], order[k, 2] = a, b, c
    return order


@kernel
def _ripples(u_dc: Array, duties: Array, u_s: Vector, middle: Vector, T_s: float, a: Array, b: Vector) -> Vector:
    """The current's ripple (A, stationary) when each leg rises: the integral of the voltage less its mean."""
    ripple = np.empty(duties.shape, np.complex128)
    for k in range(len(duties)):
        on_a, on_b, on_c = rise_of(duties[k, 0]), rise_of(duties[k, 1]), rise_of(duties[k, 2])
        for leg in range(3):
            when = rise_of(duties[k, leg])
            area = -u_s[k] * when
            area += 2.0 / 3.0 * u_dc[k] * (
                A * max(0.0, when - on_a) + B * max(0.0, when - on_b) + C * max(0.0, when - on_c)
            )
            ripple[k, leg] = _driven_slope(area * T_s * middle[k].conjugate(), a[k], b[k]) * middle[k]
    return ripple

