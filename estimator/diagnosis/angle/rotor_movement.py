"""The rotor's movement within an encoder's count: what torque and order of the turn say of it.

A smooth angle is rid of its rounding, and of some of what the rotor does meanwhile. Lost movement would look like what
currents do, or like harmonics of the magnets' flux: it goes by the same torque, has the same orders. Knows nothing of
recordings.
"""

from collections.abc import Sequence
from typing import Final, cast

import numpy as np

from estimator.arrays import Array, Vector
from estimator.diagnosis.angle.smoothest_course import SmoothCourse, fast, smoothest, surer, surest
from estimator.kernel import kernel

_BEND: Final = 32  # periods to either side, over which torque bends a movement
_HELD_PERIODS: Final = 40  # times that many periods: fewer say nothing of a shaft
_KNOWN_MOVES: Final = 3  # moves: torque, friction, and one in proportion to speed
_PUSHED: Final = 5.0  # standard deviations, by which torque is seen to move it
_SWING_ORDERS: Final = 24  # of the electrical turn, at which a rotor may swing: cogging, ripple of the torque
_SEEN_POWER: Final = 20.0  # times the power by chance, by which a movement is seen
_ORDERS_AT_ONCE: Final = 4  # orders
_FITS: Final = 8
_FURTHER: Final = 1.8  # times the step that edges ask for: with it, others do
_NO_NEARER: Final = 0.99  # of its error: a step that brings less is the last
_SURER: Final = 0.9  # of its error: an angle that is known better beside a movement
_ANEW: Final = 1024  # values, after which a sum begins anew: it keeps its digits


