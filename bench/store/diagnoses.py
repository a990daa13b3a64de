"""Diagnoses that have ended, on disk: a folder each, written whole or not at all.

    diagnoses/20260131-120000-000/
        heading.json      of which recording, how asked, how it ended
        result.json       as `bench.diagnoses.published` says
        figures.json.gz
        report.html.gz    files that are not listed in `_PLAIN` are packed
        machine.toml

What is there is not changed again; several of one recording stand side by side. Knows nothing of how a diagnosis is
made.
"""

import contextlib
import gzip
import hashlib
import json
import os
import re
import shutil
import threading
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from pydantic import TypeAdapter, ValidationError

from bench.errors import RecordingError, UnknownError, shown
from bench.files import free_name, read_bytes, sweep, sync_folder, unfinished_folder
from bench.store.catalogue.database import microseconds, time_at
from bench.store.catalogue.found import Row
from bench.store.shelf import Checked, OnRead

FOLDER: Final = "diagnoses"  # in that of the recordings
_HEADING: Final = "heading.json"
_PLAIN: Final = ("result.json", "machine.toml")  # which other tools read as they are
_ID: Final = re.compile(r"[0-9]{8}-[0-9]{6}-[0-9]{3}")
_MOST: Final = 1 << 30  # bytes of a file


@dataclass(frozen=True, slots=True)
class Heading:
    """A diagnosis that has ended, without its files."""

    id: str
    recording: str  # id
    drive: str  # that made it; empty where the recording does not say
    asked: datetime
    started: datetime | None  # None: it never was
    ended: datetime
    state: str  # done, failed, cancelled
    reason: str  # why it failed, or was cancelled
    verdict: str | None  # of one that is done
    sentence: str | None
    request: dict[str, Any]  # trust, nominal and witness, as they are asked for
    versions: dict[str, str]  # of what it was made with
    sums: dict[str, str] = field(default_factory=dict[str, str])  # SHA-256 of each file's content


_KIND: Final = TypeAdapter(Heading)
_AS_THEY_ARE: Final = ("id", "recording", "drive", "state", "reason", "verdict", "sentence")  # in a catalogue's row
_TIMES: Final = ("asked", "started", "ended")
_TABLES: Final = ("request", "versions", "sums")


