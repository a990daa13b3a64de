"""Frames to blocks: joins the frames of a row by the drive's tick, unwraps the tick, counts what is missing. Pure.

A row whose frames are not all there when a later row is complete is lost: a gap, never a repetition.
"""

import struct
from dataclasses import dataclass

import numpy as np

from drivers.block import Block
from drivers.errors import FrameError
from drivers.wire.canopen_od import ROW_TPDOS, TPDO_LAYOUT, tpdo_struct_format
from drivers.wire.codec import FullScales, count_size

_UNPACK = [struct.Struct(tpdo_struct_format(number)) for number in range(len(TPDO_LAYOUT))]
_NAMES = [signal.name for layout in TPDO_LAYOUT[:ROW_TPDOS] for signal in layout[1:]]
_TICKS = 1 << 16
TELLABLE = _TICKS // 2  # control periods; a row's 16-bit tick tells no longer silence


@dataclass(slots=True)
class Counts:
    """What an assembler has seen."""

    rows: int = 0
    gaps: int = 0
    rows_lost: int = 0
    frames_late: int = 0  # repeated, or older than a row already given out


class Assembler:
    """Joins the frames of one stream of rows of `periods` control periods.

    `tick` is the drive's full tick, read before the stream began and after `periods` was set: rows that began
    before it are ignored, the first is less than 32768 periods later. `after` is where the rows of a stream before
    this one ended, when there was one.
    """

    def __init__(self, T_s: float, periods: int, full: FullScales, tick: int, after: int | None = None) -> None:
        self._T_s = T_s
        self.periods = periods
        self._scales = np.array([count_size(s, full) for layout in TPDO_LAYOUT[:ROW_TPDOS] for s in layout[1:]])
        self._slow_scale = count_size(TPDO_LAYOUT[ROW_TPDOS][1], full)
        self._last_tick = tick
        self._after = after
        self._first = True
        self._pending: dict[int, list[tuple[int, ...] | None]] = {}
        self._ticks: list[int] = []
        self._rows: list[tuple[int, ...]] = []
        self._lost_before = 0
        self._ready: list[Block] = []
        self._temperatures = (float("nan"), float("nan"))
        self.counts = Counts()

    def frame(self, number: int, data: bytes | bytearray) -> None:
        """Take in TPDO `number` (0 to 3). Raises FrameError when it cannot be one."""
        if len(data) != _UNPACK[number].size:
            raise FrameError(f"TPDO {number + 1} has {_UNPACK[number].size} bytes, got {len(data)}")
        tick, *values = _UNPACK[number].unpack(data)
        if number == ROW_TPDOS:
            self._temperatures = (values[0] * self._slow_scale, values[1] * self._slow_scale)
            return
        ahead = (tick - self._last_tick) % _TICKS
        if ahead >= TELLABLE or (ahead == 0 and not self._first):
            self.counts.frames_late += not self._first
            return
        parts = self._pending.setdefault(tick, [None] * ROW_TPDOS)
        if parts[number] is not None:
            self.counts.frames_late += 1
            return
        parts[number] = tuple(values)
        if all(part is not None for part in parts):
            self._complete(tick, ahead, [value for part in parts if part for value in part])

    @property
    def end(self) -> int | None:
        """Tick at which the latest row ended, be it of the stream before; None when there was none."""
        return self._after if self._first else self._last_tick + self.periods

    def take(self) -> list[Block]:
        """The blocks complete by now, oldest first; each is consecutive in itself."""
        self._close_block()
        ready, self._ready = self._ready, []
        return ready

    def _complete(self, tick: int, ahead: int, values: list[int]) -> None:
        if not self._first and ahead % self.periods:
            raise FrameError(
                f"rows come every {self.periods} ticks, but tick {tick} came {ahead} after the one before"
            )
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
        self._ticks.append(self._last_tick)
        self._rows.append(tuple(values))
        self.counts.rows += 1
        self._pending = {
            other: parts for other, parts in self._pending.items() if 0 < (other - tick) % _TICKS < TELLABLE
        }

    def _count_of(self, name: str) -> float:
        return float(self._scales[_NAMES.index(name)])

    def _close_block(self) -> None:
        if not self._rows:
            return
        columns = (np.array(self._rows, dtype=np.float64) * self._scales).T
        self._ready.append(Block(
            tick=np.array(self._ticks, dtype=np.int64), **dict(zip(_NAMES, columns, strict=True)),
            T_s=self._T_s, periods=self.periods, lost_before=self._lost_before, i_step=self._count_of("i_d"),
            u_step=self._count_of("u_d"),
            temp_winding=self._temperatures[0], temp_magnet=self._temperatures[1],
        ))
        self._ticks, self._rows, self._lost_before = [], [], 0
