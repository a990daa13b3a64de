"""Voltage that a bridge's legs lose in one control period, from the currents at its ends.

The equations of `inverter_voltage_error`, period by period, so that a simulation can ask for one. Where a current is
near zero at an edge, the period is followed from edge to edge, with what other effects add to the voltage in it: a
branch beside the machine lets currents change faster, a ladder's rung drops more of their change.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from estimator.arrays import Vector
from estimator.kernel import lean_kernel
from estimator.physics.bridge.drop_course import follow_drops
from estimator.physics.bridge.legs import Legs, bow_of, damping_of, moved_in
from estimator.physics.bridge.period_course import (
    Period,
    axis_of,
    course_between,
    cut,
    phase,
    rise_of,
    soft,
    still_dead,
    unlike,
    weight,
)  # fmt: skip

_MOST_MOVED = 1.5  # times what u_dc / L makes of a current in a dead time: no current moves more meanwhile
_NARROW = 0.06  # times the same: a spread of currents that does not matter
_LAST_SHOT = 0.003  # times the same: where the last shot may end
_LITTLE_LOST = 0.05  # of what the other one loses
SHOTS: Final = 12  # at a period's end, where it lies in a bend
_FIRST_OF_ALIKE = 1.0 - 1e-6  # as near: of two legs alike, the first


def lost_between(
    legs: Legs, begin: Vector, end: Vector, dead_time: float, u_drop: float, spread: float, knee: float
) -> Vector:  # fmt: skip
    """Voltage (V) that dead times and drops lose in each period, from currents (A) at its ends; all in the stationary
    frame.
    """
    lost = np.zeros(len(begin), np.complex128)
    _add_lost(lost, legs, begin, end, dead_time, u_drop, spread, knee)
    return lost


@lean_kernel
def _add_lost(
    lost: Vector, legs: Legs, begin: Vector, end: Vector, dead_time: float, u_drop: float, spread: float, knee: float
) -> None:  # fmt: skip
    for k in range(len(lost)):
        lost[k] = lost_in(legs, k, begin[k], end[k], dead_time, u_drop, spread, knee)


@lean_kernel
def lost_in(
    legs: Legs, k: int, i_0: complex, i_1: complex, dead_time: float, u_drop: float, spread: float, knee: float
) -> complex:  # fmt: skip
    """Voltage (V, stationary) that period k loses, for currents (A) at its ends that are known within a spread (A)."""
    drops, rails, _, _ = _by_drops(legs, k, i_0, i_1, dead_time, u_drop, knee)
    if len(legs.u_dc) == 0 or dead_time == 0.0:
        return drops + rails
    far, nearest, changes = _laid_out(legs, k, i_0, i_1, dead_time, u_drop, spread)
    if nearest < 0:
        return drops + rails + far
    apart, moves = 0j, moved_in(legs, k, dead_time)
    if _barely_bends(legs, k, dead_time, u_drop):
        apart, u_drop = drops, 0.0
    narrow = _NARROW * moves
    if spread <= narrow:
        return apart + rails + _between_edges(legs, k, i_0, i_1, u_drop, knee, changes, moves)
    # Currents spread, as noise makes them: the mean of two that have the spread beyond that
    off = math.sqrt(spread * spread - narrow * narrow) * axis_of(nearest)
    lower = _between_edges(legs, k, i_0 - off, i_1 - off, u_drop, knee, changes, moves)
    upper = _between_edges(legs, k, i_0 + off, i_1 + off, u_drop, knee, changes, moves)
    return apart + rails + 0.5 * (lower + upper)


@lean_kernel
def _barely_bends(legs: Legs, k: int, dead_time: float, u_drop: float) -> bool:
    """Drops, or what a dead time loses, are so little that neither bends the course by which the other acts."""
    drops, lost = u_drop * legs.T_s, dead_time * legs.u_dc[k]
    return drops < _LITTLE_LOST * lost or lost < _LITTLE_LOST * drops


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
    drops, rails, by_real, by_imag = _by_drops(legs, k, i_0, i_1, dead_time, u_drop, knee)
    volts, settled = drops + rails, True
    if dead_time != 0.0 and len(legs.u_dc) > 0:
        far, nearest, changes = _laid_out(legs, k, i_0, i_1, dead_time, u_drop, 0.0)
        if nearest < 0:
            volts += far
        else:
            apart, of_drops = 0j, (0j, 0j)
            if _barely_bends(legs, k, dead_time, u_drop):
                apart, u_drop, of_drops = drops, 0.0, (by_real, by_imag)
            close, full = _LAST_SHOT * moved_in(legs, k, dead_time), 2.0 / 3.0 * legs.u_dc[k]
            last = course_between(_period(legs, k, u_drop, knee), i_0, i_1, beside, shots, close, changes, legs.room)
            volts = apart + rails + full * (_ideal(legs, k) - last.held)
            by_real, by_imag = of_drops[0] - full * last.held_real, of_drops[1] - full * last.held_imag
            beside, settled = last.beside, abs(last.step) * legs.T_s < close
    return Loss(volts, by_real, by_imag, beside, settled)


@lean_kernel
def _by_drops(
    legs: Legs, k: int, i_0: complex, i_1: complex, dead_time: float, u_drop: float, knee: float
) -> tuple[complex, complex, complex, complex]:  # fmt: skip
    """Lost voltage (V, stationary) of drops, that of the dead time of legs that come to stay high, and slopes (ohm).

    Slopes by the real and imaginary part of the current at the end.
    """
    lost, rails, by_real, by_imag, moment = 0j, 0j, 0j, 0j, 0j
    known = len(legs.u_dc) > 0
    if known and u_drop != 0.0:
        follow_drops(legs, k, i_0, i_1, dead_time, u_drop, knee)
    for leg in range(3):
        axis, volts, by_end = axis_of(leg), 0.0, 0.0
        if not known:
            start, end = phase(i_0, axis), phase(i_1, axis)
            soft_end = soft(end, knee)
            volts = 0.5 * (start / soft(start, knee) + end / soft_end)
            by_end = 0.5 * knee * knee / (soft_end * soft_end * soft_end)
        elif u_drop != 0.0:
            volts, by_end, late = legs.room.drops.loss[leg]
            moment += axis * (u_drop * late)
        lost += axis * (u_drop * volts)
        by_real += axis * (u_drop * by_end * axis.real)
        by_imag += axis * (u_drop * by_end * axis.imag)
        if known and legs.duties[k, leg] >= 1.0 > legs.before[k, leg]:  # a leg that stays high rises at the start
            start = phase(i_0, axis)
            rails += axis * (legs.u_dc[k] / legs.T_s * 0.5 * dead_time * (1.0 + start / soft(start, knee)))
    lost += unlike(legs.R_s * legs.T_s, legs.b[k], legs.middle[k], moment)
    return 2.0 / 3.0 * lost, 2.0 / 3.0 * rails, 2.0 / 3.0 * by_real, 2.0 / 3.0 * by_imag


@lean_kernel
def _laid_out(
    legs: Legs, k: int, i_0: complex, i_1: complex, dead_time: float, u_drop: float, spread: float
) -> tuple[complex, int, int]:
    """Lost voltage (V, stationary) where each edge's diode is known, and -1; else the leg whose current is nearest zero
    at an edge, and how often switches change on the period's course. Beside drops the room has the currents at edges.
    """
    u_dc, T_s, room, lost, moment, nearest, closest = legs.u_dc[k], legs.T_s, legs.room, 0j, 0j, 0, math.inf
    near = _MOST_MOVED * moved_in(legs, k, dead_time) + spread
    bow = bow_of(legs, k)
    damping, dead = damping_of(legs, k), dead_time / T_s
    for leg in range(3):
        axis, rise = axis_of(leg), rise_of(legs.duties[k, leg])
        bowed = phase(bow, axis) * 4.0 * rise * (1.0 - rise)
        start, end = phase(i_0, axis) + bowed, phase(i_1, axis) + bowed
        away = (end - start) * rise + phase(legs.ripple[k, leg], axis)
        at_rise, at_fall, at_last = start + away, end - away, start - away
        if u_drop != 0.0:
            at_rise, at_fall = room.drops.edge[leg, 0], room.drops.edge[leg, 1]
        left = still_dead(legs.before[k, leg], dead)
        close = min(abs(at_rise), abs(at_fall), abs(at_last) if left > 0.0 else math.inf)
        if close < _FIRST_OF_ALIKE * closest:
            nearest, closest = leg, close
        room.out[leg, 0] = 0 if abs(at_rise) < near else 1 if at_rise > 0.0 else -1
        room.out[leg, 1] = 0 if abs(at_fall) < near else 1 if at_fall > 0.0 else -1
        room.out[leg, 2] = 0 if abs(at_last) < near else 1 if at_last > 0.0 else -1
        full = 2.0 / 3.0 * u_dc * axis
        if 0.0 < rise < 0.5 and at_rise > 0.0:
            span = min(1.0 - 2.0 * rise, dead)
            volts, late = _pulse(damping, rise + 0.5 * span, span)
            lost += full * volts
            moment += full * late
        if 0.0 < rise < 0.5 and at_fall < 0.0:
            span = min(dead, rise)
            volts, late = _pulse(damping, 1.0 - rise + 0.5 * span, span)
            lost -= full * volts
            moment -= full * late
        if at_last < 0.0:
            span = min(left, rise)
            volts, late = _pulse(damping, 0.5 * span, span)
            lost -= full * volts
            moment -= full * late
    lost += unlike(legs.R_s * T_s, legs.b[k], legs.middle[k], moment)
    if closest >= near:
        return lost, -1, 0
    return lost, nearest, cut(legs.duties[k], legs.before[k], dead_time, T_s, room)


@lean_kernel
def _pulse(damping: float, part: float, span: float) -> tuple[float, float]:
    """What the link's voltage lost over a span around a part of the period counts as, and its first moment."""
    return span * weight(damping, part, span), span * (part - 0.5)