def driven(theta: Array, torques: Sequence[Array], ends: Sequence[int]) -> Array:
    """What torque and friction make of a movement (rad); zero where the shaft is held: nothing of it goes by them.

    J d(omega)/dt = torque - C sign(omega) - B omega - load, its inertia and frictions by least squares of how the
    movement bends over some periods. What goes by the square of time is no matter: a smooth angle follows it. Of
    several torques the first is known but for the inertia, and others count where they are seen beside it.
    """
    n, none = len(theta), np.zeros(len(theta))
    if n < _HELD_PERIODS * _BEND:
        return none
    omega = cast(Array, np.gradient(_mean(theta, _BEND)))
    moves = [_twice_summed(x) for x in (torques[0], np.sign(omega), omega, *torques[1:])]

    def bend(x: Array) -> Array:
        mean = _mean(x, _BEND // 2)
        return (mean[2 * _BEND :] - 2.0 * mean[_BEND:-_BEND] + mean[: -2 * _BEND])[inner]

    whole = np.ones(n, np.bool_)
    for end in ends:
        whole[max(end - 2 * _BEND, 0) : end + 2 * _BEND] = False
    inner = whole[_BEND:-_BEND]
    bends = [bend(x) for x in moves]
    size = [float(np.sqrt(np.mean(x**2))) for x in bends]
    if not size[0] > 0.0 or np.sum(inner) < _HELD_PERIODS * _BEND:
        return none
    seen = bend(theta)
    there = [k for k in range(_KNOWN_MOVES) if size[k] > 0.0]
    found, sure = _coefficients([bends[k] / size[k] for k in there], seen)
    if sure[0] < _PUSHED:
        return none
    for k in (k for k in range(_KNOWN_MOVES, len(moves)) if size[k] > 0.0):
        more = [*there, k]
        other, sure = _coefficients([bends[j] / size[j] for j in more], seen)
        if abs(sure[-1]) > _PUSHED:
            there, found = more, other
    return cast(Array, sum(found[j] / size[k] * moves[k] for j, k in enumerate(there)))


def _coefficients(columns: Sequence[Array], seen: Array) -> tuple[Array, Array]:
    """Of columns, that make what is seen, by least squares; and in standard errors of bends."""
    A = np.array(columns)
    inverse = np.linalg.pinv(A @ A.T)
    found = inverse @ (A @ seen)
    left = float(np.mean((seen - found @ A) ** 2)) * 3.0 * _BEND  # neighbours share periods
    return found, found / np.sqrt(np.maximum(left * np.diag(inverse), 1e-300))


def turning(
    counts: Array, reach: float, torques: Sequence[Array], ends: Sequence[int], n_p: int
) -> tuple[Array, SmoothCourse]:
    """What torque and orders of the turn make of a movement (rad), as counts show it, and the smoothest course beside.

    `counts`: their middles, rad, each `reach` wide to either side; or wider, where edges are not where they should be.
    Whether torque moves the rotor, and whether it swings, is decided by how well counts then hold the angle.
    """
    pushed = driven(counts, torques, ends)
    moves = [np.zeros(len(counts)), *([pushed] if pushed.any() else [])]
    which, course = surest([(counts - x, reach) for x in moves], ends)
    known, pushing = moves[which], [_twice_summed(x) for x in torques] if which else []
    moved, beside = _moved_further(counts, known, course, pushing, n_p)
    known, course = (moved, beside) if beside.off < _SURER * course.off else (known, course)
    return known, surer(counts - known, course)


def _moved_further(
    counts: Array, known: Array, course: SmoothCourse, pushing: Sequence[Array], n_p: int
) -> tuple[Array, SmoothCourse]:
    """A movement and its course, with what else counts show of torques, and of swings at orders of the turn.

    Once and twice in a mechanical turn an encoder may swing; a rotor, by torque that has an order of the electrical
    one. Each step fits the course and all that is seen jointly, as the edges of counts hold them now.
    """
    own = 1.0 / n_p, 2.0 / n_p
    orders, pushed = dict[float, None](), dict[int, None]()
    best = known, course
    for fit in range(_FITS):
        theta = known + course.course
        there = np.flatnonzero(course.pull)
        edges = course.pull[there]
        waves = {n: cast(Vector, np.exp(-1j * n * theta[there])) for n in (*own, *range(1, _SWING_ORDERS + 1))}
        seen = {n: abs(edges @ wave) ** 2 for n, wave in waves.items()}
        plain = _SEEN_POWER * float(edges @ edges)
        orders |= dict.fromkeys([n for n in sorted(seen, key=lambda n: -seen[n])[:_ORDERS_AT_ONCE] if seen[n] > plain])
        lost = [course.lost(x)[there] for x in pushing]
        pushed |= {k: None for k, x in enumerate(lost) if (edges @ x) ** 2 > 2.0 * plain * np.sum(x**2) / len(there)}
        if not orders and not pushed:
            break
        moves = [pushing[k] for k in pushed]
        for n in orders:
            moves += [x if n in own else _twice_summed(x) for x in (np.cos(n * theta), np.sin(n * theta))]
        known = known + _FURTHER * _moves_fitted(counts - theta, course, [fast(x, course.ends) for x in moves])
        before, course = course.off, smoothest(counts - known, course.reach, course.ends)
        best = min(best, (known, course), key=lambda found: found[1].off)
        if fit > 0 and course.off > _NO_NEARER * before:
            break
    return best


def _moves_fitted(off: Array, course: SmoothCourse, moves: Sequence[Array]) -> Array:
    """Of moves, what edges and middles of counts, `off` from the course, ask for: with as much of it as it follows."""
    X: Array = np.array([move * course.reach / max(float(np.std(move)), 1e-300) for move in moves])
    lost: Array = np.array([course.weight * course.lost(x) for x in X])
    pull = course.weight * np.where(course.pull != 0.0, course.pull, off)
    sizes: Array = np.linalg.pinv(lost @ X.T, hermitian=True) @ (X @ pull)
    return sizes @ X


def _twice_summed(x: Array) -> Array:
    """What bends by x from value to value, but for its mean."""
    return np.concatenate((np.zeros(1), np.cumsum(np.cumsum(x - np.mean(x)))[:-1]))


@kernel
def _mean(x: Array, w: int) -> Array:
    """Moving mean over 2 w + 1 values; as it is at the ends."""
    out, n = x.copy(), len(x)
    for begin in range(w, n - w, _ANEW):
        base, total = x[begin], 0.0
        for k in range(begin - w, begin + w + 1):
            total += x[k] - base
        for k in range(begin, min(begin + _ANEW, n - w)):
            out[k] = base + total / (2 * w + 1)
            if k + w + 1 < n:
                total += x[k + w + 1] - x[k - w]
    return out
