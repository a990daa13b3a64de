"""CAN frames to rows: joins the frames of a row by the drive's tick. Pure.

A row whose frames are not all there when a later row is complete is lost. A frame of another length is not of this
stream; one that says otherwise of a row than another did makes that row unknown, and tells of a second sender, as does
a second sequence of ticks.
"""

import struct
from collections import deque
from typing import Final

from drivers.block import Block
from drivers.rows import TELLABLE, TICKS, Counts, RowBlocks
from drivers.wire.canopen_od import ROW_TPDOS, TPDO_LAYOUT, tpdo_struct_format
from drivers.wire.codec import FullScales, count_size
from drivers.wire.dictionary import STREAM_ROW

_UNPACK = [struct.Struct(tpdo_struct_format(number)) for number in range(len(TPDO_LAYOUT))]
_NAMES = [signal.name for layout in TPDO_LAYOUT[:ROW_TPDOS] for signal in layout[1:]]
_REMEMBERED: Final = 64  # rows, by which repeated frames are told from a second sender's
_WATCHED: Final = 300  # frames of rows, the latest
_STRAY: Final = 0.25  # of these, of no row: two sequences of ticks
_ORDER = [_NAMES.index(name) for name in STREAM_ROW]


class Assembler:
    """Joins the frames of one stream; arguments as of `RowBlocks`."""

    def __init__(self, T_s: float, periods: int, full: FullScales, tick: int, after: int | None = None) -> None:
        self._rows = RowBlocks(T_s, periods, full, tick, after)
        self._slow_scale = count_size(TPDO_LAYOUT[ROW_TPDOS][1], full)
        self._pending: dict[int, list[tuple[int, ...] | None]] = {}
        self._given: dict[int, tuple[int, list[tuple[int, ...] | None]]] = {}  # by 16 bits of tick
        self._strays: deque[bool] = deque(maxlen=_WATCHED)
        self.conflicts = 0  # frames that said otherwise of a row than one before

    @property
    def counts(self) -> Counts:
        """What has been seen of the stream."""
        return self._rows.counts

    @property
    def periods(self) -> int:
        """Control periods per row."""
        return self._rows.periods

    @property
    def end(self) -> int | None:
        """Tick at which the latest row ended, be it of the stream before; None when there was none."""
        return self._rows.end

    @property
    def two_sequences(self) -> bool:
        """Many of the latest frames are of no row that was or is under way."""
        return len(self._strays) == _WATCHED and sum(self._strays) > _STRAY * _WATCHED

    def frame(self, number: int, data: bytes | bytearray) -> None:
        """Take in TPDO `number` (0 to 3); what cannot be one is counted."""
        if len(data) != _UNPACK[number].size:
            self.counts.frames_foreign += 1
            return
        tick, *values = _UNPACK[number].unpack(data)
        if number == ROW_TPDOS:
            self._rows.temperatures = (values[0] * self._slow_scale, values[1] * self._slow_scale)
            return
        given, end = self._given.get(tick), self._rows.end or 0
        if given is not None and end - given[0] < TELLABLE:
            self._repeated(given[1][number], tuple(values))
            self._strays.append(False)
            return
        new = self._rows.is_new(tick)
        self._strays.append(not new and self.counts.rows > 0)
        if not new:
            return
        parts = self._pending.setdefault(tick, [None] * ROW_TPDOS)
        if parts[number] is not None:
            if not self._repeated(parts[number], tuple(values)):
                parts[number] = ()  # what is true is not known
            return
        parts[number] = tuple(values)
        if all(parts):
            joined = [value for part in parts if part for value in part]
            self._rows.row(tick, tuple(joined[k] for k in _ORDER))
            self._remember(tick, parts)
            self._pending = {
                other: parts for other, parts in self._pending.items() if 0 < (other - tick) % TICKS < TELLABLE
            }

    def _repeated(self, one: tuple[int, ...] | None, other: tuple[int, ...]) -> bool:
        """Count a frame that came again; whether it says the same as before."""
        same = one == other
        if same:
            self.counts.frames_late += 1
        else:
            self.counts.frames_foreign += 1
            self.conflicts += 1
        return same

    def _remember(self, tick: int, parts: list[tuple[int, ...] | None]) -> None:
        self._given.pop(tick, None)
        self._given[tick] = (self._rows.end or 0, parts)
        if len(self._given) > _REMEMBERED:
            del self._given[next(iter(self._given))]

    def take(self) -> list[Block]:
        """The blocks complete by now, oldest first; each is consecutive in itself."""
        return self._rows.take()
