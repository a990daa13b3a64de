"""Voltage that a bridge's legs lose in one control period, from the currents at its ends.

The equations of `inverter_voltage_error`, period by period, so that a simulation can ask for one.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.kernel import kernel
from estimator.physics.rows import AXES, Real, Rows, Vector

_A, _B, _C = AXES
Three = tuple[float, float, float]
_PASSES = 8
_STEPS = 12
_FAR = math.sqrt(3.0)  # Gauss-Hermite's nodes, of a normal spread
_MOVES = 4.0  # times u_dc / L: currents move no faster while legs are dead
_CLOSE = 1e-4  # of what a dead time can lose


class Legs(NamedTuple):
    """What the legs do in each period, whatever the currents."""

    u_dc: Real  # V; of no length where it is not known: then each end's current counts for half a period
    duties: Real  # (n, 3)
    edges: NDArray[np.int8]  # (n, 3): 1 where a leg rises at the period's start, -1 where it falls
    order: NDArray[np.int8]  # (n, 3): the legs as they rise
    ripple: Vector  # (n, 3): A, stationary, when each leg rises
    u_s: Vector  # V, stationary
    middle: Vector  # exp(j theta_e) in the middle
    T_s: float  # s
    L_d: float  # H
    L_q: float  # H


def legs_of(rows: Rows) -> Legs:
    """The legs of a recording's periods."""
    u_dc, middle, T_s = rows.u_dc, rows.middle, rows.T_s
    L_d, L_q, u_s = float(rows.machine.L_d), float(rows.machine.L_q), rows.u * middle
    if u_dc is None:
        none = np.zeros((0, 3))
        return Legs(
            np.zeros(0), none, none.astype(np.int8), none.astype(np.int8), none.astype(np.complex128), u_s, middle,
            T_s, L_d, L_q,
        )  # fmt: skip
    edges, order = edges_at_start(rows), rows.once("order", lambda: _orders(rows.duties))
    ripple = rows.once("ripple", lambda: _ripples(u_dc, rows.duties, u_s, middle, T_s, L_d, L_q))
    return Legs(u_dc, rows.duties, edges, order, ripple, u_s, middle, T_s, L_d, L_q)


def legs_at_rest(u_dc: Real, duties: Real, T_s: float, L: float) -> Legs:
    """The legs before a motor that stands, none of them left at a rail."""
    u_s = np.ascontiguousarray(2.0 / 3.0 * u_dc * (duties @ np.array(AXES)), np.complex128)
    middle = np.ones(len(duties), np.complex128)
    ripple = _ripples(u_dc, duties, u_s, middle, T_s, L, L)
    return Legs(u_dc, duties, np.zeros(duties.shape, np.int8), _orders(duties), ripple, u_s, middle, T_s, L, L)


def edges_at_start(rows: Rows) -> NDArray[np.int8]:
    """Where a leg rises (1) or falls (-1) at a period's start, (n, 3): before, it stood at the other rail."""
    return rows.once("edges at start", lambda: _edges(rows.duties >= 1.0))


def _edges(stays_high: NDArray[np.bool_]) -> NDArray[np.int8]:
    before = np.concatenate((stays_high[:1], stays_high[:-1]))
    return (stays_high & ~before).astype(np.int8) - (before & ~stays_high)


@kernel
def lost_voltages(legs: Legs, i_s: Vector, dead_time: float, u_drop: float, width: float) -> Vector:
    """Lost voltage (V) of each period, from currents (A) at samples; both in the stationary frame."""
    lost = np.empty(len(legs.middle), np.complex128)
    for k in range(len(lost)):
        lost[k] = lost_voltage(legs, k, i_s[k], i_s[k + 1], dead_time, u_drop, width)
    return lost


@kernel
def lost_between(legs: Legs, begin: Vector, end: Vector, dead_time: float, u_drop: float, width: float) -> Vector:
    """Lost voltage (V) of periods that need not join, from currents (A) at their ends; all in the stationary frame."""
    lost = np.empty(len(begin), np.complex128)
    for k in range(len(lost)):
        lost[k] = lost_voltage(legs, k, begin[k], end[k], dead_time, u_drop, width)
    return lost


