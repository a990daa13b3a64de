"""Times of rows that are not what they should be: none at all, too coarse for the rows, or of a counter that wraps.

Coarse times - rounded to a grain about as long as a row, or in single precision - are those of even rows if each is
within half a grain of where even rows would be. Where they cannot be, rows are lost: a gap is found as soon as no even
rows would do. Knows nothing of files.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bench.errors import RecordingError

Column = NDArray[np.float64]
Part = Mapping[str, Column]  # columns by quantity, of equal length; none: a line was left out

JITTER: Final = 0.2  # of a step, by which a row's time may be off its place
DRIFT: Final = 0.01  # of a step, by which a run's mean step, or a given T_s, may differ from the recording's
LARGEST: Final = 1e12  # SI; a cell beyond is a marker for "no value", not one
ODD: Final = 0.1  # share of steps that are none of even rows, up to which times are taken as they are

_WRAP: Final = 2.0**32  # counts
_TICKS: Final = (1e-9, 1e-6, 1e-3)  # s, that a count may be where times come in s
_PAUSE: Final = 1e-3  # of a counter's range, that may be lost where it wraps
_FEWEST: Final = 100  # rows that tell a grain
_FEW: Final = 5  # odd steps that do
_SINGLE: Final = 5.1e-9  # of a time, that it may be off single precision: it is written with nine digits
_LAG: Final = 25  # rows by which a step is told at first
_APART: Final = 0.05  # of a step: sizes of steps that differ
_COARSEST: Final = 50.0  # steps
_UNSTEADY: Final = 2e-4  # by which the rows' step may change
_BREAKS: Final = 0.01  # share of rows at which even rows may end


def expect_advance(t: Column, rows: NDArray[np.int64], *, equal: bool = False) -> None:
    """Raise RecordingError at the first time that runs backwards, or, unless `equal` ones may be, repeats."""
    steps = np.diff(t)
    back = np.flatnonzero(steps < 0 if equal else steps <= 0)
    if len(back):
        k = back[0]
        said = "repeats" if t[k + 1] == t[k] else "runs backwards"
        raise RecordingError(
            f"row {rows[k + 1]}: time {said}: expected more than {t[k]:.9g} s (row {rows[k]}), came {t[k + 1]:.9g} s"
        )


def odd_steps(steps: Column) -> tuple[float, NDArray[np.bool_]]:
    """The median of steps, and which of them are no multiple of it. All of them, where it is zero."""
    median = float(np.sort(steps)[(len(steps) - 1) // 2])
    if not median > 0.0:
        return median, np.ones(len(steps), dtype=np.bool_)
    multiple = np.rint(steps / median)
    return median, (multiple < 1) | (np.abs(steps / median - multiple) > JITTER + DRIFT * multiple)


def numbered(parts: Iterator[Part], step: float) -> Iterator[Part]:
    """Parts with times by the rows' numbers."""
    row = 0
    for part in parts:
        n = len(next(iter(part.values()))) if part else 0
        yield {**part, "t": step * np.arange(row, row + n, dtype=np.float64)} if part else part
        row += n


@dataclass(slots=True)
class Counter:
    """A 32-bit counter's times, made to go on where it wraps. `tick`: s a count, where it is known."""

    tick: float
    wraps: int = 0  # so far
    _passed: float = 0.0  # s
    _last: float = math.nan  # s, as in the file

    def unwrapped(self, parts: Iterator[Part]) -> Iterator[Part]:
        """Parts with times that go on."""
        for part in parts:
            yield {**part, "t": self._one(part["t"])} if part else part

    def _one(self, t: Column) -> Column:
        timed = np.flatnonzero(np.abs(t) < LARGEST)
        if not len(timed):
            return t
        steps = np.diff(t[timed], prepend=self._last)
        self._last = float(t[timed[-1]])
        added = np.zeros(len(t))
        for k in np.flatnonzero(steps < 0.0):
            added[timed[k]] = self._range(float(steps[k]))
        self.wraps += int(np.count_nonzero(added))
        passed, self._passed = self._passed, self._passed + float(added.sum())
        return t + (passed + np.cumsum(added)) if self._passed else t

    def _range(self, step: float) -> float:
        """The range (s) of the counter that would step back by so much where it wraps; 0 where there is none."""
        ranges = (_WRAP * tick for tick in (self.tick, *_TICKS))
        return next((size for size in ranges if 0.0 < step + size <= _PAUSE * size), 0.0)


