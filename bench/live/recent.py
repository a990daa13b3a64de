"""The rows of the last half minute as they came, for whoever watches the drive; thinned when they are asked for.

While nobody asks, nothing is computed. Extremes are kept: what one row showed is seen, however short.
"""

import math
import threading
from collections import deque
from dataclasses import dataclass
from itertools import islice, takewhile
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bench.live.drive_clock import ticks_between
from drivers.block import Block

SIGNALS: Final = ("i_d", "i_q", "u_d", "u_q", "omega_e", "u_dc")
_SPAN: Final = 30.0  # s that are kept
_MOST: Final = 60_000  # rows that are kept
_BIN: Final = 0.02  # s, or a row where that is longer
_LATEST: Final = 0.1  # s over which the latest values are means
_SEVERAL: Final = 64  # blocks that may hold them

Values = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Latest:
    """What a drive does now: means over the last tenth of a second, SI; NaN where it tells none."""

    values: dict[str, float]  # by `SIGNALS`
    temp_winding: float  # degC
    temp_magnet: float  # degC


@dataclass(frozen=True, slots=True)
class Place:
    """A bin of a drive's clock: how often that had begun anew, and the number of the bin since then."""

    epoch: int
    bin: int

    def __str__(self) -> str:
        return f"{self.epoch}.{self.bin}"


@dataclass(frozen=True, slots=True)
class Course:
    """Signals over the last seconds by bins of equal length, without a bin left out: a gap is NaN."""

    bin_time: float  # s
    first: Place
    t_end: float  # s, drive's clock at the end of the newest row
    low: dict[str, Values]  # least value in each bin, SI, by `SIGNALS`
    high: dict[str, Values]

    @property
    def last(self) -> Place:
        """The newest bin, which may not be full yet."""
        return Place(self.first.epoch, self.first.bin + len(self.low[SIGNALS[0]]) - 1)


class Recent:
    """The latest rows of one drive. From any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._blocks: deque[Block] = deque()
        self._rows = 0
        self._epoch = 0  # times the drive's clock, or what a bin is of it, began anew

    def put(self, block: Block) -> None:
        """Take rows."""
        with self._lock:
            if self._blocks and not _follows(block, self._blocks[-1]):
                self._blocks.clear()
                self._rows = 0
                self._epoch += 1
            self._blocks.append(block)
            self._rows += len(block)
            span = _SPAN / block.T_s
            while self._rows > _MOST or ticks_between(int(self._blocks[0].tick[0]), int(block.tick[-1])) > span:
                self._rows -= len(self._blocks.popleft())

    def latest(self) -> Latest | None:
        """What the newest rows say; None before the first."""
        with self._lock:
            if not self._blocks:
                return None
            newest = self._blocks[-1]
            since = int(newest.tick[-1]) - _LATEST / newest.T_s
            several = islice(reversed(self._blocks), _SEVERAL)
            blocks = [block for block in several if ticks_between(int(since), int(block.tick[-1])) > 0]
        values = {name: _mean(np.concatenate([getattr(block, name) for block in blocks])) for name in SIGNALS}
        return Latest(values, newest.temp_winding, newest.temp_magnet)

    def newest(self) -> Place:
        """The bin that the newest row is in; the first one before there is a row."""
        with self._lock:
            if not self._blocks:
                return Place(self._epoch, 0)
            block = self._blocks[-1]
            return Place(self._epoch, int(block.tick[-1]) // _ticks(block))

    def course(self, since: Place | None = None) -> Course | None:
        """All bins, or from that one on; None before the first row."""
        with self._lock:
            if not self._blocks:
                return None
            newest, epoch = self._blocks[-1], self._epoch
            ticks = _ticks(newest)
            first = since.bin if since is not None and since.epoch == epoch else 0
            later = takewhile(lambda block: int(block.tick[-1]) // ticks >= first, reversed(self._blocks))
            blocks = list(later)[::-1] or [newest]
        bins = np.concatenate([block.tick for block in blocks]) // ticks
        kept = bins >= min(first, int(bins[-1]))
        bins = bins[kept]
        starts = np.flatnonzero(np.diff(bins, prepend=bins[0] - 1))
        at, count = bins[starts] - bins[0], int(bins[-1] - bins[0]) + 1
        low, high = dict[str, Values](), dict[str, Values]()
        for name in SIGNALS:
            values: Values = np.concatenate([getattr(block, name) for block in blocks])[kept]
            for told, extreme in ((low, np.fmin), (high, np.fmax)):
                told[name] = np.full(count, math.nan)
                told[name][at] = extreme.reduceat(values, starts)
        t_end = newest.end * newest.T_s
        return Course(ticks * newest.T_s, Place(epoch, int(bins[0])), t_end, low, high)


def _ticks(block: Block) -> int:
    """Of a bin."""
    return max(block.periods, round(_BIN / block.T_s))


def _follows(block: Block, before: Block) -> bool:
    """The same clock and rows, and later."""
    same = (block.T_s, block.periods) == (before.T_s, before.periods)
    return same and int(block.tick[0]) > int(before.tick[-1])


def _mean(values: Values) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else math.nan
