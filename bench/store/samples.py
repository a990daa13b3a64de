"""Samples of a recording for a plot: columns of a stretch of time, thinned with their extremes kept.

Few rows are read as they are; of many, the overview is taken, so that a day's recording takes no more memory, and
hardly more time, than a minute's. Knows nothing of HTTP.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from bench.errors import LimitError, RecordingError
from bench.recordings.sources import Source, listed, source_of
from bench.recordings.table import header_of, numeric_columns, read_rows, row_count
from bench.store.overview import check_times, overview_of
from bench.store.thinning import Bins, Course, Floats, gaps_in, thinned, usual_step
from drivers.wire.dictionary import signal_named

MOST_POINTS: Final = 10_000
MOST_SIGNALS: Final = 16
_READ: Final = 1 << 23  # numbers that are read as they are at most: 64 MB


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """What is plotted."""

    since: float  # s, from the recording's begin
    until: float  # s
    course: Course
    units: dict[str, str]  # of each signal; empty where nothing says it


def samples_of(path: Path, names: Sequence[str], since: float, until: float | None, points: int) -> Samples:
    """Columns of a Parquet, all where none is named, from `since` to `until` (s; None: its end), in so many points.

    Raises LimitError where it does not have them, RecordingError where it cannot be read.
    """
    rows, time = row_count(path) or 0, _time(path)
    if not rows:
        raise RecordingError(f"{path.name}: expected rows, it has none")
    units = _units(path, time.column, names)
    if until is not None and not since < until:
        raise LimitError(f"until: expected a time after since = {since:g} s, got {until:g} s")
    if rows * (len(units) + 1) <= _READ:
        bins, gaps, end = _rows(path, time, list(units), slice(0, rows), None)
    else:
        bins, gaps, end = _of_long(path, time, list(units), rows, (since, until), points)
    until = end if until is None else min(until, end)
    inside = slice(np.searchsorted(bins.last, since), np.searchsorted(bins.first, until, side="right"))
    course = thinned(bins.part(inside), gaps, since, max(since, until), points)
    return Samples(since, max(since, until), course, units)


def _of_long(
    path: Path, time: Source, names: list[str], rows: int, window: tuple[float, float | None], points: int
) -> tuple[Bins, Floats, float]:
    """Of a long recording: bins of its overview, or rows where those would be too few."""
    overview = overview_of(path, time.column, time.scale.factor, names, rows)
    bins, starts = overview.bins, overview.starts
    end = float(bins.last[-1])
    since, until = window[0], end if window[1] is None else min(window[1], end)
    first, after = np.searchsorted(bins.last, since), np.searchsorted(bins.first, until, side="right")
    if after - first >= points or (starts[after] - starts[first]) * (len(names) + 1) > _READ:
        return bins, overview.gaps, end
    begin = max(0, int(first) - 1)  # the row before tells of a gap
    read, gaps, _ = _rows(path, time, names, slice(int(starts[begin]), int(starts[after])), float(bins.first[begin]))
    return read, gaps, end


def _rows(
    path: Path, time: Source, names: list[str], rows: slice, begin: float | None
) -> tuple[Bins, Floats, float]:
    """These rows, the gaps between them, and the last one's time. `begin`: the first one's, s; None: the begin is it"""
    parts = list(read_rows(path, [time.column, *names], rows))
    t, *columns = (np.concatenate([part[name] for part in parts]) for name in (time.column, *names))
    t = t * time.scale.factor
    t = t - t[0] + (begin or 0.0)
    check_times(path, t)
    return Bins.of_rows(t, dict(zip(names, columns, strict=True))), gaps_in(t, usual_step(t)), float(t[-1])


def _time(path: Path) -> Source:
    """The column of times. Raises RecordingError where there is none."""
    header = header_of(path)
    found = source_of(path, header, "t", None, None)
    if found is None or found.column not in numeric_columns(path):
        raise RecordingError(
            f"{path.name}: to be plotted, expected a column t of times in s, there are {listed(header.names)}; "
            "another one is taken by: pmsm-bench recordings import --map t=COLUMN"
        )
    return found


def _units(path: Path, time: str, names: Sequence[str]) -> dict[str, str]:
    """The signals that are asked for, with their units. Raises LimitError."""
    there = {name: _unit(name, said) for name, said in numeric_columns(path).items() if name != time}
    wanted = list(dict.fromkeys(names)) or list(there)[:MOST_SIGNALS]
    for name in wanted:
        if name not in there:
            raise LimitError(f"signals: expected some of {listed(list(there))}, got {name!r}")
    if len(wanted) > MOST_SIGNALS:
        raise LimitError(f"signals: expected at most {MOST_SIGNALS}, got {len(wanted)}")
    return {name: there[name] for name in wanted}


def _unit(name: str, said: str) -> str:
    """The dictionary's, else what the file says."""
    try:
        return signal_named(name).unit
    except KeyError:
        return said
