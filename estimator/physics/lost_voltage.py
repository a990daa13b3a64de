"""Voltage that a bridge's legs lose in one control period, from the currents at its ends.

The equations of `inverter_voltage_error`, period by period, so that a simulation can ask for one. Where a current is
near zero at an edge, the period is followed from edge to edge, with what other effects add to the voltage in it: a
branch beside the machine lets currents change faster, a ladder's rung drops more of their change.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.kernel import kernel, lean_kernel
from estimator.physics.period_course import (
    A,
    B,
    C,
    Period,
    Room,
    axis_of,
    course_between,
    cut,
    empty_room,
    phase,
    rise_of,
    still_dead,
    weight,
)  # fmt: skip
from estimator.physics.rows import AXES, OTHERS, Real, Rows, Vector

_MOVES = 1.5  # times what u_dc / L makes of a current in a dead time: no current moves more meanwhile
_NARROW = 0.03  # times the same: a spread of currents that does not matter
_CLOSE = 0.003  # times the same: where the last shot may end
SHOTS: Final = 12  # at a period's end, where it lies in a bend
_COURSES = 4  # times that a current's course through zero is followed by what drops make of it
_STRAIGHT = 5e-3  # of a zero crossing's width, by which drops may bend it unseen
_OF_ARC = 1.0 / 12.0  # of what a slope's change along a piece adds up to: the arc's mean above its chord
_SAME = 1e-3  # of a drop, by which another course may change its mean unseen
_BACK = 0.2  # of a width, that what bends a current by a width takes back in the next course
_NEARER = 1.0 - 1e-6  # as near: of two legs alike, the first


class Legs(NamedTuple):
    """What the legs do in each period, whatever the currents."""

    u_dc: Real  # V; of no length where it is not known: then each end's current counts for half a period
    duties: Real  # (n, 3)
    before: Real  # (n, 3): the duties of the period before
    order: NDArray[np.int8]  # (n, 3): the legs as they rise
    ripple: Vector  # (n, 3): A, stationary, when each leg rises
    middle: Vector  # exp(j theta_e) in the middle
    T_s: float  # s
    R_s: float  # ohm
    a: Real  # 1/H, stiffness of the straight lines that go on from here: see `rows.Stiffness`
    b: Vector  # 1/H, rotor frame
    psi_0: Vector  # Vs, at no current of these lines
    others: Vector  # V, stationary, what other effects add
    D: Real  # rad, electrical, by which the rotor turns in each period
    room: Room


def legs_of(rows: Rows) -> Legs:
    """The legs of a recording's periods."""
    u_dc, middle, T_s = rows.u_dc, rows.middle, rows.T_s
    R_s, (g, psi_0), u_s = float(rows.machine.R_s), rows.local_line, rows.u * middle
    a, b = g.a + rows.fast_stiffness, g.b
    others = rows.kept[OTHERS] * middle if OTHERS in rows.kept else np.zeros(len(rows), np.complex128)
    if rows.fast_resistance > 0.0:
        R_s += rows.fast_resistance
        others = others - rows.fast_resistance * rows.i_mean * middle
    if u_dc is None:
        none = np.zeros((0, 3))
        return Legs(
            np.zeros(0), none, none, none.astype(np.int8), none.astype(np.complex128), middle, T_s,
            R_s, a, b, psi_0, others, rows.D, empty_room(),
        )  # fmt: skip
    before, order = duties_before(rows), rows.once("order", lambda: _orders(rows.duties))
    ripple = rows.once("ripple", lambda: _ripples(u_dc, rows.duties, u_s, middle, T_s, a, b))
    return Legs(
        u_dc, rows.duties, before, order, ripple, middle, T_s, R_s, a, b, psi_0, others, rows.D, empty_room()
    )


