"""Voltage that a bridge's legs lose in one control period, from the currents at its ends.

The equations of `inverter_voltage_error`, period by period, so that a simulation can ask for one. Where a current is
near zero at an edge, the period is followed from edge to edge: both switches of a leg are off for the dead time, its
current flows on through a diode until it is zero, and then the leg floats. Derived here.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.kernel import kernel
from estimator.physics.rows import AXES, Real, Rows, Vector

_A, _B, _C = AXES
_NONE = 2  # of a leg's switches is on
_MOVES = 2.5  # times what u_dc / L makes of a current in a dead time: no current moves more meanwhile
_NARROW = 0.03  # times the same: a spread of currents that does not matter
_CLOSE = 0.003  # times the same: where the last shot may end
_SHOTS = 6  # at a period's end
_NEARER = 1.0 - 1e-6  # as near: of two legs alike, the first
_DRAWN = 1.0  # of what the end says at best, to what the machine's parameters say
_CHANGES = 4  # of sign between two edges at most
_SETTLES = 8  # passes over legs that float together
_ROUNDING = 1e-12  # of what the link's voltage makes of a current in a period
_SHORT = 0.05  # of a period, in which the resistive drop hardly changes


class Room(NamedTuple):
    """Room to work in, for a period."""

    out: NDArray[np.int8]  # (3, 2): of each leg as it rises and falls, 1 where its current surely flows out, -1 into it
    first: NDArray[np.int8]  # (3,): of each leg's switches on at the begin, 0 the lower, 1 the upper, 2 none
    moments: Real  # (15,) s, where switches change, in order
    whose: NDArray[np.int8]  # (15,): the leg
    to: NDArray[np.int8]  # (15,)
    high: Real  # (3,) what share of the link's voltage each leg has
    free: NDArray[np.bool_]  # (3,) none of its switches is on
    zero: NDArray[np.bool_]  # (3,) nor is a diode: its current has come to zero


class Period(NamedTuple):
    """What drives the current in one control period."""

    u_dc: float  # V
    T_s: float  # s
    R_s: float  # ohm
    L_d: float  # H
    L_q: float  # H
    psi_f: float  # Vs
    D: float  # rad, electrical, by which the rotor turns
    middle: complex  # exp(j theta_e) in the middle


class Legs(NamedTuple):
    """What the legs do in each period, whatever the currents."""

    u_dc: Real  # V; of no length where it is not known: then each end's current counts for half a period
    duties: Real  # (n, 3)
    edges: NDArray[np.int8]  # (n, 3): 1 where a leg rises at the period's start, -1 where it falls
    order: NDArray[np.int8]  # (n, 3): the legs as they rise
    ripple: Vector  # (n, 3): A, stationary, when each leg rises
    middle: Vector  # exp(j theta_e) in the middle
    T_s: float  # s
    R_s: float  # ohm
    L_d: float  # H
    L_q: float  # H
    psi_f: float  # Vs
    D: Real  # rad, electrical, by which the rotor turns in each period
    room: Room


def _room() -> Room:
    legs, changes, flags = np.empty(3, np.int8), np.empty(15, np.int8), np.zeros(3, np.bool_)
    out, moments = np.zeros((3, 2), np.int8), np.empty(15)
    return Room(out, legs, moments, changes, changes.copy(), np.empty(3), flags, flags.copy())


def legs_of(rows: Rows) -> Legs:
    """The legs of a recording's periods."""
    u_dc, middle, T_s = rows.u_dc, rows.middle, rows.T_s
    m = rows.machine
    R_s, L_d, L_q, psi_f = float(m.R_s), float(m.L_d), float(m.L_q), float(m.psi_f)
    u_s = rows.u * middle
    if u_dc is None:
        none = np.zeros((0, 3))
        return Legs(
            np.zeros(0), none, none.astype(np.int8), none.astype(np.int8), none.astype(np.complex128), middle,
            T_s, R_s, L_d, L_q, psi_f, rows.D, _room(),
        )  # fmt: skip
    edges, order = edges_at_start(rows), rows.once("order", lambda: _orders(rows.duties))
    ripple = rows.once("ripple", lambda: _ripples(u_dc, rows.duties, u_s, middle, T_s, L_d, L_q))
    return Legs(u_dc, rows.duties, edges, order, ripple, middle, T_s, R_s, L_d, L_q, psi_f, rows.D, _room())


