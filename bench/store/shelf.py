"""The shelf: all recordings of a folder - of streams, captures, experiments, and files put there - with what is said of
them. The files are the truth; what has been read of one is kept until it changes.
"""

import contextlib
import json
import threading
from collections.abc import Callable, Container, Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from bench.errors import RecordingError, UnknownError, shown
from bench.recordings.table import check_undamaged, column_names, extent, notes, row_count
from bench.store.annotations import SUFFIX as ABOUT
from bench.store.annotations import Annotations, Mark
from bench.store.catalogue.database import microseconds, time_at
from bench.store.catalogue.found import Row
from bench.store.overview import beside
from bench.store.segments import FoundSegments, damaged_in, ids_in

PARQUET: Final = ".parquet"
_AS_THEY_ARE: Final = (  # in a row of the catalogue
    "id", "kind", "drive", "rows", "seconds", "bytes", "title", "note", "whole", "ended", "gaps", "rows_lost",
    "continues", "url", "problem",
)  # fmt: skip

OnRead = Callable[[list[Row], list[str]], None]


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
    url: str = ""  # where the drive was; empty where it is not said
    problem: str = ""  # what is wrong with the file, a sentence


@dataclass(frozen=True, slots=True)
class Checked:
    """What `verify` found of a file."""

    name: str
    problem: str  # empty: it is whole


class Shelf:
    """The recordings of a folder; from any thread."""

    def __init__(self, folder: Path, on_read: OnRead = lambda _read, _gone: None) -> None:
        """`on_read` hears of rows of what was read anew, and of ids whose files have gone; it does not wait."""
        self.folder, self._on_read = folder.absolute(), on_read
        self._lock = threading.Lock()
        self._read: dict[str, tuple[tuple[int, int], Recording]] = {}  # by id: time and size of the file, what it said

    def recall(self, rows: Iterable[Row]) -> None:
        """What files said when they were read by a service before this one, as `on_read` was told."""
        with self._lock:
            for row in rows:
                with contextlib.suppress(ValueError, LookupError, TypeError):  # it is read anew
                    one = _of_row(row, self.folder)
                    self._read.setdefault(one.id, ((row["changed"], row["bytes"]), one))

    def rows(self) -> list[Row]:
        """Of all that is known of the files, without what is said of them."""
        self.all()
        with self._lock:
            return [_row(read, changed) for (changed, _), read in self._read.values() if not read.problem]

    def all(self) -> list[Recording]:
        """Those that are closed, the newest first."""
        paths = self._paths()
        there = {path.name.removesuffix(PARQUET) for path in paths}
        with self._lock:
            gone = [id_ for id_ in self._read if id_ not in there]
            for id_ in gone:
                del self._read[id_]
        fresh: list[Row] = []
        about = {path.name.removesuffix(ABOUT) for path in self.folder.glob(f"*{ABOUT}")} if paths else set[str]()
        found = [self._of(path, fresh, about) for path in paths]
        if fresh or gone:
            self._on_read(fresh, gone)
        return sorted((one for one in found if one is not None), key=lambda one: one.begun, reverse=True)

    def one(self, id_: str) -> Recording:
        """A recording. Raises UnknownError."""
        path = self.folder / f"{id_}{PARQUET}"
        fresh: list[Row] = []
        found = self._of(path, fresh) if Path(id_).name == id_ and path in self._paths() else None
        if fresh:
            self._on_read(fresh, [])
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
        """Remove it from the disk, with what is said of it, and its damaged segments. Raises UnknownError, OSError."""
        path = self.one(id_).path
        path.unlink()
        path.with_name(f"{id_}{ABOUT}").unlink(missing_ok=True)
        beside(path).unlink(missing_ok=True)
        for damaged in damaged_in(self.folder, id_):
            damaged.unlink(missing_ok=True)

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
        for path in damaged_in(self.folder):
            yield Checked(path.name, f"{path.name}: a damaged segment, of which its recording has what could be read")

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

    def _of(self, path: Path, fresh: list[Row], about: Container[str] | None = None) -> Recording | None:
        """None where it has gone meanwhile. `fresh` takes a row of what was read; `about`: those something is said of.
        """
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
            if not read.problem:  # which may pass
                fresh.append(_row(read, stat.st_mtime_ns))
        return read if about is not None and id_ not in about else _annotated(read, Annotations.read(self.folder, id_))


def _row(one: Recording, changed: int) -> Row:
    """As the catalogue has it; `changed`: ns since 1970, when its file was."""
    told = {name: getattr(one, name) for name in _AS_THEY_ARE}
    return told | {
        "changed": changed, "begun": microseconds(one.begun), "columns": json.dumps(one.columns),
        "marks": json.dumps([asdict(mark) for mark in one.marks]),
    }  # fmt: skip


def _of_row(row: Row, folder: Path) -> Recording:
    """Raises ValueError, LookupError, TypeError."""
    told = {name: row[name] for name in _AS_THEY_ARE}
    return Recording(
        **told, path=folder / f"{row['id']}{PARQUET}", begun=time_at(row["begun"]),
        columns=tuple(json.loads(row["columns"])), marks=tuple(Mark(**mark) for mark in json.loads(row["marks"])),
    )  # fmt: skip


def _recording(id_: str, path: Path, size: int, changed: datetime) -> Recording:
    try:
        told, rows, columns, span = notes(path), row_count(path) or 0, column_names(path), extent(path, "t")
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
    elif kind == "experiment" and isinstance(told.get("T_s"), float) and span is not None:
        seconds = span + told["T_s"]
    return Recording(
        id_, path, kind, str(told.get("drive", "")), _time_of(told, changed), rows, seconds, size, columns,
        str(request.get("title", "")), str(request.get("note", "")), marks,
        whole=told.get("complete", True) is not False and not told.get("lacking") and told.get("at", "") is not None,
        ended=". ".join([str(told.get("ended", "")), *map(str, told.get("lacking", ()))]).strip(". "),
        gaps=len(lost), rows_lost=sum(int(event.get("rows", 0)) for event in lost),
        continues=str(told.get("continues", "")), url=str(told.get("url", "")),
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
