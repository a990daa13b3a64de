"""CAN frames to rows: joins the frames of a row by the drive's tick. Pure.

A row whose frames are not all there when a later row is complete is lost. A frame of another length is not of this
stream; one that says otherwise of a row than another did makes that row unknown, and tells of a second sender, as does
a second sequence of ticks.
"""

import struct
from collections import deque
from collections.abc import Sequence
from typing import Final

import numpy as np

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
_ROW_FRAME: Final = _UNPACK[0].size  # bytes of each frame of a row
_NOT_KNOWN: Final = b"?"  # of which frames have said different things


class Assembler:
    """Joins the frames of one stream; arguments as of `RowBlocks`."""

    def __init__(self, T_s: float, periods: int, full: FullScales, tick: int, after: int | None = None) -> None:
        self._rows = RowBlocks(T_s, periods, full, tick, after)
        self._slow_scale = count_size(TPDO_LAYOUT[ROW_TPDOS][1], full)
        self._pending: dict[int, list[bytes]] = {}  # by 16 bits of tick: frames of a row, empty where none has come
        self._given: dict[int, tuple[int, Sequence[bytes]]] = {}  # rows' ends and frames, likewise
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

    def frames(self, frames: Sequence[tuple[int, bytes]]) -> None:
        """Take in frames, each with the number of its TPDO; rows that are whole and follow each other at once."""
        if not self._taken_whole([frame for frame in frames if frame[0] < ROW_TPDOS]):
            for number, data in frames:
                self.frame(number, data)
            return
        for number, data in frames:
            if number == ROW_TPDOS:
                self.frame(number, data)

    def _taken_whole(self, frames: Sequence[tuple[int, bytes]]) -> bool:
        """Take in rows of the stream whose frames are all there, in order, and join those before; or nothing."""
        n, end = len(frames) // ROW_TPDOS, self._rows.end
        if not n or self._pending or end is None or not self.counts.rows:
            return False
        payloads = [data for _, data in frames]
        in_order = [number for number, _ in frames] == [*range(ROW_TPDOS)] * n
        if not in_order or any(len(data) != _ROW_FRAME for data in payloads):
            return False
        words = np.frombuffer(b"".join(payloads), "<i2").reshape(n, ROW_TPDOS, -1)
        ticks = end + self.periods * np.arange(n)
        if (words[:, :, 0] != ticks.astype(np.uint16).view(np.int16)[:, None]).any():
            return False
        self._rows.run(end & 0xFFFF_FFFF, words[:, :, 1:].reshape(n, -1)[:, _ORDER])
        self._strays.extend([False] * len(frames))
        for k, tick in enumerate(ticks.tolist()):
            self._remember(tick + self.periods, payloads[ROW_TPDOS * k : ROW_TPDOS * (k + 1)], tick % TICKS)
        return True

    def frame(self, number: int, data: bytes | bytearray) -> None:
        """Take in TPDO `number` (0 to 3); what cannot be one is counted."""
        if len(data) != _UNPACK[number].size:
            self.counts.frames_foreign += 1
            return
        data = bytes(data)
        tick = int.from_bytes(data[:2], "little")
        if number == ROW_TPDOS:
            _, *values = _UNPACK[number].unpack(data)
            self._rows.temperatures = (values[0] * self._slow_scale, values[1] * self._slow_scale)
            return
        given, end = self._given.get(tick), self._rows.end or 0
        if given is not None and end - given[0] < TELLABLE:
            self._repeated(given[1][number], data)
            self._strays.append(False)
            return
        new = self._rows.is_new(tick)
        self._strays.append(not new and self.counts.rows > 0)
        if not new:
            return
        parts = self._pending.setdefault(tick, [b""] * ROW_TPDOS)
        if parts[number]:
            if not self._repeated(parts[number], data):
                parts[number] = _NOT_KNOWN
            return
        parts[number] = data
        if all(len(part) == _ROW_FRAME for part in parts):
            self._row(tick, parts)

    def _row(self, tick: int, parts: Sequence[bytes]) -> None:
        """All frames of a row have come."""
        joined = [value for unpack, part in zip(_UNPACK, parts, strict=False) for value in unpack.unpack(part)[1:]]
        self._rows.row(tick, tuple(joined[k] for k in _ORDER))
        self._remember(self._rows.end or 0, parts, tick)
        self._pending = {
            other: parts for other, parts in self._pending.items() if 0 < (other - tick) % TICKS < TELLABLE
        }

    def _repeated(self, one: bytes, other: bytes) -> bool:
        """Count a frame that came again; whether it says the same as before."""
        same = one == other
        if same:
            self.counts.frames_late += 1
        else:
            self.counts.frames_foreign += 1
            self.conflicts += 1
        return same

    def _remember(self, end: int, parts: Sequence[bytes], tick: int) -> None:
        """The frames of a row that ended at `end`, by 16 bits of its own tick."""
        self._given.pop(tick, None)
        self._given[tick] = (end, parts)
        if len(self._given) > _REMEMBERED:
            del self._given[next(iter(self._given))]

    def take(self) -> list[Block]:
        """The blocks complete by now, oldest first; each is consecutive in itself."""
        return self._rows.take()