def legs_at_rest(u_dc: Real, duties: Real, T_s: float, L: float) -> Legs:
    """The legs before a motor that stands, none of them left at a rail."""
    u_s = np.ascontiguousarray(2.0 / 3.0 * u_dc * (duties @ np.array(AXES)), np.complex128)
    middle = np.ones(len(duties), np.complex128)
    ripple = _ripples(u_dc, duties, u_s, middle, T_s, L, L)
    edges, D = np.zeros(duties.shape, np.int8), np.zeros(len(duties))
    return Legs(u_dc, duties, edges, _orders(duties), ripple, middle, T_s, 0.0, L, L, 0.0, D, _room())


def edges_at_start(rows: Rows) -> NDArray[np.int8]:
    """Where a leg rises (1) or falls (-1) at a period's start, (n, 3): before, it stood at the other rail."""
    return rows.once("edges at start", lambda: _edges(rows.duties >= 1.0))


def _edges(stays_high: NDArray[np.bool_]) -> NDArray[np.int8]:
    before = np.concatenate((stays_high[:1], stays_high[:-1]))
    return (stays_high & ~before).astype(np.int8) - (before & ~stays_high)


@kernel
def lost_by_dead_time(legs: Legs, i_s: Vector, dead_time: float, spread: float) -> Vector:
    """Voltage (V) that dead times lose in each period, from currents (A) at samples; both in the stationary frame."""
    lost = np.zeros(len(legs.middle), np.complex128)
    if len(legs.u_dc) > 0 and dead_time != 0.0:
        for k in range(len(lost)):
            lost[k] = _by_dead_time(legs, k, i_s[k], i_s[k + 1], dead_time, spread)
    return lost


@kernel
def lost_by_drops(legs: Legs, i_s: Vector, dead_time: float, u_drop: float, width: float) -> Vector:
    """The same by drops, and by the dead time of legs that leave a rail."""
    lost = np.empty(len(legs.middle), np.complex128)
    for k in range(len(lost)):
        lost[k] = _by_drops(legs, k, i_s[k], i_s[k + 1], dead_time, u_drop, width)
    return lost


@kernel
def lost_between(legs: Legs, begin: Vector, end: Vector, dead_time: float, u_drop: float, width: float) -> Vector:
    """Lost voltage (V) of periods that need not join, from currents (A) at their ends; all in the stationary frame."""
    lost = np.empty(len(begin), np.complex128)
    for k in range(len(lost)):
        lost[k] = lost_voltage(legs, k, begin[k], end[k], dead_time, u_drop, width, width)
    return lost


@kernel
def lost_voltage(
    legs: Legs, k: int, i_0: complex, i_1: complex, dead_time: float, u_drop: float, width: float, spread: float
) -> complex:
    """Lost voltage (V) of period k, from the currents (A) at its ends; both in the stationary frame.

    Currents pass zero within `width` for drops; they are known within `spread` for dead times.
    """
    lost = _by_drops(legs, k, i_0, i_1, dead_time, u_drop, width)
    if dead_time != 0.0 and len(legs.u_dc) > 0:
        lost += _by_dead_time(legs, k, i_0, i_1, dead_time, spread)
    return lost


