"""The smoothest course that counts allow: where a rotor turns through its counts, most of their rounding goes.

A count says that the angle lies within it, and no more; the many by which a rotor turns while it moves on smoothly, and
where they change, say it far better than their means do. The course m bends as little as they allow,

    min   sum w (m - y)^2 + sum (S^3 third difference of m)^2      outside of a count: y its edge, w = 1
                                                                  within: y its middle, w little

by Newton's method, each step one solve of a matrix with seven diagonals, soon only around counts that the course has
reached or left since the last one. S, the periods over which it may bend, is halved around a place where the course
leaves counts. Of N periods means leave 1/sqrt(N) of the rounding, this 1/N.
Sources: N. T. Thao, M. Vetterli, IEEE Trans. Signal Processing 42, 519, 1994 (consistent reconstruction);
E. T. Whittaker, Proc. Edinburgh Math. Soc. 41, 63, 1923 (graduation by third differences). Knows nothing of rotors.
"""

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Final, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array
from estimator.kernel import kernel, lean_kernel

_STIFF: Final = 24.0  # periods, over which a course may bend
_STEP_HALVINGS: Final = 4
_OUTSIDE_COUNTS: Final = 0.02  # counts, by which it leaves one
_NO_COURSE: Final = 0.25  # the same, however soon it may bend: that is no course
_SOONER_REACH: Final = 12  # times the periods to either side, where it may bend sooner then
_WIDER: Final = (1.1, 1.4)  # times counts' width
_LEAST_BEND: Final = 0.5  # of a course
_HOLDING_WEIGHT: Final = 3e-4  # weight within a count: it holds a course that reaches no edge
_SOONER: Final = 1.5  # power of how much sooner it may bend, by which that grows
_NEWTON_STEPS: Final = 40  # of Newton's method, at most
_FELT: Final = 16  # times the periods to either side of a count that was reached or left, which the next one moves
_JUDGED_PERIODS: Final = 60_000  # periods, that tell which course is the surest
_BLOCKS: Final = 8
_WORTH_BLOCKS: Final = 2  # times as many, from which on it saves time
_SHORTEST: Final = 8  # periods of a run
_NEIGHBOURS: Final = 4  # times the periods to either side, whose counts hold a course


class SmoothCourse(NamedTuple):
    """A course, how far it may be off, and what holds it."""

    course: Array
    variance: Array  # by how far all counts around would let it move
    pull: Array  # how far outside of its count it is, against that side; zero within
    weight: Array
    span: Array  # periods, over which it may bend
    reach: float  # of counts to either side
    ends: Sequence[int]

    @property
    def off(self) -> float:
        """Rms by which it may be off."""
        return math.sqrt(float(np.mean(self.variance)))

    def lost(self, x: Array) -> Array:
        """What of another movement it would not follow."""
        return _lost(x, self.weight, self.span, self.ends)


def surer(counts: Array, course: SmoothCourse) -> SmoothCourse:
    """The course, or, where most of it has to bend sooner, that of wider counts which is the surest.

    Edges of a real encoder are not all in place.
    """
    if np.mean(course.span < _STIFF) < _LEAST_BEND:
        return course
    return surest([(counts, wider * course.reach) for wider in (1.0, *_WIDER)], course.ends, course)[1]


def surest(
    tried: Sequence[tuple[Array, float]], ends: Sequence[int], first: SmoothCourse | None = None
) -> tuple[int, SmoothCourse]:
    """Which of some counts, each with its reach, has the surest course, and that; by blocks of a long recording.

    `first`: the course of the first of them, where it is known.
    """
    if len(tried) > 1 and ends[-1] > _WORTH_BLOCKS * _JUDGED_PERIODS:
        part, cuts = _spread_blocks(ends)
        best = int(np.argmin([smoothest(counts[part], reach, cuts).off for counts, reach in tried]))
        return best, first if best == 0 and first is not None else smoothest(*tried[best], ends)
    known = [] if first is None else [first]
    courses = [*known, *(smoothest(counts, reach, ends) for counts, reach in tried[len(known) :])]
    best = int(np.argmin([course.off for course in courses]))
    return best, courses[best]


def _spread_blocks(ends: Sequence[int]) -> tuple[NDArray[np.intp], list[int]]:
    """Places in blocks all over a recording, and where runs of these begin and end."""
    length = _JUDGED_PERIODS // _BLOCKS
    starts = np.rint(np.linspace(0.0, ends[-1] - length, _BLOCKS)).astype(np.intp)
    cuts = np.clip(np.array(ends) - starts[:, None], 0, length) + length * np.arange(_BLOCKS)[:, None]
    return (starts[:, None] + np.arange(length)).ravel(), np.unique(cuts).tolist()