@kernel
def lost_voltage(
    legs: Legs, k: int, i_0: complex, i_1: complex, dead_time: float, u_drop: float, width: float
) -> complex:
    """Lost voltage (V) of period k, from the currents (A) at its ends; both in the stationary frame."""
    axes = (_A, _B, _C)
    lost = 0j
    if len(legs.u_dc) == 0:
        for axis in axes:
            start, end = _phase(i_0, axis), _phase(i_1, axis)
            lost += axis * u_drop * 0.5 * (start / _soft(start, width) + end / _soft(end, width))
        return 2.0 / 3.0 * lost
    u_dc = legs.u_dc[k]
    by_rise, by_fall = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if dead_time != 0.0:
        by_rise, by_fall = _all_by_dead_time(legs, k, i_0, i_1, dead_time, width)
    for leg in range(3):
        axis = axes[leg]
        start, end = _phase(i_0, axis), _phase(i_1, axis)
        slope = end - start
        volts = (by_rise[leg] + by_fall[leg]) / legs.T_s
        edge = legs.edges[k, leg]
        if edge != 0.0:  # a leg that leaves a rail has an edge at the period's start
            volts += u_dc / legs.T_s * 0.5 * dead_time * (edge + start / _soft(start, width))
        if u_drop != 0.0:
            # Mean of the sign over the period, piece by piece between the edges, from both ends to the middle
            total, early = 0.0, 0.0
            was_up, was_down, soft_was_up, soft_was_down = start, end, _soft(start, width), _soft(end, width)
            for part in range(4):
                late, away = 0.5, 0.0
                if part < 3:
                    other = legs.order[k, part]
                    late, away = _rise(legs.duties[k, other]), _phase(legs.ripple[k, other], axis)
                up, down = start + slope * late + away, end - slope * late - away
                soft_up, soft_down = _soft(up, width), _soft(down, width)
                mean = (was_up + up) / (soft_was_up + soft_up) + (was_down + down) / (soft_was_down + soft_down)
                total += (late - early) * mean
                early, was_up, was_down, soft_was_up, soft_was_down = late, up, down, soft_up, soft_down
            volts += u_drop * total
        lost += axis * volts
    return 2.0 / 3.0 * lost


@kernel
def _put(three: Three, place: int, value: float) -> Three:
    a, b, c = three
    return value if place == 0 else a, value if place == 1 else b, value if place == 2 else c


@kernel
def _farthest(was: Three, rise: Three, fall: Three) -> float:
    a, b, c = rise[0] + fall[0] - was[0], rise[1] + fall[1] - was[1], rise[2] + fall[2] - was[2]
    return max(abs(a), abs(b), abs(c))