@kernel
def _by_drops(
    legs: Legs, k: int, i_0: complex, i_1: complex, dead_time: float, u_drop: float, width: float
) -> complex:
    """Lost voltage (V, stationary) of drops, and of the dead time of legs that leave a rail."""
    axes = (_A, _B, _C)
    lost = 0j
    if len(legs.u_dc) == 0:
        for axis in axes:
            start, end = _phase(i_0, axis), _phase(i_1, axis)
            lost += axis * u_drop * 0.5 * (start / _soft(start, width) + end / _soft(end, width))
        return 2.0 / 3.0 * lost
    u_dc, bow_s = legs.u_dc[k], _bow(legs.psi_f, legs.L_d, legs.D[k], legs.middle[k])
    for leg in range(3):
        axis = axes[leg]
        start, end = _phase(i_0, axis), _phase(i_1, axis)
        slope, volts = end - start, 0.0
        edge = legs.edges[k, leg]
        if edge != 0.0:  # a leg that leaves a rail has an edge at the period's start
            volts += u_dc / legs.T_s * 0.5 * dead_time * (edge + start / _soft(start, width))
        if u_drop != 0.0:
            # Mean of the sign over the period, piece by piece between the edges, from both ends to the middle
            total, early, bow = 0.0, 0.0, _phase(bow_s, axis)
            was_up, was_down, soft_was_up, soft_was_down = start, end, _soft(start, width), _soft(end, width)
            for part in range(4):
                late, away = 0.5, 0.0
                if part < 3:
                    other = legs.order[k, part]
                    late, away = _rise(legs.duties[k, other]), _phase(legs.ripple[k, other], axis)
                bowed = bow * 4.0 * late * (1.0 - late)
                up, down = start + slope * late + away + bowed, end - slope * late - away + bowed
                soft_up, soft_down = _soft(up, width), _soft(down, width)
                mean = (was_up + up) / (soft_was_up + soft_up) + (was_down + down) / (soft_was_down + soft_down)
                total += (late - early) * mean
                early, was_up, was_down, soft_was_up, soft_was_down = late, up, down, soft_up, soft_down
            volts += u_drop * total
        lost += axis * volts
    return 2.0 / 3.0 * lost


@kernel
def _by_dead_time(legs: Legs, k: int, i_0: complex, i_1: complex, dead_time: float, spread: float) -> complex:
    """Lost voltage (V, stationary) of the dead times alone."""
    u_dc, T_s, room, lost, nearest, closest = legs.u_dc[k], legs.T_s, legs.room, 0j, 0, math.inf
    moves = u_dc / min(legs.L_d, legs.L_q) * dead_time  # A
    near = _MOVES * moves + spread
    bow = _bow(legs.psi_f, legs.L_d, legs.D[k], legs.middle[k])
    damping = legs.R_s * T_s * (0.5 / legs.L_d + 0.5 / legs.L_q)
    for leg in range(3):
        axis, rise = _axis(leg), _rise(legs.duties[k, leg])
        bowed = _phase(bow, axis) * 4.0 * rise * (1.0 - rise)
        start, end = _phase(i_0, axis) + bowed, _phase(i_1, axis) + bowed
        away = (end - start) * rise + _phase(legs.ripple[k, leg], axis)
        at_rise, at_fall = start + away, end - away
        close = min(abs(at_rise), abs(at_fall))
        if close < _NEARER * closest:
            nearest, closest = leg, close
        room.out[leg, 0] = 0 if abs(at_rise) < near else 1 if at_rise > 0.0 else -1
        room.out[leg, 1] = 0 if abs(at_fall) < near else 1 if at_fall > 0.0 else -1
        if rise < 0.5 and at_rise > 0.0:
            lost += 2.0 / 3.0 * axis * u_dc * min(1.0 - 2.0 * rise, dead_time / T_s) * _weight(damping, rise)
        if rise > 0.0 and at_fall < 0.0:
            lost -= 2.0 / 3.0 * axis * u_dc * min(2.0 * rise, dead_time / T_s) * _weight(damping, 1.0 - rise)
    if closest >= near:
        return lost
    changes = _cut(legs.duties[k], dead_time, T_s, room)
    if spread < _NARROW * moves:
        return _between_edges(legs, k, i_0, i_1, changes, moves)
    # Currents spread, as noise makes them: the mean of two that have this spread
    off = spread * _axis(nearest)
    lower = _between_edges(legs, k, i_0 - off, i_1 - off, changes, moves)
    return 0.5 * (lower + _between_edges(legs, k, i_0 + off, i_1 + off, changes, moves))


