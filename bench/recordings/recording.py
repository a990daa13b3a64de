"""Recordings on disk to samples: CSV, CSV.gz or Parquet, whole or chunk by chunk in constant memory.

Columns `t u_d u_q i_d i_q omega_e`, and `theta_e` or its integral; `i_d_mean i_q_mean periods` where a row covers
several control periods; `u_dc`, and `i_a i_b i_c` where all three are there, unless they hold no value at the
beginning. SI, peak dq, by the period convention. A mapping names columns called otherwise and their units, a
constant stands in for a column and wins over one that is there. With `theta_e`, dq quantities may be phase or
alpha-beta ones, and the speed is the angle's derivative where it is missing. Without `t`, a constant `T_s` makes times
of the rows' numbers.

Alignment: `u=+1` says that the voltage recorded in row k was applied over row k+1; fractions mix two rows by
the time each was applied. The rows at a run's ends that are left without a voltage are not used. All else,
`u_dc` too, is of the row it stands in.

Knows nothing of estimators. Options that cannot be are a ConfigError, files that cannot be a RecordingError.
"""

import math
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, field, fields, replace
from itertools import chain, groupby
from pathlib import Path
from typing import cast

import numpy as np

from bench.errors import RecordingError, shown
from bench.recordings.forms.csv_rows import Lines
from bench.recordings.forms.times import LARGEST, Column, Counter, Even, Part, grain_of, numbered
from bench.recordings.forms.units import UNCHANGED
from bench.recordings.runs import OF_INSTANTS, PROBE, Chunk, RunSplitter, find_clock
from bench.recordings.sources import (
    MAX_PERIODS,
    OPTIONAL,
    PHASES,
    STATIONARY,
    TEMPERATURES,
    Sources,
    check_options,
    find_sources,
)
from bench.recordings.table import check_undamaged, column_names, header_of, notes, read_parts, row_count
from estimator.samples import Resolution, Samples

CHUNK_ROWS = 65_536


@dataclass(frozen=True, slots=True)
class Summary:
    """What a recording held and what became of it, for reports."""

    path: str
    T_s: float  # s, control period
    periods: int  # control periods per row
    rows: int  # in the file
    used: int  # handed on as samples
    runs: int  # stretches without a gap
    duration: float  # s, first row's start to last row's end, gaps included
    left_out: int  # rows with a cell missing or not finite
    missing: Mapping[str, int]  # such cells, by quantity
    unaligned: int  # rows at the runs' ends without a partner after alignment
    lost_rows: int  # rows that the times say are not in the file
    irregular_steps: int  # steps of time that are no multiple of the row's duration
    sources: Mapping[str, str]  # each quantity's source in words
    unused: tuple[str, ...]  # columns present and not read
    expected: int | None = None  # rows it was to have, where it says so
    off: str = ""  # when the drive drove no voltage, where it says so
    read_as: tuple[str, ...] = ()  # what was made of the file before, a sentence each

    def remarks(self) -> tuple[str, ...]:
        """What a user should know besides the result."""
        said = list(self.read_as)
        if self.lost_rows:
            said.append(f"rows lost, by the times: {self.lost_rows}")
        if self.irregular_steps:
            said.append(f"steps of time that are no multiple of the rows' duration: {self.irregular_steps}")
        if self.left_out:
            cells = ", ".join(f"{name} in {count}" for name, count in self.missing.items())
            said.append(f"rows left out for want of a value: {self.left_out} of {self.rows} ({cells})")
        if self.unaligned:
            said.append(f"rows without a voltage after alignment: {self.unaligned}")
        if self.expected is not None and self.rows < self.expected:
            said.append(f"the recording is partial: {self.rows} of {self.expected} rows")
        if self.off:
            said.append(self.off)
        if self.runs > 1:
            said.append(f"runs without a gap: {self.runs}")
        return tuple(said)


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """A recording in memory."""

    runs: tuple[Samples, ...]
    summary: Summary