@kernel
def _all_by_dead_time(
    legs: Legs, k: int, i_0: complex, i_1: complex, dead_time: float, width: float
) -> tuple[Three, Three]:  # fmt: skip
    """Vs that each leg loses at its rise and at its fall."""
    u_dc, by_rise, by_fall = legs.u_dc[k], (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    near = _FAR * width + _MOVES * u_dc / min(legs.L_d, legs.L_q) * dead_time
    far = True
    for leg in range(3):  # far from where a current changes sign
        start, end, rise = _phase(i_0, _axis(leg)), _phase(i_1, _axis(leg)), _rise(legs.duties[k, leg])
        away = (end - start) * rise + _phase(legs.ripple[k, leg], _axis(leg))
        far = far and min(abs(start + away), abs(end - away)) > near
        if rise < 0.5 and start + away > 0.0:
            by_rise = _put(by_rise, leg, u_dc * min((1.0 - 2.0 * rise) * legs.T_s, dead_time))
        if rise > 0.0 and end - away < 0.0:
            by_fall = _put(by_fall, leg, -u_dc * min(2.0 * rise * legs.T_s, dead_time))
    if far:
        return by_rise, by_fall
    for _ in range(_PASSES):  # what one leg loses moves the others' currents
        was = by_rise[0] + by_fall[0], by_rise[1] + by_fall[1], by_rise[2] + by_fall[2]
        for leg in range(3):
            at_rise, at_fall = _by_dead_time(legs, k, i_0, i_1, dead_time, width, by_rise, by_fall, leg)
            by_rise, by_fall = _put(by_rise, leg, at_rise), _put(by_fall, leg, at_fall)
        if _farthest(was, by_rise, by_fall) < _CLOSE * u_dc * dead_time:
            break
    return by_rise, by_fall


@kernel
def _axis(leg: int) -> complex:
    return _A if leg == 0 else _B if leg == 1 else _C


@kernel
def _by_dead_time(
    legs: Legs, k: int, i_0: complex, i_1: complex, dead_time: float, width: float, by_rise: Three, by_fall: Three,
    leg: int,
) -> tuple[float, float]:  # fmt: skip
    """Vs that a leg loses at its rise and at its fall, where the others lose what is known of them.

    Both switches are off. A current out of the leg flows on through the lower diode, one into it through the upper, and
    where it has come to zero the leg floats on the voltage that keeps it there. The loss moves the current, from both
    ends of the period to the edges: it is the one that follows from itself.
    """
    u_dc, T_s, rise = legs.u_dc[k], legs.T_s, _rise(legs.duties[k, leg])
    on, off = (1.0 - 2.0 * rise) * T_s, 2.0 * rise * T_s  # a pulse shorter than the dead time is lost whole
    if on <= 0.0 or off <= 0.0:
        return 0.0, 0.0
    axis = _axis(leg)
    start, end = _phase(i_0, axis), _phase(i_1, axis)
    slope = end - start
    away = slope * rise + _phase(legs.ripple[k, leg], axis)
    at_rise, at_fall, own = start + away, end - away, 0.0
    without_pulses = _driven(legs.u_s[k], legs.middle[k], legs.L_d, legs.L_q)
    low = slope / T_s - _phase(without_pulses, axis)  # A/s at the rise, with this leg low
    low_at_fall = low
    for other in range(3):
        rate = _phase(_driven(2.0 / 3.0 * _axis(other), legs.middle[k], legs.L_d, legs.L_q), axis)  # A/s per V
        if other == leg:
            own = rate
            continue
        lost = by_rise[other] + by_fall[other]
        apart = (rise - _rise(legs.duties[k, other])) * T_s  # s, since the other was told to rise, at the rise
        risen = min(by_rise[other], u_dc * max(apart, 0.0))
        fallen = max(by_fall[other], u_dc * min(apart, 0.0))
        at_rise += rate * (lost * rise - risen)
        at_fall += rate * (lost * (1.0 - rise) - by_rise[other] - fallen)
        # For which part of the dead time the other is high
        low += rate * (lost / T_s + u_dc * _share(apart + dead_time - by_rise[other] / u_dc, dead_time))
        low_at_fall += rate * (lost / T_s + u_dc * _share(apart - by_fall[other] / u_dc, dead_time))
    dead, dead_at_fall = min(on, dead_time), min(off, dead_time)
    least, most = -u_dc * dead_at_fall, u_dc * dead
    lost, risen, fallen = by_rise[leg] + by_fall[leg], 0.0, 0.0
    for _ in range(_STEPS):
        i, j = at_rise + own * rise * lost, own * lost / T_s
        risen = u_dc * (dead - _held_high(i, width, low + j, low + j + own * u_dc, dead))
        i = at_fall + own * ((1.0 - rise) * lost - risen)
        fallen = -u_dc * _held_high(i, width, low_at_fall + j, low_at_fall + j + own * u_dc, dead_at_fall)
        more = risen + fallen - lost
        if abs(more) < _CLOSE * u_dc * dead_time:
            break
        if more > 0.0:
            least = lost
        else:
            most = lost
        # Between the rails' currents a loss is in proportion to the current
        by_i = rise if 0.0 < risen < u_dc * dead else 0.0
        by_both = 1.0 - by_i - (1.0 - rise - by_i if -u_dc * dead_at_fall < fallen < 0.0 else 0.0)
        lost += more / by_both
        if not least < lost < most:
            lost = 0.5 * (least + most)
    return risen, fallen


@kernel
def _share(time: float, whole: float) -> float:
    return min(max(time / whole, 0.0), 1.0)


@kernel
def _held_high(i: float, width: float, low: float, high: float, dead: float) -> float:
    """Mean of `_high_for` over currents that spread by `width` (A), as noise and the legs' capacitance make them."""
    if abs(i) > _FAR * width + dead * max(abs(low), abs(high)):
        return _high_for(i, low, high, dead)
    away = _FAR * width
    ends = _high_for(i - away, low, high, dead) + _high_for(i + away, low, high, dead)
    return (4.0 * _high_for(i, low, high, dead) + ends) / 6.0


@kernel
def _high_for(i: float, low: float, high: float, dead: float) -> float:
    """Time (s) of a dead time in which a leg is high, or floats so far above low; its current i (A) at the begin.

    low, high: di/dt (A/s) with the leg at either rail.
    """
    floats = min(max(-low / (high - low), 0.0), 1.0)
    if i > 0.0:
        to_zero = i / -low if low < 0.0 else dead
        return max(dead - to_zero, 0.0) * floats
    to_zero = min(-i / high, dead) if high > 0.0 else dead
    return to_zero + (dead - to_zero) * floats


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
