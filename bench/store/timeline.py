"""When rows were made, as control periods from a recording's begin: by the drive's clock, as long as it is the same.

Where that begins anew, as after a reset, it goes on by the bench's clock, and says so. Pure.
"""

import math
from dataclasses import dataclass

from bench.live.acquisition import Link
from bench.live.drive_clock import ticks_between
from bench.store.rows import Rows
from bench.store.segments import Event
from drivers.block import Block


@dataclass(frozen=True, slots=True)
class Gap:
    """Rows that never came."""

    place: int  # control periods from the recording's begin to the first row after it
    rows: int  # the drive made, as far as it is known
    clock_reset: bool  # the drive's clock began anew: how long it took is by the bench's

    def event(self, begin: int) -> Event:
        """As a recording tells it that begins at a place."""
        return {"place": self.place - begin, "what": "clock reset" if self.clock_reset else "gap", "rows": self.rows}


class Timeline:
    """Of one recording, block after block."""

    def __init__(self) -> None:
        self._end: int | None = None  # control periods from the begin to the end of the latest row
        self._tick = 0  # of the drive, there
        self._made = 0.0  # s, monotonic, when it was
        self._resets = 0

    def rows(self, block: Block, link: Link) -> tuple[Rows, Gap | None]:
        """A block's rows where they belong, and the gap before them. `link`: as it was when the block had come."""
        place, gap = 0, None
        if self._end is not None:
            reset = link.clock_resets != self._resets
            missed = ticks_between(self._tick, int(block.tick[0]))
            if reset or missed < 0:
                missed, reset = self._by_our_clock(block, link), True
            place = self._end + missed
            if missed or block.lost_before or reset:
                gap = Gap(place, max(missed // block.periods, block.lost_before), reset)
        rows = Rows.of(block, place, gap.rows if gap else 0)
        self._end, self._tick = rows.end, block.end
        self._made, self._resets = link.made or self._made, link.clock_resets
        return rows, gap

    def _by_our_clock(self, block: Block, link: Link) -> int:
        """Control periods between the latest row's end and a block's begin, whole rows and at least one."""
        seconds = (link.made or self._made) - self._made - len(block) * block.periods * block.T_s
        return max(1, math.ceil(seconds / (block.T_s * block.periods))) * block.periods
