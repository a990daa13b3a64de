"""Captures on disk: what is known of one under way, and the recording it becomes. The one file that writes Parquet.

A capture under way is `NAME.part`, see `part_file`: what it is, anew whenever more of that is known, and counts as they
came. The recording is `NAME.parquet`, written whole or not at all. What can no longer be completed is kept as
`NAME.partial.parquet`, whose notes say so. No file that is there is written over, see `bench.files`.
"""

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from bench.files import write_new
from bench.recordings.foreign.content import NOTES, pa, pq
from bench.recordings.part_file import OnPartFile, PartFile, piece_size
from bench.recordings.seal import sealed
from drivers.capture import Capture, Setup, Upload, decoded
from drivers.drive import Identity
from drivers.wire.codec import FullScales, channel_signal, count_size

_HEADING: Final = b"H"
_SAMPLES: Final = b"S"


@dataclass(frozen=True, slots=True)
class Heading:
    """What a capture under way is, apart from its samples."""

    id: str
    drive: str
    url: str
    device: str
    asked: str  # RFC 3339
    request: dict[str, Any]
    T_s: float  # s
    full: dict[str, float]  # full scales, SI
    number: int = 0  # of the drive's recording; 0 before it is armed
    armed: int = 0  # the drive's tick then
    tick: int = 0  # of the first sample
    count: int | None = None  # samples there are; None before it is complete in the drive
    off_before: str = ""  # why the drive drove no voltage when it was armed, a clause; empty: it did
    off_after: str = ""  # why it drove none when its upload began

    @classmethod
    def of(cls, id_: str, drive: str, url: str, asked: str, request: dict[str, Any], identity: Identity) -> Self:
        return cls(id_, drive, url, device_of(identity), asked, request, identity.T_s, dict(identity.full))

    @property
    def record(self) -> bytes:
        """As it stands in a part file."""
        return json.dumps(asdict(self)).encode()


class CapturePart(OnPartFile):
    """The part file of a capture under way, grown as samples come."""

    what = "a capture"

    def __init__(self, file: PartFile, heading: Heading, data: bytearray) -> None:
        """Use `begun` or `found`."""
        self.heading, self.data = heading, data  # what was there, whole samples alone
        super().__init__(file)
        self._done = len(data)

    @classmethod
    def begun(cls, path: Path, heading: Heading) -> Self:
        """A new file, under this name or the next that is free. Raises OSError."""
        return cls(PartFile.begun(path, _HEADING, heading.record), heading, bytearray())

    @classmethod
    def of(cls, file: PartFile) -> Self:
        headings = [content for kind, content in file.records if kind == _HEADING]
        heading = Heading(**json.loads(headings[-1]))
        data = bytearray().join(content for kind, content in file.records if kind == _SAMPLES)
        size = 2 * len(heading.request["signals"])
        return cls(file, heading, data[: len(data) // size * size])

    def change(self, heading: Heading) -> None:
        """More is known of it; on disk at once. Raises OSError."""
        self._file.append(_HEADING, heading.record)
        self._file.sync()
        self.heading = heading

    def keep(self, data: bytearray, size: int) -> None:
        """Keep the first `size` bytes of the samples. Raises OSError."""
        whole = piece_size(2 * len(self.heading.request["signals"]))
        while self._done < size:
            end = min(self._done + whole, size)
            self._file.append(_SAMPLES, data[self._done : end])
            self._done = end

    @property
    def samples(self) -> int:
        """Whole samples on disk."""
        return self._done // (2 * len(self.heading.request["signals"]))


def device_of(identity: Identity) -> str:
    """A drive's device in words."""
    return f"{identity.device_name}, serial {identity.serial}"


def write_recording(path: Path, heading: Heading, upload: Upload) -> Path:
    """Write what has been uploaded as a recording, whole or not at all, and tell where. Raises OSError."""
    got = decoded(upload, heading.T_s, heading.full)
    return write_columns(path, {"t": got.t} | got.columns, _notes(heading, upload.setup, got))


def write_columns(path: Path, columns: Mapping[str, NDArray[np.float64]], said: Mapping[str, Any]) -> Path:
    """Write t and recorded signals (SI) with notes, sealed, whole or not at all, and tell where. Raises OSError."""
    schema = pa.schema(
        [pa.field(name, pa.float64(), metadata={"unit": _unit(name)}) for name in columns],
        metadata={NOTES: json.dumps(dict(said)).encode()},
    )
    table = pa.table(dict(columns), schema=schema)
    content: Any = pa.BufferOutputStream()
    pq.write_table(table, content, compression="zstd", write_page_checksum=True)
    whole = sealed(content.getvalue().to_pybytes())
    return write_new(path, lambda file: file.write(whole))


def column_steps(names: Iterable[str], full: FullScales) -> dict[str, float]:
    """SI value of a count of each signal."""
    return {name: count_size(channel_signal(name), full) for name in names}


def _notes(heading: Heading, setup: Setup, got: Capture) -> dict[str, Any]:
    """What a reader of the recording should know besides its columns; SI."""
    samples, expected = len(got.t), heading.request["length"]
    return {
        "capture": heading.id, "drive": heading.drive, "url": heading.url, "device": heading.device,
        "asked": heading.asked, "request": heading.request,
        "samples": samples, "expected": expected, "complete": samples == expected,
        "T_s": heading.T_s, "decimation": setup.decimation, "tick": heading.tick,
        "off_before": heading.off_before, "off_after": heading.off_after,
        "steps": column_steps(setup.channels, heading.full),
    }


def _unit(name: str) -> str:
    return "s" if name == "t" else channel_signal(name).unit