class Diagnoses:
    """The diagnoses of a folder; from any thread."""

    def __init__(self, captures: Path, on_read: OnRead = lambda _read, _gone: None) -> None:
        """`captures`: the folder of the recordings; `on_read` is as of `Shelf`."""
        self.folder, self._on_read = captures.absolute() / FOLDER, on_read
        self._lock = threading.Lock()
        self._read: dict[str, Heading] = {}  # by id

    def all(self) -> list[Heading]:
        """The newest first; one whose heading cannot be read is left out, for `verify` to tell."""
        ids, found, fresh = self._ids(), list[Heading](), list[Row]()
        with self._lock:
            gone = [id_ for id_ in self._read if id_ not in set(ids)]
            for id_ in gone:
                del self._read[id_]
        for id_ in ids:
            try:
                found.append(self._heading(id_, fresh))
            except (RecordingError, UnknownError):
                continue
        if fresh or gone:
            self._on_read(fresh, gone)
        return sorted(found, key=lambda one: (one.asked, one.id), reverse=True)

    def recall(self, rows: Iterable[Row]) -> None:
        """What was read by a service before this one, as `on_read` was told."""
        with self._lock:
            for row in rows:
                with contextlib.suppress(ValueError, LookupError, TypeError):  # it is read anew
                    self._read.setdefault(row["id"], _of_row(row))

    def rows(self) -> list[Row]:
        """Of all of them."""
        return [_row(one) for one in self.all()]

    def has(self, id_: str) -> bool:
        """Whether there is one of this id."""
        return _ID.fullmatch(id_) is not None and (self.folder / id_).is_dir()

    def one(self, id_: str) -> Heading:
        """One by its id. Raises UnknownError."""
        try:
            if self.has(id_):
                return self._heading(id_)
        except RecordingError:
            pass
        raise UnknownError(f"no diagnosis {shown(id_)}")

    def keep(self, heading: Heading, files: Mapping[str, bytes]) -> Heading:
        """Put one on disk, whole or not at all; as it is kept then. Raises OSError."""
        heading = replace(heading, sums={name: _sum(content) for name, content in files.items()})
        with unfinished_folder(self.folder) as part:
            for name, content in files.items():
                _write(part / _on_disk(name), content if name in _PLAIN else gzip.compress(content, 6, mtime=0))
            _write(part / _HEADING, _KIND.dump_json(heading, indent=1))
            sync_folder(part)
            part.rename(self.folder / heading.id)
            sync_folder(self.folder)
        return heading

    def file(self, id_: str, name: str) -> bytes | None:
        """A file's content; None where the diagnosis has none of that name. Raises UnknownError, RecordingError."""
        if not self.has(id_):
            raise UnknownError(f"no diagnosis {shown(id_)}")
        heading = self._heading(id_)
        if name not in heading.sums:
            return None
        path = self.folder / id_ / _on_disk(name)
        try:
            content = read_bytes(path, _MOST)
            content = content if name in _PLAIN else gzip.decompress(content)
        except (OSError, EOFError, zlib.error) as error:
            said = error.strerror if isinstance(error, OSError) and error.strerror else "it is cut short, or damaged"
            raise RecordingError(f"{path}: cannot be read: {said}") from None
        if _sum(content) != heading.sums[name]:
            raise RecordingError(f"{path}: expected the content that was written, it has another checksum")
        return content

    def delete(self, id_: str) -> None:
        """Remove one from the disk. Raises UnknownError, OSError."""
        if not self.has(id_):
            raise UnknownError(f"no diagnosis {shown(id_)}")
        part = free_name(self.folder)  # gone whole or not at all, as well
        try:
            (self.folder / id_).rename(part)
        except FileNotFoundError:
            raise UnknownError(f"no diagnosis {shown(id_)}") from None
        sync_folder(self.folder)
        with self._lock:
            self._read.pop(id_, None)
        shutil.rmtree(part, ignore_errors=True)

    def tidy(self) -> None:
        """Remove what a killed process has left half written."""
        sweep(self.folder)

    def verify(self) -> Iterator[Checked]:
        """Every diagnosis, each of its files read against its checksum."""
        for id_ in self._ids():
            try:
                for name in self._heading(id_).sums:
                    self.file(id_, name)
            except (RecordingError, UnknownError) as error:
                yield Checked(f"{FOLDER}/{id_}", str(error))
            else:
                yield Checked(f"{FOLDER}/{id_}", "")

    def _ids(self) -> list[str]:
        try:
            names = os.listdir(self.folder)  # noqa: PTH208 - thousands of names, without a path for each
        except OSError:
            return []
        return sorted(name for name in names if _ID.fullmatch(name))

    def _heading(self, id_: str, fresh: list[Row] | None = None) -> Heading:
        """`fresh` takes a row where it was read. Raises UnknownError where it has gone, RecordingError where it makes
        no sense.
        """
        with self._lock:
            read = self._read.get(id_)
        if read is None:
            read = self._read_heading(id_)
            if fresh is not None:  # else it is read again, and told then
                fresh.append(_row(read))
                with self._lock:
                    self._read[id_] = read
        return read

    def _read_heading(self, id_: str) -> Heading:
        path = self.folder / id_ / _HEADING
        try:
            heading = _KIND.validate_json(read_bytes(path))
        except FileNotFoundError:
            if not self.has(id_):
                raise UnknownError(f"no diagnosis {shown(id_)}") from None
            raise RecordingError(f"{path}: expected the heading of a diagnosis, there is none") from None
        except OSError as error:
            raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from None
        except ValidationError:
            raise RecordingError(f"{path}: expected the heading of a diagnosis, it is something else") from None
        if heading.id != id_:
            raise RecordingError(f"{path}: expected the heading of {id_}, it is that of {shown(heading.id)}")
        return heading


def _row(one: Heading) -> Row:
    """As the catalogue has it."""
    told = {name: getattr(one, name) for name in _AS_THEY_ARE}
    times = {name: None if (time_ := getattr(one, name)) is None else microseconds(time_) for name in _TIMES}
    return told | times | {name: json.dumps(getattr(one, name)) for name in _TABLES}


def _of_row(row: Row) -> Heading:
    """Raises ValueError, LookupError, TypeError."""
    told = {name: row[name] for name in _AS_THEY_ARE}
    times: dict[str, Any] = {name: None if row[name] is None else time_at(row[name]) for name in _TIMES}
    return Heading(**told, **times, **{name: json.loads(row[name]) for name in _TABLES})


def _on_disk(name: str) -> str:
    return name if name in _PLAIN else f"{name}.gz"


def _sum(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _write(path: Path, content: bytes) -> None:
    with path.open("xb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
