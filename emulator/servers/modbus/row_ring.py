"""The latest rows of the stream, by running number: what a drive keeps for clients that ask. Knows nothing of buses."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from drivers.wire.codec import FullScales, si_to_counts
from drivers.wire.dictionary import STREAM_ROW
from emulator.drive.virtual_drive import StreamRows

CAPACITY: Final = 8192  # rows
_HALF: Final = 1 << 31  # of all numbers of 32 bits


@dataclass(frozen=True, slots=True)
class Piece:
    """Rows that join, each of `periods` control periods."""

    first: int  # running number
    tick: int  # at which the first began
    periods: int
    rows: bytes  # big-endian counts, row by row
    count: int


class RowRing:
    """Counts of the rows since reset, the latest `CAPACITY` of them."""

    def __init__(self, full: FullScales) -> None:
        self.made = 0  # since reset
        self._full = full
        self._ticks = np.zeros(CAPACITY, np.int64)
        self._periods = np.zeros(CAPACITY, np.int64)
        self._counts = np.zeros((CAPACITY, len(STREAM_ROW)), ">i2")

    def clear(self) -> None:
        """As after a reset."""
        self.made = 0

    def add(self, rows: StreamRows, end: int) -> None:
        """Take in rows that are complete; the last of them ended at tick `end`."""
        n = len(rows)
        place = np.arange(self.made, self.made + n) % CAPACITY
        self._ticks[place] = rows.row_tick
        self._periods[place] = np.diff(rows.row_tick, append=end)
        self._counts[place] = si_to_counts([getattr(rows, name) for name in STREAM_ROW], STREAM_ROW, self._full)
        self.made += n

    def piece(self, first: int, most: int) -> Piece:
        """`most` rows from number `first` (low 32 bits) on, or from the oldest there is, as far as they join."""
        first = self.made + (first - self.made + _HALF) % (2 * _HALF) - _HALF
        first = min(max(first, self.made - CAPACITY, 0), self.made)
        place = np.arange(first, min(first + most, self.made)) % CAPACITY
        if not len(place):
            return Piece(first, 0, 0, b"", 0)
        ticks, periods = self._ticks[place], self._periods[place]
        joins = (ticks[1:] == ticks[:-1] + periods[:-1]) & (periods[1:] == periods[0])
        count = 1 + int(np.argmin(np.append(joins, False)))
        return Piece(first, int(ticks[0]), int(periods[0]), self._counts[place[:count]].tobytes(), count)
