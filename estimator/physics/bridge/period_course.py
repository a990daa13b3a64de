"""The course of one control period: currents followed from edge to edge through the bridge's dead times.

Both switches of a leg are off for the dead time, its current flows on through a diode until it is zero, and then the
leg floats. Derived here.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array
from estimator.kernel import lean_kernel
from estimator.physics.vectors import AXES

A, B, C = AXES
_NO_SWITCH = 2  # of a leg's switches is on
_DRAWN = 1.0  # of what the end says at best, to what the machine's parameters say
_STEP_BACK = 0.2  # of a step, that the next one may lead back where nothing bends: slopes are not exact
_CHANGES = 4  # of sign between two edges at most
_SETTLES = 8  # passes over legs that float together
_ROUNDED_CURRENT = 1e-12  # of what the link's voltage makes of a current in a period
_KNEES_FAR = 20.0  # knees, from which on a drop is nearly whole
_KNEES_FLAT = 8.0  # knees, from which on it hardly changes
_EVEN_DROP = 2e-4  # of a drop, by which it may change along a piece unseen
_SHORT_PIECE = 1e-3  # of what the current changes by, that the resistive drop's own change may take unseen, twice


class Drops(NamedTuple):
    """What drops do in a period, all three legs together."""

    sign: Array  # (3, 4, 2) mean of each phase current's sign between edges, from the period's start and from its end
    varies: Array  # (3,) by how much in the period
    mean: Array  # (3,) over the period
    loss: Array  # (3, 3) the same as what is lost at the end counts, its slope, 1/A, and its first moment
    change: Array  # (3, 4, 2) of the sign itself, from edge to edge
    arc: NDArray[np.complex128]  # (4, 2) A, stationary: mean of how far drops bend the current between these edges
    ahead: NDArray[np.complex128]  # (4, 2) A: how far drops bend it at these edges
    late: Array  # (4,) share of the period at which the legs rise, in order, and its middle
    edge: Array  # (3, 2) A, each leg's current as it rises and falls, by drops
    shift: NDArray[np.complex128]  # (4, 2) A, stationary: how far dead times shift it at these edges
    jump: NDArray[np.complex128]  # (4, 2) A: and how much farther on an edge's other side


class Pieces(NamedTuple):
    """What drives the current from one change of switches to the next, whatever it is: (16,) each."""

    of_mirrored: NDArray[np.complex128]  # A/s that it falls, by its mirror image, A
    steady: NDArray[np.complex128]  # A/s that it falls besides
    twice: NDArray[np.complex128]  # 1/H, by the mirror image of a voltage


class Room(NamedTuple):
    """Room to work in, for a period."""

    out: NDArray[np.int8]  # (3, 3): of each leg as it rises, falls and last fell, 1 where its current surely flows out,
    # -1 into it
    first: NDArray[np.int8]  # (3,): of each leg's switches on at the begin, 0 the lower, 1 the upper, 2 none
    moments: Array  # (15,) s, where switches change, in order
    whose: NDArray[np.int8]  # (15,): the leg
    to: NDArray[np.int8]  # (15,)
    high: Array  # (3,) what share of the link's voltage each leg has
    free: NDArray[np.bool_]  # (3,) none of its switches is on
    zero: NDArray[np.bool_]  # (3,) nor is a diode: its current has come to zero
    drops: Drops
    pieces: Pieces


class Period(NamedTuple):
    """What drives the current in one control period."""

    u_dc: float  # V
    T_s: float  # s
    R_s: float  # ohm
    a: float  # 1/H, stiffness of straight lines: see `rows.Stiffness`
    b: complex  # 1/H, rotor frame
    psi_0: complex  # Vs, rotor frame, at no current of these straight lines
    others: complex  # V, stationary, what other effects add
    change: complex  # V, by which that changes in the period
    D: float  # rad, electrical, by which the rotor turns
    middle: complex  # exp(j theta_e) in the middle
    u_drop: float  # V
    knee: float  # A, below which it softens


def empty_room() -> Room:
    legs, changes, flags = np.empty(3, np.int8), np.empty(15, np.int8), np.zeros(3, np.bool_)
    out, moments = np.zeros((3, 3), np.int8), np.empty(15)
    arc, ahead, shift, jump = np.empty((4, 4, 2), np.complex128)
    drops = Drops(
        np.empty((3, 4, 2)), np.empty(3), np.zeros(3), np.empty((3, 3)), np.empty((3, 4, 2)), arc, ahead, np.empty(4),
        np.empty((3, 2)), shift, jump,
    )  # fmt: skip
    pieces = Pieces(*np.empty((3, 16), np.complex128))
    return Room(out, legs, moments, changes, changes.copy(), np.empty(3), flags, flags.copy(), drops, pieces)


@lean_kernel
def still_dead(before: float, dead: float) -> float:
    """How much of a dead time is left of the period before, whose duty is given, where a leg begins low; as shares of a
    period. A leg that stayed high falls only now.
    """
    return max(dead - rise_of(before), 0.0) if before < 1.0 else dead


@lean_kernel
def cut(duties: Array, before: Array, dead_time: float, T_s: float, room: Room) -> int:
    """Put in order where switches change, and say how often.

    Of a leg whose current surely flows out, the diode that goes on is the lower one, as if its lower switch were on;
    into it, the upper one.
    """
    count = 0
    for leg in range(3):
        duty = duties[leg]
        room.first[leg] = 1 if duty >= 1.0 else 0
        if duty >= 1.0:
            continue
        rise, (at_rise, at_fall, at_last) = rise_of(duty) * T_s, room.out[leg]
        fall, dead = T_s - rise, still_dead(before[leg], dead_time / T_s) * T_s
        if dead > 0.0 and at_last <= 0:
            room.first[leg] = _NO_SWITCH if at_last == 0 else 1
            if dead < rise:
                count = _put(room, count, dead, leg, 0)
        if duty <= 0.0:
            continue
        if at_rise == 0:
            count = _put(room, count, rise, leg, _NO_SWITCH)
        if at_rise < 0:
            count = _put(room, count, rise, leg, 1)
        elif rise + dead_time < fall:
            count = _put(room, count, rise + dead_time, leg, 1)
        if at_fall == 0:
            count = _put(room, count, fall, leg, _NO_SWITCH)
        if at_fall > 0:
            count = _put(room, count, fall, leg, 0)
        elif fall + dead_time < T_s:
            count = _put(room, count, fall + dead_time, leg, 0)
    return count


@lean_kernel
def _put(room: Room, count: int, t: float, leg: int, to: int) -> int:
    place = count
    while place > 0 and room.moments[place - 1] > t:
        room.moments[place], room.whose[place] = room.moments[place - 1], room.whose[place - 1]
        room.to[place] = room.to[place - 1]
        place -= 1
    room.moments[place], room.whose[place], room.to[place] = t, leg, to
    return count + 1


class Shot(NamedTuple):
    """A period that takes the current to an end, nearly."""

    held: complex  # how high the legs are held on average, along their axes
    held_real: complex  # 1/A, its slope by the real part of the current (stationary) at the end
    held_imag: complex  # 1/A
    beside: complex  # A/s that the current falls beside what the machine's parameters say
    step: complex  # A/s, by which that has changed at last
    longest: float  # A/s, that such a change may be


@lean_kernel
def course_between(
    period: Period, i_0: complex, i_1: complex, beside: complex, shots: int, close: float, changes: int, room: Room
) -> Shot:  # fmt: skip
    """The course that takes the current (A, stationary) from one end to the other, after so many shots at most.

    By the machine's parameters, and as much beside them (one constant voltage) as lets it end where it does: of that
    the end often says little, so it is drawn towards none. close: A, by which the last shot may move the end.
    """
    last = Shot(0j, 0j, 0j, beside, 0j, math.inf)
    _lay(period, changes, room)
    for _ in range(shots):
        last = _shot(period, i_0, i_1, last, changes, room)
        if abs(last.step) * period.T_s < close:
            break
    return last


@lean_kernel
def _shot(period: Period, i_0: complex, i_1: complex, last: Shot, changes: int, room: Room) -> Shot:
    """A step of Newton's method. The course is nearly straight from one change of sign to the next: what is sought
    may lie where it bends, so from the first step that leads back on they halve.
    """
    end, by_real, by_imag, held, held_real, held_imag = _course_of_period(period, i_0, last.beside, changes, room)
    off, least = i_1 - end, _DRAWN * period.T_s**2
    xx, yy, xy = phase(by_real, by_real) + least, phase(by_imag, by_imag) + least, phase(by_real, by_imag)
    over = 1.0 / (xx * yy - xy * xy)
    x, y = phase(by_real, off) - least * last.beside.real, phase(by_imag, off) - least * last.beside.imag
    step, longest = complex((x * yy - y * xy) * over, (y * xx - x * xy) * over), last.longest
    if phase(step, last.step) < -_STEP_BACK * abs(last.step) * abs(last.step):
        longest = min(longest, abs(last.step))
    if longest < math.inf:
        longest *= 0.5
        if abs(step) > longest:
            step *= longest / abs(step)
    x, y = by_real.real, by_imag.real
    along_real = ((x * yy - y * xy) * over) * held_real + ((y * xx - x * xy) * over) * held_imag
    x, y = by_real.imag, by_imag.imag
    along_imag = ((x * yy - y * xy) * over) * held_real + ((y * xx - x * xy) * over) * held_imag
    held += held_real * step.real + held_imag * step.imag
    return Shot(held, along_real, along_imag, last.beside + step, step, longest)


@lean_kernel
def _course_of_period(  # noqa: PLR0912, PLR0915 - in pieces that share arrays it takes twice as long
    period: Period, i: complex, beside: complex, changes: int, room: Room
) -> tuple[complex, complex, complex, complex, complex, complex]:  # fmt: skip
    """The current (A, stationary) at a period's end, its slopes by the real and imaginary part of `beside` (s), how
    high the legs are held on average, along their axes and by `weight`, and its slopes without weights (s/A).

    In a dead time a current out of the leg flows on through the lower diode, one into it through the upper, and where
    it has come to zero the leg floats on the voltage that keeps it there. beside: A/s that the current falls beside
    what the machine's parameters say.
    """
    T_s, high, free, zero, pieces = period.T_s, room.high, room.free, room.zero, room.pieces
    alike, per_T, of_i = period.a, 1.0 / T_s, _falls_by_itself(period)[0]
    full, damping, loose, knee = 2.0 / 3.0 * period.u_dc, period.R_s * T_s * alike, 0, period.knee
    part_lost = period.u_drop / period.u_dc
    by_real, by_imag, held, held_real, held_imag, moment, t = 0j, 0j, 0j, 0j, 0j, 0j, 0.0
    none = _ROUNDED_CURRENT * full * alike * T_s
    for leg in range(3):
        to = room.first[leg]
        free[leg], zero[leg], high[leg] = to == _NO_SWITCH, False, float(to)
        loose += to == _NO_SWITCH
    for change in range(changes + 1):
        until = room.moments[change] if change < changes else T_s
        if until > t:
            by_mirrored, by_turning = pieces.of_mirrored[change], pieces.steady[change] + beside
            twice = pieces.twice[change]
            was, was_held, crossed, crossed_real, crossed_imag = 0j, 0j, False, 0.0, 0.0
            for n in range(_CHANGES + 1):
                span, first, floats = until - t, -1, 0
                falls = of_i * i + by_mirrored * i.conjugate() + by_turning
                more_real, more_imag, level_real, level_imag, drops = -1.0 + 0j, -1j, 0j, 0j, 0j
                if loose > 0:
                    for leg in range(3):
                        if free[leg]:
                            current = phase(i, axis_of(leg))
                            high[leg] = -part_lost if current > 0.0 else 1.0 + part_lost
                            zero[leg] = zero[leg] or abs(current) < none
                            floats += zero[leg]
                if part_lost != 0.0:
                    level = high[0] * A + high[1] * B + high[2] * C
                    undropped = full * (alike * level + twice * level.conjugate()) - falls
                    drops, ahead = _drops_along(
                        i, span, undropped, part_lost, knee, full, alike, twice, free
                    )
                    falls += full * (alike * drops + twice * drops.conjugate())
                    middle = 0.5 * (i + ahead)
                    level_real = -part_lost * _along_slopes(middle, by_real, knee, free)
                    level_imag = -part_lost * _along_slopes(middle, by_imag, knee, free)
                    more_real += full * (alike * level_real + twice * level_real.conjugate())
                    more_imag += full * (alike * level_imag + twice * level_imag.conjugate())
                if floats > 0:
                    _float(high, zero, full, part_lost, alike, twice, falls)
                    floats = int(zero[0]) + int(zero[1]) + int(zero[2])
                level = high[0] * A + high[1] * B + high[2] * C
                rate = full * (alike * level + twice * level.conjugate()) - falls
                if span * damping > _SHORT_PIECE * T_s:  # by the mean current
                    way = (span / 3.0) * rate
                    way = 0.5 * span * (rate - of_i * way - by_mirrored * way.conjugate())
                    rate -= of_i * way + by_mirrored * way.conjugate()
                if loose > 0:
                    if floats == 1:
                        axis = axis_of(0 if zero[0] else 1 if zero[1] else 2)
                        drives = alike * axis + twice * axis.conjugate()
                        own = (1.0 / phase(drives, axis)) * drives
                        lifts = (1.0 / (full * phase(drives, axis))) * axis
                        along_real, along_imag = phase(more_real, axis), phase(more_imag, axis)
                        more_real -= own * along_real
                        more_imag -= own * along_imag
                        level_real -= lifts * along_real
                        level_imag -= lifts * along_imag
                    elif floats > 1:
                        rate, drops, more_real, more_imag, level_real, level_imag = 0j, 0j, 0j, 0j, 0j, 0j
                    if crossed:  # when that is, shifts too
                        by_real += (was - rate) * crossed_real
                        by_imag += (was - rate) * crossed_imag
                        held_real += (was_held - level + drops) * crossed_real
                        held_imag += (was_held - level + drops) * crossed_imag
                    for leg in range(3):
                        if free[leg] and not zero[leg]:
                            current, fall = phase(i, axis_of(leg)), -phase(rate, axis_of(leg))
                            if current * fall > 0.0 and current / fall < span and abs(current) >= none and n < _CHANGES:
                                span, first = current / fall, leg
                part = (t + 0.5 * span) * per_T
                kept = level - drops
                held += kept * (span * weight(damping, part, span * per_T))
                moment += kept * (span * (part - 0.5))
                held_real += level_real * span
                held_imag += level_imag * span
                i += rate * span
                by_real += more_real * span
                by_imag += more_imag * span
                t, crossed = t + span, first >= 0
                if not crossed:
                    break
                was, was_held, zero[first], fall = rate, kept, True, -phase(rate, axis_of(first))
                crossed_real = phase(by_real, axis_of(first)) / fall
                crossed_imag = phase(by_imag, axis_of(first)) / fall
            t = until
        if change < changes:
            leg, to = room.whose[change], room.to[change]
            loose += int(to == _NO_SWITCH) - int(free[leg])
            free[leg], zero[leg], high[leg] = to == _NO_SWITCH, False, float(to)
    held += unlike(period.R_s * T_s, period.b, period.middle, moment)
    return i, by_real, by_imag, per_T * held, per_T * held_real, per_T * held_imag


@lean_kernel
def _lay(period: Period, changes: int, room: Room) -> None:
    """Put in the room what drives the current in each piece, as the rotor stands in its middle."""
    (_, of_mirrored, of_magnets), pieces, t = _falls_by_itself(period), room.pieces, 0.0
    for change in range(changes + 1):
        until = room.moments[change] if change < changes else period.T_s
        late = 0.5 * (t + until) / period.T_s - 0.5
        turned, others = period.D * late, period.others + late * period.change
        rotor = period.middle * complex(1.0 - 0.5 * turned * turned, turned)
        square = rotor * rotor
        twice = period.b * square
        pieces.of_mirrored[change], pieces.twice[change] = of_mirrored * square, twice
        pieces.steady[change] = of_magnets * rotor + period.a * others + twice * others.conjugate()
        t = until


@lean_kernel
def _drops_along(
    i: complex, span: float, undropped: complex, drop: float, knee: float, full: float, alike: float,
    twice: complex, free: NDArray[np.bool_],
) -> tuple[complex, complex]:  # fmt: skip
    """Mean drops over a span (s) of a current (A, stationary) that changes by `undropped` (A/s) without them, over the
    link's voltage, and the current at its end.

    First straight on, then by the drops of that, then on a course that bows as drops change along it.
    """
    here = _softs(i, knee)
    begun = drop * _signs_between(i, here, i, here, free)
    first = full * (alike * begun + twice * begun.conjugate())
    ahead = i + span * (undropped - first)
    there = _softs(ahead, knee)
    drops = drop * _signs_between(i, here, ahead, there, free)
    if abs(drops - begun) < _EVEN_DROP * drop:
        return drops, ahead
    ahead = i + span * (undropped - full * (alike * drops + twice * drops.conjugate()))
    there = _softs(ahead, knee)
    drops = drop * _signs_between(ahead, there, ahead, there, free)
    bowed = 0.5 * (i + ahead) + 0.125 * span * (full * (alike * drops + twice * drops.conjugate()) - first)
    between = _softs(bowed, knee)
    drops = 0.5 * drop * (
        _signs_between(i, here, bowed, between, free) + _signs_between(bowed, between, ahead, there, free)
    )
    return drops, i + span * (undropped - full * (alike * drops + twice * drops.conjugate()))


@lean_kernel
def _softs(i: complex, knee: float) -> tuple[float, float, float]:
    return _soft(phase(i, A), knee), _soft(phase(i, B), knee), _soft(phase(i, C), knee)


@lean_kernel
def soft(i: float, knee: float) -> float:
    """A current's size (A), softened near zero: drops are i over it."""
    return math.sqrt(i * i + knee * knee)