def legs_at_rest(u_dc: Real, duties: Real, T_s: float, L: float) -> Legs:
    """The legs before a motor that stands, taken as leaving no rail at a period's start."""
    u_s = np.ascontiguousarray(2.0 / 3.0 * u_dc * (duties @ np.array(AXES)), np.complex128)
    middle = np.ones(len(duties), np.complex128)
    a, none, no_flux = np.full(len(duties), 1.0 / L), np.zeros(len(duties)), np.zeros(len(duties), np.complex128)
    ripple = _ripples(u_dc, duties, u_s, middle, T_s, a, no_flux)
    return Legs(
        u_dc, duties, duties, _orders(duties), ripple, middle, T_s, 0.0, a, no_flux, no_flux, no_flux,
        none, empty_room(),
    )  # fmt: skip


def duties_before(rows: Rows) -> Real:
    """The duties of the period before, (n, 3); of the same one where there was none."""
    return rows.once("duties before", lambda: _before(rows.duties, rows.joined))


def _before(duties: Real, joined: NDArray[np.bool_]) -> Real:
    before = np.concatenate((duties[:1], duties[:-1]))
    return np.where(np.concatenate((joined[:1], joined[:-1]))[:, None], before, duties)


def lost_by_dead_time(legs: Legs, i_s: Vector, dead_time: float, spread: float) -> Vector:
    """Voltage (V) that dead times lose in each period, from currents (A) at samples; both in the stationary frame."""
    return lost_by_both(legs, i_s, dead_time, 0.0, spread, 1.0)


def lost_by_both(legs: Legs, i_s: Vector, dead_time: float, u_drop: float, spread: float, knee: float) -> Vector:
    """The same by dead times and drops."""
    lost = np.zeros(len(legs.middle), np.complex128)
    _add_both(lost, legs, i_s[:-1], i_s[1:], dead_time, u_drop, spread, knee)
    return lost


def lost_between(legs: Legs, begin: Vector, end: Vector, dead_time: float, u_drop: float, width: float) -> Vector:
    """Lost voltage (V) of periods that need not join, from currents (A) at their ends; all in the stationary frame."""
    lost = np.zeros(len(begin), np.complex128)
    _add_both(lost, legs, begin, end, dead_time, u_drop, width, width)
    return lost


@lean_kernel
def _add_both(
    lost: Vector, legs: Legs, begin: Vector, end: Vector, dead_time: float, u_drop: float, spread: float, knee: float
) -> None:  # fmt: skip
    edges = len(legs.u_dc) > 0 and dead_time != 0.0
    for k in range(len(lost)):
        lost[k] += _by_drops(legs, k, begin[k], end[k], dead_time, u_drop, knee)[0]
        if edges:
            lost[k] += _by_dead_time(legs, k, begin[k], end[k], dead_time, u_drop, spread)


class Loss(NamedTuple):
    """What a period loses, all in the stationary frame."""

    volts: complex  # V
    by_real: complex  # ohm, its slope by the real part of the current at the end
    by_imag: complex  # ohm
    beside: complex  # A/s, to go on from
    settled: bool  # another shot would change nothing


@lean_kernel
def lost_after(
    legs: Legs, k: int, i_0: complex, i_1: complex, dead_time: float, u_drop: float, knee: float,
    beside: complex, shots: int,
) -> Loss:  # fmt: skip
    """What period k loses for currents (A) that are known, after so many shots more at the end.

    beside: 0 for the first, then that of the last.
    """
    volts, by_real, by_imag = _by_drops(legs, k, i_0, i_1, dead_time, u_drop, knee)
    settled = True
    if dead_time != 0.0 and len(legs.u_dc) > 0:
        far, nearest, changes = _laid_out(legs, k, i_0, i_1, dead_time, u_drop, 0.0)
        if nearest < 0:
            volts += far
        else:
            close, full = _CLOSE * _moves(legs, k, dead_time), 2.0 / 3.0 * legs.u_dc[k]
            last = course_between(_period(legs, k, u_drop), i_0, i_1, beside, shots, close, changes, legs.room)
            volts += full * (_ideal(legs, k) - last.held)
            by_real -= full * last.held_real
            by_imag -= full * last.held_imag
            beside, settled = last.beside, abs(last.step) * legs.T_s < close
    return Loss(volts, by_real, by_imag, beside, settled)