def smoothest(counts: Array, reach: float, ends: Sequence[int]) -> SmoothCourse:
    """Of counts' middles, each `reach` wide to either side, in runs; as they are where a run is too short to tell.

    As they are, too, around places where it would leave them however soon it may bend: no rotor's movement.
    """
    n = len(counts)
    off, variance, span = np.zeros(n), np.full(n, reach**2 / 3.0), np.full(n, _STIFF)
    for run in _runs(ends):
        off[run], span[run] = _departure(counts[run], reach)
        variance[run] = _room(off[run], span[run], reach)
        left = np.abs(off[run]) > reach * (1.0 + 2.0 * _NO_COURSE)
        astray = _near_any(left, round(_SOONER_REACH * _STIFF / 2**_STEP_HALVINGS))
        off[run][astray], variance[run][astray] = 0.0, reach**2 / 3.0
    pull = np.clip(off, -reach, reach) - off
    return SmoothCourse(counts + off, variance, pull, _weight(off, reach, _middle_weight(span)), span, reach, ends)


def fast(x: Array, ends: Sequence[int]) -> Array:
    """What of a movement is too fast for a course that bends as little as it may and is held by no edge."""
    return _lost(x, np.full(len(x), _HOLDING_WEIGHT), np.full(len(x), _STIFF), ends)


def _lost(x: Array, weight: Array, span: Array, ends: Sequence[int]) -> Array:
    out, none, L = np.zeros(len(x)), np.zeros(len(x)), np.empty((len(x), 3))
    for run in _runs(ends):
        _newton_step(out[run], L[run], -x[run], none[run], math.inf, weight[run], _stiff(span[run]), 0, len(out[run]))
    return out


def _runs(ends: Sequence[int]) -> list[slice]:
    """Rows without a gap that are long enough to have a course, from their ends."""
    return [slice(a, b) for a, b in pairwise(ends) if b - a >= _SHORTEST]


def _departure(counts: Array, reach: float) -> tuple[Array, Array]:
    """Of one run: the course less counts, and the periods over which it may bend."""
    n = len(counts)
    span, off = np.full(n, _STIFF), np.zeros(n)
    for halved in range(_STEP_HALVINGS + 1):
        off = _newton(counts, reach, off, span)
        left = np.abs(off) > reach * (1.0 + 2.0 * _OUTSIDE_COUNTS)
        if halved == _STEP_HALVINGS or not left.any():
            break
        near = _near_any(left, round(_SOONER_REACH * _STIFF / 2**halved))
        span[near] = np.minimum(span[near], _STIFF / 2 ** (halved + 1))
    return off, span


def _near_any(there: NDArray[np.bool_], w: int) -> NDArray[np.bool_]:
    """Within w periods of one that is there."""
    return _highest(there.astype(np.float64), w) > 0.0


def _newton(counts: Array, reach: float, off: Array, span: Array) -> Array:
    """The course less counts for given periods, from one that is near; at first all counts' middles hold it alike."""
    within = _middle_weight(span)
    weight = _weight(off, reach, within) if off.any() else np.ones(len(off))
    return _converged(counts, reach, off, weight, within, _stiff(span), np.rint(_FELT * span).astype(np.intp))


def _stiff(span: Array) -> Array:
    """Of third differences."""
    two = np.minimum(span[1:], span[:-1])
    cube = np.minimum(two[2:], two[:-2]) ** 3
    return cast(Array, cube * cube)


def _weight(off: Array, reach: float, within: Array) -> Array:
    return np.where(np.abs(off) > reach, 1.0, within)


def _middle_weight(span: Array) -> Array:
    """Weight of a count's middle."""
    return _HOLDING_WEIGHT * (_STIFF / span) ** _SOONER


def _room(off: Array, span: Array, reach: float) -> Array:
    """Variance of an angle that may be anywhere where all counts around hold it."""
    variance = np.empty(len(off))
    for periods in np.unique(span).tolist():
        there, w = span == periods, round(_NEIGHBOURS * periods)
        up, down = (reach - _highest(x, w)[there] for x in (off, -off))
        outside = np.minimum(np.minimum(up, down), 0.0)
        up, down = np.maximum(up, 0.0), np.maximum(down, 0.0)
        variance[there] = (up * up - up * down + down * down) / 3.0 + outside * outside
    return variance