@dataclass(frozen=True, slots=True)
class Grain:
    """How coarse times are, and the even rows that they are of."""

    step: float  # s between rows
    doubt: float  # of a step, by which a step may be longer or shorter
    size: float  # s, to which times are rounded; of single precision at the beginning
    single: bool  # whether times are in single precision

    def half(self, t: Column) -> Column:
        """By how much each time may be off, s."""
        if not self.single:
            return np.full(len(t), 0.5 * self.size * (1.0 + 1e-6))
        with np.errstate(over="ignore"):
            return 0.5 * np.spacing(np.abs(t).astype(np.float32)).astype(np.float64) + 1e-8 * np.abs(t)

    def remark(self) -> str:
        """What was made of the times."""
        how = "are in single precision, in steps of" if self.single else "are rounded to"
        said = f"times {how} {self.size:.3g} s, too coarse: rows are taken as even, {self.step:.9g} s apart"
        hidden = math.floor(self.size / self.step + 1e-6)
        if not hidden:
            return said
        return f"{said}; a gap of up to {hidden} rows need not show in such times, a larger one is told to within them"


def grain_of(t: Column, step: float | None) -> Grain | None:
    """The grain of the first times; None where they are fine, or none of even rows. `step`: s, where it is given."""
    rows = np.flatnonzero(np.abs(t) < LARGEST)
    t = t[rows]
    steps = np.diff(t)
    if len(t) < _FEWEST or np.any(steps < 0.0):
        return None
    median, odd = odd_steps(steps)
    other = step is not None and abs(median - step) > DRIFT * step
    if np.sum(odd) < _FEW and not other:
        return None
    sizes = [(False, _size(steps, float(np.median(_slopes(t, rows, _LAG)))))]
    if np.all(np.abs(t - t.astype(np.float32)) <= _SINGLE * np.abs(t)):
        sizes.insert(0, (True, float(np.spacing(np.float32(np.abs(t).max())))))
    for single, size in sizes:
        grain = _refined(t, rows, size, step, single=single)
        if grain is None:
            continue
        even = Even(grain)
        even.places(t, rows)
        if np.mean(odd) > ODD and even.breaks <= _BREAKS * len(t):
            return grain
        # Few of them may be rows that are lost or repeat.
        if even.breaks == 0 and steps.min() > 0.0 and (np.sum(odd) >= _FEW or grain.step == step):
            return grain
    return None


def _refined(
    t: Column, rows: NDArray[np.int64], size: float, given: float | None, *, single: bool
) -> Grain | None:
    """Even rows of times with a grain of that size (s), gaps aside; None where there are none."""
    places, lag = rows.astype(np.float64), _LAG
    while True:
        slopes = _slopes(t, places, lag)
        usual = slopes[np.abs(slopes - np.median(slopes)) <= size / lag]  # across gaps there are others
        if not len(usual):
            return None
        slope = float(np.mean(usual))
        if not 0.0 < size <= _COARSEST * slope:
            return None
        even = Even(Grain(slope, 1.5 * size / (lag * slope) + _UNSTEADY, size, single))
        places = even.places(t, rows)
        if not np.all(np.diff(places) > 0.0):
            return None
        if lag > len(t) // 8:
            break
        lag *= 4
    span = float(places[-1] - places[0])
    step, doubt = float(t[-1] - t[0]) / span, size * (1 + even.breaks) / span
    agrees = given is not None and abs(step - given) <= max(doubt, _UNSTEADY * step)
    step = given if given is not None and agrees else _simplest(step, doubt)
    return Grain(step, doubt / step + _UNSTEADY, size, single)


def _slopes(t: Column, places: Column | NDArray[np.int64], lag: int) -> Column:
    """Times (s) of a step, by rows so many apart. Shape (n - lag,)."""
    return (t[lag:] - t[:-lag]) / (places[lag:] - places[:-lag])


