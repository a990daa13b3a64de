"""The shelf: all recordings of a folder - of streams, captures, experiments, and files put there - with what is said of
them. The files are the truth; what has been read of one is kept until it changes.
"""

import contextlib
import threading
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from bench.errors import RecordingError, UnknownError, shown
from bench.recordings.table import check_undamaged, column_names, notes, row_count
from bench.store.annotations import SUFFIX as ABOUT
from bench.store.annotations import Annotations, Mark
from bench.store.overview import beside
from bench.store.segments import FoundSegments, ids_in

PARQUET: Final = ".parquet"


@dataclass(frozen=True, slots=True)
class Recording:
    """A recording on the shelf."""

    id: str
    path: Path
    kind: str  # stream, capture, experiment, or file
    drive: str  # name, as it was then; empty where it is not said
    begun: datetime
    rows: int
    seconds: float | None  # None where the file does not say
    bytes: int
    columns: tuple[str, ...]
    title: str
    note: str
    marks: tuple[Mark, ...]
    whole: bool  # it has all that it was to have
    ended: str  # why it ended, where that is said
    gaps: int
    rows_lost: int
    continues: str = ""  # id of the recording that it goes on with
    problem: str = ""  # what is wrong with the file, a sentence


@dataclass(frozen=True, slots=True)
class Checked:
    """What `verify` found of a file."""

    name: str
    problem: str  # empty: it is whole


class Shelf:
    """The recordings of a folder; from any thread."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder.absolute()
        self._lock = threading.Lock()
        self._read: dict[str, tuple[tuple[int, int], Recording]] = {}  # by id: time and size of the file, what it said

    def all(self) -> list[Recording]:
        """Those that are closed, the newest first."""
        found = [self._of(path) for path in self._paths()]
        return sorted((one for one in found if one is not None), key=lambda one: one.begun, reverse=True)

    def one(self, id_: str) -> Recording:
        """A recording. Raises UnknownError."""
        path = self.folder / f"{id_}{PARQUET}"
        found = self._of(path) if Path(id_).name == id_ and path in self._paths() else None
        if found is None:
            raise UnknownError(f"no recording {shown(id_)}")
        return found

    def annotate(self, id_: str, title: str | None, note: str | None) -> None:
        """Give a recording, closed or under way, another title, another note; None leaves it. Raises OSError."""
        with self._lock:
            said = Annotations.read(self.folder, id_)
            said = replace(
                said, title=said.title if title is None else title, note=said.note if note is None else note
            )
            said.write(self.folder, id_)

    def mark(self, id_: str, mark: Mark) -> None:
        """Mark a moment of it. Raises UnknownError, RecordingError, OSError."""
        recording = self.one(id_)
        if not 0.0 <= mark.t <= (recording.seconds or mark.t):
            raise RecordingError(f"expected a time of 0 to {recording.seconds:g} s in {id_}, got {mark.t:g} s")
        with self._lock:
            said = Annotations.read(self.folder, id_).marked(mark)
            said.write(self.folder, id_)

    def delete(self, id_: str) -> None:
        """Remove it from the disk, with what is said of it. Raises UnknownError, OSError."""
        path = self.one(id_).path
        path.unlink()
        path.with_name(f"{id_}{ABOUT}").unlink(missing_ok=True)
        beside(path).unlink(missing_ok=True)

    def verify(self) -> Iterator[Checked]:
        """Every file of the folder that is, or was to be, a recording: read whole against its checksums."""
        for path in self._paths():
            try:
                check_undamaged(path)
                column_names(path)
            except (RecordingError, OSError) as error:
                yield Checked(path.name, str(error))
            else:
                yield Checked(path.name, "")
        for id_ in ids_in(self.folder):
            yield Checked(id_, self._left(id_))

    def _left(self, id_: str) -> str:
        """What is to be said of segments without a Parquet; empty where they are being written."""
        try:
            found = FoundSegments.found(self.folder, id_)
            if found is None:
                return ""
            with contextlib.closing(found):
                for _ in found.records():
                    pass
        except (RecordingError, OSError) as error:
            return str(error)
        said = "; ".join(["it was not closed: the service does that when it starts", *found.lacking])
        return f"{id_}: {said}"

    def _paths(self) -> list[Path]:
        if not self.folder.is_dir():
            return []
        return sorted(path for path in self.folder.glob(f"*{PARQUET}") if not path.name.startswith("."))

    def _of(self, path: Path) -> Recording | None:
        """None where it has gone meanwhile."""
        id_ = path.name.removesuffix(PARQUET)
        try:
            stat = path.stat()
        except OSError:
            return None
        with self._lock:
            state, read = self._read.get(id_, (None, None))
        if read is None or state != (stat.st_mtime_ns, stat.st_size):
            read = _recording(id_, path, stat.st_size, datetime.fromtimestamp(stat.st_mtime, UTC))
            with self._lock:
                self._read[id_] = (stat.st_mtime_ns, stat.st_size), read
        return _annotated(read, Annotations.read(self.folder, id_))


def _recording(id_: str, path: Path, size: int, changed: datetime) -> Recording:
    try:
        told, rows, columns = notes(path), row_count(path) or 0, column_names(path)
    except (RecordingError, OSError) as error:
        return Recording(
            id_, path, "file", "", changed, 0, None, size, (), "", "", (), whole=False, ended="", gaps=0, rows_lost=0,
            problem=str(error),
        )  # fmt: skip
    kind = _kind(told)
    events: list[dict[str, Any]] = told.get("events", [])
    lost = [event for event in events if event.get("what") in ("gap", "clock reset", "dropped")]
    marks = tuple(
        Mark(float(event["t"]), str(event["text"]), str(event.get("whom", "")), str(event.get("at", "")))
        for event in events if event.get("what") == "mark"
    )
    request = told.get("request", {})
    seconds = told.get("duration")
    if kind == "capture" and isinstance(told.get("T_s"), float):
        seconds = rows * told["T_s"] * told.get("decimation", 1)
    return Recording(
        id_, path, kind, str(told.get("drive", "")), _time_of(told, changed), rows, seconds, size, columns,
        str(request.get("title", "")), str(request.get("note", "")), marks,
        whole=told.get("complete", True) is not False and not told.get("lacking"),
        ended=". ".join([str(told.get("ended", "")), *map(str, told.get("lacking", ()))]).strip(". "),
        gaps=len(lost), rows_lost=sum(int(event.get("rows", 0)) for event in lost),
        continues=str(told.get("continues", "")),
    )  # fmt: skip


def _kind(told: dict[str, Any]) -> str:
    if told.get("kind") in ("stream", "file"):
        return str(told["kind"])
    return next((kind for kind in ("experiment", "capture") if kind in told), "file")


def _time_of(told: dict[str, Any], otherwise: datetime) -> datetime:
    """When it began, where it says so."""
    for key in ("begun", "asked"):
        with contextlib.suppress(ValueError, TypeError):
            found = datetime.fromisoformat(told[key]) if key in told else None
            if found is not None and found.tzinfo is not None:
                return found
    return otherwise


def _annotated(recording: Recording, said: Annotations) -> Recording:
    return replace(
        recording, title=recording.title if said.title is None else said.title,
        note=recording.note if said.note is None else said.note,
        marks=tuple(sorted((*recording.marks, *said.marks), key=lambda mark: mark.t)),
    )  # fmt: skip
