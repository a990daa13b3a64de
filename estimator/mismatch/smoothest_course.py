"""The smoothest course that counts allow: where a rotor turns through its counts, most of their rounding goes.

A count says that the angle lies within it, and no more; the many by which a rotor turns while it moves on smoothly, and
where they change, say it far better than their means do. The course m bends as little as they allow,

    min   sum w (m - y)^2 + sum (S^3 third difference of m)^2      outside of a count: y its edge, w = 1
                                                                  within: y its middle, w little

by Newton's method, each step one solve of a matrix with seven diagonals. S, the periods over which it may bend, is
halved around a place where the course leaves counts. Of N periods means leave 1/sqrt(N) of the rounding, this 1/N.
Sources: N. T. Thao, M. Vetterli, IEEE Trans. Signal Processing 42, 519, 1994 (consistent reconstruction);
E. T. Whittaker, Proc. Edinburgh Math. Soc. 41, 63, 1923 (graduation by third differences). Knows nothing of rotors.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Final, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from estimator.kernel import kernel

Real = NDArray[np.float64]

_STIFF: Final = 24.0  # periods, over which a course may bend
_HALVINGS: Final = 4
_OUTSIDE: Final = 0.02  # counts, by which it leaves one
_ASTRAY: Final = 0.25  # the same, however soon it may bend: that is no course
_AROUND: Final = 12  # times the periods to either side, where it may bend sooner then
_WIDER: Final = (1.1, 1.4)  # times counts' width
_BENT: Final = 0.5  # of a course
_WITHIN: Final = 3e-4  # weight within a count: it holds a course that reaches no edge
_SOONER: Final = 1.5  # power of how much sooner it may bend, by which that grows
_STEPS: Final = 12  # of Newton's method, at most
_SHORTEST: Final = 8  # periods of a run
_NEIGHBOURS: Final = 4  # times the periods to either side, whose counts hold a course


class Course(NamedTuple):
    """A course, how far it may be off, and what holds it."""

    course: Real
    variance: Real  # by how far all counts around would let it move
    pull: Real  # how far outside of its count it is, against that side; zero within
    weight: Real
    span: Real  # periods, over which it may bend
    reach: float  # of counts to either side
    ends: Sequence[int]

    @property
    def off(self) -> float:
        """Rms by which it may be off."""
        return math.sqrt(float(np.mean(self.variance)))

    def lost(self, x: Real) -> Real:
        """What of another movement it would not follow."""
        return _lost(x, self.weight, self.span, self.ends)


def surer(counts: Real, course: Course) -> Course:
    """The course, or, where most of it has to bend sooner, that of wider counts which is the surest.

    Edges of a real encoder are not all in place.
    """
    if np.mean(course.span < _STIFF) < _BENT:
        return course
    others = [smoothest(counts, wider * course.reach, course.ends) for wider in _WIDER]
    return min((course, *others), key=lambda one: one.off)


def smoothest(counts: Real, reach: float, ends: Sequence[int]) -> Course:
    """Of counts' middles, each `reach` wide to either side, in runs; as they are where a run is too short to tell.

    As they are, too, around places where it would leave them however soon it may bend: no rotor's movement.
    """
    n = len(counts)
    off, variance, span = np.zeros(n), np.full(n, reach**2 / 3.0), np.full(n, _STIFF)
    for run in _runs(ends):
        off[run], span[run] = _off(counts[run], reach)
        variance[run] = _room(off[run], span[run], reach)
        astray = _around(np.abs(off[run]) > reach * (1.0 + 2.0 * _ASTRAY), round(_AROUND * _STIFF / 2**_HALVINGS))
        off[run][astray], variance[run][astray] = 0.0, reach**2 / 3.0
    pull = np.clip(off, -reach, reach) - off
    return Course(counts + off, variance, pull, _weight(off, reach, span), span, reach, ends)


def fast(x: Real, ends: Sequence[int]) -> Real:
    """What of a movement is too fast for a course that bends as little as it may and is held by no edge."""
    return _lost(x, np.full(len(x), _WITHIN), np.full(len(x), _STIFF), ends)


def _lost(x: Real, weight: Real, span: Real, ends: Sequence[int]) -> Real:
    out = np.zeros(len(x))
    for run in _runs(ends):
        stiff = _stiff(span[run])
        out[run] = _solved(weight[run], stiff, _bend(x[run], stiff))
    return out


def _runs(ends: Sequence[int]) -> list[slice]:
    """Those that are long enough."""
    return [slice(a, b) for a, b in pairwise(ends) if b - a >= _SHORTEST]


def _off(counts: Real, reach: float) -> tuple[Real, Real]:
    """Of one run: the course less counts, and the periods over which it may bend."""
    n = len(counts)
    span, off = np.full(n, _STIFF), np.zeros(n)
    for halved in range(_HALVINGS + 1):
        off = _bent(counts, reach, off, span)
        left = np.abs(off) > reach * (1.0 + 2.0 * _OUTSIDE)
        if halved == _HALVINGS or not left.any():
            break
        near = _around(left, round(_AROUND * _STIFF / 2**halved))
        span[near] = np.minimum(span[near], _STIFF / 2 ** (halved + 1))
    return off, span


def _around(there: NDArray[np.bool_], w: int) -> NDArray[np.bool_]:
    """Within w periods of one that is there."""
    changes, at = np.zeros(len(there) + 1, np.intp), np.flatnonzero(there)
    np.add.at(changes, np.maximum(at - w, 0), 1)
    np.add.at(changes, np.minimum(at + w + 1, len(there)), -1)
    return np.cumsum(changes[:-1]) > 0


def _bent(counts: Real, reach: float, off: Real, span: Real) -> Real:
    """The course less counts for given periods, from one that is near; at first all counts' middles hold it alike."""
    stiff = _stiff(span)
    weight = _weight(off, reach, span) if off.any() else np.ones(len(off))
    for _ in range(_STEPS):
        pull = np.where(np.abs(off) > reach, np.clip(off, -reach, reach) - off, -off)
        off = off + _solved(weight, stiff, weight * pull - _bend(counts + off, stiff))
        before, weight = weight, _weight(off, reach, span)
        if np.array_equal(weight, before):
            break
    return off


