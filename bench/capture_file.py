"""Captures on disk: what has been uploaded so far, and the recording it becomes. The one file that writes Parquet.

An upload under way is `NAME.part`: a line of JSON that says what it is, then counts as they came; it outlives the
process, and is locked while one works at it. The recording is `NAME.parquet`, written whole or not at all. What can no
longer be completed is kept as `NAME.partial.parquet`, whose notes say so. No file that is there is written over: the
new one is `NAME-1` then, or the next that is free.
"""

import contextlib
import fcntl
import json
import os
import secrets
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from itertools import count
from pathlib import Path
from typing import Any, BinaryIO, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.capture import Capture, Setup, Upload, decoded
from drivers.drive import Identity
from drivers.wire.codec import FullScales, channel_signal, count_size

T = TypeVar("T")


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
        device = f"{identity.device_name}, serial {identity.serial}"
        return cls(
            id_, drive, url, device, asked, request, upload.number, upload.tick, upload.count, identity.T_s,
            dict(identity.full),
        )


class PartFile:
    """The file of an upload under way, grown as samples come. It is locked until `close`, which leaves it there."""

    def __init__(self, path: Path, file: BinaryIO, heading: Heading, data: bytearray) -> None:
        """Use `begun` or `found`."""
        self.path, self.heading, self.data = path, heading, data  # what was there, whole samples alone
        self._file, self._done = file, len(data)

    @classmethod
    def begun(cls, path: Path, heading: Heading) -> Self:
        """A new file, under this name or the next that is free. Raises OSError."""
        path, file = _first_free(path, lambda name: name.open("xb"))
        with contextlib.suppress(OSError):  # where a file system has no locks, one does without
            fcntl.flock(file, fcntl.LOCK_EX)
        part = cls(path, file, heading, bytearray())
        try:
            file.write(_head(heading))
            file.flush()
        except OSError:
            part.remove()
            raise
        return part

    @classmethod
    def found(cls, path: Path) -> Self | None:
        """One that an interrupted upload has left; None where it cannot be read as one, or is being worked at."""
        if not path.is_file():
            return None
        with contextlib.ExitStack() as stack, contextlib.suppress(OSError, ValueError, TypeError, KeyError):
            file = stack.enter_context(path.open("r+b"))
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if not os.fstat(file.fileno()).st_nlink:  # it has ended since
                return None
            head, end, data = file.read().partition(b"\n")
            heading = Heading(**json.loads(head))
            size = 2 * len(heading.request["signals"])
            if end and size:
                data = data[: len(data) // size * size][: heading.count * size]
                file.truncate(len(head) + len(end) + len(data))
                file.seek(0, os.SEEK_END)
                stack.pop_all()
                return cls(path, file, heading, bytearray(data))
        return None

    def keep(self, data: bytearray, size: int) -> None:
        """Have the first `size` bytes of the samples on disk."""
        self._file.write(data[self._done : size])
        self._file.flush()
        self._done = max(self._done, size)

    @property
    def samples(self) -> int:
        """Whole samples on disk."""
        return self._done // (2 * len(self.heading.request["signals"]))

    def remove(self) -> None:
        """It is needed no longer."""
        self.path.unlink(missing_ok=True)
        self.close()

    def close(self) -> None:
        """Leave it to who comes next."""
        with contextlib.suppress(OSError):  # of what could not be written, which has been said
            self._file.close()


def _head(heading: Heading) -> bytes:
    return json.dumps(asdict(heading)).encode() + b"\n"


def write_recording(path: Path, heading: Heading, upload: Upload) -> Path:
    """Write what has been uploaded as a recording, whole or not at all, and tell where. Raises OSError."""
    got = decoded(upload, heading.T_s, heading.full)
    return write_columns(path, {"t": got.t} | got.columns, _notes(heading, upload.setup, got))


def write_columns(path: Path, columns: Mapping[str, NDArray[np.float64]], said: Mapping[str, Any]) -> Path:
    """Write t and recorded signals (SI) with notes, whole or not at all, and tell where. Raises OSError."""
    import pyarrow
    import pyarrow.parquet

    from bench.table import NOTES

    pa: Any = pyarrow
    pq: Any = pyarrow.parquet
    schema = pa.schema(
        [pa.field(name, pa.float64(), metadata={"unit": _unit(name)}) for name in columns],
        metadata={NOTES: json.dumps(dict(said)).encode()},
    )
    table = pa.table(dict(columns), schema=schema)
    return write_new(path, lambda file: pq.write_table(table, file, compression="zstd"))


def column_steps(names: Iterable[str], full: FullScales) -> dict[str, float]:
    """SI value of a count of each signal."""
    return {name: count_size(channel_signal(name), full) for name in names}


def write_new(path: Path, write: Callable[[BinaryIO], object]) -> Path:
    """Write a file, whole or not at all, under this name or the next that is free; tell which. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with _unfinished(path) as (unfinished, file):
        write(file)
        file.flush()
        os.fsync(file.fileno())
        return _first_free(path, lambda name: give_name(unfinished, name))[0]


def check_place(path: Path) -> None:
    """Raise OSError where no new file can be written beside this one."""
    with _unfinished(path):
        pass


@contextmanager
def _unfinished(path: Path) -> Generator[tuple[Path, BinaryIO]]:
    """A file of a name that nobody else has; it is gone afterwards."""
    name = path.with_name(f"{path.name}.{secrets.token_hex(4)}.tmp")
    with name.open("xb") as file:
        try:
            yield name, file
        finally:
            name.unlink(missing_ok=True)


def give_name(unfinished: Path, name: Path) -> None:
    """Give a written file its name. Raises FileExistsError where that is another's."""
    try:
        os.link(unfinished, name)
    except FileExistsError:
        raise
    except OSError:  # a file system without links
        name.open("xb").close()
        unfinished.replace(name)


def _first_free(path: Path, make: Callable[[Path], T]) -> tuple[Path, T]:
    """Make a file that is not there yet, under this name or `NAME-1`, `NAME-2`. Raises OSError."""
    stem, dot, ends = path.name.partition(".")
    for k in count(1):
        try:
            return path, make(path)
        except FileExistsError:
            path = path.with_name(f"{stem}-{k}{dot}{ends}")
    raise AssertionError


def _notes(heading: Heading, setup: Setup, got: Capture) -> dict[str, Any]:
    """What a reader of the recording should know besides its columns; SI."""
    samples, expected = len(got.t), heading.request["length"]
    return {
        "capture": heading.id, "drive": heading.drive, "url": heading.url, "device": heading.device,
        "asked": heading.asked, "request": heading.request,
        "samples": samples, "expected": expected, "complete": samples == expected,
        "T_s": heading.T_s, "decimation": setup.decimation, "tick": heading.tick,
        "steps": column_steps(setup.channels, heading.full),
    }


def _unit(name: str) -> str:
    return "s" if name == "t" else channel_signal(name).unit
