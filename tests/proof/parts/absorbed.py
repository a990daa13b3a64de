"""Concealed by absorption: recordings whose conventional fit looks perfect while its parameters are wrong.

A drive emulated in a process of its own, on a socket, is captured by the bench; its residual is held against that of
the same drive without the effect. What window, recursion and Kalman filter say stands beside the truth. The diagnosis
is asked, and where it asks for an experiment, the bench runs that on the drive, whose load machine is set to the speeds
that are asked for, and asks again, up to three times. What no experiment on a drive can tell - all voltages, or all
currents, scaled alike - is asked again with R_s by a meter.

An effect whose conventional residual shows is halved before anything is diagnosed, as often as that takes. What then
puts no parameter off by more than 1 % is no case of absorption: it is diagnosed and shown, and not counted as found.
"""

import contextlib
import math
from collections.abc import Generator, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from io import StringIO
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final

import pyarrow
import pyarrow.compute
import pyarrow.parquet

from bench.actions import experiment
from bench.actions.capture_request import NEEDED
from bench.actions.experiment import Plan, Progress, experiment_of
from bench.actions.safety.limits import Limits
from bench.actions.safety.unfinished import Origin
from bench.cli.commands import capture
from bench.diagnoses.diagnose import work
from bench.diagnoses.diagnosis_request import Request, json_text
from bench.errors import BenchError
from bench.live import method
from bench.live.window import Window
from bench.machine_file import Nominal
from drivers.connect import connect
from drivers.errors import DriveError, NoReplyError
from emulator.conceal.recording import recorded
from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.thermal import REFERENCE
from emulator.scenario.scenarios import Scenario
from emulator.scenario.text import text_of
from estimator.interval import Z_95
from estimator.machine import PARAMETERS
from estimator.online.estimate import Status, WindowEstimate
from estimator.samples import Samples
from tests.proof.parts.absorbed_cases import Case, cases
from tests.proof.proof import Bar, Proof, Settings, Table
from tests.support.recordings import read_recording
from tests.support.served_drive import emulator, ready, tcp_url

pa: Any = pyarrow  # comes without types
pc: Any = pyarrow.compute
pq: Any = pyarrow.parquet

ROUNDS: Final = 3  # of experiment and diagnosis
PERFECT: Final = 1.03  # times the noise floor
_HALVINGS: Final = 6
_ATTEMPTS: Final = 3
_PAUSE: Final = 1.0  # s, between speeds
_PERIODS: Final = 5  # of a regression row: with one, the currents' noise in it shows
_WRONG: Final = 0.01  # of a parameter, and ...
_ERRORS: Final = 3.0  # ... so many standard errors
_METER: Final = 0.005  # tolerance of R_s by a meter
_SETTLED: Final = ("explained", "no_mismatch")
_GAIN: Final = {"voltages": "dc_link_gain", "currents": "current_sensor_gain"}  # what is to be asked about

Temperatures = tuple[tuple[float, float], ...]  # degC of winding and magnets, at start and end
Errors = Mapping[str, float | None]  # by parameter, relative; None: the estimator does not tell it


@dataclass(frozen=True, slots=True)
class Step:
    """A diagnosis of a case."""

    after: str  # what was done before it, in words
    verdict: str
    names: tuple[str, ...]
    doubts: tuple[str, ...]
    size: str  # of the finding
    true: str
    errors: Errors  # of the machine's parameters
    wrong: str  # why it is confident and wrong; "" where it is not
    warned: bool = False  # it says that all voltages, or all currents, may be scaled by what they are scaled by


@dataclass(frozen=True, slots=True)
class Outcome:
    """A case, done."""

    title: str
    motor: str
    effect: str
    scaled: str  # "voltages", "currents" or ""
    true: str
    halved: int
    ratio: float  # of the conventional residual to the noise floor
    by: Mapping[str, Errors]  # wls, rls, ekf
    control: Errors  # wls without the effect
    steps: tuple[Step, ...]
    problem: str = ""  # why an experiment was not done

    @property
    def found(self) -> bool:
        """The last diagnosis names the effect."""
        return bool(self.effect) and self.steps[-1].names == (self.effect,)

    @property
    def concealed(self) -> bool:
        """The conventional fit looks perfect and is wrong."""
        return self.ratio <= PERFECT and _worst(self.by["wls"]) > _WRONG