class RecordingReader:
    """An open recording: iterate once over its chunks; `summary` grows on the way."""

    def __init__(
        self, path: Path, sources: Sources, parts: Iterator[Part], T_s: float | None, shift: float,
        noted: "_Noted", u_dc: float | None, told: "_Told", beside: Sequence[str], *, skipping: bool = False,
    ) -> None:
        self.path = path
        self._told = told
        with _naming(path):
            first = _first_rows(parts)
            periods = _periods(first, sources)
            if grain := grain_of(_times_of(first), None if T_s is None else T_s * periods):
                told.times.append(grain.remark())
                parts = Even(grain).spaced(chain(first, parts))
                first = _first_rows(parts)
            self.clock = find_clock(_times_of(first), periods, T_s, skipping=skipping)
        self.sources = used = sources.without(_empty(first)).with_u_dc(u_dc)
        parts = chain(first, parts)
        if sources.frame is not None:
            parts = sources.frame.turned(parts, self.clock.step)
        empty = set(sources.columns) - set(used.columns)
        self._parts = ({name: column for name, column in part.items() if name not in empty} for part in parts)
        self._noted = noted
        constants = {name: value for name, value in used.constants.items() if name not in STATIONARY}
        self._splitter = RunSplitter(self.clock, constants, shift, noted.resolution, beside, q_only=sources.q_only)
        self._chunks = self._read()

    @property
    def rows_expected(self) -> int | None:
        """Rows of the file, where its format says so beforehand."""
        return row_count(self.path)

    def __iter__(self) -> Iterator[Chunk]:
        return self._chunks

    @property
    def summary(self) -> Summary:
        """The account of what has been read so far."""
        clock, sources, noted = self.clock, self.sources, self._noted
        return Summary(
            path=str(self.path), T_s=clock.T_s, periods=clock.periods, duration=self._splitter.duration,
            sources=sources.told, unused=sources.unused, expected=noted.expected, off=noted.off,
            read_as=(*self._told.remarks(), *sources.remarks),
            **asdict(self._splitter.tally),
        )

    def _read(self) -> Iterator[Chunk]:
        for part in self._parts:
            with _naming(self.path):
                chunks = list(self._splitter.feed(part))
            yield from chunks
        with _naming(self.path, self._noted.off):
            self._splitter.finish()


@contextmanager
def open_recording(
    path: str | Path,
    *,
    mapping: Mapping[str, str] | None = None,
    constants: Mapping[str, float] | None = None,
    T_s: float | None = None,
    align: Mapping[str, float] | None = None,
    theta_step: float = 0.0,
    u_dc: float | None = None,
    n_p: int | None = None,
    optional: bool = True,
    temperatures: bool = False,
    phases: bool = False,
    q_alone: bool = False,
    skipping: bool = False,
    chunk_rows: int = CHUNK_ROWS,
) -> Generator[RecordingReader]:
    """A recording's chunks of about `chunk_rows` rows, in constant memory however long the file.

    `mapping`: quantity to the file's column, see `sources`. `constants`: quantity to value; `T_s` and `n_p` go before
    the arguments. `T_s`: control period in s, which the file's times must meet within 1 %. `align`: `{"u": rows}`, see
    the module. `theta_step`: resolution of `theta_e` in rad, 0 where it is not known. `u_dc`: V, where the recording
    does not say. `n_p`: pole pairs, for units that are mechanical. `optional`: whether to read dc link and phase
    currents. `temperatures`, `phases`: whether to have them, or phase currents, beside the samples. `q_alone`: whether
    the q axis alone is enough, so that u_d, and i_d, need not be there. `skipping`: whether rows may be one in several
    control periods, with both axes.
    """
    path, mapping, constants, align = Path(path), mapping or {}, constants or {}, align or {}
    check_options(mapping, constants, T_s, align)
    check_undamaged(path)
    header = header_of(path)
    sources = find_sources(
        path, header, mapping, constants, optional=optional, temperatures=temperatures, phases=phases, n_p=n_p,
        q_alone=q_alone,
    )
    columns = tuple(dict.fromkeys(sources.columns.values()))
    T_s, told = constants.get("T_s", T_s), _Told(header.remark)
    with closing(read_parts(path, columns, chunk_rows, told.lines)) as parts:
        named = (_named(part, sources) for part in parts)
        if "t" in sources.columns:
            told.counter = Counter(abs(sources.scales.get("t", UNCHANGED).factor))
            named = told.counter.unwrapped(named)
        else:
            named = numbered(named, constants["T_s"] * constants.get("periods", 1))
        noted = _noted(path, sources, theta_step)
        beside = (*TEMPERATURES, *(PHASES if phases and not optional else ()))
        yield RecordingReader(
            path, sources, named, T_s, align.get("u", 0), noted, u_dc, told, beside,
            skipping=skipping and not sources.q_only,
        )


def _named(part: Part, sources: Sources) -> Part:
    """A part's columns by quantity, in SI."""
    if not part:
        return part
    return {name: sources.scales.get(name, UNCHANGED)(part[column]) for name, column in sources.columns.items()}


@dataclass(slots=True)
class _Told:
    """What is to be said of a file and of what was made of it."""

    form: str  # of the file
    lines: Lines = field(default_factory=Lines)
    counter: Counter | None = None
    times: list[str] = field(default_factory=list[str])

    def remarks(self) -> tuple[str, ...]:
        """A sentence each, of what has been read so far."""
        wraps = 0 if self.counter is None else self.counter.wraps
        wrapped = (f"times of a 32-bit counter that wraps were made to go on: {wraps} times",) if wraps else ()
        return (*((self.form,) if self.form else ()), *self.lines.remarks(), *wrapped, *self.times)


def whole(reader: RecordingReader) -> Recording:
    """All of an open recording."""
    runs = tuple(joined(reader))
    return Recording(runs, reader.summary)


def joined(chunks: Iterable[Chunk]) -> Iterator[Samples]:
    """Runs from their chunks."""
    for _, run in groupby(chunks, lambda chunk: chunk.run):
        yield one_of([chunk.samples for chunk in run])