@lean_kernel
def _by_drops(
    legs: Legs, k: int, i_0: complex, i_1: complex, dead_time: float, u_drop: float, knee: float
) -> tuple[complex, complex, complex]:  # fmt: skip
    """Lost voltage (V, stationary) of drops, and of the dead time of legs that come to stay high; its slopes (ohm).

    Slopes by the real and imaginary part of the current at the end.
    """
    lost, by_real, by_imag = 0j, 0j, 0j
    known = len(legs.u_dc) > 0
    if known and u_drop != 0.0:
        _follow_drops(legs, k, i_0, i_1, dead_time, u_drop, knee)
    for leg in range(3):
        axis, volts, by_end = axis_of(leg), 0.0, 0.0
        if not known:
            start, end = phase(i_0, axis), phase(i_1, axis)
            soft_end = _soft(end, knee)
            volts = 0.5 * (start / _soft(start, knee) + end / soft_end)
            by_end = 0.5 * knee * knee / (soft_end * soft_end * soft_end)
        elif u_drop != 0.0:
            volts, by_end = legs.room.loss[leg]
        lost += axis * (u_drop * volts)
        by_real += axis * (u_drop * by_end * axis.real)
        by_imag += axis * (u_drop * by_end * axis.imag)
        if known and legs.duties[k, leg] >= 1.0 > legs.before[k, leg]:  # a leg that stays high rises at the start
            start = phase(i_0, axis)
            lost += axis * (legs.u_dc[k] / legs.T_s * 0.5 * dead_time * (1.0 + start / _soft(start, knee)))
    return 2.0 / 3.0 * lost, 2.0 / 3.0 * by_real, 2.0 / 3.0 * by_imag


@lean_kernel
def _follow_drops(
    legs: Legs, k: int, i_0: complex, i_1: complex, dead_time: float, u_drop: float, knee: float
) -> None:  # fmt: skip
    """Put in the room what drops do in period k, and how it changes with the currents at the end.

    Near zero a drop bends the course of its current: while it is less than its mean, the current gets ahead. And dead
    times shift it after each edge. So the course is followed again by what was found.
    """
    room, bends = legs.room, 2.0 / 3.0 * u_drop * legs.T_s  # Vs
    bow, damping, alike = _bow(legs, k), _damping(legs, k), legs.a[k]
    twice = legs.b[k] * legs.middle[k] * legs.middle[k]  # of the mirror image
    jolt, moves = 2.0 / 3.0 * legs.u_dc[k] * dead_time, _moves(legs, k, dead_time)  # Vs, A
    strength = abs(bends) * (legs.a[k] + abs(legs.b[k])) / knee
    near, varied = 1.0 / (1.0 + _BACK * strength), strength + 2.0 / 3.0 * moves / knee
    for course in range(_COURSES):
        changes = 0.0
        for leg in range(3):
            if course == 0 or varied * room.varies[leg] * room.varies[leg] > _STRAIGHT:
                before = room.mean[leg]
                _mean_signs(legs, k, leg, i_0, i_1, knee, bow, damping, course > 0)
                changes = max(changes, abs(room.mean[leg] - before))
        most = max(room.varies[0], room.varies[1], room.varies[2])
        if varied * most * most < _STRAIGHT or (course > 0 and changes < _SAME) or course == _COURSES - 1:
            break
        if course == 0:
            _none_of(room)
        if jolt > 0.0:
            _shift(legs, k, jolt, moves)
        early, up, down = 0.0, 0j, 0j
        for part in range(4):
            late, more_up, more_down = room.late[part], 0j, 0j
            for leg in range(3):
                axis = (bends * (late - early)) * axis_of(leg)
                up -= axis * (room.sign[leg, part, 0] - room.mean[leg])
                down += axis * (room.sign[leg, part, 1] - room.mean[leg])
                more_up += axis * (_OF_ARC * room.change[leg, part, 0])
                more_down -= axis * (_OF_ARC * room.change[leg, part, 1])
            room.ahead[part, 0] += near * (alike * up + twice * up.conjugate() - room.ahead[part, 0])
            room.ahead[part, 1] += near * (alike * down + twice * down.conjugate() - room.ahead[part, 1])
            room.arc[part, 0] += near * (alike * more_up + twice * more_up.conjugate() - room.arc[part, 0])
            room.arc[part, 1] += near * (alike * more_down + twice * more_down.conjugate() - room.arc[part, 1])
            early = late


