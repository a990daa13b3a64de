"""Drops of transistors and diodes over a control period: the mean sign of each phase current, along its course.

u_drop i / sqrt(i^2 + knee^2) is a resistance of many ohm near zero. While it is less than its mean the current gets
ahead, by which it passes zero at another moment; all three phases do so together. And dead times shift the currents
after each edge. Derived here: piece by piece between the legs' edges, from both ends to the middle, and again by what
was found.
"""

from estimator.kernel import lean_kernel
from estimator.physics.bridge.legs import Legs, bow_of, damping_of, moved_in
from estimator.physics.bridge.period_course import Drops, axis_of, phase, rise_of, soft, weight

_COURSES = 4  # times that a course is followed
_STRAIGHT = 5e-3  # of a knee, by which drops may bend a course unseen
_SAME_MEAN = 1e-3  # of a drop, by which another course may change its mean unseen
_OF_ARC = 1.0 / 12.0  # of what a slope's change along a piece adds up to: the arc's mean above its chord
_KNEES_AWAY = 3.0  # knees, from which on a drop is nearly whole
_TAKEN_BACK = 0.2  # of a knee, that what bends a current by a knee takes back in the next course


@lean_kernel
def follow_drops(
    legs: Legs, k: int, i_0: complex, i_1: complex, dead_time: float, u_drop: float, knee: float
) -> None:  # fmt: skip
    """Put in the room what drops do in period k, and how it changes with the currents at the end.

    Near zero a drop bends the course of its current: while it is less than its mean, the current gets ahead. And dead
    times shift it after each edge. So the course is followed again by what was found.
    """
    drops, bends = legs.room.drops, 2.0 / 3.0 * u_drop * legs.T_s  # Vs
    bow, damping = bow_of(legs, k), damping_of(legs, k)
    jolt, moves = 2.0 / 3.0 * legs.u_dc[k] * dead_time, moved_in(legs, k, dead_time)  # Vs, A
    strength = abs(bends) * (legs.a[k] + abs(legs.b[k])) / knee
    near, reach = 1.0 / (1.0 + _TAKEN_BACK * strength), moves + _KNEES_AWAY * knee if jolt > 0.0 else 0.0
    for course in range(_COURSES):
        changes = 0.0
        for leg in range(3):
            if course == 0 or strength * drops.varies[leg] * drops.varies[leg] > _STRAIGHT:
                before = drops.mean[leg]
                _mean_signs(legs, k, leg, i_0, i_1, knee, reach, bow, damping, course > 0)
                changes = max(changes, abs(drops.mean[leg] - before))
        most = max(drops.varies[0], drops.varies[1], drops.varies[2])
        if strength * most * most < _STRAIGHT or (course > 0 and changes < _SAME_MEAN) or course == _COURSES - 1:
            break
        if course == 0:
            _none_of(drops)
        if jolt > 0.0:
            _shift(legs, k, jolt, moves)
        _bend(legs, k, bends, near)


@lean_kernel
def _bend(legs: Legs, k: int, bends: float, near: float) -> None:
    """Move what the room has of how far drops bend the current, at edges and between them, `near` of the way to what
    these signs make of it. bends: Vs, of a drop over a period.
    """
    drops, early, up, down = legs.room.drops, 0.0, 0j, 0j
    alike, twice = legs.a[k], legs.b[k] * legs.middle[k] * legs.middle[k]
    for part in range(4):
        late, more_up, more_down = drops.late[part], 0j, 0j
        for leg in range(3):
            axis = (bends * (late - early)) * axis_of(leg)
            up -= axis * (drops.sign[leg, part, 0] - drops.mean[leg])
            down += axis * (drops.sign[leg, part, 1] - drops.mean[leg])
            more_up += axis * (_OF_ARC * drops.change[leg, part, 0])
            more_down -= axis * (_OF_ARC * drops.change[leg, part, 1])
        drops.ahead[part, 0] += near * (alike * up + twice * up.conjugate() - drops.ahead[part, 0])
        drops.ahead[part, 1] += near * (alike * down + twice * down.conjugate() - drops.ahead[part, 1])
        drops.arc[part, 0] += near * (alike * more_up + twice * more_up.conjugate() - drops.arc[part, 0])
        drops.arc[part, 1] += near * (alike * more_down + twice * more_down.conjugate() - drops.arc[part, 1])
        early = late


@lean_kernel
def _shift(legs: Legs, k: int, jolt: float, moves: float) -> None:
    """Put in the room how far dead times shift the current at edges, and how much farther after them.

    A leg rises late where its current flows out, and falls late where it flows into it: each shifts the flux linkage by
    `jolt` (Vs); and all that is made up for evenly, as the end is known. moves: A, what a dead time makes of a current
    that comes to zero in it.
    """
    drops, whole = legs.room.drops, 0j
    alike, twice = legs.a[k], legs.b[k] * legs.middle[k] * legs.middle[k]
    for part in range(3):
        leg = legs.order[k, part]
        axis = jolt * axis_of(leg) if 0.0 < drops.late[part] < 0.5 else 0j
        by_axis, out, into = alike * axis + twice * axis.conjugate(), drops.edge[leg, 0], -drops.edge[leg, 1]
        drops.jump[part, 0] = -0.5 * (1.0 + out / soft(out, moves)) * by_axis
        drops.jump[part, 1] = -0.5 * (1.0 + into / soft(into, moves)) * by_axis
        whole += drops.jump[part, 0] - drops.jump[part, 1]
    up, down = 0j, 0j
    for part in range(4):
        drops.shift[part, 0], drops.shift[part, 1] = up - drops.late[part] * whole, down + drops.late[part] * whole
        up, down = up + drops.jump[part, 0], down + drops.jump[part, 1]


