"""A recording under way on disk: segments of rows and events, one after the other, each readable alone.

    ID.0001.stream, ID.0002.stream, ...: part files (see `recordings.part_file`) of at most 64 MB
    H   the heading, as JSON: what the recording is; the same in each segment but for the number
    R   rows, see `rows`
    E   an event, as JSON: {"place": ..., "what": ..., ...}

What is appended outlives the process at once, and a power cut half a second later. What a segment's end lacks is told.
"""

import contextlib
import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final, Self

from bench.errors import RecordingError
from bench.recordings.part_file import PartFile
from bench.store.rows import Rows, packed, unpacked

SUFFIX: Final = ".stream"
_HEADING: Final = b"H"
_ROWS: Final = b"R"
_EVENT: Final = b"E"
_SEGMENT: Final = 1 << 26  # bytes of a segment, from which on another one begins

Event = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Heading:
    """What a recording of the stream is."""

    id: str
    drive: str
    url: str
    device: str
    layout: int  # checksum of the drive's dictionary
    asked: str  # RFC 3339
    whom: str  # who asked for it
    begun: str  # RFC 3339, by the bench's clock: place 0
    request: dict[str, Any]
    T_s: float  # s, control period
    periods: int  # control periods a row
    steps: dict[str, float]  # SI value of a count of each column
    window: dict[str, Any]  # of the estimation, at the begin
    machine: dict[str, Any]  # nominal values, SI
    versions: dict[str, str]
    continues: str = ""  # id of the recording that it goes on with
    segment: int = 1


class Segments:
    """The segments of a recording that grows; all are locked until `close`."""

    def __init__(self, folder: Path, heading: Heading) -> None:
        """Begin the first. Raises OSError, FileExistsError where one of that name is there."""
        self._folder, self._heading = folder, heading
        self._before: list[PartFile] = []  # full ones
        self._file = self._begun(heading)

    @property
    def size(self) -> int:
        """Bytes of all segments."""
        return sum(file.size for file in (*self._before, self._file))

    def rows(self, rows: Rows) -> None:
        """Append rows. Raises OSError; what was there is safe then."""
        self._append(_ROWS, packed(rows))

    def event(self, event: Event) -> None:
        """Append an event. Raises OSError."""
        self._append(_EVENT, json.dumps(event).encode())

    def sync(self) -> None:
        """Have all of it on disk. Raises OSError."""
        self._file.sync()

    def close(self) -> None:
        """Leave it to who comes next, on disk."""
        with contextlib.suppress(OSError, ValueError):
            self._file.sync()
        for file in (*self._before, self._file):
            file.close()

    def _append(self, kind: bytes, content: bytes) -> None:
        if self._file.size + len(content) > _SEGMENT:
            heading = replace(self._heading, segment=self._heading.segment + 1)
            file = self._begun(heading)
            self._file.sync()
            self._before.append(self._file)
            self._heading, self._file = heading, file
        self._file.append(kind, content)

    def _begun(self, heading: Heading) -> PartFile:
        path = path_of(self._folder, heading.id, heading.segment)
        if path.exists():
            raise FileExistsError(f"{path.name} is there already")
        return PartFile.begun(path, _HEADING, json.dumps(asdict(heading)).encode())


class FoundSegments:
    """The segments that a recording has left, locked until `close`; read one by one, as often as one likes."""

    def __init__(self, heading: Heading, paths: list[Path], locks: contextlib.ExitStack) -> None:
        """Use `found`."""
        self.heading, self.paths = heading, paths
        self.lacking: list[str] = []  # of the reading before: what is damaged or missing, a sentence each
        self._locks = locks

    @classmethod
    def found(cls, folder: Path, id_: str) -> Self | None:
        """Those of a recording; None where it is still under way. Raises RecordingError, OSError."""
        paths = sorted(folder.glob(f"{id_}.[0-9][0-9][0-9][0-9]{SUFFIX}"))
        heading: Heading | None = None
        with contextlib.ExitStack() as locks:
            for path in paths:
                with contextlib.suppress(RecordingError):  # told when it is read
                    file = PartFile.found(path)
                    if file is None:
                        return None
                    locks.callback(file.close)
                    heading = heading or _heading_of(file)
                    file.records.clear()
            if heading is None:
                raise RecordingError(f"{id_}: expected segments of a recording, none of {len(paths)} can be read")
            return cls(heading, paths, locks.pop_all())
        raise AssertionError

    def records(self) -> Iterator[Rows | Event]:
        """Rows and events in their order; `lacking` tells afterwards what was not there."""
        self.lacking = []
        expected = 1
        for path in self.paths:
            try:
                records, damaged = PartFile.contents(path)
                heading = Heading(**json.loads(records[0][1]))
            except (RecordingError, OSError, ValueError, TypeError, LookupError) as error:
                self.lacking.append(str(error))
                continue
            if heading.segment != expected:
                self.lacking.append(f"segments {expected} to {heading.segment - 1} are not there")
            expected = heading.segment + 1
            if damaged:
                self.lacking.append(f"the last {damaged} bytes of {path.name} are not whole, and are left out")
            for kind, content in records[1:]:
                if kind == _ROWS:
                    yield unpacked(content)
                elif kind == _EVENT:
                    yield json.loads(content)

    def remove(self) -> None:
        """They are needed no longer. Raises OSError."""
        for path in self.paths:
            path.unlink(missing_ok=True)

    def close(self) -> None:
        """Leave them to who comes next."""
        self._locks.close()


def path_of(folder: Path, id_: str, segment: int) -> Path:
    """Of a segment."""
    return folder / f"{id_}.{segment:04d}{SUFFIX}"


def ids_in(folder: Path) -> list[str]:
    """Of recordings that are under way, or were left, by name."""
    return sorted({path.name.rsplit(".", 2)[0] for path in folder.glob(f"*.[0-9][0-9][0-9][0-9]{SUFFIX}")})


def _heading_of(file: PartFile) -> Heading:
    try:
        return Heading(**json.loads(file.records[0][1]))
    except (ValueError, TypeError, LookupError):
        raise RecordingError(f"{file.path.name}: expected a recording of the stream, it is something else") from None