@lean_kernel
def _soft(current: float, knee: float) -> float:
    """A softened size as `soft` has it (A), worked out sooner where the current is far from zero."""
    size = abs(current)
    return size + 0.5 * knee * knee / size if size > _KNEES_FAR * knee else soft(size, knee)


@lean_kernel
def _signs_between(
    i_0: complex, soft_0: tuple[float, float, float], i_1: complex, soft_1: tuple[float, float, float],
    free: NDArray[np.bool_],
) -> complex:  # fmt: skip
    """Mean signs of the phase currents between two (A, stationary) on a straight course, along the axes of legs that
    are not free.
    """
    both, signs = i_0 + i_1, 0j
    if not free[0]:
        signs += A * (phase(both, A) / (soft_0[0] + soft_1[0]))
    if not free[1]:
        signs += B * (phase(both, B) / (soft_0[1] + soft_1[1]))
    if not free[2]:
        signs += C * (phase(both, C) / (soft_0[2] + soft_1[2]))
    return signs


@lean_kernel
def _along_slopes(i: complex, step: complex, knee: float, free: NDArray[np.bool_]) -> complex:
    """What these signs at a current (A, stationary) change by in a small step of it."""
    change = 0j
    for leg in range(3):
        axis = axis_of(leg)
        current = phase(i, axis)
        if not free[leg] and abs(current) < _KNEES_FLAT * knee:
            square = current * current + knee * knee
            change += axis * (phase(step, axis) * knee * knee / (square * math.sqrt(square)))
    return change