@kernel
def _cut(duties: Real, dead_time: float, T_s: float, room: Room) -> int:
    """Put in order where switches change, and say how often.

    Of a leg whose current surely flows out, the diode that goes on is the lower one, as if its lower switch were on;
    into it, the upper one.
    """
    count = 0
    for leg in range(3):
        duty = duties[leg]
        room.first[leg] = 1 if duty >= 1.0 else 0
        if not 0.0 < duty < 1.0:
            continue
        rise, at_rise, at_fall = _rise(duty) * T_s, room.out[leg, 0], room.out[leg, 1]
        fall = T_s - rise
        over = fall + dead_time - T_s  # a dead time that goes on into the next period, whose begin is like this one's
        if over > 0.0 and at_fall <= 0:
            room.first[leg] = _NONE if at_fall == 0 else 1
            if over < rise:
                count = _put(room, count, over, leg, 0)
        if at_rise == 0:
            count = _put(room, count, rise, leg, _NONE)
        if at_rise < 0:
            count = _put(room, count, rise, leg, 1)
        elif rise + dead_time < fall:
            count = _put(room, count, rise + dead_time, leg, 1)
        if at_fall == 0:
            count = _put(room, count, fall, leg, _NONE)
        if at_fall > 0:
            count = _put(room, count, fall, leg, 0)
        elif over < 0.0:
            count = _put(room, count, fall + dead_time, leg, 0)
    return count


@kernel
def _put(room: Room, count: int, t: float, leg: int, to: int) -> int:
    place = count
    while place > 0 and room.moments[place - 1] > t:
        room.moments[place], room.whose[place] = room.moments[place - 1], room.whose[place - 1]
        room.to[place] = room.to[place - 1]
        place -= 1
    room.moments[place], room.whose[place], room.to[place] = t, leg, to
    return count + 1


@kernel
def _between_edges(legs: Legs, k: int, i_0: complex, i_1: complex, changes: int, moves: float) -> complex:
    """Lost voltage (V, stationary) of a period that takes the current from one end to the other.

    By the machine's parameters, and as much beside them (one constant voltage) as lets it end where it does: of that
    the end often says little, so it is drawn towards none. Newton's method: the course is nearly straight from one
    change of sign to the next.
    """
    u_dc, T_s, duties = legs.u_dc[k], legs.T_s, legs.duties[k]
    period = Period(u_dc, T_s, legs.R_s, legs.L_d, legs.L_q, legs.psi_f, legs.D[k], legs.middle[k])
    held, ideal, beside, least = 0j, 0j, 0j, _DRAWN * T_s**2
    for leg in range(3):
        ideal += min(max(duties[leg], 0.0), 1.0) * _axis(leg)
    for _ in range(_SHOTS):
        end, by_real, by_imag, held, held_real, held_imag = _course(period, i_0, beside, changes, legs.room)
        off = i_1 - end
        x = _phase(by_real, off) - least * beside.real
        y = _phase(by_imag, off) - least * beside.imag
        xx, yy, xy = _phase(by_real, by_real) + least, _phase(by_imag, by_imag) + least, _phase(by_real, by_imag)
        step = complex(x * yy - y * xy, y * xx - x * xy) / (xx * yy - xy * xy)
        beside += step
        if abs(step) * T_s < _CLOSE * moves:
            held += held_real * step.real + held_imag * step.imag
            break
    return 2.0 / 3.0 * u_dc * (ideal - held)


