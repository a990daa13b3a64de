"""Captures on disk: what has been uploaded so far, and the recording it becomes. The one file that writes Parquet.

An upload under way is `NAME.part`: a line of JSON that says what it is, then counts as they came; it outlives the
process. The recording is `NAME.parquet`, written whole or not at all. What can no longer be completed is kept as
`NAME.partial.parquet`, whose notes say so.
"""

import contextlib
import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from drivers.capture import Capture, Setup, Upload, decoded
from drivers.drive import Identity
from drivers.wire.codec import channel_signal, count_size


@dataclass(frozen=True, slots=True)
class Heading:
    """What an upload under way is, apart from its samples."""

    id: str
    drive: str
    url: str
    device: str
    asked: str  # RFC 3339
    request: dict[str, Any]
    number: int  # of the drive's recording
    tick: int
    count: int  # samples there are
    T_s: float  # s
    full: dict[str, float]  # full scales, SI

    @classmethod
    def of(
        cls, id_: str, drive: str, url: str, asked: str, request: dict[str, Any], identity: Identity, upload: Upload
    ) -> Self:
        full = {"i_full": identity.i_full, "u_full": identity.u_full, "omega_full": identity.omega_full}
        device = f"{identity.device_name}, serial {identity.serial}"
        return cls(
            id_, drive, url, device, asked, request, upload.number, upload.tick, upload.count, identity.T_s, full
        )


class PartFile:
    """The file of an upload under way, grown as samples come. Use as a context manager; leaving it keeps the file."""

    def __init__(self, path: Path, heading: Heading, done: int | None = None) -> None:
        """A new file; with `done`, the one that is there, of whose samples so many bytes are good. Raises OSError."""
        head = json.dumps(asdict(heading)).encode() + b"\n"
        self._file = path.open("xb" if done is None else "r+b")
        self._done = done or 0
        if done is None:
            self._file.write(head)
            self._file.flush()
        else:
            self._file.truncate(len(head) + done)
            self._file.seek(0, os.SEEK_END)

    def keep(self, data: bytearray, size: int) -> None:
        """Have the first `size` bytes of the samples on disk."""
        self._file.write(data[self._done : size])
        self._file.flush()
        self._done = max(self._done, size)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()


def read_part(path: Path) -> tuple[Heading, bytearray] | None:
    """What an upload that was interrupted has kept, whole samples alone; None where it cannot be read as one."""
    with contextlib.suppress(OSError, ValueError, TypeError, KeyError):
        head, end, data = path.read_bytes().partition(b"\n")
        heading = Heading(**json.loads(head))
        size = 2 * len(heading.request["signals"])
        if end and size:
            return heading, bytearray(data[: len(data) // size * size][: heading.count * size])
    return None


def write_recording(path: Path, heading: Heading, upload: Upload) -> None:
    """Write what has been uploaded as a recording, whole or not at all. Raises OSError."""
    import pyarrow
    import pyarrow.parquet

    from bench.table import NOTES

    pa: Any = pyarrow
    pq: Any = pyarrow.parquet
    got = decoded(upload, heading.T_s, heading.full)
    columns = {"t": got.t} | got.columns
    schema = pa.schema(
        [pa.field(name, pa.float64(), metadata={"unit": _unit(name)}) for name in columns],
        metadata={NOTES: json.dumps(_notes(heading, upload.setup, got)).encode()},
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(path.name + ".tmp")
    try:
        with unfinished.open("wb") as file:
            pq.write_table(pa.table(columns, schema=schema), file, compression="zstd")
            file.flush()
            os.fsync(file.fileno())
        unfinished.replace(path)
    except BaseException:
        unfinished.unlink(missing_ok=True)
        raise


def _notes(heading: Heading, setup: Setup, got: Capture) -> dict[str, Any]:
    """What a reader of the recording should know besides its columns; SI."""
    samples = len(got.t)
    return {
        "capture": heading.id, "drive": heading.drive, "url": heading.url, "device": heading.device,
        "asked": heading.asked, "request": heading.request,
        "samples": samples, "expected": heading.count, "complete": samples == heading.count,
        "T_s": heading.T_s, "decimation": setup.decimation, "tick": heading.tick,
        "steps": {name: count_size(channel_signal(name), heading.full) for name in setup.channels},
    }


def _unit(name: str) -> str:
    return "s" if name == "t" else channel_signal(name).unit
