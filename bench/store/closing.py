"""What becomes of a recording of the stream: one Parquet, sealed, written whole or not at all; then its segments go.

Its notes tell what the columns do not: where it is from, gaps, events, why it ended. It may be begun anew after a kill
at any instant: the Parquet is there before the first segment goes, and tells by its id that it is. Damaged segments
stay.
"""

import contextlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from bench.errors import RecordingError
from bench.files import check_free, sync_folder
from bench.recordings.table import notes
from bench.store.overview import prepare
from bench.store.rows import COLUMNS, Rows, table_columns
from bench.store.sealed_file import write_sealed
from bench.store.segments import Event, FoundSegments, Hole
from drivers.wire.dictionary import signal_named

_ROWS: Final = 1 << 18  # of a row group
_ROOM: Final = 1 << 20  # bytes that a Parquet may have more than its segments


@dataclass(slots=True)
class _Account:
    """What the segments hold."""

    rows: int = 0
    end: int = 0  # control periods from the begin
    temperatures: bool = False  # the drive has told one


def closed(segments: FoundSegments, why: str = "", *, cut: bool = False) -> Path | None:
    """Make a Parquet of segments, and remove them; None where they hold no row. Raises OSError, RecordingError.

    Those that are damaged are kept, see `FoundSegments.remove`.

    `why`: why it ended, where the segments do not say; `cut`: then it was not to.
    """
    folder, heading = segments.paths[0].parent, segments.heading
    path = folder / f"{heading.id}.parquet"
    part = _unfinished(path)
    try:
        account, told = _account(segments, why, cut)
        if notes_of(path).get("recording") != heading.id:
            if not account.rows:
                segments.remove()
                return None
            check_free(folder, sum(one.stat().st_size for one in segments.paths) + _ROOM, "the recording")
            path = _written(path, part, segments, account, told)
    finally:
        part.unlink(missing_ok=True)
    segments.remove()
    sync_folder(folder)
    with contextlib.suppress(RecordingError, OSError):  # it is made when it is needed, else
        prepare(path)
    return path


def notes_of(path: Path) -> dict[str, Any]:
    """What the bench noted in a Parquet; empty where there is none that can be read."""
    try:
        return notes(path) if path.is_file() else {}
    except (RecordingError, OSError):
        return {}


def _account(segments: FoundSegments, why: str, cut: bool) -> tuple[_Account, dict[str, Any]]:
    """What there is, and the notes of it."""
    heading, account = segments.heading, _Account()
    events: list[Event] = []
    for record in segments.records():
        if isinstance(record, Rows):
            account.rows += len(record)
            account.end = record.end
            account.temperatures |= record.temp_winding == record.temp_winding
            account.temperatures |= record.temp_magnet == record.temp_magnet
        else:
            events.append(record)
    ended: Event = next((event for event in reversed(events) if event["what"] == "ended"), Event())
    for hole in segments.holes:
        events.append(_gap(hole, events, heading.periods))
        account.end = max(account.end, hole.end)
    events.sort(key=lambda event: event["place"])
    told = asdict(heading) | {
        "recording": heading.id, "kind": "stream", "rows": account.rows, "duration": account.end * heading.T_s,
        "events": [_timed(event, heading.T_s) for event in events if event is not ended],
        "ended": ended.get("why", why), "at": ended.get("at"), "lacking": segments.lacking,
        "complete": bool(ended) or not cut,
    }
    for key in ("segment", "id"):
        del told[key]
    return account, told


def _gap(hole: Hole, events: Iterable[Event], periods: int) -> Event:
    """What a hole is in a recording's events: its rows but for those that other gaps within it tell of."""
    told = sum(
        event["rows"] for event in events
        if event["what"] in ("gap", "clock reset") and hole.begin < event["place"] <= hole.end
    )
    rows = max((hole.end - hole.begin) // periods - told, 0)
    return {"place": hole.end, "what": "gap", "rows": rows, "why": "what was written of them is damaged, or missing"}


def _timed(event: Event, T_s: float) -> Event:
    """With t in s in place of control periods."""
    return {"t": event["place"] * T_s} | {key: value for key, value in event.items() if key != "place"}


def _written(path: Path, part: Path, segments: FoundSegments, account: _Account, told: Mapping[str, Any]) -> Path:
    names = ["t", *COLUMNS, "periods", *(["temp_winding", "temp_magnet"] if account.temperatures else [])]
    groups = (table_columns(stretch, segments.heading.T_s) for stretch in _groups(segments))
    return write_sealed(path, part, {name: _unit(name) for name in names}, groups, told)


def _unfinished(path: Path) -> Path:
    """Where a recording is written that is not whole yet: nobody else does who does not have its segments."""
    return path.with_name(f".{path.stem}.unfinished")


def _groups(segments: FoundSegments) -> Iterator[list[Rows]]:
    """Rows, so many together as make a row group."""
    group: list[Rows] = []
    for record in segments.records():
        if isinstance(record, Rows):
            group.append(record)
            if sum(map(len, group)) >= _ROWS:
                yield group
                group = []
    if group:
        yield group


def _unit(name: str) -> str:
    return "s" if name == "t" else "1" if name == "periods" else signal_named(name).unit
