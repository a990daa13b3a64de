"""`pmsm-bench replay`: options to a replay, a replay to a table, JSON and CSV."""

import csv
import json
import os
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from rich.progress import MofNCompleteColumn, TimeRemainingColumn

from bench.cli.exit_codes import DOES_NOT, code_of
from bench.cli.output import STANDARD_OUTPUT, as_refusal, check_new, opened, print_json, write_whole
from bench.cli.table import basis_of, estimates_table
from bench.cli.terminal import Terminal, bar
from bench.errors import ConfigError
from bench.live.watch import Explained
from bench.live.window import AUTO, Window
from bench.machine_file import Nominal, load_machine, load_toml
from bench.recordings.column_options import columns_of
from bench.recordings.recording import open_recording
from bench.recordings.replay import OnEstimate, Replay, as_json, replay
from estimator.machine import PARAMETERS
from estimator.online.estimate import WindowEstimate
from estimator.online.window_ls import MAX_LENGTH
from estimator.witness import Witness


@dataclass(frozen=True, slots=True)
class Options:
    """Options of the estimation as given; None where one is not."""

    method: str | None = None
    window: str | None = None  # samples, or auto
    longest: int | None = None  # samples
    periods: int | None = None
    forgetting_factor: float | None = None
    ekf: str | None = None  # preset or file
    estimate: str | None = None  # names with commas
    witnesses: Mapping[str, Witness] = field(default_factory=dict[str, Witness])

    def settings(self, machine: Nominal) -> Window:
        """The settings they ask for. Raises ConfigError, LimitError."""
        if self.method == "ekf" and not machine.given:
            raise ConfigError("--method ekf: expected start values by --nominal MACHINE.toml, got none")
        change: dict[str, object] = {
            "method": self.method, "longest": self.longest, "periods_per_row": self.periods,
            "forgetting_factor": self.forgetting_factor, "length": _length(self.window),
            "ekf": None if self.ekf is None else _tuning(self.ekf),
            "estimated": None if self.estimate is None else _names(self.estimate),
        }
        given = {key: value for key, value in change.items() if value is not None}
        return Window(length=MAX_LENGTH, held=machine.given).changed(given)

    def remarks(self, settings: Window) -> tuple[str, ...]:
        """A sentence for each option given that has no part in this."""
        uses = (
            ("--window", self.window, settings.method == "wls", "it goes with --method wls"),
            ("--longest", self.longest, settings.chosen_by_data, "it goes with --window auto"),
            ("--periods", self.periods, settings.method != "ekf", "the Kalman filter takes rows one by one"),
            ("--forgetting-factor", self.forgetting_factor, settings.method == "rls", "it goes with --method rls"),
            ("--ekf", self.ekf, settings.method == "ekf", "it goes with --method ekf"),
        )
        return tuple(
            f"{option} has no part in this: {use}" for option, value, applies, use in uses
            if value is not None and not applies
        )


