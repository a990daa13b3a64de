"""A recording's rows to runs: consecutive samples one step apart. Knows nothing of files and their formats.

What ends a run: a step of several periods (lost rows), a step that is no multiple of the period, a row left out because
a cell is missing or not finite, and a line that cannot be read. Nothing is filled in. The result does not depend on how
the rows are divided into parts.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bench.errors import RecordingError
from bench.recordings.forms.times import DRIFT, JITTER, LARGEST, ODD, Part, expect_advance, odd_steps
from estimator.samples import Column, Resolution, Samples

PROBE = 10_000  # rows that settle the step between rows
SHORTEST, LONGEST = 1e-7, 5e-3  # s, that a control period may be
MOST_SKIPPED: Final = 1000  # control periods from row to row
_FAR_APART: Final = 0.5e-3  # s: few drives control as seldom
OF_INSTANTS: Final = (
    "of one row in several the rows well after each step of the currents are steady points, which pmsm-bench diagnose "
    "--format points takes"
)
"""What a diagnosis can do with values of an instant, a clause."""


@dataclass(frozen=True, slots=True)
class Clock:
    """The time base of a recording."""

    step: float  # s, between rows, by the recording's own times
    T_s: float  # s, control period: as given, or step / periods
    periods: int  # control periods per row
    skips: bool = False  # a row is the values of the first of them, and not means over all
    given: bool = False  # the control period was, and the times agree


@dataclass(slots=True)
class Tally:
    """What became of the rows so far, as a recording's summary tells it."""

    rows: int = 0  # in the file
    used: int = 0  # handed on
    runs: int = 0
    left_out: int = 0  # a cell missing or not finite
    missing: dict[str, int] = field(default_factory=dict[str, int])  # such cells, by quantity
    unaligned: int = 0  # at a run's end, without a partner after alignment
    lost_rows: int = 0  # that the times say are not in the file
    irregular_steps: int = 0  # that are no multiple of the period


@dataclass(frozen=True, slots=True, eq=False)
class Chunk:
    """A stretch of a run."""

    samples: Samples
    run: int  # from 1
    joined: bool  # follows the chunk before by exactly one row
    beside: Mapping[str, Column] = field(default_factory=dict[str, Column])  # of the same rows, as they are


def find_clock(t: Column, periods: int, T_s: float | None, *, skipping: bool = False) -> Clock:
    """The time base from the first times. Where `T_s` is given and agrees, it is the control period.

    `skipping`: rows may be one in several control periods.
    """
    rows = np.flatnonzero(np.abs(t) < LARGEST)
    if len(rows) < 2:
        raise RecordingError(f"expected at least 2 rows with a time, came {len(rows)}")
    t = t[rows]
    expect_advance(t, rows + 1)
    steps = np.diff(t)
    median, odd = odd_steps(steps)
    if np.mean(odd) > ODD:
        raise RecordingError(
            f"expected evenly sampled rows, {np.mean(odd):.0%} of the steps of t are no multiple of "
            f"their median {median:.6g} s (shortest {steps.min():.6g} s, longest {steps.max():.6g} s)"
        )
    # The mean of the single steps is finer than the median where the file's times are rounded.
    step = float(f"{np.mean(steps[np.abs(steps / median - 1) <= JITTER]):.9g}")
    T = step / periods
    if skipping and periods == 1 and T_s is not None and (rows_of := _one_in(T / T_s)):
        return Clock(step, step / rows_of, rows_of, skips=True, given=True)
    if T_s is not None and abs(T - T_s) > DRIFT * T_s:
        raise RecordingError(f"expected T_s = {T_s:g} s, the times say {T:g} s{_looks_like(step, T, T_s)}")
    if not SHORTEST <= T <= LONGEST:
        log = "; a log of steady states is diagnosed by --format points" if T > LONGEST else ""
        raise RecordingError(
            f"t steps by {step:g} s, expected {SHORTEST:g} to {LONGEST:g} s a control period: is t in ms, or us? "
            f"expected s, or its unit: --map t=COLUMN[us]{log}"
        )
    return Clock(step, T if T_s is None else T_s, periods, given=T_s is not None)


def _looks_like(step: float, T: float, T_s: float) -> str:
    """What times may be that say another control period, in a sentence's part."""
    ratio = T / T_s
    guesses = [f"in {unit}" for unit, factor in (("ms", 1e3), ("us", 1e6)) if abs(ratio / factor - 1.0) < DRIFT]
    if abs(step - 1.0) < 1e-9:
        guesses.insert(0, "a row number")
    if guesses:
        return f": is t {' or '.join(guesses)}? expected s, or what makes s of it: --map t=COLUMN*{T_s / T:.6g}"
    if rows_of := _one_in(ratio):
        return (
            f": is it one row in {rows_of}? A diagnosis needs every control period; pmsm-bench replay takes such rows "
            f"of both axes, and means over {rows_of} with i_d_mean, i_q_mean and periods = {rows_of}; {OF_INSTANTS}"
        )
    return ""


