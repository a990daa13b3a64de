"""Replay: the streaming core over a recording, chunk by chunk in constant memory. Knows nothing of terminals."""

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import numpy as np

from bench.errors import ConfigError, RecordingError
from bench.live import method
from bench.live.doubts import doubted
from bench.live.q_axis import estimate_on_q, window_on_q
from bench.live.watch import Explained
from bench.live.window import Window
from bench.live.witnessed import with_witnesses
from bench.recordings.judgement import Judgement, Verdict
from bench.recordings.recording import RecordingReader, Summary
from bench.recordings.runs import Chunk, perhaps_of_instants
from bench.recordings.screen import Screen
from bench.recordings.skipping import SLOWEST, SkippingRows
from bench.recordings.sources import NOT_RECORDED, PHASES, TEMPERATURES
from bench.recordings.turned import Turned
from estimator.diagnosis.intake.causes import bring_in_order
from estimator.diagnosis.intake.phase_sensors import Fault, PhaseSums
from estimator.diagnosis.intake.speed_factor import speed_factor
from estimator.diagnosis.words import listed
from estimator.machine import PARAMETERS
from estimator.online.estimate import WindowEstimate
from estimator.online.window_ls import MAX_LENGTH
from estimator.samples import Column, Samples
from estimator.witness import Witness

_NOT_EXPLAINED: Final = "the model does not explain these rows"
_TOLERANCE: Final = dict.fromkeys(PARAMETERS, 0.1)  # of nominal values, that speak of another convention
_CAUSES: Final = 3  # that a sentence names
_MEMORY: Final = 5.0  # time constants, after which what is forgotten counts no more


@dataclass(frozen=True, slots=True)
class Replay:
    """What a recording says at its end; no estimate is ok of equations that do not fit."""

    recording: Summary
    window: Window
    result: WindowEstimate
    verdict: Verdict
    remarks: tuple[str, ...]  # what a user should know besides, a sentence each
    temperatures: Mapping[str, float]  # degC, means of the rows that it rests on, of those that the recording has


OnEstimate = Callable[[float, WindowEstimate], None]
"""Called with the time (s) at the newest row's end, and what the rows so far say."""


def replay(
    reader: RecordingReader, window: Window, every: int = 0, on_estimate: OnEstimate | None = None,
    on_rows: Callable[[int], None] | None = None, nominal: Mapping[str, float] | None = None, n_p: int | None = None,
    witnesses: Mapping[str, Witness] | None = None,
) -> Replay:
    """Stream a recording through the estimator; with `every`, report each time so many more rows have come.

    `on_rows` hears the number of rows done, now and then. `nominal`: values (SI) that the machine should have;
    `n_p`: its pole pairs, where they are known. `witnesses`: of parameters, which take part at the end.
    """
    if witnesses and window.method != "wls":
        raise ConfigError(f"--witness goes with --method wls, got {window.method}")
    turned = Turned(n_p, nominal or {}, set_speed="omega_e" in reader.sources.constants)
    if reader.clock.skips:
        return _replay_skipping(reader, window, every, on_estimate, on_rows, nominal, n_p, turned, witnesses or {})
    instead = None if witnesses else _instead(reader, window)
    found = _replay_periods(reader, window, every, on_estimate, on_rows, nominal, n_p, witnesses, turned, instead)
    if instead is None or found.verdict.status is not Explained.NO:
        return found
    instead.finish()
    said = instead.said(window, over=turned.doubt())
    if said is None or not said.explains:
        return found
    remarks = [*reader.summary.remarks(), *turned.remarks(), said.remark]
    remarks += _convention(said.result, said.verdict, nominal or {}, n_p)
    remarks += ["estimates over time are those of every period, and not of such rows"] if on_estimate else []
    return replace(found, result=said.result, verdict=said.verdict, remarks=tuple(remarks))


def _instead(reader: RecordingReader, window: Window) -> SkippingRows | None:
    """What takes rows for some that skip control periods, where they may be: of an unknown period, and all together."""
    unknown = not reader.clock.given and reader.clock.periods == 1 and reader.clock.step >= SLOWEST
    together = window.method == "wls" and _rests_on(window) is None and not window.chosen_by_data
    return SkippingRows(None) if unknown and together and not reader.sources.q_only else None