def prove(settings: Settings) -> Proof:
    """All cases of a seed."""
    folder = settings.folder / "absorbed"
    folder.mkdir(parents=True, exist_ok=True)
    outcomes = list(_done(cases(settings.seed, quick=settings.quick), folder, settings.jobs))
    return proof_of(outcomes)


def _done(wanted: Sequence[Case], folder: Path, jobs: int) -> Iterator[Outcome]:
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        yield from pool.map(_run_numbered, [(case.name, case.seed, folder) for case in wanted])


def _run_numbered(given: tuple[str, int, Path]) -> Outcome:
    name, seed, folder = given
    return run(next(case for case in cases(seed, quick=False) if case.name == name), folder)


# --- one case


def run(case: Case, folder: Path) -> Outcome:
    """Capture, fit, diagnose, and do what is asked for. Raises BenchError, DriveError where the drive fails."""
    case, floor, control, halved = _hidden(case)
    while True:
        with _drive(case.scenario, folder / f"{case.name}.toml") as url:
            file = _captured(url, case, folder / f"{case.name}.parquet")
            samples = _samples(file, case.nominal)
            fits = {name: _fit(samples, case, name) for name in ("wls", "rls", "ekf")}
            ratio = _left(fits["wls"], case) / floor
            if ratio <= PERFECT or halved == _HALVINGS or not case.kind.effect:
                truth = _truth(case, samples)
                steps, problem = _asked(case, url, file, truth)
                by = {name: _errors_of(fit, case, truth) for name, fit in fits.items()}
                return Outcome(
                    case.title, case.motor, case.kind.effect, case.kind.scaled, steps[0].true, halved, ratio, by,
                    control, steps, problem,
                )
        case, halved = case.halved(), halved + 1


def _asked(case: Case, url: str, file: Path, truth: Mapping[str, float]) -> tuple[tuple[Step, ...], str]:
    """Diagnoses, each after what the one before has asked for; and what was in the way of an experiment."""
    said, problem = _diagnosis(file, case.nominal), ""
    steps = [judged("the first recording", said, case, truth)]
    for number in range(1, ROUNDS + 1):
        if not case.kind.effect or steps[-1].names or said["verdict"] in _SETTLED:
            break
        try:
            plan = Plan.of(asked := experiment_of(said))
            there, temperatures = _at_all_speeds(case, url, plan, file.with_stem(f"{file.stem}_{number}"))
        except (BenchError, DriveError) as error:
            problem = str(error)
            break
        said = _diagnosis(there, case.nominal)
        steps.append(judged(_words(plan, asked), said, case, _truth_of(case, temperatures)))
    if not case.kind.effect:
        metered = replace(case.nominal, given={**case.nominal.given, "R_s": truth["R_s"]})
        steps.append(judged("R_s by a meter", _diagnosis(file, metered, {"R_s": _METER}), case, truth))
    return tuple(steps), problem


def _hidden(case: Case) -> tuple[Case, float, Errors, int]:
    """The case with so much of its effect as does not show; the noise floor (A), and what is wrong without effect."""
    without = _simulated(case.without, case.seconds)
    plain = _fit(without, case, "wls", case.seconds)
    floor, here = _left(plain, case), _left(_fit(without, case, "wls"), case)  # `here`: by the same noise
    control = _errors_of(plain, case, {name: getattr(case.scenario.motor, name) for name in PARAMETERS})
    halved = 0
    while halved < _HALVINGS:
        shown = _left(_fit(_simulated(case.scenario, case.seconds), case, "wls"), case)
        if shown <= (1.0 + 0.5 * (PERFECT - 1.0)) * here:
            break
        case, halved = case.halved(), halved + 1
    return case, floor, control, halved


def _left(fit: WindowEstimate, case: Case) -> float:
    """A fit's residual as a current (A), by its own inductances: that is how noise of currents enters voltages."""
    L_d, L_q = (fit.estimates[name].value or case.nominal.given[name] for name in ("L_d", "L_q"))
    return (fit.residual_rms or math.nan) / math.sqrt(L_d * L_q)


def _simulated(scenario: Scenario, seconds: float) -> Samples:
    r = recorded(scenario, round(seconds / scenario.drive.T_s))
    return Samples(r["theta_e"], r["omega_e"], r["i_d"], r["i_q"], r["u_d"], r["u_q"], scenario.drive.T_s)


