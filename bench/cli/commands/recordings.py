"""`pmsm-bench recordings`: over the service's REST interface."""

import json
import time
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from rich.table import Column, Table
from rich.text import Text

from bench.cli.output import check_new
from bench.cli.rest import Rest, rest_at
from bench.cli.terminal import Terminal, one_line
from bench.errors import BenchError, ConfigError, shown
from bench.files import check_place, check_regular

_TIMEOUT: Final = 30.0  # s for one answer
_PERIOD: Final = 0.2  # s between two questions
_LATEST: Final = "latest"
_FORMATS: Final = {".parquet": "parquet", ".csv": "csv", ".mat": "mat", ".mf4": "mf4"}
_CONVERTED: Final = 300.0  # s for one in another tool's form
_DAY: Final = 86_400.0  # s
_console: Final = Terminal(soft_wrap=True)


def begin(name: str, given: dict[str, Any], service: str | None) -> None:
    """Begin a recording, and tell what it takes. Raises BenchError."""
    with rest_at(service, _TIMEOUT) as rest:
        room = rest.call("GET", name, "recordings", key="free_bytes")
        begun = rest.call("POST", name, "recordings", body=given, key="state")
    _console.print(f"{begun['id']}: {begun['state']}; {_takes(room)}; end it by: pmsm-bench recordings stop")


def end(id_: str, service: str | None) -> None:
    """End a recording, and wait until it is closed. Raises BenchError."""
    with rest_at(service, _TIMEOUT) as rest:
        id_ = _id(rest, id_, running=True)
        said = rest.call("POST", id_, "stop", body={}, key="state", under="recordings")
        while said["state"] not in ("done", "failed", "cancelled"):
            time.sleep(_PERIOD)
            said = rest.call("GET", id_, key="state", under="recordings")
    _console.print(f"{id_}: {said['state']}, {said['rows']} rows, {_seconds(said)}: {said['reason']}")
    if said["state"] == "failed":
        raise BenchError(f"recording {id_} failed: {said['reason']}")


def show_all(filters: dict[str, str], service: str | None, *, as_json: bool) -> None:
    """A table of recordings. Raises BenchError."""
    with rest_at(service, _TIMEOUT) as rest:
        said = rest.call("GET", key="recordings", query=filters, under="recordings")
    if as_json:
        print(json.dumps(said, indent=1))
        return
    if not said["recordings"]:
        _console.print("no recording; begin one by: pmsm-bench recordings start DRIVE")
        return
    several = len({one["url"] for one in said["recordings"]} - {""}) > 1  # benches of one folder call theirs alike
    headings = ("begun", "length", "MB", "kind", *((Column("at", overflow="fold"),) if several else ()), "")
    table = Table(Column("recording", no_wrap=True), *headings, box=None, pad_edge=False)
    for one in said["recordings"]:
        state = "" if one["state"] == "done" and one["whole"] else _state(one)
        table.add_row(
            one["id"], f"{_local(one['begun']):%Y-%m-%d %H:%M}", _seconds(one), f"{one['bytes'] / 1e6:.3g}",
            one["kind"], *((one["url"],) if several else ()), Text("; ".join(filter(None, (state, one["title"])))),
        )  # fmt: skip
    _console.print(table)
    if said["next"] is not None:
        _console.print(f"{len(said['recordings'])} of {said['total']}; more by --limit")


def show_one(id_: str, service: str | None, *, as_json: bool) -> None:
    """All that is known of one. Raises BenchError."""
    with rest_at(service, _TIMEOUT) as rest:
        one = rest.call("GET", _id(rest, id_), key="state", under="recordings")
    if as_json:
        print(json.dumps(one, indent=1))
        return
    lost = f"{one['gaps']} gaps, {one['rows_lost']} rows lost" if one["gaps"] else "no gap"
    lines = [
        f"{one['id']}: {_state(one)}", one["title"], one["note"],
        f"{one['kind']} of {one['drive'] or 'no drive'}" + (f" at {one['url']}" if one["url"] else ""),
        f"begun {_local(one['begun']):%Y-%m-%d %H:%M:%S}",
        f"{one['rows']} rows, {_seconds(one)}, {one['bytes'] / 1e6:.3g} MB, {lost}", ", ".join(one["columns"]),
        one["reason"], f"goes on with {one['continues']}" if one["continues"] else "",
        *(f"  {mark['t']:.3f} s  {mark['text']}" for mark in one["marks"]),
    ]  # fmt: skip
    for line in filter(None, lines):
        _console.print(Text(line))