def _replay_periods(
    reader: RecordingReader, window: Window, every: int, on_estimate: OnEstimate | None,
    on_rows: Callable[[int], None] | None, nominal: Mapping[str, float] | None, n_p: int | None,
    witnesses: Mapping[str, Witness] | None, turned: Turned, instead: SkippingRows | None,
) -> Replay:  # fmt: skip
    """Rows of every control period, or means over several. `instead` takes them, too."""
    q_only, i_d = reader.sources.q_only, reader.sources.told["i_d"] != NOT_RECORDED
    window = window_on_q(window, i_d=i_d) if q_only else window
    running, screen = method.start(window), Screen()
    judgement, rests_on, due, rows = Judgement(window, nominal or {}), _rests_on(window), every, 0
    reports: deque[_Report] = deque()  # that wait until their rows have been judged
    warmth, sensors = _Warmth(rests_on), PhaseSums()

    def run(chunk: Chunk) -> None:
        nonlocal due, rows
        judgement.take(chunk.samples)
        turned.compare(chunk.samples)
        for piece, joined in _pieces(chunk, due, every):
            method.take(running, piece, joined=joined)
            due -= len(piece)
            rows += len(piece)
            if every and due <= 0:
                reports.append(_Report(rows, piece.t0 + len(piece) * piece.T, estimate()))
                due = every
        report()

    def estimate(by: Window = window) -> WindowEstimate:
        one = running if by is window else replace(running, window=by)
        return estimate_on_q(one, reader.clock.step, i_d=i_d) if q_only else method.estimate(one)

    def report() -> None:
        while reports and reports[0].rows <= judgement.done:
            one = reports.popleft()
            mismatch = doubt(one.rows)
            if on_estimate is not None:
                on_estimate(one.t, replace(one.result, estimates=doubted(one.result, mismatch)))

    def doubt(newest: int) -> str:
        said = _NOT_EXPLAINED if judgement.concerns(newest, rests_on) else ""
        fault = sensors.fault()
        wrong = fault.says if fault is not None and fault.sure and fault.made_of is not False else ""
        return "; ".join(filter(None, (turned.doubt(), wrong, said)))

    for chunk in reader:
        turned.take(chunk.samples)
        if instead is not None:
            instead.take(chunk.samples, joined=chunk.joined)
        warmth.take(chunk)
        _take_phases(sensors, chunk)
        if on_rows is not None:
            on_rows(reader.summary.rows)
        for left in screen.take(chunk):
            run(left)
    for left in screen.finish():
        run(left)
    verdict = judgement.verdict()
    report()
    result, witnessed = with_witnesses(running, estimate, witnesses or {})
    mismatch = doubt(rows)
    changes = judgement.changes() if rests_on is None and window.method != "ekf" else {}
    result = replace(result, estimates=doubted(result, mismatch, changes))
    fault = sensors.fault()
    remarks = (
        *reader.summary.remarks(), *screen.remarks(), *turned.remarks(), *_speed(judgement.worst, n_p),
        *_sensor(fault), *(() if fault or turned.doubt() else _convention(result, verdict, nominal or {}, n_p)),
        *witnessed, *_far_apart(reader, verdict),
    )  # fmt: skip
    return Replay(reader.summary, window, result, verdict, remarks, warmth.means())


def _replay_skipping(
    reader: RecordingReader, window: Window, every: int, on_estimate: OnEstimate | None,
    on_rows: Callable[[int], None] | None, nominal: Mapping[str, float] | None, n_p: int | None, turned: Turned,
    witnesses: Mapping[str, Witness],
) -> Replay:  # fmt: skip
    """Rows that skip control periods, all of them together."""
    one_in = f"rows that skip control periods, here one in {reader.clock.periods}"
    if window.method != "wls":
        raise ConfigError(f"{one_in}: expected --method wls, got {window.method}")
    if _rests_on(window) is not None or window.chosen_by_data:
        raise ConfigError(f"{one_in}, are taken all together: expected no --window")
    if window.periods_per_row != 1:
        raise ConfigError(f"{one_in}, are taken one by one: expected no --periods")
    rows, due, done = SkippingRows(reader.clock.T_s), every, 0
    warmth = _Warmth(None)
    for chunk in reader:
        turned.take(chunk.samples)
        warmth.take(chunk)
        if on_rows is not None:
            on_rows(reader.summary.rows)
        for piece, joined in _pieces(chunk, due, every):
            rows.take(piece, joined=joined)
            due, done = due - len(piece), done + len(piece)
            if every and due <= 0:
                due = every
                if on_estimate is not None and (so_far := rows.said(window)) is not None:
                    on_estimate(piece.t0 + len(piece) * piece.T, replace(so_far.result, samples=done))
    rows.finish()
    said = rows.said(window, over=turned.doubt(), nominal=nominal)
    if said is None:
        raise RecordingError(f"{reader.path}: expected rows, came none")
    remarks = (
        *reader.summary.remarks(), *turned.remarks(), said.remark,
        *(() if turned.doubt() else _convention(said.result, said.verdict, nominal or {}, n_p)),
        *(f"{name}: its witness has no part in this, for {one_in}" for name in witnesses),
    )  # fmt: skip
    return Replay(reader.summary, window, said.result, said.verdict, remarks, warmth.means())


def _take_phases(sensors: PhaseSums, chunk: Chunk) -> None:
    """Of a recording that has the phase currents."""
    if set(PHASES) <= chunk.beside.keys():
        rows = chunk.samples
        sensors.take([chunk.beside[name] for name in PHASES], rows.i_d + 1j * rows.i_q, rows.theta_e)


@dataclass(frozen=True, slots=True)
class _Report:
    """What the rows so far say, before it is known whether constant parameters explain them."""

    rows: int
    t: float  # s
    result: WindowEstimate