def _highest(x: Array, w: int) -> Array:
    """Of w values to either side."""
    from scipy import ndimage

    return cast(Callable[..., Array], ndimage.maximum_filter1d)(x, 2 * w + 1)


@kernel
def _converged(
    counts: Array, reach: float, off: Array, weight: Array, within: Array, stiff: Array, felt: NDArray[np.intp]
) -> Array:
    """The course less counts, from one that is near, and weights that hold it in the first step; `felt`: periods to
    either side that a change of a count's weight moves.
    """
    n, m = len(counts), 1
    off, weight, x, L = off.copy(), weight.copy(), np.empty(n), np.empty((n, 3))
    begins, ends, changes = np.zeros(n, np.intp), np.full(n, n), np.zeros(n + 1, np.intp)
    for _ in range(_NEWTON_STEPS):
        for part in range(m):
            _newton_step(x, L, counts, off, reach, weight, stiff, begins[part], ends[part])
        for part in range(m):
            for k in range(begins[part], ends[part]):
                before = off[k]
                off[k] += x[k]
                now = 1.0 if abs(off[k]) > reach else within[k]
                if now != weight[k] or (now == 1.0 and before * off[k] < 0.0):
                    weight[k] = now
                    changes[max(k - felt[k], 0)] += 1
                    changes[min(k + felt[k] + 1, n)] -= 1
        level, m = 0, 0
        for k in range(n + 1):
            was, level, changes[k] = level, level + changes[k], 0
            if was == 0 and level > 0:
                begins[m] = k
            elif was > 0 and level == 0:
                ends[m] = k
                m += 1
        if m == 0:
            break
    return off


@lean_kernel
def _newton_step(
    x: Array, L: Array, counts: Array, off: Array, reach: float, weight: Array, stiff: Array, begin: int, end: int
) -> None:
    """Write Newton's step from `off` between two periods, where all others stay.

    x of (weight + D' stiff D) x = weight pull - D' stiff D (counts + off), with D the third difference: L d L', each
    row of L with three numbers.
    """
    n = len(counts)
    r_1 = r_2 = r_3 = y_1 = y_2 = y_3 = 0.0  # of the rows before: 1 / d, and what is asked of them
    l_12 = l_13 = l_23 = 0.0  # of the row before: its first and second neighbour; of that before: its first
    s_1 = s_2 = s_3 = t_1 = t_2 = t_3 = 0.0
    for k in range(max(begin - 3, 0), end):
        s_0 = t_0 = 0.0  # how stiff the third difference is that begins here, and what it pulls by
        if k < n - 3:
            s_0 = stiff[k]
            inner = counts[k + 2] + off[k + 2] - (counts[k + 1] + off[k + 1])
            t_0 = s_0 * (counts[k + 3] + off[k + 3] - (counts[k] + off[k]) - 3.0 * inner)
        if k >= begin:
            e_3 = -s_3
            l_3 = e_3 * r_3
            e_2 = 3.0 * (s_2 + s_3) - e_3 * l_23
            l_2 = e_2 * r_2
            e_1 = -3.0 * (s_1 + 3.0 * s_2 + s_3) - e_3 * l_13 - e_2 * l_12
            l_1 = e_1 * r_1
            r_0 = 1.0 / (weight[k] + s_0 + 9.0 * (s_1 + s_2) + s_3 - e_3 * l_3 - e_2 * l_2 - e_1 * l_1)
            pull = min(max(off[k], -reach), reach) - off[k] if abs(off[k]) > reach else -off[k]
            y = weight[k] * pull + t_0 - 3.0 * (t_1 - t_2) - t_3 - l_3 * y_3 - l_2 * y_2 - l_1 * y_1
            x[k], L[k, 0], L[k, 1], L[k, 2] = y * r_0, l_1, l_2, l_3
            r_3, r_2, r_1, y_3, y_2, y_1 = r_2, r_1, r_0, y_2, y_1, y
            l_23, l_12, l_13 = l_12, l_1, l_2
        s_3, s_2, s_1, t_3, t_2, t_1 = s_2, s_1, s_0, t_2, t_1, t_0
    p_1 = p_2 = p_3 = 0.0  # what the rows behind take off
    for k in range(end - 1, begin - 1, -1):
        x[k] -= p_1
        p_1, p_2, p_3 = p_2 + L[k, 0] * x[k], p_3 + L[k, 1] * x[k], L[k, 2] * x[k]