@lean_kernel
def _shift(legs: Legs, k: int, jolt: float, moves: float) -> None:
    """Put in the room how far dead times shift the current at edges, and how much farther after them.

    A leg rises late where its current flows out, and falls late where it flows into it: each shifts the flux linkage by
    `jolt` (Vs); and all that is made up for evenly, as the end is known. moves: A, what a dead time makes of a current
    that comes to zero in it.
    """
    room, whole = legs.room, 0j
    alike, twice = legs.a[k], legs.b[k] * legs.middle[k] * legs.middle[k]
    for part in range(3):
        leg = legs.order[k, part]
        axis = jolt * axis_of(leg) if 0.0 < room.late[part] < 0.5 else 0j
        by_axis, out, into = alike * axis + twice * axis.conjugate(), room.edge[leg, 0], -room.edge[leg, 1]
        room.jump[part, 0] = -0.5 * (1.0 + out / _soft(out, moves)) * by_axis
        room.jump[part, 1] = -0.5 * (1.0 + into / _soft(into, moves)) * by_axis
        whole += room.jump[part, 0] - room.jump[part, 1]
    up, down = 0j, 0j
    for part in range(4):
        room.shift[part, 0], room.shift[part, 1] = up - room.late[part] * whole, down + room.late[part] * whole
        up, down = up + room.jump[part, 0], down + room.jump[part, 1]


@lean_kernel
def _none_of(room: Room) -> None:
    """Nothing bends the course yet."""
    for part in range(4):
        for side in range(2):
            room.ahead[part, side], room.arc[part, side] = 0j, 0j
            room.shift[part, side], room.jump[part, side] = 0j, 0j


@lean_kernel
def _mean_signs(
    legs: Legs, k: int, leg: int, i_0: complex, i_1: complex, knee: float, bow_s: complex, damping: float, bent: bool
) -> None:  # fmt: skip
    """Put in the room a phase current's mean sign, between edges and over the period, also as `weight` has it, and the
    slope (1/A) of that by the current at the end; and how much it varies.

    From both ends to the middle. `bent`: by drops, as the room says.
    """
    axis, room = axis_of(leg), legs.room
    start, end, bow = phase(i_0, axis), phase(i_1, axis), phase(bow_s, axis)
    slope, early, least, most = end - start, 0.0, 1.0, -1.0
    mean, volts, by_end = 0.0, 0.0, 0.0
    was_up, was_down, soft_was_up, soft_was_down = start, end, _soft(start, knee), _soft(end, knee)
    sign_was_up, sign_was_down = start / soft_was_up, end / soft_was_down
    for part in range(4):
        late, away = 0.5, 0.0
        if part < 3:
            other = legs.order[k, part]
            late, away = rise_of(legs.duties[k, other]), phase(legs.ripple[k, other], axis)
        bowed = bow * 4.0 * late * (1.0 - late)
        up, down = start + slope * late + away + bowed, end - slope * late - away + bowed
        if bent:
            up, down = up + phase(room.ahead[part, 0], axis), down + phase(room.ahead[part, 1], axis)
        room.late[part] = late
        if part < 3 and legs.order[k, part] == leg:
            room.edge[leg, 0], room.edge[leg, 1] = up, down
        if bent:
            up, down = up + phase(room.shift[part, 0], axis), down + phase(room.shift[part, 1], axis)
        soft_up, soft_down = _soft(up, knee), _soft(down, knee)
        sign_up, sign_down = up / soft_up, down / soft_down
        over_up, over_down = 1.0 / (soft_was_up + soft_up), 1.0 / (soft_was_down + soft_down)
        mean_up, mean_down = (was_up + up) * over_up, (was_down + down) * over_down
        # of neither where the other end is: the ends move by the share of the period that is behind them
        by_up = early * (1.0 - mean_up * sign_was_up) + late * (1.0 - mean_up * sign_up)
        by_down = (1.0 - early) * (1.0 - mean_down * sign_was_down) + (1.0 - late) * (1.0 - mean_down * sign_down)
        if bent:
            mean_up += phase(room.arc[part, 0], axis) * _rise(sign_up - sign_was_up, up - was_up, soft_up, knee)
            mean_down += phase(room.arc[part, 1], axis) * _rise(
                sign_down - sign_was_down, down - was_down, soft_down, knee
            )
        span, middle = late - early, 0.5 * (late + early)
        mean += span * (mean_up + mean_down)
        volts += span * (mean_up * weight(damping, middle) + mean_down * weight(damping, 1.0 - middle))
        by_end += span * (by_up * over_up + by_down * over_down)
        room.sign[leg, part, 0], room.sign[leg, part, 1] = mean_up, mean_down
        room.change[leg, part, 0], room.change[leg, part, 1] = sign_up - sign_was_up, sign_down - sign_was_down
        least, most = min(least, mean_up, mean_down), max(most, mean_up, mean_down)
        early, was_up, was_down, soft_was_up, soft_was_down = late, up, down, soft_up, soft_down
        sign_was_up, sign_was_down = sign_up, sign_down
        if bent:
            was_up, was_down = up + phase(room.jump[part, 0], axis), down + phase(room.jump[part, 1], axis)
            soft_was_up, soft_was_down = _soft(was_up, knee), _soft(was_down, knee)
            sign_was_up, sign_was_down = was_up / soft_was_up, was_down / soft_was_down
    room.mean[leg], room.loss[leg, 0], room.loss[leg, 1], room.varies[leg] = mean, volts, by_end, most - least