@lean_kernel
def _falls_by_itself(period: Period) -> tuple[complex, complex, complex]:
    """How fast the resistance and the induced voltage let a current (A, stationary) fall, A/s: what multiplies it, its
    mirror image times the rotor's direction squared, and that direction.
    """
    a, b, omega, psi_0 = period.a, period.b, period.D / period.T_s, period.psi_0
    saliency = -2.0 / (a * a - b.real * b.real - b.imag * b.imag) * b  # L_d - L_q, where the axes are apart
    of_i = complex(a * period.R_s, -omega * (b.real * saliency.real + b.imag * saliency.imag))
    of_mirrored = (1j * omega * a) * saliency + period.R_s * b
    return of_i, of_mirrored, (1j * omega) * (a * psi_0 - b * psi_0.conjugate())


@lean_kernel
def _float(
    high: Array, zero: NDArray[np.bool_], full: float, beyond: float, alike: float, twice: complex, falls: complex
) -> None:  # fmt: skip
    """Set legs that float so that their currents stay zero; those that a diode `beyond` a rail holds, float no more."""
    for leg in range(3):
        high[leg] = 0.5 if zero[leg] else high[leg]
    for _ in range(_SETTLES if int(zero[0]) + int(zero[1]) + int(zero[2]) > 1 else 1):
        for leg in range(3):
            if zero[leg]:
                axis, level = axis_of(leg), high[0] * A + high[1] * B + high[2] * C
                rate = full * (alike * level + twice * level.conjugate()) - falls
                drives = full * (alike * axis + twice * axis.conjugate())
                high[leg] = min(max(high[leg] - phase(rate, axis) / phase(drives, axis), -beyond), 1.0 + beyond)
    for leg in range(3):
        zero[leg] = zero[leg] and -beyond < high[leg] < 1.0 + beyond


