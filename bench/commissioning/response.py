"""What a control loop makes of steps of its reference: the mean response, its overshoot, and when it has settled.

A drive excites itself by steps from one level to another and back, at instants that are all multiples of one time; many
such steps, brought to 0 and 1, are averaged. Times are told from where the response has first gone a twentieth of the
way, since a recording does not hold the reference.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bench.errors import BenchError

Column = NDArray[np.float64]
BAND: Final = 0.05  # of the step, either way: within, it has settled
_FEWEST: Final = 4  # steps
_CLEAR: Final = 6.0  # times the noise, that a step has to be
_MARGIN: Final = 10  # of the time between steps, left out at its end: the next may begin a little earlier
_SMOOTH: Final = 100  # of the time between steps, a mean over which, twice, takes an encoder's steps away
_BEFORE: Final = 0.25  # of the time between steps, at its end, that tells the level before


class UnclearStepError(BenchError):
    """No response can be told from a recording."""


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """A step from 0 to 1."""

    t: Column  # s, from where it has first gone a twentieth of the way
    y: Column
    steps: int  # that it is the mean of
    error: float  # of the mean, standard deviation of one sample

    @property
    def overshoot(self) -> float:
        """By how much it is above 1 at its highest; 0 where it is not."""
        return max(0.0, float(np.max(self.y)) - 1.0)

    @property
    def settling(self) -> float:
        """s after which it stays within `BAND` of 1; infinite where it does not."""
        return _settled(self.t, self.y)

    @property
    def tracking(self) -> float:
        """s: integral of the deviation's size, the reference a step at time 0."""
        after = self.t >= 0.0
        return float(np.sum(np.abs(self.y[after] - 1.0)) * (self.t[1] - self.t[0]))


def averaged(y: Column, T: float, hold: int, size: float) -> Response:
    """The mean response to steps by `size` (in y's unit) every `hold` samples of T (s), up or down or none.

    Raises UnclearStepError.
    """
    return averaged_with(y, T, hold, size, ())[0]


def averaged_with(
    y: Column, T: float, hold: int, size: float, others: Sequence[Column]
) -> tuple[Response, list[Column]]:
    """As `averaged`, and what other columns do at the same steps, in their units, from before each on, step upwards."""
    if len(y) // hold - 1 < _FEWEST:
        raise UnclearStepError(f"expected at least {_FEWEST} steps, {hold} samples each, got {len(y)} samples")
    at, before, after = _phase(y, hold), max(2, round(_BEFORE * hold)), hold - hold // _MARGIN
    steps = list[tuple[int, float]]()
    for k in range(at, len(y) - hold, hold):
        if k >= before:
            change = float(np.mean(y[k + hold // 2 : k + after]) - np.mean(y[k - before : k]))
            if abs(change) > 0.5 * size:
                steps.append((k, math.copysign(1.0, change)))
    if len(steps) < _FEWEST:
        raise UnclearStepError(f"expected at least {_FEWEST} steps by {size:.3g}, found {len(steps)}")

    def means(column: Column) -> Column:
        return np.array([
            way * (column[k - before : k + after] - np.mean(column[k - before : k])) for k, way in steps
        ])  # fmt: skip

    every = means(_smoothed(y, max(1, hold // _SMOOTH))) / size
    error = float(np.std(every[:, :before], ddof=1)) / math.sqrt(len(every))
    if error * _CLEAR > 1.0:
        raise UnclearStepError(f"the steps are {1.0 / error:.2g} times their noise, expected {_CLEAR:g}")
    mean = every.mean(axis=0)
    t = T * (np.arange(len(mean), dtype=np.float64) - before) - _begins(mean, T, before)
    return Response(t, mean, len(every), error), [means(other).mean(axis=0) for other in others]


def _smoothed(y: Column, width: int) -> Column:
    """The mean over so many samples of the mean over so many."""
    mean = np.full(width, 1.0 / width)
    return np.convolve(np.pad(y, width - 1, "edge"), np.convolve(mean, mean), "valid")


def _phase(y: Column, hold: int) -> int:
    """At which sample, of every `hold`, steps begin, or a little before: the next few change the most."""
    reach = max(1, hold // 8)
    change = np.abs(y[reach:] - y[:-reach])
    rows = len(change) // hold
    profile = change[: rows * hold].reshape(rows, hold).mean(axis=0)
    profile -= np.median(profile)
    # the first of those with most of the change
    largest = int(np.argmax(profile))
    at = largest
    while profile[(at - 1) % hold] > 0.2 * profile[largest] and (largest - at) < hold // 2:
        at -= 1
    return (at + reach - 1 - reach // 2) % hold  # a slow one has gone some way until it is seen


def _begins(y: Column, T: float, before: int) -> float:
    """s after sample `before`, or before it, at which y goes through a twentieth on its way to a half."""
    half = before + int(np.argmax(y[before:] > 0.5))
    below = np.flatnonzero(y[:half] <= BAND)
    if not len(below) or y[half] <= BAND:
        return 0.0
    k = int(below[-1])
    return T * (k - before + (BAND - y[k]) / (y[k + 1] - y[k]))


def _settled(t: Column, y: Column) -> float:
    outside = np.flatnonzero(np.abs(y - 1.0) > BAND)
    if not len(outside):
        return 0.0
    k = int(outside[-1])
    if k + 1 == len(y):
        return math.inf
    edge = 1.0 + math.copysign(BAND, y[k] - 1.0)
    return float(t[k] + (edge - y[k]) / (y[k + 1] - y[k]) * (t[k + 1] - t[k]))