@lean_kernel
def _rise(change: float, along: float, soft: float, knee: float) -> float:
    """Mean slope (1/A) of a current's sign along a piece of its course."""
    return change / along if abs(along) > 1e-3 * knee else knee * knee / (soft * soft * soft)


@lean_kernel
def _damping(legs: Legs, k: int) -> float:
    """R_s T_s / L."""
    return legs.R_s * legs.T_s * legs.a[k]


@lean_kernel
def _by_dead_time(legs: Legs, k: int, i_0: complex, i_1: complex, dead_time: float, u_drop: float, spread: float) -> complex:
    """Lost voltage (V, stationary) of the dead times alone, beside drops that the room has."""
    lost, nearest, changes = _laid_out(legs, k, i_0, i_1, dead_time, u_drop, spread)
    if nearest < 0:
        return lost
    moves = _moves(legs, k, dead_time)
    if spread < _NARROW * moves:
        return _between_edges(legs, k, i_0, i_1, u_drop, changes, moves)
    # Currents spread, as noise makes them: the mean of two that have this spread
    off = spread * axis_of(nearest)
    lower = _between_edges(legs, k, i_0 - off, i_1 - off, u_drop, changes, moves)
    return 0.5 * (lower + _between_edges(legs, k, i_0 + off, i_1 + off, u_drop, changes, moves))