def _fit(samples: Samples, case: Case, name: str, window: float | None = None) -> WindowEstimate:
    """What an estimator without effects says: over a window (s), the case's; recursion and filter at the end."""
    window = window or case.window
    long = len(samples) * samples.T > 1.01 * window
    held = {**case.nominal.given, **{key: getattr(case.scenario.motor, key) for key in case.held}}
    change: dict[str, Any] = {
        "method": name, "periods_per_row": _PERIODS, "length": round(window / samples.T),
        "estimated": [key for key in PARAMETERS if key not in case.held],
        "forgetting_factor": 0.999 if long else 1.0,
    }  # fmt: skip
    running = method.start(Window(held=held).changed(change))
    method.take(running, samples, joined=False)
    return method.estimate(running)


def _errors_of(fit: WindowEstimate, case: Case, truth: Mapping[str, float]) -> Errors:
    """Relative errors of what is estimated and told."""
    found: dict[str, float | None] = {}
    for name, estimate in fit.estimates.items():
        told = estimate.status is Status.OK and estimate.value is not None and name not in case.held
        found[name] = estimate.value / truth[name] - 1.0 if told and estimate.value is not None else None
    return found


@contextlib.contextmanager
def _drive(scenario: Scenario, file: Path) -> Generator[str]:
    """The URL of an emulated drive, of a process of its own."""
    file.write_text(text_of(scenario), encoding="utf-8")
    url = tcp_url()
    with emulator("--at", url, "--scenario", str(file)) as process:
        ready(process)
        yield url


def _captured(url: str, case: Case, file: Path) -> Path:
    file.unlink(missing_ok=True)
    length = round(case.seconds / case.scenario.drive.T_s)
    with contextlib.redirect_stdout(StringIO()):
        capture.directly(url, {"signals": [*NEEDED, "u_dc"], "length": length}, file)
    return file


def _at_all_speeds(case: Case, url: str, plan: Plan, file: Path) -> tuple[Path, Temperatures]:
    """The experiment, and the load machine set to each of its speeds: the drive starts anew where that is another.

    A machine that warms up stays as it is, at its speed: the bench remarks on it. Raises DriveError, BenchError.
    """
    run = case.scenario.run
    speeds = tuple(dict.fromkeys(hold.speed_rpm for hold in plan.holds))
    if len(speeds) == 1 or case.scenario.effects.thermal.C_w > 0.0:
        return _experiment(url, plan, file)
    files: list[Path] = []
    for number, speed in enumerate(speeds):
        part = replace(plan, holds=tuple(hold for hold in plan.holds if hold.speed_rpm == speed))
        turned = replace(case.scenario, run=replace(run, speed_rpm=speed, seed=run.seed + number))
        of_speed = file.with_stem(f"{file.stem}_{speed:.0f}")
        with _drive(turned, of_speed.with_suffix(".toml")) as at:
            files.append(_experiment(at, part, of_speed)[0])
    tables: list[Any] = []
    for table in map(pq.read_table, files):
        later = tables[-1]["t"][-1].as_py() + _PAUSE if tables else 0.0
        tables.append(table.set_column(0, "t", pc.add(table["t"], later)))
    pq.write_table(pa.concat_tables(tables), file)
    return file, ((REFERENCE, REFERENCE),) * 2


def _experiment(url: str, plan: Plan, file: Path) -> tuple[Path, Temperatures]:
    """Have the bench do it; again where a busy host keeps the drive from answering. Raises DriveError, BenchError."""
    for _ in range(_ATTEMPTS - 1):
        with contextlib.suppress(NoReplyError):
            return _one_experiment(url, plan, file)
    return _one_experiment(url, plan, file)


def _one_experiment(url: str, plan: Plan, file: Path) -> tuple[Path, Temperatures]:
    """Its recording, and what the drive said of its temperatures meanwhile."""
    file.unlink(missing_ok=True)
    read: list[tuple[float, float]] = []
    with connect(url) as drive:

        def look(far: Progress) -> None:
            if far.phase.startswith("holding"):
                read.append((drive.read("temp_winding"), drive.read("temp_magnet")))

        part = experiment.begin(file, plan, drive, {"url": url})
        try:
            origin = Origin(file.parent / "control", url, "an experiment of the proof")
            experiment.run(drive, plan, look, part=part, limits=Limits(), origin=origin)
            done = part.written()
        finally:
            part.remove()
    return done, (read[0], read[-1])