def run(
    file: Path, nominal: Path | None, mapping: Sequence[str] | None, constants: Sequence[str] | None,
    align: Sequence[str] | None, options: Options, every: int | None, json_out: Path | None, csv_out: Path | None,
) -> int:
    """Replay a recording, print what it says at its end, write what was asked for; the exit code."""
    machine = load_machine(nominal) if nominal is not None else Nominal({})
    settings = options.settings(machine)
    hop = every if every is not None else max(1, (1000 if options.window is None else settings.samples) // 10)
    if hop < 1:
        raise ConfigError(f"--every: expected at least 1 row, got {hop}")
    shown = json_out == STANDARD_OUTPUT
    _check_outputs(file, {"--json": None if shown else json_out, "--csv": csv_out})
    mapped, held, aligned = columns_of(mapping, constants, align)
    with (
        open_recording(
            file, mapping=mapped, constants=held, T_s=machine.T_s, align=aligned, theta_step=machine.theta_step,
            n_p=machine.n_p, optional=False, temperatures=True, phases=True, q_alone=True, skipping=True,
        ) as reader,
        _track(csv_out) as on_estimate,
        bar("rows", reader.rows_expected, MofNCompleteColumn(), TimeRemainingColumn()) as update,
    ):
        n_p = held.get("n_p", machine.n_p)
        replayed = replay(
            reader, settings, hop if csv_out else 0, on_estimate, lambda done: update(completed=done), machine.given,
            None if n_p is None else int(n_p), {**machine.witnesses, **options.witnesses},
        )
    replayed = replace(replayed, remarks=(*replayed.remarks, *options.remarks(settings)))
    if shown:
        print_json(as_json(replayed))
        return _code(replayed)
    _print(replayed)
    if json_out is not None:
        with as_refusal(json_out):
            write_whole(json_out, json.dumps(as_json(replayed), indent=2) + "\n", over=False)
    return _code(replayed)


def _code(replayed: Replay) -> int:
    if replayed.verdict.status is Explained.NO:
        return DOES_NOT
    return code_of(as_json(replayed)["estimates"])


def _length(text: str | None) -> int | str | None:
    if text is None or text == AUTO:
        return text
    try:
        return int(text)
    except ValueError:
        raise ConfigError(f"--window: expected a whole number of samples or {AUTO}, got {text!r}") from None


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _tuning(text: str) -> Mapping[str, object]:
    """A preset of the filter's tuning, or the settings that a TOML file holds."""
    if text in ("tuned", "paper"):
        return {"preset": text}
    if not os.path.isfile(text):  # noqa: PTH113 - also for a name that cannot be
        raise ConfigError(f"--ekf: expected tuned, paper or a TOML file, got {text!r}")
    settings = load_toml(text)
    if "preset" not in settings:
        raise ConfigError(f'{text}: expected preset = "tuned", "paper" or "custom" and settings of it, got no preset')
    return settings


def _check_outputs(file: Path, outputs: Mapping[str, Path | None]) -> None:
    """Refuse, before anything is opened, an output that would overwrite the recording, the other output or a file."""
    taken = [os.path.realpath(file)]
    for option, path in outputs.items():
        if path is None:
            continue
        if os.path.realpath(path) in taken:
            raise ConfigError(f"{path}: expected a file of its own, this is the recording or the other output")
        taken.append(os.path.realpath(path))
        check_new(option, path)


@contextmanager
def _track(path: Path | None) -> Generator[OnEstimate | None]:
    """A writer of estimates over time to CSV: t, then value, std, status and chosen window of each parameter."""
    if path is None:
        yield None
        return
    with as_refusal(path), opened(path) as file:
        writer = csv.writer(file)
        header = [f"{name}{suffix}" for name in PARAMETERS for suffix in ("", "_std", "_status", "_window")]
        writer.writerow(["t", "samples", *header])

        def write(t: float, result: WindowEstimate) -> None:
            cells = [cell for e in result.estimates.values() for cell in (e.value, e.std, e.status, e.window)]
            writer.writerow([f"{t:.9g}", result.samples, *("" if cell is None else cell for cell in cells)])

        yield write


def _print(replayed: Replay) -> None:
    console = Terminal(soft_wrap=True)
    summary, result = replayed.recording, replayed.result
    title = f"{summary.path}: {summary.used} of {summary.rows} rows used, {summary.duration:.6g} s"
    console.print(title)
    settings = asdict(replayed.window)
    periods = settings["periods_per_row"]
    rows = "" if settings["method"] == "ekf" else f", {periods} period{'s' if periods > 1 else ''} per row"
    residual = "" if result.residual_rms is None else f", residual {result.residual_rms:.3g} V"
    basis = f"{basis_of(settings, result.samples)}{rows}, {result.gaps} gaps{residual}"
    console.print(estimates_table(as_json(replayed), settings, basis), soft_wrap=False)
    said = replayed.verdict.sentence()
    console.print(f"{said[0].upper()}{said[1:]}.")
    for remark in replayed.remarks:
        console.print(remark)