class _Warmth:
    """Temperatures beside the newest so many rows; None: all of them."""

    def __init__(self, rows: int | None) -> None:
        self._rows = rows
        self._newest: dict[str, Column] = {}
        self._sums: dict[str, tuple[float, int]] = {}  # where all of them count: of values, and how many

    def take(self, chunk: Chunk) -> None:
        """The next rows."""
        for name, column in chunk.beside.items():
            if name not in TEMPERATURES:
                continue
            if self._rows is None:
                self._sums[name] = _added(self._sums.get(name, (0.0, 0)), column)
            else:
                self._newest[name] = np.concatenate((self._newest.get(name, column[:0]), column))[-self._rows :]

    def means(self) -> dict[str, float]:
        """degC, by quantity."""
        sums = self._sums | {name: _added((0.0, 0), column) for name, column in self._newest.items()}
        return {name: total / count for name, (total, count) in sums.items() if count}


def _added(before: tuple[float, int], column: Column) -> tuple[float, int]:
    """A sum and a count with the finite values of a column."""
    known = column[np.isfinite(column)]
    return before[0] + float(known.sum()), before[1] + len(known)


def _rests_on(window: Window) -> int | None:
    """The newest so many rows that estimates rest on; None: all of them."""
    if window.method == "wls":
        return window.samples + 1 if window.samples < MAX_LENGTH else None
    forgotten = 1.0 - window.forgetting_factor
    return round(_MEMORY / forgotten) * window.periods_per_row if window.method == "rls" and forgotten > 0.0 else None


def as_json(replayed: Replay) -> dict[str, Any]:
    """A replay as plain values, SI."""
    result, window = replayed.result, replayed.window
    return {
        "method": window.method,
        "estimates": {name: asdict(estimate) for name, estimate in result.estimates.items()},
        "samples": result.samples,
        "gaps": result.gaps,
        "equations": result.equations,
        "condition": result.condition,
        "residual_rms_V": result.residual_rms,
        "combinations": [asdict(combination) for combination in result.combinations],
        "mismatch": asdict(replayed.verdict),
        "window": asdict(window),
        "temperatures_degC": dict(replayed.temperatures),
        "remarks": list(replayed.remarks),
        "recording": asdict(replayed.recording),
    }


def _speed(worst: Sequence[Samples], n_p: int | None) -> Sequence[str]:
    """What the voltages ask for in place of a speed that the angle is the integral of, a sentence where they do."""
    found = None if worst and worst[0].q_only else speed_factor(worst, n_p)
    if found is None:
        return ()
    pairs = "" if found.n_p is None or n_p is not None else f", of {found.n_p} pole pairs"
    unit = f": is omega_e {found.unit}{pairs}?" if found.unit else ":"
    return (
        f"the voltages ask for another speed, with which {math.sqrt(found.left):.2g} of what they leave unexplained is "
        f"left{unit} --map omega_e=COLUMN*{1.0 / found.factor:.6g}",
    )


def _far_apart(reader: RecordingReader, verdict: Verdict) -> Sequence[str]:
    """What rows may be that the equations do not explain, a sentence where they are far apart."""
    if verdict.status is not Explained.NO or reader.clock.given or reader.sources.q_only:
        return ()
    return perhaps_of_instants(reader.clock.step, reader.clock.periods)


def _sensor(fault: Fault | None) -> Sequence[str]:
    """What is wrong with a phase current's sensor, a sentence where one is."""
    if fault is None:
        return ()
    return (f"{fault.remark()}; pmsm-bench diagnose corrects them" if fault.sure and fault.made_of else fault.remark(),)


def _convention(
    result: WindowEstimate, verdict: Verdict, nominal: Mapping[str, float], n_p: int | None
) -> Sequence[str]:
    """What the machine file, else the recording, may follow, a sentence where all parameters are nominal but for it.

    Nothing of rows whose voltages the equations do not explain.
    """
    if verdict.rms_V is not None and verdict.least_V is not None and verdict.rms_V > verdict.least_V:
        return ()
    told = {name: e.value for name, e in result.estimates.items() if e.value is not None and e.std is not None}
    if not (set(PARAMETERS) <= told.keys() and set(PARAMETERS) <= nominal.keys()):
        return ()
    over = {name: told[name] / nominal[name] for name in PARAMETERS}
    likely = bring_in_order(over, n_p or 1, _TOLERANCE)
    of_machine = [cause.says for cause in likely if cause.of_machine]
    causes = [*of_machine[:1], *(cause.says for cause in likely if not cause.of_machine)]
    if not causes:
        return ()
    times = f"R_s, L_d, L_q and psi_f are {listed(f'{x:.3g}' for x in over.values())} times the nominal ones"
    return (f"{times}: {'; or '.join(causes[:_CAUSES])}",)


def _pieces(chunk: Chunk, due: int, every: int) -> Iterator[tuple[Samples, bool]]:
    """A chunk cut where reports are due, and whether each piece follows the rows before it."""
    if not every:
        yield chunk.samples, chunk.joined
        return
    start, stop = 0, min(due, len(chunk.samples))
    while start < len(chunk.samples):
        yield chunk.samples[start:stop], chunk.joined or start > 0
        start, stop = stop, min(stop + every, len(chunk.samples))
