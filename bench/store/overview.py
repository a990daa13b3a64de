"""The overview of a long recording, beside it as `ID.overview`: its rows in bins of 1024, by which it is plotted.

It is made when it is first needed, of the columns that are asked for, and anew where the recording has changed; nothing
is lost with it. Some 0.1 % of what the columns take uncompressed. A reader passes over one that makes no sense.
"""

import contextlib
import os
import threading
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bench.errors import RecordingError
from bench.files import sync_folder, unfinished
from bench.recordings.forms.csv_rows import Part
from bench.recordings.table import numeric_columns, read_rows, row_count
from bench.store.thinning import Bins, Floats, Spread, gaps_in, usual_step

SUFFIX: Final = ".overview"
BIN: Final = 1024  # rows
_BLOCK: Final = 1 << 18  # rows that are looked at together, whole bins
_LONG: Final = 1 << 22  # rows, from which on one is made before it is needed
_GAPS: Final = 1 << 16  # that are kept, the longest
_MAKING: Final = threading.Lock()  # two who ask at once would both read all of it


@dataclass(frozen=True, slots=True, eq=False)
class Overview:
    """All of a recording in bins; times from its begin."""

    bins: Bins
    gaps: Floats  # s, of the rows before and after each; the longest, in their order. Shape (m, 2)

    @property
    def starts(self) -> NDArray[np.int64]:
        """The first row of each bin, and the number of all rows. Shape (n + 1,)."""
        return np.r_[0, np.cumsum(self.bins.rows)]


def overview_of(path: Path, time: str, to_s: float, names: Sequence[str], rows: int) -> Overview:
    """A recording's overview with these columns, as it is kept, or made now. `time`: the column of times; times
    `to_s` they are in s. `rows`: of the recording. Raises RecordingError.
    """
    with _MAKING:
        kept = _kept(path)
        lacking = [name for name in names if kept is None or name not in kept.bins.signals]
        if kept is not None and not lacking:
            return kept
        made = _made(path, time, to_s, lacking, rows)
        if kept is not None:
            signals = {**kept.bins.signals, **made.bins.signals}
            made = Overview(Bins(made.bins.first, made.bins.last, made.bins.rows, signals), made.gaps)
        with contextlib.suppress(OSError):  # where nothing can be kept, it is made each time
            _keep(path, made)
        return made


def prepare(path: Path) -> None:
    """Make the overview of a recording of the bench's own where it is long. Raises RecordingError, OSError."""
    if (rows := row_count(path) or 0) >= _LONG:
        overview_of(path, "t", 1.0, [name for name in numeric_columns(path) if name != "t"], rows)


def beside(path: Path) -> Path:
    """Where a recording's overview is."""
    return path.with_suffix(SUFFIX)


# --- made


def _made(path: Path, time: str, to_s: float, names: Sequence[str], rows: int) -> Overview:
    bins, gaps = list[Bins](), list[Floats]()
    begin, before, step = 0.0, np.empty(0), np.inf
    length = np.inf
    for part in _blocks(read_rows(path, [time, *names], slice(None))):
        t = to_s * part[time]
        if not len(before):
            begin, step = float(t[0]), usual_step(t)
            length = BIN * _mean_step(path, time, to_s, rows)
        t = t - begin
        check_times(path, np.r_[before, t])
        steps = np.diff(t, prepend=before if len(before) else t[:1])
        starts = np.union1d(np.arange(0, len(t), BIN), np.flatnonzero(steps > length))
        bins.append(_binned(t, {name: part[name] for name in names}, starts))
        gaps.append(gaps_in(np.r_[before, t], step))
        before = t[-1:]
    if not bins:
        raise RecordingError(f"{path}: expected rows, came none")
    return Overview(_joined(bins), _longest(np.concatenate(gaps)))


def check_times(path: Path, t: Floats) -> None:
    """Raise RecordingError where times do not go on."""
    wrong = np.flatnonzero(~(np.diff(t) > 0.0))
    if len(wrong) or not np.isfinite(t).all():
        at = f"after {t[wrong[0]]:.6g} s comes {t[wrong[0] + 1]:.6g} s" if len(wrong) else f"came {t[0]:.6g} s"
        raise RecordingError(
            f"{path.name}: to be plotted, expected a time in each row, later than the one before: {at}; a file is "
            "brought in order by: pmsm-bench recordings import"
        )


