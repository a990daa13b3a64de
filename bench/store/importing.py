"""A file of somebody's brought to the shelf: read by what is said of its columns, and written as a recording in SI.

What the recording is of stands in its notes, `imported`: the file's name, form, size and checksum, what was said of its
columns, and what was made of them. The file itself is not kept. Knows nothing of HTTP.
"""

import re
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from bench.errors import BenchError, LimitError, RecordingError, UnavailableError, shown
from bench.files import check_free, unfinished_folder
from bench.recordings.recording import RecordingReader, open_recording
from bench.recordings.runs import Chunk
from bench.recordings.sources import listed
from bench.recordings.table import form, notes
from bench.store.sealed_file import Columns, write_sealed
from drivers.wire.dictionary import signal_named
from estimator.samples import Samples

MOST: Final = 4_000_000_000  # bytes of a file
_ROWS: Final = 1 << 18  # of a row group
_LONGEST: Final = 80  # characters of an id
_ENDINGS: Final = re.compile(r"(\.(csv|txt|tsv|gz|parquet|pq|mat|mf4|mdf|dat))+$", re.IGNORECASE)
_KEPT: Final = (  # of the notes of a recording of the bench's own, by which it is read and listed
    "drive", "device", "url", "begun", "complete", "expected", "off_before", "off_after", "events", "machine", "window",
    "versions", "lacking", "ended",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Import:
    """What is said of a file."""

    name: str  # as its owner calls it
    title: str = ""
    note: str = ""
    mapping: Mapping[str, str] = field(default_factory=dict[str, str])  # see `recordings.sources`
    constants: Mapping[str, float] = field(default_factory=dict[str, float])
    align: Mapping[str, float] = field(default_factory=dict[str, float])
    whom: str = ""  # who brings it

    def __post_init__(self) -> None:
        name = self.name
        if not 0 < len(name) <= 200 or not name.isprintable() or re.search(r"[/\\]", name) or name.startswith("."):
            raise LimitError(f"name: expected that of a file, without folders, got {shown(name)}")

    @property
    def id(self) -> str:
        """Of the recording, if it is free."""
        plain = re.sub(r"[^A-Za-z0-9_-]+", "-", _ENDINGS.sub("", self.name)).strip("-")[:_LONGEST] or "file"
        return f"{plain}-file" if plain == "latest" else plain


@contextmanager
def place_for(folder: Path, name: str) -> Generator[Path]:
    """Where a file that comes can be put; gone afterwards, with all beside it. Raises OSError."""
    with unfinished_folder(folder) as place:
        yield place / f"file{Path(name).suffix.lower()[:8]}"


def check_room(folder: Path, size: int, kept_free: float) -> None:
    """Raise UnavailableError where there is no room for a file of so many bytes, and what others are left."""
    try:
        check_free(folder, int(size + kept_free), "the file, and what is left for others,")
    except OSError as error:
        raise UnavailableError(str(error.strerror)) from None


def imported(folder: Path, source: Path, said: Import, sha256: str) -> Path:
    """Make a recording of a file; where it is. Raises BenchError, OSError."""
    part = source.with_name("part")
    try:
        with open_recording(
            source, mapping=said.mapping, constants=said.constants, align=said.align, temperatures=True
        ) as reader:
            groups = _groups(reader)
            first = next(groups, None)
            if first is None:
                raise RecordingError(f"{said.name}: expected rows that can be used, came none")
            units = {name: _unit(name) for name in first}
            path = folder / f"{said.id}.parquet"
            return write_sealed(
                path, part, units, _all(first, groups), lambda: _told(source, said, sha256, reader)
            )
    except BenchError as error:
        raise type(error)(str(error).replace(str(source), said.name)) from None


def _all(first: Columns, others: Iterator[Columns]) -> Iterator[Columns]:
    yield first
    yield from others


def _groups(reader: RecordingReader) -> Iterator[Columns]:
    """Columns of so many rows together as make a row group, SI."""
    waiting, rows = list[Chunk](), 0
    for chunk in reader:
        waiting.append(chunk)
        rows += len(chunk.samples)
        if rows >= _ROWS:
            yield _columns(waiting)
            waiting, rows = [], 0
    if waiting:
        yield _columns(waiting)


def _columns(chunks: list[Chunk]) -> Columns:
    samples = [chunk.samples for chunk in chunks]
    names = [one.name for one in fields(Samples) if isinstance(getattr(samples[0], one.name), np.ndarray)]
    times = [one.t0 + one.T * np.arange(len(one), dtype=np.float64) for one in samples]
    columns: dict[str, NDArray[np.float64]] = {"t": np.concatenate(times)}
    columns |= {name: np.concatenate([getattr(one, name) for one in samples]) for name in names}
    columns |= {name: np.concatenate([chunk.beside[name] for chunk in chunks]) for name in chunks[0].beside}
    if samples[0].periods > 1:
        columns["periods"] = np.full(len(columns["t"]), float(samples[0].periods))
    return columns


def _told(source: Path, said: Import, sha256: str, reader: RecordingReader) -> dict[str, Any]:
    """The notes of the recording."""
    before, summary, now = notes(source), reader.summary, datetime.now(UTC).isoformat()
    steps = before.get("steps")
    known = cast(dict[str, Any], steps) if isinstance(steps, dict) else {}
    plain = {name: column for name, column in reader.sources.columns.items() if name not in reader.sources.scales}
    asked = before.get("request")
    first = cast(dict[str, Any], asked) if isinstance(asked, dict) else {}
    return {key: before[key] for key in _KEPT if key in before} | {
        "kind": "file", "asked": now, "T_s": summary.T_s, "rows": summary.used, "duration": summary.duration,
        "request": {
            "title": said.title or before.get("title") or first.get("title") or "",
            "note": said.note or before.get("note") or first.get("note") or "",
        },
        "steps": {name: known[column] for name, column in plain.items() if column in known},
        "imported": {
            "name": said.name, "form": form(source), "bytes": source.stat().st_size, "sha256": sha256,
            "whom": said.whom, "at": now, "map": dict(said.mapping), "set": dict(said.constants),
            "align": dict(said.align), "columns": dict(summary.sources), "unused": list(summary.unused),
            "remarks": [*summary.remarks(), *_left_out(summary.unused)], "notes": before,
        },
    }  # fmt: skip


def _left_out(columns: Sequence[str]) -> Iterator[str]:
    """A sentence where columns of the file are not in the recording."""
    if columns:
        yield f"columns left out: {listed(columns)}"


def remarks_of(path: Path) -> list[str]:
    """What was made of a file that was brought, and what was left out of it, a sentence each."""
    told = notes(path).get("imported")
    return cast(list[str], cast(dict[str, Any], told)["remarks"]) if isinstance(told, dict) else []


def _unit(name: str) -> str:
    return {"t": "s", "periods": "1"}.get(name) or signal_named(name).unit