def _samples(file: Path, nominal: Nominal) -> Samples:
    (samples,) = read_recording(file, T_s=nominal.T_s, u_dc=nominal.u_dc).runs
    return samples


def _truth(case: Case, samples: Samples) -> dict[str, float]:
    """What is true of the drive's first recording: its past and present, run once more."""
    if case.scenario.effects.thermal.C_w <= 0.0:
        return _truth_of(case, ((REFERENCE, REFERENCE),) * 2)
    drive = VirtualDrive(case.scenario)
    drive.run(max(1, round(samples.t0 / samples.T_s)))
    started = drive.truth
    drive.run(len(samples))
    ended = drive.truth
    return _truth_of(case, tuple((at.temp_winding, at.temp_magnet) for at in (started, ended)))


def _truth_of(case: Case, temperatures: Temperatures) -> dict[str, float]:
    """The machine at a recording's start, and by how much it moves, by its temperatures at start and end."""
    truth = {name: getattr(case.scenario.motor, name) for name in PARAMETERS}
    thermal = case.scenario.effects.thermal
    if thermal.C_w <= 0.0:
        return truth
    (R_0, R_1), (psi_0, psi_1) = (
        [1.0 + per_kelvin * (at[node] - REFERENCE) for at in temperatures]
        for node, per_kelvin in ((0, thermal.alpha), (1, thermal.beta))
    )
    truth |= {"R_s": truth["R_s"] * R_0, "psi_f": truth["psi_f"] * psi_0}
    return truth | {"rise": R_1 / R_0 - 1.0, "change": psi_1 / psi_0 - 1.0}


def _diagnosis(file: Path, nominal: Nominal, trust: Mapping[str, float] | None = None) -> dict[str, Any]:
    content = work(Request(file, nominal, trust or {}), lambda share, phase: None).content
    file.with_suffix(".trusted.json" if trust else ".json").write_text(json_text(content), encoding="utf-8")
    return content


def judged(after: str, said: Mapping[str, Any], case: Case, truth: Mapping[str, float]) -> Step:
    """A diagnosis beside what is true."""
    names = tuple(finding["effect"] for finding in said["findings"])
    doubts = tuple(dict.fromkeys(effect for doubt in said["ambiguous"] for effect in doubt["effects"]))
    told = said["machine"]["after"]
    errors = {name: told[name]["value"] / truth[name] - 1.0 if name in told else None for name in PARAMETERS}
    size = ""
    for finding in said["findings"]:
        if finding["effect"] == case.kind.effect:
            quantity = finding["parameters"][case.kind.parameter]
            size = f"{quantity['value']:.4g} ± {Z_95 * (quantity['std'] or math.nan):.1g} {quantity['unit']}"
    wrong = [f"names {name}" for name in names if name != case.kind.effect]
    if said["verdict"] in _SETTLED:
        for name in PARAMETERS:
            off, std = errors[name], float(told[name]["std"] or math.inf) if name in told else math.inf
            if off is not None and abs(off) > max(_WRONG, _ERRORS * std / truth[name]):
                wrong.append(f"{said['verdict']} with {name} off by {off:+.1%}")
    told = case.kind.told(case, truth)
    open_ = said["machine"]["scales"].get(case.kind.scaled)
    warned = open_ is not None and open_["least"] <= told <= open_["most"]
    true = f"{told:.4g} {case.kind.unit}"
    return Step(after, said["verdict"], names, doubts, size, true, errors, "; ".join(wrong), warned)


def _words(plan: Plan, asked: Mapping[str, Any]) -> str:
    levels = "; ".join(f"{h.speed_rpm:g} rpm, {h.i_d:g} A, {h.i_q:g} A" for h in plan.holds)
    return f"experiment: {levels}; steps of {asked.get('step', 0.0):g} A; {plan.seconds:g} s"


# --- what it says


