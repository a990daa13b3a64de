"""CAN frames to rows: joins the frames of a row by the drive's tick. Pure.

A row whose frames are not all there when a later row is complete is lost.
"""

import struct

from drivers.block import Block
from drivers.errors import FrameError
from drivers.rows import TELLABLE, TICKS, Counts, RowBlocks
from drivers.wire.canopen_od import ROW_TPDOS, TPDO_LAYOUT, tpdo_struct_format
from drivers.wire.codec import FullScales, count_size
from drivers.wire.dictionary import STREAM_ROW

_UNPACK = [struct.Struct(tpdo_struct_format(number)) for number in range(len(TPDO_LAYOUT))]
_NAMES = [signal.name for layout in TPDO_LAYOUT[:ROW_TPDOS] for signal in layout[1:]]
_ORDER = [_NAMES.index(name) for name in STREAM_ROW]


class Assembler:
    """Joins the frames of one stream; arguments as of `RowBlocks`."""

    def __init__(self, T_s: float, periods: int, full: FullScales, tick: int, after: int | None = None) -> None:
        self._rows = RowBlocks(T_s, periods, full, tick, after)
        self._slow_scale = count_size(TPDO_LAYOUT[ROW_TPDOS][1], full)
        self._pending: dict[int, list[tuple[int, ...] | None]] = {}

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

    def frame(self, number: int, data: bytes | bytearray) -> None:
        """Take in TPDO `number` (0 to 3). Raises FrameError when it cannot be one."""
        if len(data) != _UNPACK[number].size:
            raise FrameError(f"TPDO {number + 1} has {_UNPACK[number].size} bytes, got {len(data)}")
        tick, *values = _UNPACK[number].unpack(data)
        if number == ROW_TPDOS:
            self._rows.temperatures = (values[0] * self._slow_scale, values[1] * self._slow_scale)
            return
        if not self._rows.is_new(tick):
            return
        parts = self._pending.setdefault(tick, [None] * ROW_TPDOS)
        if parts[number] is not None:
            self.counts.frames_late += 1
            return
        parts[number] = tuple(values)
        if all(part is not None for part in parts):
            joined = [value for part in parts if part for value in part]
            self._rows.row(tick, tuple(joined[k] for k in _ORDER))
            self._pending = {
                other: parts for other, parts in self._pending.items() if 0 < (other - tick) % TICKS < TELLABLE
            }

    def take(self) -> list[Block]:
        """The blocks complete by now, oldest first; each is consecutive in itself."""
        return self._rows.take()
