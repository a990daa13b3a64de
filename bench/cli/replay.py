"""`pmsm-bench replay`: options to a replay, a replay to a table, JSON and CSV."""

import csv
import json
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from bench.cli.table import row_cells
from bench.errors import ConfigError
from bench.machine_file import Nominal, load_machine
from bench.recording import open_recording
from bench.replay import OnEstimate, Replay, as_json, replay
from bench.window import Window
from estimator.estimate import WindowEstimate
from estimator.machine import PARAMETERS
from estimator.window_ls import MAX_LENGTH

T = TypeVar("T")


def run(
    file: Path, nominal: Path | None, mapping: Sequence[str], constants: Sequence[str], align: Sequence[str],
    window: int | None, periods: int, estimated: str | None, every: int | None, json_out: Path | None,
    csv_out: Path | None,
) -> None:
    """Replay a recording, print what its last window says, write what was asked for."""
    machine = load_machine(nominal) if nominal is not None else Nominal({})
    change: dict[str, object] = {"length": MAX_LENGTH if window is None else window, "periods_per_row": periods}
    if estimated is not None:
        change["estimated"] = [name.strip() for name in estimated.split(",") if name.strip()]
    settings = Window(held=machine.given).changed(change)
    hop = every if every is not None else max(1, (window or 1000) // 10)
    if hop < 1:
        raise ConfigError(f"--every: expected at least 1 row, got {hop}")
    _check_outputs(file, json_out, csv_out)
    with (
        open_recording(
            file, mapping=_pairs("--map", mapping, str), constants=_pairs("--set", constants, float), T_s=machine.T_s,
            align=_pairs("--align", align, float),
        ) as reader,
        _track(csv_out) as on_estimate,
        _progress(reader.rows_expected) as on_rows,
    ):
        replayed = replay(reader, settings, hop if csv_out else 0, on_estimate, on_rows)
    _print(replayed)
    if json_out is not None:
        with _written(json_out):
            json_out.write_text(json.dumps(as_json(replayed), indent=2) + "\n", encoding="utf-8")


@contextmanager
def _progress(rows: int | None) -> Generator[Callable[[int], None]]:
    """A bar on standard error while a long recording is read, where that is a terminal."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("rows", total=rows)
        yield lambda done: bar.update(task, completed=done)


def _check_outputs(file: Path, *outputs: Path | None) -> None:
    """Refuse, before anything is opened, an output that would overwrite the recording or the other output."""
    taken = [file.resolve()]
    for path in outputs:
        if path is None:
            continue
        if path.resolve() in taken:
            raise ConfigError(f"{path}: expected a file of its own, this is the recording or the other output")
        taken.append(path.resolve())


def _pairs(option: str, items: Sequence[str], convert: Callable[[str], T]) -> dict[str, T]:
    """NAME=VALUE,... of a repeatable option."""
    pairs: dict[str, T] = {}
    for item in ",".join(items).split(","):
        if not item:
            continue
        name, equals, value = (part.strip() for part in item.partition("="))
        try:
            if not (name and equals and value):
                raise ValueError
            converted = convert(value)
        except ValueError:
            form = "NAME=COLUMN" if convert is str else "NAME=NUMBER"
            raise ConfigError(f"{option}: expected {form}[,...], got {item!r}") from None
        if name in pairs:
            raise ConfigError(f"{option}: {name} is given twice")
        pairs[name] = converted
    return pairs


@contextmanager
def _track(path: Path | None) -> Generator[OnEstimate | None]:
    """A writer of estimates over time to CSV: t, then value, std and status of each parameter."""
    if path is None:
        yield None
        return
    with _written(path), path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        header = [f"{name}{suffix}" for name in PARAMETERS for suffix in ("", "_std", "_status")]
        writer.writerow(["t", "samples", *header])

        def write(t: float, result: WindowEstimate) -> None:
            cells = [cell for e in result.estimates.values() for cell in (e.value, e.std, e.status)]
            writer.writerow([f"{t:.9g}", result.samples, *("" if cell is None else cell for cell in cells)])

        yield write


@contextmanager
def _written(path: Path) -> Generator[None]:
    try:
        yield
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror or error}") from None


def _print(replayed: Replay) -> None:
    console = Console(highlight=False)
    summary, result = replayed.recording, replayed.result
    title = f"{summary.path}: {summary.used} of {summary.rows} rows used, {summary.duration:.6g} s"
    console.print(title, soft_wrap=True, markup=False)
    table = Table(
        caption=f"last window: {result.samples} samples, {replayed.window.periods_per_row} periods per row, "
        f"{result.gaps} gaps" + (f", residual {result.residual_rms:.3g} V" if result.residual_rms is not None else ""),
    )
    for heading in ("", "value", "± 95 %", "unit", "status"):
        table.add_column(heading, justify="right" if heading in ("value", "± 95 %") else "left")
    for name, estimate in result.estimates.items():
        table.add_row(name, *row_cells(asdict(estimate)))
    console.print(table)
    for remark in replayed.remarks:
        console.print(remark, soft_wrap=True, markup=False)