def _size(steps: Column, slope: float) -> float:
    """The least by which steps of different sizes differ; 0 where they are not of a few sizes."""
    gaps = np.diff(np.sort(steps))
    apart = gaps[gaps > _APART * slope]
    return float(apart.min()) if 0 < len(apart) < 0.1 * len(steps) else 0.0


def _simplest(value: float, doubt: float) -> float:
    """The number of the fewest digits within `doubt` of a value."""
    return next((x for digits in range(1, 10) if abs((x := float(f"{value:.{digits}g}")) - value) <= doubt), value)


@dataclass(slots=True)
class Even:
    """Rows of coarse times, put where even rows would be."""

    grain: Grain
    breaks: int = 0  # at which even rows end, so far
    _row: int = 0  # of the file, next
    _known: tuple[int, float, float, float] | None = None  # newest row: its number, place, and where it may be, s to s
    _raw: tuple[int, float] | None = None  # its number and time
    _origin: float = field(default=math.nan)  # s

    def spaced(self, parts: Iterator[Part]) -> Iterator[Part]:
        """Parts with times as even as the rows are."""
        for part in parts:
            yield {**part, "t": self._one(part["t"])} if part else part

    def _one(self, t: Column) -> Column:
        timed = np.flatnonzero(np.abs(t) < LARGEST)
        rows, self._row = timed + self._row, self._row + len(t)
        if not len(timed):
            return t
        if self._known is None:
            self._origin = float(t[timed[0]])
        made = np.full(len(t), np.nan)
        made[timed] = self._origin + self.grain.step * self.places(t[timed], rows)
        return made

    def places(self, t: Column, rows: NDArray[np.int64]) -> Column:
        """How many steps after the first row each of these is; they go on where the ones before ended. Shape (n,)."""
        self._expect_advance(t, rows)
        half = self.grain.half(t)
        low, high = t - half, t + half  # s, where each row may be
        if self._known is None:
            self._known = int(rows[0]), 0.0, float(low[0]), float(high[0])
        places, start = np.empty(len(t)), 0
        while start < len(t):
            start = self._until_break(places, t, rows, low, high, start)
        return places

    def _until_break(
        self, places: Column, t: Column, rows: NDArray[np.int64], low: Column, high: Column, start: int
    ) -> int:
        """Places of even rows from `start` on; the row at which they end."""
        assert self._known is not None
        step, doubt = self.grain.step, self.grain.doubt
        row, place, a, b = self._known
        since = rows[start:] - row
        slow, fast = step * (1.0 - doubt) * since, step * (1.0 + doubt) * since
        earliest = slow + np.maximum(np.maximum.accumulate(low[start:] - slow), a)
        latest = fast + np.minimum(np.minimum.accumulate(high[start:] - fast), b)
        broken = earliest > latest
        end = int(np.argmax(broken)) if broken.any() else len(since)
        places[start : start + end] = place + since[:end]
        if end:
            self._known = int(rows[start + end - 1]), float(place + since[end - 1]), float(earliest[end - 1]), float(
                latest[end - 1])  # fmt: skip
        if start + end < len(t):
            self._begin_anew(int(rows[start + end]), *(float(x[start + end]) for x in (t, low, high)))
        return start + end

    def _begin_anew(self, row: int, t: float, low: float, high: float) -> None:
        """A row that is not where even rows would be: later by lost rows, or anywhere."""
        assert self._known is not None
        before, place, a, b = self._known
        step, since = self.grain.step, row - before
        lost = round((t - 0.5 * (a + b)) / step - since)
        self.breaks += 1
        self._known = row, place + since + (lost if lost >= 1 else -0.5), low, high

    def _expect_advance(self, t: Column, rows: NDArray[np.int64]) -> None:
        if self._raw is not None:
            t, rows = np.r_[self._raw[1], t], np.r_[self._raw[0], rows]
        expect_advance(t, rows + 1, equal=True)
        self._raw = int(rows[-1]), float(t[-1])