def _stiff(span: Real) -> Real:
    """Of third differences."""
    return cast(Real, np.minimum.reduce([span[k : len(span) - 3 + k] for k in range(4)])) ** 6


def _weight(off: Real, reach: float, span: Real) -> Real:
    return np.where(np.abs(off) > reach, 1.0, _WITHIN * (_STIFF / span) ** _SOONER)


def _room(off: Real, span: Real, reach: float) -> Real:
    """Variance of an angle that may be anywhere where all counts around hold it."""
    variance = np.empty(len(off))
    for periods in np.unique(span).tolist():
        there, w = span == periods, round(_NEIGHBOURS * periods)
        up, down = (reach - _highest(x, w)[there] for x in (off, -off))
        outside = np.minimum(np.minimum(up, down), 0.0)
        up, down = np.maximum(up, 0.0), np.maximum(down, 0.0)
        variance[there] = (up * up - up * down + down * down) / 3.0 + outside * outside
    return variance


def _highest(x: Real, w: int) -> Real:
    """Of w values to either side."""
    padded = np.pad(x, w, constant_values=-np.inf)
    size, width = 1, 2 * w + 1
    while 2 * size <= width:
        padded = np.maximum(padded[size:], padded[:-size])
        size *= 2
    rest = width - size
    return np.maximum(padded[rest:], padded[: len(padded) - rest]) if rest else padded


def _bend(x: Real, stiff: Real) -> Real:
    """What third differences pull by: D' stiff D x."""
    third, out = stiff * np.diff(x, 3), np.zeros(len(x))
    for k, factor in enumerate((-1.0, 3.0, -3.0, 1.0)):
        out[k : k + len(third)] += factor * third
    return out


@kernel
def _solved(weight: Real, stiff: Real, b: Real) -> Real:
    """x of (weight + D' stiff D) x = b, with D the third difference: L d L', each row of L with three numbers."""
    n = len(b)
    L, d, x = np.empty((n, 3)), np.empty(n), b.copy()
    d_1 = d_2 = d_3 = 1.0  # of the rows before
    l_12 = l_13 = l_23 = 0.0  # of the row before: its first and second neighbour; of that before: its first
    for k in range(n):
        s_0 = stiff[k] if k < n - 3 else 0.0
        s_1 = stiff[k - 1] if 1 <= k < n - 2 else 0.0
        s_2 = stiff[k - 2] if 2 <= k < n - 1 else 0.0
        s_3 = stiff[k - 3] if k >= 3 else 0.0
        l_3 = -s_3 / d_3
        l_2 = (3.0 * (s_2 + s_3) - l_3 * d_3 * l_23) / d_2
        l_1 = (-3.0 * (s_1 + 3.0 * s_2 + s_3) - l_3 * d_3 * l_13 - l_2 * d_2 * l_12) / d_1
        d[k] = weight[k] + s_0 + 9.0 * (s_1 + s_2) + s_3 - l_1 * l_1 * d_1 - l_2 * l_2 * d_2 - l_3 * l_3 * d_3
        for m, entry in enumerate((l_1, l_2, l_3)):
            L[k, m] = entry
            if k > m:
                x[k] -= entry * x[k - m - 1]
        d_3, d_2, d_1 = d_2, d_1, d[k]
        l_23, l_12, l_13 = l_12, l_1, l_2
    x /= d
    for k in range(n - 2, -1, -1):
        for m in range(min(3, n - 1 - k)):
            x[k] -= L[k + m + 1, m] * x[k + m + 1]
    return x
