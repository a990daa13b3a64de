"""ASAM MDF by asammdf, the one file that knows it. Written: MDF 4.10, a group of all columns with t as its master.

The notes are the file's comment, as JSON. Read are the channels of numbers of one group, that with the most of them,
and of those with the same times; nothing is interpolated, and what has other times is left out, and told.
"""

import importlib
import json
import re
from collections.abc import Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np

from bench.errors import RecordingError
from bench.recordings.foreign.content import Content, Floats, numbers, object_of, of_one_length

_VERSION: Final = "4.10"
_TIME: Final = "t"
_MASTER: Final = 2  # type of a channel


def write(path: Path, content: Content) -> None:
    """One of MDF 4. Raises RecordingError, OSError."""
    asammdf: Any = importlib.import_module("asammdf")
    if (t := content.columns.get(_TIME)) is None:
        raise RecordingError("expected a column t of times, which MDF is by; there is none")
    signals: list[Any] = [
        asammdf.Signal(samples=column, timestamps=t, name=name, unit=content.units.get(name, ""))
        for name, column in content.columns.items() if name != _TIME
    ]
    with asammdf.MDF(version=_VERSION) as file:
        file.append(signals, comment=str(content.notes.get("title", "")), common_timebase=True)
        file.header.comment = json.dumps(dict(content.notes))
        if (begun := _begun(content.notes)) is not None:
            file.header.start_time = begun
        Path(file.save(path, overwrite=True, compression=1)).replace(path)  # it gives names an ending of its own


def read(path: Path) -> Content:
    """Raises RecordingError."""
    asammdf: Any = importlib.import_module("asammdf")
    try:
        with asammdf.MDF(path) as file:
            return _content(file)
    except (RecordingError, MemoryError):
        raise
    except Exception as error:  # noqa: BLE001 - whatever the library raises over foreign bytes
        said = (str(error).splitlines() or [type(error).__name__])[0][:200]
        raise RecordingError(f"expected a file of ASAM MDF, it cannot be read: {said}") from None


def _content(file: Any) -> Content:
    groups = [k for k, group in enumerate(file.groups) if group.channel_group.cycles_nr > 1]
    if not groups:
        raise RecordingError("expected a group of channels with rows, found none")
    chosen = max(groups, key=lambda k: (len(file.groups[k].channels), -k))
    t = np.asarray(file.get_master(chosen), np.float64)
    found, units = [(_TIME, t)], {_TIME: "s"}
    others = 0
    for k in groups:
        if k != chosen and not np.array_equal(np.asarray(file.get_master(k), np.float64), t):
            others += len(file.groups[k].channels)
            continue
        for name, column, unit in _channels(file, k):
            found.append((name, column))
            units[name] = unit
    made = of_one_length(found, units)
    said = (f"left out, channels of other times: {others}",) if others else ()
    return Content(made.columns, made.units, _notes(file.header.comment), (*made.remarks, *said))


def _channels(file: Any, group: int) -> Iterator[tuple[str, Floats, str]]:
    """Name, numbers and unit of a group's channels of numbers, without its master."""
    for index, channel in enumerate(file.groups[group].channels):
        if channel.channel_type == _MASTER:
            continue
        signal = file.get(group=group, index=index)
        column = numbers(signal.samples)
        if column is None or column.ndim != 1:
            continue
        if (invalid := signal.invalidation_bits) is not None:
            column[np.asarray(invalid, np.bool_)] = np.nan
        yield str(signal.name).split("\\")[0], column, str(signal.unit or "")


def _notes(comment: str) -> dict[str, Any]:
    """The bench's own, of the file's comment: in XML, as asammdf hands it out."""
    text = comment or ""
    if text.lstrip().startswith("<"):
        try:
            found = ElementTree.fromstring(re.sub(r"\sxmlns=\"[^\"]*\"", "", text)).find("TX")
        except ElementTree.ParseError:
            return {}
        text = "" if found is None else found.text or ""
    return object_of(text)


def _begun(notes: Mapping[str, Any]) -> datetime | None:
    for key in ("begun", "asked"):
        try:
            found = datetime.fromisoformat(notes[key])
        except (LookupError, ValueError, TypeError):
            continue
        if found.tzinfo is not None:
            return found
    return None