@lean_kernel
def _between_edges(
    legs: Legs, k: int, i_0: complex, i_1: complex, u_drop: float, knee: float, changes: int, moves: float
) -> complex:  # fmt: skip
    """Lost voltage (V, stationary) of a period that takes the current from one end to the other."""
    last = course_between(_period(legs, k, u_drop, knee), i_0, i_1, 0j, SHOTS, _LAST_SHOT * moves, changes, legs.room)
    return 2.0 / 3.0 * legs.u_dc[k] * (_ideal(legs, k) - last.held)


@lean_kernel
def _period(legs: Legs, k: int, u_drop: float, knee: float) -> Period:
    return Period(
        legs.u_dc[k], legs.T_s, legs.R_s, legs.a[k], legs.b[k], legs.psi_0[k], legs.others[k], legs.change[k],
        legs.D[k], legs.middle[k], u_drop, knee,
    )


@lean_kernel
def _ideal(legs: Legs, k: int) -> complex:
    """How high the legs are commanded to be held on average, along their axes and by `weight`."""
    ideal, damping = 0j, damping_of(legs, k)
    for leg in range(3):
        duty = min(max(legs.duties[k, leg], 0.0), 1.0)
        ideal += duty * weight(damping, 0.5, duty) * axis_of(leg)
    return ideal