@kernel
def _course(  # noqa: PLR0912, PLR0915 - in pieces that share arrays it takes twice as long
    period: Period, i: complex, beside: complex, changes: int, room: Room
) -> tuple[complex, complex, complex, complex, complex, complex]:  # fmt: skip
    """The current (A, stationary) at a period's end, its slopes by the real and imaginary part of `beside` (s), how
    high the legs are held on average, along their axes and by `_weight`, and its slopes (s/A).

    In a dead time a current out of the leg flows on through the lower diode, one into it through the upper, and where
    it has come to zero the leg floats on the voltage that keeps it there. beside: A/s that the current falls beside
    what the machine's parameters say.
    """
    T_s, high, free, zero = period.T_s, room.high, room.free, room.zero
    alike, apart = 0.5 / period.L_d + 0.5 / period.L_q, 0.5 / period.L_d - 0.5 / period.L_q  # of its mirror
    full, damping, loose = 2.0 / 3.0 * period.u_dc, period.R_s * T_s * alike, 0
    by_real, by_imag, held, held_real, held_imag, t = 0j, 0j, 0j, 0j, 0j, 0.0
    none = _ROUNDING * full * alike * T_s
    for leg in range(3):
        to = room.first[leg]
        free[leg], zero[leg], high[leg] = to == _NONE, False, float(to)
        loose += to == _NONE
    for change in range(changes + 1):
        until = room.moments[change] if change < changes else T_s
        if until > t:
            turned = period.D * (0.5 * (t + until) / T_s - 0.5)
            rotor = period.middle * complex(1.0 - 0.5 * turned * turned, turned)
            twice = apart * rotor * rotor
            was, was_held, crossed, crossed_real, crossed_imag = 0j, 0j, False, 0.0, 0.0
            for _ in range(_CHANGES):
                span, first, floats = until - t, -1, 0
                falls = _falls(period, rotor, alike, twice, i) + beside
                more_real, more_imag, level_real, level_imag = -1.0 + 0j, -1j, 0j, 0j
                if loose > 0:
                    for leg in range(3):
                        if free[leg]:
                            current = _phase(i, _axis(leg))
                            high[leg], zero[leg] = 0.0 if current > 0.0 else 1.0, zero[leg] or abs(current) < none
                            floats += zero[leg]
                    if floats > 0:
                        _float(high, zero, full, alike, twice, falls)
                        floats = int(zero[0]) + int(zero[1]) + int(zero[2])
                level = high[0] * _A + high[1] * _B + high[2] * _C
                rate = full * (alike * level + twice * level.conjugate()) - falls
                if span > _SHORT * T_s:  # by the current in the middle
                    rate += falls - beside - _falls(period, rotor, alike, twice, i + 0.5 * span * rate)
                if loose > 0:
                    if floats == 1:
                        axis = _axis(0 if zero[0] else 1 if zero[1] else 2)
                        drives = alike * axis + twice * axis.conjugate()
                        own = drives / _phase(drives, axis)
                        more_real += own * axis.real
                        more_imag += own * axis.imag
                        lifts = axis / (full * _phase(drives, axis))
                        level_real, level_imag = lifts * axis.real, lifts * axis.imag
                    elif floats > 1:
                        rate, more_real, more_imag = 0j, 0j, 0j
                    if crossed:  # when that is, shifts too
                        by_real += (was - rate) * crossed_real
                        by_imag += (was - rate) * crossed_imag
                        held_real += (was_held - level) * crossed_real
                        held_imag += (was_held - level) * crossed_imag
                    for leg in range(3):
                        if free[leg] and not zero[leg]:
                            current, fall = _phase(i, _axis(leg)), -_phase(rate, _axis(leg))
                            if current * fall > 0.0 and current / fall < span:
                                span, first = current / fall, leg
                held += level * (span * _weight(damping, (t + 0.5 * span) / T_s))
                held_real += level_real * span
                held_imag += level_imag * span
                i += rate * span
                by_real += more_real * span
                by_imag += more_imag * span
                t, crossed = t + span, first >= 0
                if not crossed:
                    break
                was, was_held, zero[first], fall = rate, level, True, -_phase(rate, _axis(first))
                crossed_real, crossed_imag = _phase(by_real, _axis(first)) / fall, _phase(by_imag, _axis(first)) / fall
            t = until
        if change < changes:
            leg, to = room.whose[change], room.to[change]
            loose += int(to == _NONE) - int(free[leg])
            free[leg], zero[leg], high[leg] = to == _NONE, False, float(to)
    return i, by_real, by_imag, held / T_s, held_real / T_s, held_imag / T_s