def _one_in(ratio: float) -> int:
    """Control periods from row to row, of a step over the control period; 0 where there is one, or no whole number."""
    whole = round(ratio)
    return whole if 1 < whole <= MOST_SKIPPED and abs(ratio / whole - 1.0) < DRIFT else 0


def perhaps_of_instants(step: float, periods: int) -> Sequence[str]:
    """Of rows that no machine explains, of a control period that nobody gave: a sentence where they are far apart."""
    if periods > 1 or step < _FAR_APART:
        return ()
    return (
        f"rows are {step * 1e3:.4g} ms apart: is that one row in several control periods? pmsm-bench replay takes such "
        f"rows by --set T_s=SECONDS; a diagnosis needs every control period; {OF_INSTANTS}",
    )


class RunSplitter:
    """Takes parts in their order and hands on chunks of runs; `finish` after the last.

    `shift`: by how many rows the voltage was recorded before it was applied. With a fraction, the voltage of
    a row is the mean of the two recorded ones weighted by the time each was applied in it.
    """

    def __init__(
        self, clock: Clock, constants: Mapping[str, float], shift: float, resolution: Resolution,
        beside: Sequence[str] = (), *, q_only: bool = False,
    ) -> None:
        """`beside`: columns that go along with the samples; a row may do without a value of them. `q_only`: theirs."""
        self.clock, self._q_only = clock, q_only
        self._resolution, self._beside = resolution, beside
        self.tally = Tally()
        self._constants = {name: value for name, value in constants.items() if name != "periods"}
        self._late, self._later = math.floor(shift), math.ceil(shift)
        self._weight = shift - self._late
        self._cut_front, self._cut_back = max(self._later, 0), max(-self._late, 0)
        self._first_t = math.nan  # s
        self._longest = 0  # rows of the longest run
        self._last_time: tuple[int, float] | None = None  # row, s: the newest usable time
        self._last_good = False
        self._passed = 0  # lines that were left out
        self._angle: tuple[float, float, float] | None = None  # s, rad/s, rad: where the integral of omega_e is
        self._run = _Run()

    @property
    def duration(self) -> float:
        """Time from the first row's start to the last row's end so far, s; not a number before the first."""
        return (math.nan if self._last_time is None else self._last_time[1]) - self._first_t + self.clock.step

    def feed(self, part: Part) -> Iterator[Chunk]:
        """The chunks that end with this part's rows."""
        if not part:
            self._pass_line()
            return
        n = len(part["t"])
        if n == 0:
            return
        rows = np.arange(n) + self.tally.rows + self._passed + 1
        self.tally.rows += n
        good, joined = self._screen(part, rows)
        kept = np.flatnonzero(good)
        if len(kept) == 0:
            return
        starts = ~joined[kept]
        columns = {name: column[kept] for name, column in part.items() if name != "periods"}
        columns |= {name: np.full(len(kept), value) for name, value in self._constants.items()}
        if "theta_e" not in columns:
            columns["theta_e"] = self._integrated(columns["t"], columns["omega_e"], starts)
        edges = sorted({0, len(kept), *np.flatnonzero(starts).tolist()})
        for a, b in pairwise(edges):
            if starts[a]:
                self._end_run()
            stretch = {name: column[a:b] for name, column in columns.items()}
            yield from self._take(stretch, int(rows[kept[a]]), int(rows[kept[b - 1]]))

    def _pass_line(self) -> None:
        """A line that was left out, of which only the times can say whether it was a row."""
        self._last_good = False
        self._passed += 1
        if self._last_time is not None:
            row, t = self._last_time
            self._last_time = row + 1, t

    def finish(self) -> None:
        """Judge the recording as a whole, after its last part."""
        self._end_run()
        if self._longest < 2:
            cells = ", ".join(f"{name} in {count}" for name, count in self.tally.missing.items())
            raise RecordingError(
                f"expected at least 2 consecutive usable rows, found none in {self.tally.rows} rows"
                + (f" (no value: {cells})" if cells else "")
            )

    def _screen(self, part: Part, rows: NDArray[np.int64]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which rows are usable, and which of them follow a usable one by exactly one step."""
        tally = self.tally
        usable = {name: np.abs(column) < LARGEST for name, column in part.items()}
        joined = self._one_step(part["t"], usable["t"], rows)
        if "periods" in part:
            changed = usable["periods"] & (part["periods"] != self.clock.periods)
            if changed.any():
                k = int(np.argmax(changed))
                came = f"{self.clock.periods} before, {part['periods'][k]:g} in row {rows[k]}"
                raise RecordingError(f"expected rows of equally many control periods, came {came}")
        usable = {name: ok for name, ok in usable.items() if name not in self._beside}
        good = np.logical_and.reduce(list(usable.values()))
        for name, ok in usable.items():
            if not ok.all():
                tally.missing[name] = tally.missing.get(name, 0) + int(np.sum(~ok))
        tally.left_out += int(np.sum(~good))
        joined &= good
        joined[1:] &= good[:-1]
        joined[0] &= self._last_good
        self._last_good = bool(good[-1])
        return good, joined

    def _one_step(
        self, t: Column, timed: NDArray[np.bool_], rows: NDArray[np.int64]
    ) -> NDArray[np.bool_]:
        """Which rows come one step after the row before them; counts lost rows and irregular steps."""
        one_step = np.zeros(len(t), dtype=np.bool_)
        places = np.flatnonzero(timed)
        if len(places) == 0:
            return one_step
        t, rows = t[places], rows[places]
        if self._last_time is None:
            self._first_t = float(t[0])
        else:
            t, rows = np.r_[self._last_time[1], t], np.r_[self._last_time[0], rows]
        self._last_time = int(rows[-1]), float(t[-1])
        expect_advance(t, rows)
        steps = np.diff(t) / self.clock.step
        multiple = np.rint(steps)
        there = np.diff(rows)  # rows the file has for this step: more than one where times are missing
        odd = (multiple < there) | (np.abs(steps - multiple) > JITTER + DRIFT * (multiple - 1))
        self.tally.lost_rows += int(np.sum(np.maximum(multiple - there, 0)))
        self.tally.irregular_steps += int(np.sum(odd))
        one_step[places[len(places) - len(steps):]] = ~odd & (multiple == 1)
        return one_step

    def _integrated(self, t: Column, omega_e: Column, starts: NDArray[np.bool_]) -> Column:
        """theta_e by the trapezoidal rule from 0 at the first usable row on, across gaps as well."""
        t_0, omega_0, theta_0 = self._angle or (t[0], omega_e[0], 0.0)
        T = np.where(starts, np.diff(t, prepend=t_0), self.clock.T_s * self.clock.periods)
        turns = T * (omega_e + np.r_[omega_0, omega_e[:-1]]) / 2
        theta_e = np.cumsum(np.r_[theta_0, turns])[1:]
        self._angle = float(t[-1]), float(omega_e[-1]), float(theta_e[-1])
        return theta_e

    def _take(self, columns: dict[str, Column], first: int, last: int) -> Iterator[Chunk]:
        """Rows of one run: align their voltages, hand on what has a partner, keep what waits for one."""
        run = self._run.extended(columns["t"], first, last)
        if run.waiting:
            columns = {name: np.r_[run.waiting[name], column] for name, column in columns.items()}
        front, back = self._cut_front, self._cut_back
        if front + back:
            run.waiting = {name: column[-(front + back):] for name, column in columns.items()}
        n = len(columns["t"])
        if n <= front + back:
            return
        rows = slice(front, n - back)
        if not run.handed_on:
            self.tally.runs += 1
        taken: dict[str, Any] = {name: column[rows] for name, column in columns.items() if name != "t"}
        taken |= {name: self._aligned(columns[name], rows) for name in ("u_d", "u_q")}
        beside = {name: taken.pop(name) for name in self._beside if name in taken}
        samples = Samples(
            **taken, T_s=self.clock.T_s, periods=self.clock.periods, t0=float(columns["t"][front]),
            resolution=self._resolution, q_only=self._q_only,
        )
        joined = run.handed_on > 0
        run.handed_on += len(samples)
        self.tally.used += len(samples)
        self._longest = max(self._longest, run.handed_on)
        yield Chunk(samples, self.tally.runs, joined, beside)

    def _aligned(self, u: Column, rows: slice) -> Column:
        early = u[rows.start - self._late : rows.stop - self._late]
        if not self._weight:
            return early
        late = u[rows.start - self._later : rows.stop - self._later]
        return (1 - self._weight) * early + self._weight * late

    def _end_run(self) -> None:
        run, step = self._run, self.clock.step
        self._run = _Run()
        self.tally.unaligned += run.rows - run.handed_on
        if run.rows < 2:
            return
        mean = (run.last_t - run.first_t) / (run.rows - 1)
        if abs(mean - step) > (DRIFT + 2 * JITTER / (run.rows - 1)) * step:
            raise RecordingError(
                f"rows {run.first} to {run.last} are {mean:.6g} s apart on average, expected {step:.6g} s "
                "as at the recording's beginning"
            )


@dataclass(slots=True, eq=False)
class _Run:
    rows: int = 0
    handed_on: int = 0
    first: int = 0  # row of the file
    last: int = 0
    first_t: float = 0.0  # s
    last_t: float = 0.0  # s
    waiting: dict[str, Column] = field(default_factory=dict[str, Column])  # newest rows, for the alignment

    def extended(self, t: Column, first: int, last: int) -> "_Run":
        if not self.rows:
            self.first, self.first_t = first, float(t[0])
        self.last, self.last_t = last, float(t[-1])
        self.rows += len(t)
        return self
