"""Rows of a drive's stream: as bytes of a record on disk, and as columns of a recording. SI.

    place of the first row (8 bytes), tick (8), control periods a row (4), rows (4), lost before (4), temperatures (16)
    the columns as float64, one after the other, compressed by Zstandard

Little-endian. What came is kept to the bit; as a column's values are counts, of which there are few, they repeat.
"""

import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from bench.recordings.table import pa
from drivers.block import Block
from drivers.wire.codec import FullScales, count_size
from drivers.wire.dictionary import STREAM_ROW, signal_named

COLUMNS: Final = STREAM_ROW
BYTES_PER_ROW: Final = 40.0  # on disk, at most, of a stream of 1 kHz
SLOW: Final = ("periods", "temp_winding", "temp_magnet")  # the same for many rows
_HEAD: Final = struct.Struct("<qqIIIdd")
_CODEC: Final = pa.Codec("zstd", compression_level=3)
_BYTES: Final = 8  # of a number


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Consecutive rows without a gap."""

    place: int  # control periods from the recording's begin to the first row's start
    tick: int  # of the drive, at the first row's start
    periods: int  # control periods a row
    lost_before: int  # rows that the drive made since the row before, and which never came
    columns: NDArray[np.float64]  # (9, n), as `COLUMNS`
    temp_winding: float  # degC, latest; NaN where the drive tells none
    temp_magnet: float

    def __len__(self) -> int:
        return self.columns.shape[1]

    @property
    def end(self) -> int:
        """Control periods from the recording's begin to the last row's end."""
        return self.place + len(self) * self.periods

    @classmethod
    def of(cls, block: Block, place: int, lost_before: int) -> Self:
        """A block, where it belongs in a recording."""
        columns = np.array([getattr(block, name) for name in COLUMNS])
        return cls(
            place, int(block.tick[0]), block.periods, lost_before, columns, block.temp_winding, block.temp_magnet
        )

    def joins(self, before: "Rows") -> bool:
        """It follows another at once."""
        return self.place == before.end and self.periods == before.periods and not self.lost_before

    def part(self, rows: slice) -> "Rows":
        """Some of them."""
        first = rows.indices(len(self))[0]
        skipped = first * self.periods
        return Rows(
            self.place + skipped, self.tick + skipped, self.periods, 0 if first else self.lost_before,
            self.columns[:, rows], self.temp_winding, self.temp_magnet,
        )  # fmt: skip

    def moved(self, by: int) -> "Rows":
        """Later by so many control periods."""
        return Rows(
            self.place + by, self.tick, self.periods, self.lost_before, self.columns, self.temp_winding,
            self.temp_magnet,
        )  # fmt: skip


def joined(rows: Sequence[Rows]) -> list[Rows]:
    """The same rows in as few stretches as there are gaps."""
    stretches: list[list[Rows]] = []
    for one in rows:
        if stretches and one.joins(stretches[-1][-1]):
            stretches[-1].append(one)
        else:
            stretches.append([one])
    return [_one_of(stretch) for stretch in stretches]


def _one_of(stretch: Sequence[Rows]) -> Rows:
    if len(stretch) == 1:
        return stretch[0]
    first, last = stretch[0], stretch[-1]
    columns = np.concatenate([rows.columns for rows in stretch], axis=1)
    return Rows(
        first.place, first.tick, first.periods, first.lost_before, columns, last.temp_winding, last.temp_magnet
    )


def packed(rows: Rows) -> bytes:
    """As a record's content."""
    head = _HEAD.pack(
        rows.place, rows.tick, rows.periods, len(rows), rows.lost_before, rows.temp_winding, rows.temp_magnet
    )
    return head + _CODEC.compress(rows.columns.astype("<f8").tobytes(), asbytes=True)


def unpacked(content: bytes) -> Rows:
    """From a record's content. Raises ValueError where it is none."""
    if len(content) < _HEAD.size:
        raise ValueError(f"expected a head of {_HEAD.size} bytes, came {len(content)}")
    place, tick, periods, n, lost, winding, magnet = _HEAD.unpack_from(content)
    plain = _CODEC.decompress(content[_HEAD.size :], len(COLUMNS) * n * _BYTES, asbytes=True)
    columns = np.frombuffer(plain, "<f8").reshape(len(COLUMNS), n)
    return Rows(place, tick, periods, lost, columns, winding, magnet)


def steps_of(full: FullScales) -> dict[str, float]:
    """SI value of a count of each column."""
    return {name: count_size(signal_named(name), full) for name in COLUMNS}


def table_columns(rows: Iterable[Rows], T_s: float) -> dict[str, NDArray[np.float64]]:
    """Columns of a recording, with t in s, periods, and temperatures where they are told."""
    stretches = list(rows)
    places = np.concatenate([one.place + one.periods * np.arange(len(one)) for one in stretches])
    t = T_s * places.astype(np.float64)
    columns = np.concatenate([one.columns for one in stretches], axis=1)
    lengths = [len(one) for one in stretches]
    constant = np.array([(one.periods, one.temp_winding, one.temp_magnet) for one in stretches]).T
    slow = np.repeat(constant, lengths, axis=1)
    return {"t": t} | dict(zip((*COLUMNS, *SLOW), (*columns, *slow), strict=True))