def one_of(stretches: Sequence[Samples]) -> Samples:
    """Stretches of one run as one."""
    first = stretches[0]
    names = [one.name for one in fields(Samples) if isinstance(getattr(first, one.name), np.ndarray)]
    return replace(first, **{name: np.concatenate([getattr(part, name) for part in stretches]) for name in names})


def check_every_period(path: Path, periods: float) -> None:
    """Raise RecordingError where rows cover several control periods, of which physics cannot be told."""
    if periods > 1:
        raise RecordingError(
            f"{path}: a stream's rows cover several control periods, here {periods:g} each: capture to diagnose"
        )


def periods_said(path: Path) -> float:
    """Control periods that a row covers, as a file's first row says; 1 where it does not. Raises RecordingError."""
    if "periods" not in column_names(path):
        return 1.0
    with closing(read_parts(path, ("periods",), 1)) as parts:
        return float(next(parts, {"periods": [1.0]})["periods"][0])


def off_remark(before: str, after: str) -> str:
    """When a drive drove no voltage, by clauses that tell why before and after the recording; empty: it did."""
    told = (("when the recorder was armed", before), ("when it was uploaded", after))
    return "; ".join(f"{when} {why.replace(' is ', ' was ', 1)}" for when, why in told if why)


@dataclass(frozen=True, slots=True)
class _Noted:
    """What a recording of the bench's own says besides its columns."""

    resolution: Resolution
    expected: int | None  # rows it was to have
    off: str  # when the drive drove no voltage


def _noted(path: Path, sources: Sources, theta_step: float) -> _Noted:
    """Raises RecordingError where it holds some control periods only: their flux balances do not join."""
    told = notes(path)
    decimation, expected, steps = told.get("decimation", 1), told.get("expected"), told.get("steps")
    if decimation != 1:
        raise RecordingError(
            f"{path}: expected every control period, it holds one of {shown(decimation)}; "
            "capture with a decimation of 1"
        )
    known: Mapping[str, object] = cast(Mapping[str, object], steps) if isinstance(steps, dict) else {}

    def step(*names: str) -> float:
        found = [known[column] for name in names if (column := sources.columns.get(name, "")) in known]
        for size in found:
            if isinstance(size, bool) or not isinstance(size, int | float) or not 0.0 <= size < LARGEST:
                raise RecordingError(f"{path}: its notes tell a step of {names[0]} of {shown(size)}, expected a number")
        return max(cast("list[float]", found), default=0.0)

    resolution = Resolution(step("i_d", "i_q"), step("u_d", "u_q"), math.hypot(theta_step, step("theta_e")), theta_step)
    before, after = (said if isinstance(said := told.get(key), str) else "" for key in ("off_before", "off_after"))
    return _Noted(resolution, expected if isinstance(expected, int) else None, off_remark(before, after))


def _first_rows(parts: Iterator[Part]) -> list[Part]:
    """The parts that hold the first rows, from which the step is told."""
    first: list[Part] = []
    rows = 0
    while rows <= PROBE and (part := next(parts, None)) is not None:
        first.append(part)
        rows += len(part["t"]) if part else 0
    if rows < 2:
        raise RecordingError(f"expected at least 2 rows, came {rows}")
    return first


def _times_of(first: list[Part]) -> Column:
    """The first times, s; not a number for a line that was left out."""
    return np.concatenate([part["t"] if part else [np.nan] for part in first])[: PROBE + 1]


def _empty(first: list[Part]) -> list[str]:
    """Optional columns without a value in the first rows: a channel that nothing was connected to."""
    rows = [part for part in first if part]
    cells = {name: np.concatenate([part[name] for part in rows])[:PROBE] for name in OPTIONAL if name in rows[0]}
    return [name for name, column in cells.items() if not (np.abs(column) < LARGEST).any()]


def _periods(first: list[Part], sources: Sources) -> int:
    """Control periods a row covers."""
    periods = sources.constants.get("periods", 1.0)
    if "periods" in sources.columns:
        told = np.concatenate([part["periods"] for part in first if part])[: PROBE + 1]
        told = told[np.isfinite(told)]
        periods = float(told[0]) if len(told) else 0.0
    if not 1 <= periods <= MAX_PERIODS or periods != int(periods):
        raise RecordingError(f"periods = {periods:g}: expected a whole number of control periods, 1 or more")
    if periods > 1 and "i_d_mean" not in sources.told:
        raise RecordingError(
            f"rows that cover {periods:g} control periods need their mean currents, missing columns: "
            f"i_d_mean, i_q_mean; {OF_INSTANTS}"
        )
    return int(periods)


@contextmanager
def _naming(path: Path, off: str = "") -> Generator[None]:
    """Put the file's name before what is wrong with its rows, and after it when the drive was off."""
    try:
        yield
    except RecordingError as error:
        said = str(error)
        named = said if said.startswith(f"{path}: ") else f"{path}: {said}"
        raise RecordingError(f"{named}; {off}" if off else named) from error