@lean_kernel
def _none_of(drops: Drops) -> None:
    """Nothing bends the course yet."""
    for part in range(4):
        for side in range(2):
            drops.ahead[part, side], drops.arc[part, side] = 0j, 0j
            drops.shift[part, side], drops.jump[part, side] = 0j, 0j


@lean_kernel
def _mean_signs(
    legs: Legs, k: int, leg: int, i_0: complex, i_1: complex, knee: float, reach: float, bow_s: complex, damping: float,
    bent: bool,
) -> None:  # fmt: skip
    """Put in the room a phase current's mean sign, between edges and over the period, also as `weight` has it, and the
    slope (1/A) of that by the current at the end; and how much it varies.

    From both ends to the middle. `bent`: as the room says. reach: A, from which on dead times bring no current to zero;
    one that is nearer counts as one that varies by all it can.
    """
    axis, drops = axis_of(leg), legs.room.drops
    start, end, bow = phase(i_0, axis), phase(i_1, axis), phase(bow_s, axis)
    slope, early, least, most = end - start, 0.0, 1.0, -1.0
    mean, volts, by_end, moment, nearest = 0.0, 0.0, 0.0, 0.0, min(abs(start), abs(end))
    was_up, was_down, soft_was_up, soft_was_down = start, end, soft(start, knee), soft(end, knee)
    sign_was_up, sign_was_down = start / soft_was_up, end / soft_was_down
    for part in range(4):
        late, away = 0.5, 0.0
        if part < 3:
            other = legs.order[k, part]
            late, away = rise_of(legs.duties[k, other]), phase(legs.ripple[k, other], axis)
        bowed = bow * 4.0 * late * (1.0 - late)
        up, down = start + slope * late + away + bowed, end - slope * late - away + bowed
        if bent:
            up, down = up + phase(drops.ahead[part, 0], axis), down + phase(drops.ahead[part, 1], axis)
        drops.late[part] = late
        if part < 3 and legs.order[k, part] == leg:
            drops.edge[leg, 0], drops.edge[leg, 1] = up, down
        if bent:
            up, down = up + phase(drops.shift[part, 0], axis), down + phase(drops.shift[part, 1], axis)
        soft_up, soft_down = soft(up, knee), soft(down, knee)
        sign_up, sign_down = up / soft_up, down / soft_down
        over_up, over_down = 1.0 / (soft_was_up + soft_up), 1.0 / (soft_was_down + soft_down)
        mean_up, mean_down = (was_up + up) * over_up, (was_down + down) * over_down
        # of neither where the other end is: the ends move by the share of the period that is behind them
        by_up = early * (1.0 - mean_up * sign_was_up) + late * (1.0 - mean_up * sign_up)
        by_down = (1.0 - early) * (1.0 - mean_down * sign_was_down) + (1.0 - late) * (1.0 - mean_down * sign_down)
        if bent:
            mean_up += phase(drops.arc[part, 0], axis) * _rise(sign_up - sign_was_up, up - was_up, soft_up, knee)
            mean_down += phase(drops.arc[part, 1], axis) * _rise(
                sign_down - sign_was_down, down - was_down, soft_down, knee
            )
        span, middle = late - early, 0.5 * (late + early)
        mean += span * (mean_up + mean_down)
        volts += span * (mean_up * weight(damping, middle, span) + mean_down * weight(damping, 1.0 - middle, span))
        moment += span * (middle - 0.5) * (mean_up - mean_down)
        by_end += span * (by_up * over_up + by_down * over_down)
        drops.sign[leg, part, 0], drops.sign[leg, part, 1] = mean_up, mean_down
        drops.change[leg, part, 0], drops.change[leg, part, 1] = sign_up - sign_was_up, sign_down - sign_was_down
        least, most = min(least, mean_up, mean_down), max(most, mean_up, mean_down)
        nearest = min(nearest, abs(up), abs(down))
        early, was_up, was_down, soft_was_up, soft_was_down = late, up, down, soft_up, soft_down
        sign_was_up, sign_was_down = sign_up, sign_down
        if bent:
            was_up, was_down = up + phase(drops.jump[part, 0], axis), down + phase(drops.jump[part, 1], axis)
            soft_was_up, soft_was_down = soft(was_up, knee), soft(was_down, knee)
            sign_was_up, sign_was_down = was_up / soft_was_up, was_down / soft_was_down
    drops.mean[leg], drops.loss[leg, 0], drops.loss[leg, 1], drops.loss[leg, 2] = mean, volts, by_end, moment
    drops.varies[leg] = most - least if nearest > reach else 2.0


@lean_kernel
def _rise(change: float, along: float, soft: float, knee: float) -> float:
    """Mean slope (1/A) of a current's sign along a piece of its course."""
    return change / along if abs(along) > 1e-3 * knee else knee * knee / (soft * soft * soft)