def set_mark(id_: str, text: str, t: float | None, service: str | None) -> None:
    """Mark a moment. Raises BenchError."""
    with rest_at(service, _TIMEOUT) as rest:
        id_ = _id(rest, id_, running=t is None)
        said = rest.call("POST", id_, "marks", body={"text": text, "t": t}, key="marks", under="recordings")
    at = max((mark for mark in said["marks"] if mark["text"] == text), key=lambda mark: mark["at"])
    _console.print(Text(f"{id_}: {at['t']:.3f} s: {text}"))


def set_title(id_: str, title: str | None, note: str | None, service: str | None) -> None:
    """Another title, another note. Raises BenchError."""
    if title is None and note is None:
        raise ConfigError("expected --title or --note, got neither")
    given = {key: value for key, value in (("title", title), ("note", note)) if value is not None}
    with rest_at(service, _TIMEOUT) as rest:
        said = rest.call("PATCH", _id(rest, id_), body=given, key="title", under="recordings")
    _console.print(Text(f"{said['id']}: {said['title']}"))


def save(id_: str, out: Path, form: str | None, service: str | None) -> None:
    """Write one to a new file, in the form that its name tells, or that is named. Raises BenchError."""
    kind = _FORMATS.get(out.suffix.lower()) if form is None else form.lower()
    if kind is None:
        *most, last = _FORMATS
        raise ConfigError(f"{out}: expected a name that ends with {', '.join(most)} or {last}, or --format")
    if kind not in _FORMATS.values():
        raise ConfigError(f"--format: expected one of {', '.join(_FORMATS.values())}, got {shown(form)}")
    check_new("--out", out)
    try:
        check_place(out)
        with rest_at(service, _CONVERTED) as rest:
            written = rest.save(out, _id(rest, id_), "file", query={"format": kind})
    except OSError as error:
        raise BenchError(f"{out}: cannot be written: {error.strerror or error}") from None
    _console.print(f"{written}: {written.stat().st_size / 1e6:.3g} MB")


def bring(file: Path, said: dict[str, str], service: str | None) -> None:
    """Have a file become a recording of the service's. Raises BenchError."""
    try:
        check_regular(file)
        with file.open("rb") as content, rest_at(service, _CONVERTED) as rest:
            one = rest.send(content, "recordings", {"name": file.name} | said)
    except OSError as error:
        raise BenchError(f"{file}: cannot be read: {error.strerror or error}") from None
    for line in (f"{one['id']}: {one['rows']} rows, {_seconds(one)}, of {file}", *one["remarks"]):
        _console.print(Text(one_line(line)))


def remove(id_: str, service: str | None, *, asked: bool) -> None:
    """Delete one, having asked. Raises BenchError."""
    with rest_at(service, _TIMEOUT) as rest:
        one = rest.call("GET", id_, key="state", under="recordings")
        if asked and input(f"delete {id_}, {one['rows']} rows, {_seconds(one)}, for good? [y/N] ").lower() != "y":
            _console.print("nothing was deleted")
            return
        rest.call("DELETE", id_, key="id", under="recordings")
    _console.print(f"{id_}: deleted")


def _id(rest: Rest, id_: str, *, running: bool = False) -> str:
    """The id that `latest` stands for; `running`: it is to be under way."""
    if id_ != _LATEST:
        return id_
    if not rest.call("GET", key="recordings", under="recordings")["recordings"]:
        raise BenchError("no recording is under way" if running else "there is no recording")
    one = rest.call("GET", _LATEST, key="state", under="recordings")
    if running and one["state"] not in ("armed", "recording"):
        raise BenchError("no recording is under way")
    return str(one["id"])


def _takes(room: dict[str, Any]) -> str:
    """What a recording takes, a clause."""
    if room["bytes_per_day"] is None:
        return f"{room['free_bytes'] / 1e9:.3g} GB are free"
    return f"at most {room['bytes_per_day'] / 1e9:.2g} GB a day, room for {room['days']:.3g} days"


def _seconds(one: dict[str, Any]) -> str:
    seconds = one["seconds"]
    if seconds is None:
        return "–"
    if seconds < 120.0:
        return f"{seconds:.4g} s"
    return f"{seconds / 3600.0:.4g} h" if seconds > 7200.0 else f"{seconds / 60.0:.4g} min"


def _state(one: dict[str, Any]) -> str:
    return str(one["state"]) if one["whole"] else f"{one['state']}, not whole"


def _local(time_utc: str) -> datetime:
    return datetime.fromisoformat(time_utc).astimezone()
