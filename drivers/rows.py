"""Rows to blocks: unwraps the 16-bit tick of each row, counts what is missing, turns counts into SI. Pure.

What every transport does with a stream once its rows are whole; a lost row is a gap, never a repetition. And whether a
line carries the rows that are asked for, or which row length it would carry.
"""

import math
from dataclasses import dataclass
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.block import Block
from drivers.errors import FrameError
from drivers.wire.codec import FullScales, count_size, counts_to_si
from drivers.wire.dictionary import STREAM_ROW, signal_named

SPAN: Final = 3.0  # s of the drive's time over which it is looked at
_LOST: Final = 0.3  # of all rows: more is no fault of a line, it is too slow
_SPARE: Final = 0.7  # of what it carries is asked for: the rest is for requests
_MOST_PERIODS: Final = 1000  # control periods per row

Number = TypeVar("Number", np.int16, np.int64)

TICKS = 1 << 16
TELLABLE = TICKS // 2  # control periods; a row's 16-bit tick tells no longer silence
_FULL_TICKS = 1 << 32


@dataclass(slots=True)
class Counts:
    """What has been seen of a stream."""

    rows: int = 0
    gaps: int = 0
    rows_lost: int = 0
    frames_late: int = 0  # repeated, or older than a row already given out
    frames_foreign: int = 0  # under the stream's name, but not of it


class RowBlocks:
    """Joins the rows of one stream, each of `periods` control periods, in the order of `STREAM_ROW`.

    `tick` is the drive's full tick, read before the stream began and after `periods` was set: rows that began
    before it are ignored, the first is less than 32768 periods later. `after` is where the rows of a stream before
    this one ended, when there was one.
    """

    def __init__(self, T_s: float, periods: int, full: FullScales, tick: int, after: int | None = None) -> None:
        self.periods = periods
        self.counts = Counts()
        self.temperatures = (float("nan"), float("nan"))  # degC, of winding and magnets, as last told
        self._T_s = T_s
        self._full = full
        self._i_step, self._u_step = (count_size(signal_named(name), full) for name in ("i_d", "u_d"))
        self._last_tick = tick
        self._after = after
        self._first = True
        self._ticks: list[NDArray[np.int64]] = []
        self._rows: list[NDArray[np.int16]] = []
        self._lost_before = 0
        self._ready: list[Block] = []

    @property
    def end(self) -> int | None:
        """Tick at which the latest row ended, be it of the stream before; None when there was none."""
        return self._after if self._first else self._last_tick + self.periods

    def is_new(self, tick: int) -> bool:
        """A row of this 16-bit tick is later than those so far; one that is not is counted as late."""
        ahead = (tick - self._last_tick) % TICKS
        new = ahead < TELLABLE and (ahead > 0 or self._first)
        self.counts.frames_late += not new and not self._first
        return new

    def row(self, tick: int, values: tuple[int, ...]) -> None:
        """Take in a whole row, for which `is_new` was true. Raises FrameError where its tick cannot be."""
        ahead = (tick - self._last_tick) % TICKS
        if not self._first and ahead % self.periods:
            raise FrameError(
                f"rows come every {self.periods} ticks, but tick {tick} came {ahead} after the one before"
            )
        self._advance(ahead)
        self._append(np.array([values]).astype(np.int16))

    def ahead(self, tick: int) -> int:
        """Control periods from the latest row, or before the first from the start, to this 32-bit tick; < 0: back."""
        return (tick - self._last_tick + _FULL_TICKS // 2) % _FULL_TICKS - _FULL_TICKS // 2

    def run(self, tick: int, counts: NDArray[np.int16]) -> None:
        """Take in rows (n, len(STREAM_ROW)) that follow each other from a 32-bit tick on, in place of `row`.

        Raises FrameError where the tick cannot be.
        """
        ahead = self.ahead(tick)
        if self._first and ahead < 0:
            early = -(ahead // self.periods)
            counts, ahead = counts[early:], ahead + early * self.periods
        if not len(counts):
            return
        if not self._first and (ahead <= 0 or ahead % self.periods):
            raise FrameError(
                f"rows come every {self.periods} ticks, but tick {tick} came {ahead} after the one before"
            )
        self._advance(ahead)
        self._append(counts)

    def _append(self, counts: NDArray[np.int16]) -> None:
        """Rows (n, len(STREAM_ROW)) from the latest tick on."""
        ticks = self._last_tick + self.periods * np.arange(len(counts))
        self._ticks.append(ticks)
        self._rows.append(counts)
        self._last_tick += (len(counts) - 1) * self.periods
        self.counts.rows += len(counts)

    def _advance(self, ahead: int) -> None:
        """Go on to a row that begins so much later than the latest; what is missing between is a gap."""
        lost = ahead // self.periods - 1
        if self._first:
            lost = 0 if self._after is None else -(-max(0, self._last_tick + ahead - self._after) // self.periods)
        if lost:
            self._close_block()
            self.counts.gaps += 1
            self.counts.rows_lost += lost
            self._lost_before = lost
        self._first = False
        self._last_tick += ahead

    def take(self) -> list[Block]:
        """The blocks complete by now, oldest first; each is consecutive in itself."""
        self._close_block()
        ready, self._ready = self._ready, []
        return ready

    def _close_block(self) -> None:
        if not self._ticks:
            return
        columns = counts_to_si(_one_of(self._rows), STREAM_ROW, self._full)
        self._ready.append(Block(
            tick=_one_of(self._ticks), **dict(zip(STREAM_ROW, columns, strict=True)),
            T_s=self._T_s, periods=self.periods, lost_before=self._lost_before, i_step=self._i_step,
            u_step=self._u_step, temp_winding=self.temperatures[0], temp_magnet=self.temperatures[1],
        ))
        self._ticks, self._rows, self._lost_before = [], [], 0


def _one_of(parts: "list[NDArray[Number]]") -> "NDArray[Number]":
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


class Carried:
    """Looks at the counts of one stream whose rows have one length, now and then."""

    def __init__(self, row_time: float, counts: Counts, *, weighed: bool = False) -> None:
        """`row_time` in s; `counts` so far. `weighed`: `carries` tells what the line does, not its losses."""
        self._row_time, self._weighed = row_time, weighed
        self._rows, self._lost = counts.rows, counts.rows_lost
        self._best = 0.0  # share of all rows that it has carried since the last look; 0: not known

    def carries(self, share: float) -> None:
        """It has carried this share of all rows for a moment in which nothing else was amiss."""
        self._best = max(self._best, share)

    def periods(self, counts: Counts, periods: int) -> int:
        """The row length to ask for in place of `periods` control periods: the same where the line carries that."""
        rows, lost = counts.rows - self._rows, counts.rows_lost - self._lost
        if (rows + lost) * self._row_time < SPAN:
            return periods
        best, self._best = self._best, 0.0
        self._rows, self._lost = counts.rows, counts.rows_lost
        if not rows or lost < _LOST * (rows + lost):
            return periods
        share = (best or 1.0) if self._weighed else rows / (rows + lost)
        return periods if share >= 1.0 else min(math.ceil(periods / (_SPARE * share)), _MOST_PERIODS)


def note(periods: int, before: int, row_time: float) -> str:
    """What to tell of rows of `periods` control periods in place of those `before`; `row_time` in s, of a new one."""
    return (
        f"rows of {periods} control periods are asked for, in place of {before}: "
        f"the line carries about {1.0 / (_SPARE * row_time):.0f} rows/s"
    )
