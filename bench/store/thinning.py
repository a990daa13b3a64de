"""A recording's columns thinned for a plot: bins of rows, their extremes kept, gaps between them. Pure.

A row alone is a bin of one, so that rows and bins are thinned alike, and bins to wider ones.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_GAP: Final = 1.5  # steps, from which on rows are missing
_BROKEN: Final = 0.5  # share of the points between which a line is broken, at most, by gaps that are shorter than those


@dataclass(frozen=True, slots=True)
class Spread:
    """Of a signal in each bin; nan where the bin has no value. Shape (n,) each."""

    low: Floats
    mean: Floats
    high: Floats

    @classmethod
    def of_rows(cls, values: Floats) -> Self:
        """Each row a bin of its own."""
        values = np.where(np.isfinite(values), values, np.nan)
        return cls(values, values, values)


@dataclass(frozen=True, slots=True, eq=False)
class Bins:
    """Consecutive rows in bins, in the order of their times. Shape (n,) each."""

    first: Floats  # s, of the bin's first row, from the recording's begin
    last: Floats  # s, of its last row
    rows: NDArray[np.int64]
    signals: Mapping[str, Spread]

    def __len__(self) -> int:
        return len(self.first)

    @classmethod
    def of_rows(cls, t: Floats, columns: Mapping[str, Floats]) -> Self:
        """Each row a bin of its own."""
        return cls(t, t, np.ones(len(t), np.int64), {name: Spread.of_rows(x) for name, x in columns.items()})

    def part(self, bins: slice) -> "Bins":
        """Some of them."""
        signals = {name: Spread(s.low[bins], s.mean[bins], s.high[bins]) for name, s in self.signals.items()}
        return Bins(self.first[bins], self.last[bins], self.rows[bins], signals)

    def wider(self, starts: NDArray[np.int64]) -> "Bins":
        """Fewer bins: each begins with one of these, the first of them with bin 0."""
        if not len(starts):
            return self
        rows = np.add.reduceat(self.rows, starts)
        ends = np.r_[starts[1:], len(self)] - 1
        signals = {name: _wider(spread, self.rows, starts) for name, spread in self.signals.items()}
        return Bins(self.first[starts], self.last[ends], rows, signals)


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """What is plotted: at each time the lowest, the mean and the highest value; all nan where the line is broken."""

    t: Floats  # s, from the recording's begin: the middle of a bin
    signals: Mapping[str, Spread]
    rows: int  # that it is of
    thinned: bool  # whether points stand for several rows


def gaps_in(t: Floats, step: float) -> Floats:
    """Times (s) of the rows before and after each gap, the rows being `step` apart. Shape (m, 2)."""
    before = np.flatnonzero(np.diff(t) > _GAP * step)
    return np.stack((t[before], t[before + 1]), axis=1)


def usual_step(t: Floats) -> float:
    """Time between two rows, s; infinite for fewer than two."""
    return float(np.median(np.diff(t))) if len(t) > 1 else float("inf")


def thinned(bins: Bins, gaps: Floats, since: float, until: float, points: int) -> Course:
    """Bins from `since` to `until` (s) in at most so many points, and the breaks between them.

    A gap breaks the line; where too many would, only those do that are longer than a point's time.
    """
    rows, wide = int(bins.rows.sum()), (until - since) / points
    if len(bins) > points and wide > 0.0:
        place = np.clip(np.floor((bins.first - since) / wide), 0, points - 1)
        bins = bins.wider(np.flatnonzero(np.diff(place, prepend=-1.0)))
    t = 0.5 * (bins.first + bins.last)
    broken = _broken(bins, gaps)
    if len(broken) > _BROKEN * points and rows > len(bins):
        broken = _broken(bins, gaps[gaps[:, 1] - gaps[:, 0] > wide])
    between = 0.5 * (t[broken] + t[broken + 1])
    signals = {name: _with_breaks(spread, broken + 1) for name, spread in bins.signals.items()}
    return Course(np.insert(t, broken + 1, between), signals, rows, rows > len(bins))


def _broken(bins: Bins, gaps: Floats) -> NDArray[np.int64]:
    """Bins after which the line is broken, the last never."""
    after = np.searchsorted(bins.first, gaps[:, 0], side="right") - 1
    return np.unique(after[(after >= 0) & (after < len(bins) - 1)])


def _with_breaks(spread: Spread, places: NDArray[np.int64]) -> Spread:
    return Spread(*(np.insert(x, places, np.nan) for x in (spread.low, spread.mean, spread.high)))


def _wider(spread: Spread, rows: NDArray[np.int64], starts: NDArray[np.int64]) -> Spread:
    there = np.where(np.isnan(spread.mean), 0, rows)
    count = np.add.reduceat(there, starts)
    total = np.add.reduceat(np.where(there > 0, spread.mean * there, 0.0), starts)
    mean = np.divide(total, count, out=np.full(len(starts), np.nan), where=count > 0)
    low, high = np.fmin.reduceat(spread.low, starts), np.fmax.reduceat(spread.high, starts)
    return Spread(low, np.clip(mean, low, high), high)  # rounding would have it beyond them