@kernel
def _falls(period: Period, rotor: complex, alike: float, twice: complex, i: complex) -> complex:
    """How fast the resistance and the induced voltage let a current (A, stationary) fall, A/s."""
    induced = 1j * (period.D / period.T_s) * rotor
    induced *= period.psi_f + (period.L_d - period.L_q) * rotor * i.conjugate()
    against = period.R_s * i + induced
    return alike * against + twice * against.conjugate()


@kernel
def _float(
    high: Real, zero: NDArray[np.bool_], full: float, alike: float, twice: complex, falls: complex
) -> None:  # fmt: skip
    """Set legs that float so that their currents stay zero; those that a rail would hold, float no more."""
    for leg in range(3):
        high[leg] = 0.5 if zero[leg] else high[leg]
    for _ in range(_SETTLES if int(zero[0]) + int(zero[1]) + int(zero[2]) > 1 else 1):
        for leg in range(3):
            if zero[leg]:
                axis, level = _axis(leg), high[0] * _A + high[1] * _B + high[2] * _C
                rate = full * (alike * level + twice * level.conjugate()) - falls
                drives = full * (alike * axis + twice * axis.conjugate())
                high[leg] = min(max(high[leg] - _phase(rate, axis) / _phase(drives, axis), 0.0), 1.0)
    for leg in range(3):
        zero[leg] = zero[leg] and 0.0 < high[leg] < 1.0


@kernel
def _weight(damping: float, part: float) -> float:
    """What a voltage lost after that part of a period counts as, for who knows the currents at both ends.

    One lost early lowers the current for longer, and by that the winding's resistive drop. damping: R_s T_s / L.
    """
    return 1.0 - damping * (0.5 - part)


@kernel
def _bow(psi_f: float, L_d: float, D: float, middle: complex) -> complex:
    """What the current (A, stationary) is beside a straight line in the middle of a period: its magnets turn."""
    return -0.125 * psi_f / L_d * D * D * middle


@kernel
def _axis(leg: int) -> complex:
    return _A if leg == 0 else _B if leg == 1 else _C


@kernel
def _driven(u: complex, middle: complex, L_d: float, L_q: float) -> complex:
    """di/dt (A/s) that a voltage (V) drives, both in the stationary frame."""
    in_rotor = u * middle.conjugate()
    return complex(in_rotor.real / L_d, in_rotor.imag / L_q) * middle


@kernel
def _phase(i: complex, axis: complex) -> float:
    return i.real * axis.real + i.imag * axis.imag


@kernel
def _soft(i: float, width: float) -> float:
    return math.sqrt(i * i + width * width)


@kernel
def _rise(duty: float) -> float:
    """When a leg rises, as a share of the period; it falls at 1 less that."""
    return 0.5 * (1.0 - duty)


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
def _ripples(u_dc: Real, duties: Real, u_s: Vector, middle: Vector, T_s: float, L_d: float, L_q: float) -> Vector:
    """The current's ripple (A, stationary) when each leg rises: the integral of the voltage less its mean."""
    ripple = np.empty(duties.shape, np.complex128)
    for k in range(len(duties)):
        a, b, c = _rise(duties[k, 0]), _rise(duties[k, 1]), _rise(duties[k, 2])
        for leg in range(3):
            when = _rise(duties[k, leg])
            area = -u_s[k] * when
            area += 2.0 / 3.0 * u_dc[k] * (
                _A * max(0.0, when - a) + _B * max(0.0, when - b) + _C * max(0.0, when - c)
            )
            ripple[k, leg] = _driven(area * T_s, middle[k], L_d, L_q)
    return ripple