@lean_kernel
def _laid_out(
    legs: Legs, k: int, i_0: complex, i_1: complex, dead_time: float, u_drop: float, spread: float
) -> tuple[complex, int, int]:
    """Lost voltage (V, stationary) where each edge's diode is known, and -1; else the leg whose current is nearest zero
    at an edge, and how often switches change on the period's course.
    """
    u_dc, T_s, room, lost, nearest, closest = legs.u_dc[k], legs.T_s, legs.room, 0j, 0, math.inf
    near = _MOVES * _moves(legs, k, dead_time) + spread
    bow = _bow(legs, k)
    damping, dead = _damping(legs, k), dead_time / T_s
    for leg in range(3):
        axis, rise = axis_of(leg), rise_of(legs.duties[k, leg])
        bowed = phase(bow, axis) * 4.0 * rise * (1.0 - rise)
        start, end = phase(i_0, axis) + bowed, phase(i_1, axis) + bowed
        away = (end - start) * rise + phase(legs.ripple[k, leg], axis)
        at_rise, at_fall, at_last = start + away, end - away, start - away
        if u_drop != 0.0:
            at_rise, at_fall = room.edge[leg, 0], room.edge[leg, 1]
        left = still_dead(legs.before[k, leg], dead)
        close = min(abs(at_rise), abs(at_fall), abs(at_last) if left > 0.0 else math.inf)
        if close < _NEARER * closest:
            nearest, closest = leg, close
        room.out[leg, 0] = 0 if abs(at_rise) < near else 1 if at_rise > 0.0 else -1
        room.out[leg, 1] = 0 if abs(at_fall) < near else 1 if at_fall > 0.0 else -1
        room.out[leg, 2] = 0 if abs(at_last) < near else 1 if at_last > 0.0 else -1
        high = 0.0
        if 0.0 < rise < 0.5 and at_rise > 0.0:
            lost += 2.0 / 3.0 * axis * u_dc * min(1.0 - 2.0 * rise, dead) * weight(damping, rise)
        if 0.0 < rise < 0.5 and at_fall < 0.0:
            high += min(dead, rise)
        if at_last < 0.0:
            high += min(left, rise)
        lost -= 2.0 / 3.0 * axis * u_dc * high * weight(damping, 1.0 - rise)
    if closest >= near:
        return lost, -1, 0
    return lost, nearest, cut(legs.duties[k], legs.before[k], dead_time, T_s, room)


@lean_kernel
def _moves(legs: Legs, k: int, dead_time: float) -> float:
    """What the link's voltage makes of a current in a dead time, A."""
    return legs.u_dc[k] * (legs.a[k] + abs(legs.b[k])) * dead_time


@lean_kernel
def _between_edges(
    legs: Legs, k: int, i_0: complex, i_1: complex, u_drop: float, changes: int, moves: float
) -> complex:  # fmt: skip
    """Lost voltage (V, stationary) of a period that takes the current from one end to the other."""
    last = course_between(_period(legs, k, u_drop), i_0, i_1, 0j, SHOTS, _CLOSE * moves, changes, legs.room)
    return 2.0 / 3.0 * legs.u_dc[k] * (_ideal(legs, k) - last.held)


@lean_kernel
def _period(legs: Legs, k: int, u_drop: float) -> Period:
    return Period(
        legs.u_dc[k], legs.T_s, legs.R_s, legs.a[k], legs.b[k], legs.psi_0[k], legs.others[k], legs.D[k],
        legs.middle[k], u_drop,
    )


@lean_kernel
def _ideal(legs: Legs, k: int) -> complex:
    """How high the legs are commanded to be held on average, along their axes."""
    ideal = 0j
    for leg in range(3):
        ideal += min(max(legs.duties[k, leg], 0.0), 1.0) * axis_of(leg)
    return ideal


@lean_kernel
def _bow(legs: Legs, k: int) -> complex:
    """What the current (A, stationary) is beside a straight line in the middle of a period: its magnets turn."""
    return -0.125 * legs.D[k] * legs.D[k] * _driven(legs.psi_0[k], legs.a[k], legs.b[k]) * legs.middle[k]


@lean_kernel
def _driven(u: complex, a: float, b: complex) -> complex:
    """di/dt (A/s) that a voltage (V) drives, both in the rotor frame."""
    return a * u + b * u.conjugate()


@lean_kernel
def _soft(i: float, knee: float) -> float:
    return math.sqrt(i * i + knee * knee)


@kernel
def _orders(duties: Real) -> NDArray[np.int8]:
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
def _ripples(u_dc: Real, duties: Real, u_s: Vector, middle: Vector, T_s: float, a: Real, b: Vector) -> Vector:
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
            ripple[k, leg] = _driven(area * T_s * middle[k].conjugate(), a[k], b[k]) * middle[k]
    return ripple

