"""Whether a line carries the rows that are asked for, and which row length it would carry. Pure."""

import math
from typing import Final

from drivers.rows import Counts

SPAN: Final = 3.0  # s of the drive's time over which it is looked at
_LOST: Final = 0.3  # of all rows: more is no fault of a line, it is too slow
_SPARE: Final = 0.7  # of what it carries is asked for: the rest is for requests
_MOST_PERIODS: Final = 1000  # control periods per row


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
