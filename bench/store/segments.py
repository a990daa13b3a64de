"""A recording under way on disk: segments of rows and events, one after the other, each readable alone.

    ID.0001.stream, ID.0002.stream, ...: part files (see `recordings.part_file`) of at most 64 MB
    H   the heading, as JSON: what the recording is; the same in each segment but for the number
    R   rows, see `rows`
    E   an event, as JSON: {"place": ..., "what": ..., ...}

What is appended outlives the process at once, and a power cut half a second later. Of a damaged segment all records
are read that are whole, and it stays, as ID.0001.damaged; what is missing is told.
"""

import contextlib
import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from glob import escape
from pathlib import Path
from typing import Any, Final, Self

from bench.errors import RecordingError
from bench.recordings.part_file import DAMAGED, Damage, PartFile, Record, damaged_name, keep_damaged, salvaged
from bench.store.rows import Rows, packed, unpacked

SUFFIX: Final = ".stream"
_HEADING: Final = b"H"
_ROWS: Final = b"R"
_EVENT: Final = b"E"
_NUMBERED: Final = ".[0-9][0-9][0-9][0-9]"
_KINDS: Final = _HEADING + _ROWS + _EVENT
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


@dataclass(frozen=True, slots=True)
class Hole:
    """Where segments are damaged, or missing: control periods from the recording's begin."""

    begin: int
    end: int  # the begin, where it is not known how much is missing


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
        # Of the reading before:
        self.lacking: list[str] = []  # what is damaged or missing, a sentence each
        self.holes: list[Hole] = []  # where rows are missing for that
        self._damaged: list[Path] = []
        self._locks = locks

    @classmethod
    def found(cls, folder: Path, id_: str) -> Self | None:
        """Those of a recording; None where it is still under way. Raises RecordingError, OSError."""
        paths = sorted(folder.glob(f"{id_}{_NUMBERED}{SUFFIX}"))
        heading: Heading | None = None
        with contextlib.ExitStack() as locks:
            for path in paths:
                with contextlib.suppress(RecordingError):  # told when it is read
                    file = PartFile.locked(path)
                    if file is None:
                        return None
                    locks.callback(file.close)
                    heading = heading or _heading_of(path)
            if heading is None:
                raise RecordingError(f"{id_}: expected segments of a recording, none of {len(paths)} can be read")
            return cls(heading, paths, locks.pop_all())
        raise AssertionError

    def records(self) -> Iterator[Rows | Event]:
        """Rows and events in their order; `lacking` and `holes` tell afterwards what was not there."""
        self.lacking, self.holes, self._damaged = [], [], []
        end = latest = 0  # places: of the end of the rows so far, of what is known of
        hole, expected = False, 1
        for path in self.paths:
            if (number := _number_of(path)) != expected:
                self.lacking.append(f"segments {expected} to {number - 1} are not there")
                hole = True
            expected = number + 1
            for one in self._salvaged(path):
                if one is None:
                    hole = True
                elif isinstance(one, Rows):
                    if hole and one.place > end:
                        self.holes.append(Hole(end, one.place))
                    hole, end = False, one.end
                    yield one
                else:
                    latest = max(latest, one["place"])
                    yield one
        if hole:
            self.holes.append(Hole(end, max(end, latest)))

    def _salvaged(self, path: Path) -> Iterator[Rows | Event | None]:
        """Rows and events of a segment; None where something is damaged."""
        damaged = 0  # bytes
        try:
            for one in salvaged(path, _KINDS):
                if not isinstance(one, Damage):
                    yield from _content_of(one)
                elif one.cut and path == self.paths[-1]:
                    self.lacking.append(f"the last {one.size} bytes of {path.name} are not whole, and are left out")
                else:
                    damaged += one.size
                    yield None
        except (RecordingError, OSError, ValueError, TypeError, LookupError) as error:
            self._tell_damaged(path, str(error))
            yield None
        if damaged:
            self._tell_damaged(path, f"{damaged} bytes of {path.name} are damaged, and are left out")

    def _tell_damaged(self, path: Path, said: str) -> None:
        self.lacking.append(f"{said}; it is kept as {damaged_name(path).name}")
        self._damaged.append(path)

    def remove(self) -> None:
        """They are needed no longer, but for those that the reading before has found damaged. Raises OSError."""
        for path in self.paths:
            if path in self._damaged:
                keep_damaged(path)
            path.unlink(missing_ok=True)

    def close(self) -> None:
        """Leave them to who comes next."""
        self._locks.close()


def path_of(folder: Path, id_: str, segment: int) -> Path:
    """Of a segment."""
    return folder / f"{id_}.{segment:04d}{SUFFIX}"


def ids_in(folder: Path) -> list[str]:
    """Of recordings that are under way, or were left, by name."""
    return sorted({path.name.rsplit(".", 2)[0] for path in folder.glob(f"*{_NUMBERED}{SUFFIX}")})


def damaged_in(folder: Path, id_: str = "") -> list[Path]:
    """Damaged segments that were kept, of a recording or of all."""
    return sorted(folder.glob(f"{escape(id_) or '*'}{_NUMBERED}{DAMAGED}"))


def _number_of(path: Path) -> int:
    return int(path.name.rsplit(".", 2)[1])


def _content_of(record: Record) -> Iterator[Rows | Event]:
    kind, content = record
    if kind == _ROWS:
        yield unpacked(content)
    elif kind == _EVENT:
        yield json.loads(content)


def _heading_of(path: Path) -> Heading | None:
    """None where it is damaged, or something else."""
    with contextlib.suppress(RecordingError, OSError, ValueError, TypeError):
        for one in salvaged(path, _KINDS):
            if not isinstance(one, Damage) and one[0] == _HEADING:
                return Heading(**json.loads(one[1]))
    return None