def _blocks(parts: Iterator[Part]) -> Iterator[Part]:
    """Parts of so many rows each, but the last: bins do not depend on how a file is written."""
    waiting, rows = list[Part](), 0
    for part in parts:
        waiting.append(part)
        rows += len(next(iter(part.values())))
        if rows >= _BLOCK:
            whole = {name: np.concatenate([one[name] for one in waiting]) for name in part}
            for start in range(0, rows - _BLOCK + 1, _BLOCK):
                yield {name: column[start : start + _BLOCK] for name, column in whole.items()}
            done = rows - rows % _BLOCK
            waiting, rows = [{name: column[done:] for name, column in whole.items()}], rows - done
    if rows:
        yield {name: np.concatenate([one[name] for one in waiting]) for name in waiting[0]}


def _mean_step(path: Path, time: str, to_s: float, rows: int) -> float:
    """Time between two rows on average, gaps included, s: gaps of 1024 of these are as few as bins."""
    first, last = (
        to_s * next(read_rows(path, [time], slice(row, row + 1)))[time][0] for row in (0, rows - 1)
    )
    return float(last - first) / max(1, rows - 1)


def _binned(t: Floats, columns: Part, starts: NDArray[np.int64]) -> Bins:
    ends = np.r_[starts[1:], len(t)]
    signals = {name: _spread(x, starts, ends) for name, x in columns.items()}
    return Bins(t[starts], t[ends - 1], ends - starts, signals)


def _spread(x: Floats, starts: NDArray[np.int64], ends: NDArray[np.int64]) -> Spread:
    low, high = np.minimum.reduceat(x, starts), np.maximum.reduceat(x, starts)
    if np.isfinite(low).all() and np.isfinite(high).all():
        return Spread(low, np.clip(np.add.reduceat(x, starts) / (ends - starts), low, high), high)
    rows = Bins.of_rows(np.empty(len(x)), {"": x})
    return rows.wider(starts).signals[""]


def _joined(bins: Sequence[Bins]) -> Bins:
    first, last, rows = zip(*((one.first, one.last, one.rows) for one in bins), strict=True)
    signals = dict[str, Spread]()
    for name in bins[0].signals:
        spreads = [one.signals[name] for one in bins]
        signals[name] = Spread(*(np.concatenate([getattr(one, key) for one in spreads]) for key in _KEYS))
    return Bins(np.concatenate(first), np.concatenate(last), np.concatenate(rows), signals)


def _longest(gaps: Floats) -> Floats:
    if len(gaps) <= _GAPS:
        return gaps
    return gaps[np.sort(np.argsort(gaps[:, 0] - gaps[:, 1], kind="stable")[:_GAPS])]


# --- kept

_KEYS: Final = ("low", "mean", "high")


def _keep(path: Path, one: Overview) -> None:
    """Raises OSError."""
    content: dict[str, Any] = {
        "of": _stamp(path), "first": one.bins.first, "last": one.bins.last, "rows": one.bins.rows, "gaps": one.gaps,
        "names": np.array(list(one.bins.signals), dtype=np.str_),
    }
    for k, spread in enumerate(one.bins.signals.values()):
        content |= {f"{key}{k}": getattr(spread, key) for key in _KEYS}
    with unfinished(path.parent) as (part, file):
        np.savez(file, **content)
        file.flush()
        os.fsync(file.fileno())
        part.replace(beside(path))
        sync_folder(path.parent)


def _kept(path: Path) -> Overview | None:
    """None where there is none of the recording as it is now."""
    try:
        with beside(path).open("rb") as file, np.load(file, allow_pickle=False) as content:
            if not np.array_equal(content["of"], _stamp(path)):
                return None
            names: list[str] = content["names"].tolist()
            signals = {name: Spread(*(content[f"{key}{k}"] for key in _KEYS)) for k, name in enumerate(names)}
            return Overview(Bins(content["first"], content["last"], content["rows"], signals), content["gaps"])
    except (OSError, ValueError, LookupError, EOFError, zipfile.BadZipFile):
        return None


def _stamp(path: Path) -> NDArray[np.int64]:
    """What changes with a file."""
    stat = path.stat()
    return np.array([stat.st_mtime_ns, stat.st_size], dtype=np.int64)