def proof_of(outcomes: Sequence[Outcome]) -> Proof:
    """Bars and tables of what came out."""
    every = [one for one in outcomes if one.effect]
    named = [one for one in every if one.concealed]
    scaled = [one for one in outcomes if not one.effect]
    concealed = [one for one in outcomes if one.concealed]
    wrong = [step for one in every for step in one.steps if step.wrong]
    off = [step for one in scaled for step in one.steps if step.wrong]
    silent = [step for step in off if not step.warned]
    at_once = [one for one in named if one.steps[0].names == (one.effect,)]
    found = [one for one in named if one.found]
    metered = [one for one in scaled if one.steps[-1].names or _GAIN[one.scaled] in one.steps[-1].doubts]
    less = len(every) - len(named)
    left_out = f"; {less} left out, whose conventional fit is not so" if less else ""
    bars = [
        Bar("the conventional residual is within 3 % of the noise floor and a parameter off by more than 1 %", "all",
            f"{len(concealed)} of {len(outcomes)}", len(concealed) == len(outcomes)),
        Bar("of these, found once the experiment has run", "all",
            f"{len(found)} of {len(named)}, {len(at_once)} of them in the first recording{left_out}",
            len(found) == len(named) > 0),
        Bar("confident wrong answers, at any step", "none",
            f"{len(wrong)} of {sum(len(one.steps) for one in every)} diagnoses", not wrong),
    ]  # fmt: skip
    if scaled:
        asked = sum(len(one.steps) for one in scaled)
        bars += [
            Bar("all voltages or all currents scaled alike: a parameter off, that scale not said to be open", "none",
                f"{len(silent)} of {asked} diagnoses", not silent),
            Bar("  said to be open, with a parameter off by more than 1 % and three standard errors", "",
                f"{len(off) - len(silent)} of {asked} diagnoses", None),
            Bar("these are asked about once a meter has told R_s", "all", f"{len(metered)} of {len(scaled)}",
                len(metered) == len(scaled)),
        ]  # fmt: skip
    return Proof(
        "absorbed", "Concealed by absorption",
        "Each drive runs at one speed and about one level of current, alone or with small steps around it. The "
        f"residual of a fit of {', '.join(PARAMETERS)} (rows of {_PERIODS} periods) is that of the same drive without "
        "the effect; its parameters are not. Where a level stands alone, R_s and psi_f are fitted, and L_d and L_q "
        "held at their true values. Experiments are those that the diagnosis asks for, done on the drive by the bench.",
        tuple(bars), (_conventional_table(outcomes), _diagnosis_table(outcomes)),
    )  # fmt: skip


def _conventional_table(outcomes: Sequence[Outcome]) -> Table:
    rows = [
        (one.title, one.motor, one.true + (f" (halved {one.halved} times)" if one.halved else ""), f"{one.ratio:.3f}",
         *(_percent(one.by.get(name, {})) for name in ("wls", "rls", "ekf")), _percent(one.control))
        for one in outcomes
    ]  # fmt: skip
    errors = ", ".join(PARAMETERS)
    heads = ("concealed", "motor", "size", "residual over floor", f"WLS: error of {errors} in %", "RLS", "EKF",
             "WLS without the effect")  # fmt: skip
    return Table("What conventional estimators say", heads, tuple(rows))


def _diagnosis_table(outcomes: Sequence[Outcome]) -> Table:
    rows = [
        (one.title, one.motor, step.after, step.verdict, _named(step), step.size, step.true, _percent(step.errors),
         (f"{step.wrong}; says that {one.scaled} may be scaled so" if step.wrong and step.warned else step.wrong)
         or (one.problem if step is one.steps[-1] else ""))
        for one in outcomes for step in one.steps
    ]  # fmt: skip
    heads = ("concealed", "motor", "after", "verdict", "named", "size", "true size",
             f"error of {', '.join(PARAMETERS)} in %", "wrong, or in the way")  # fmt: skip
    return Table("What the diagnosis says", heads, tuple(rows))


def _named(step: Step) -> str:
    doubts = f"in doubt: {', '.join(step.doubts)}" if step.doubts else ""
    return "; ".join(part for part in (", ".join(step.names), doubts) if part)


def _percent(errors: Errors) -> str:
    return ", ".join("-" if (off := errors.get(name)) is None else f"{100.0 * off:+.2f}" for name in PARAMETERS)


def _worst(errors: Errors) -> float:
    return max((abs(off) for off in errors.values() if off is not None), default=0.0)
