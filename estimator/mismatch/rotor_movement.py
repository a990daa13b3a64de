"""The rotor's movement within an encoder's count: what torque and order of the turn say of it.

A smooth angle is rid of its rounding, and of some of what the rotor does meanwhile. Lost movement would look like what
currents do, or like harmonics of the magnets' flux: it goes by the same torque, has the same orders. Knows nothing of
recordings.
"""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Final, cast

import numpy as np
from numpy.typing import NDArray

from estimator.kernel import kernel
from estimator.mismatch.smoothest_course import Course, smoothest

Real = NDArray[np.float64]
Vector = NDArray[np.complex128]

_BEND: Final = 32  # periods to either side, over which torque bends a movement
_HELD: Final = 40  # times that many periods: fewer say nothing of a shaft
_KNOWN: Final = 3  # moves: torque, friction, and one in proportion to speed
_PUSHED: Final = 5.0  # standard deviations, by which torque is seen to move it
_ORDERS: Final = 24  # of the electrical turn, at which a rotor may swing: cogging, ripple of the torque
_SWINGS: Final = 20.0  # times the power by chance, by which a swing is seen
_EVEN: Final = 2  # powers of time, that any course follows
_FITS: Final = 5
_FURTHER: Final = 1.8  # times the step that edges ask for: with it, others do
_SURER: Final = 0.8  # of the variance: an angle that is known better beside a swing
_ANEW: Final = 1024  # values, after which a sum begins anew: it keeps its digits


def driven(theta: Real, torques: Sequence[Real], ends: Sequence[int]) -> Real:
    """What torque and friction make of a movement (rad); zero where the shaft is held: nothing of it goes by them.

    J d(omega)/dt = torque - C sign(omega) - B omega - load, its inertia and frictions by least squares of how the
    movement bends over some periods. What is even in time is no matter: a smooth angle follows it. Of several torques
    the first is known but for the inertia, and others count where they are seen beside it.
    """
    n, none = len(theta), np.zeros(len(theta))
    if n < _HELD * _BEND:
        return none
    omega = cast(Real, np.gradient(_mean(theta, _BEND)))
    moves = [_twice_summed(x) for x in (torques[0], np.sign(omega), omega, *torques[1:])]

    def bend(x: Real) -> Real:
        mean = _mean(x, _BEND // 2)
        return (mean[2 * _BEND :] - 2.0 * mean[_BEND:-_BEND] + mean[: -2 * _BEND])[inner]

    whole = np.ones(n, np.bool_)
    for end in ends:
        whole[max(end - 2 * _BEND, 0) : end + 2 * _BEND] = False
    inner = whole[_BEND:-_BEND]
    bends = [bend(x) for x in moves]
    size = [float(np.sqrt(np.mean(x**2))) for x in bends]
    if not size[0] > 0.0 or np.sum(inner) < _HELD * _BEND:
        return none
    seen = bend(theta)
    there = [k for k in range(_KNOWN) if size[k] > 0.0]
    found, sure = _coefficients([bends[k] / size[k] for k in there], seen)
    if sure[0] < _PUSHED:
        return none
    for k in (k for k in range(_KNOWN, len(moves)) if size[k] > 0.0):
        more = [*there, k]
        other, sure = _coefficients([bends[j] / size[j] for j in more], seen)
        if abs(sure[-1]) > _PUSHED:
            there, found = more, other
    return cast(Real, sum(found[j] / size[k] * moves[k] for j, k in enumerate(there)))


def _coefficients(columns: Sequence[Real], seen: Real) -> tuple[Real, Real]:
    """Of columns, that make what is seen, by least squares; and in standard errors of bends."""
    A = np.array(columns)
    inverse = np.linalg.pinv(A @ A.T)
    found = inverse @ (A @ seen)
    left = float(np.mean((seen - found @ A) ** 2)) * 3.0 * _BEND  # neighbours share periods
    return found, found / np.sqrt(np.maximum(left * np.diag(inverse), 1e-300))


def turning(
    counts: Real, reach: float, torques: Sequence[Real], ends: Sequence[int], n_p: int
) -> tuple[Real, Course]:
    """What torque and orders of the turn make of a movement (rad), as counts show it, and the smoothest course beside.

    `counts`: their middles, rad, each `reach` wide to either side. Whether torque moves the rotor, and whether it
    swings, is decided by how well counts then hold the angle.
    """
    known, course = np.zeros(len(counts)), smoothest(counts, reach, ends)
    pushed = driven(counts, torques, ends)
    if pushed.any():
        beside = smoothest(counts - pushed, reach, ends)
        if np.mean(beside.variance) < np.mean(course.variance):
            known, course = pushed, beside
    swung, beside = _swung(counts, known, course, reach, n_p)
    return (swung, beside) if np.mean(beside.variance) < _SURER * np.mean(course.variance) else (known, course)


def _swung(counts: Real, known: Real, course: Course, reach: float, n_p: int) -> tuple[Real, Course]:
    """The same with swings at orders of the turn.

    Once and twice in a mechanical turn an encoder may swing; a rotor, by torque that has an order of the electrical
    one. Each step fits the course and all swings that are seen jointly, as the edges of counts hold them now.
    """
    orders, own = list[float](), (1.0 / n_p, 2.0 / n_p)
    for _ in range(_FITS):
        theta = known + course.course
        orders = sorted({*orders, *_seen(course.pull, theta, (*own, *range(1, _ORDERS + 1)))})
        if not orders:
            break
        waves = [(n, cast(Real, part(n * theta))) for n in orders for part in (np.cos, np.sin)]
        moves = [_levelled(wave if n in own else _twice_summed(wave), course.ends) for n, wave in waves]
        X: Real = np.array([move * reach / max(float(np.std(move)), 1e-300) for move in moves])
        lost: Real = course.weight * np.array([course.lost(x) for x in X])
        pull = course.weight * np.where(course.pull != 0.0, course.pull, counts - theta)
        sizes: Real = np.linalg.pinv(lost @ X.T, hermitian=True) @ (X @ pull)
        known = known + _FURTHER * (sizes @ X)
        course = smoothest(counts - known, reach, course.ends)
    return known, course


def _seen(pull: Real, theta: Real, orders: Iterable[float]) -> list[float]:
    """Orders of the turn by which a course leaves its counts."""
    there = np.flatnonzero(pull)
    edges, turned = pull[there], theta[there]
    plain = _SWINGS * float(edges @ edges)
    return [n for n in orders if abs(edges @ cast(Vector, np.exp(-1j * n * turned))) ** 2 > plain]


def _levelled(x: Real, ends: Sequence[int]) -> Real:
    """But for what is even in time, in each run."""
    out = x.copy()
    for a, b in pairwise(ends):
        if b - a > _EVEN + 1:
            t = np.linspace(-1.0, 1.0, b - a)
            out[a:b] -= np.polynomial.Polynomial.fit(t, x[a:b], _EVEN)(t)
    return out


def _twice_summed(x: Real) -> Real:
    """What bends by x from value to value, but for its mean."""
    return np.concatenate((np.zeros(1), np.cumsum(np.cumsum(x - np.mean(x)))[:-1]))


@kernel
def _mean(x: Real, w: int) -> Real:
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