@lean_kernel
def weight(damping: float, part: float, span: float) -> float:
    """What a voltage lost over a span of the period, around that part of it, counts as, for who knows the currents at
    both ends.

    One lost early lowers the current for longer, and by that the winding's resistive drop: at x after the middle it
    counts exp(x d) exp(-d/2) (1 + d/2 + d^2/12), as means of the current come from both ends and slopes there; to the
    third power of the damping d = R_s T_s / L.
    """
    late, square = damping * (part - 0.5), damping * damping / 24.0
    return 1.0 + late * (1.0 + late * (0.5 + late / 6.0)) + ((1.0 + late) * span * span - 1.0) * square


@lean_kernel
def unlike(R_s_T_s: float, b: complex, middle: complex, moment: complex) -> complex:
    """What `weight` leaves out where damping is not the same on both axes, of the first moment (shares of the period)
    of what is lost; both in the stationary frame.
    """
    return R_s_T_s * (b * middle * middle) * moment.conjugate()


@lean_kernel
def axis_of(leg: int) -> complex:
    return A if leg == 0 else B if leg == 1 else C


@lean_kernel
def phase(i: complex, axis: complex) -> float:
    return i.real * axis.real + i.imag * axis.imag


@lean_kernel
def rise_of(duty: float) -> float:
    """When a leg rises, as a share of the period; it falls at 1 less that."""
    return 0.5 * (1.0 - duty)
