"""`pmsm-bench experiment`: what a diagnosis asks for, done on a drive, by the running service or by the drive's bus."""

import contextlib
import os
import threading
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, cast

import httpx
from rich.progress import BarColumn, Progress, TimeElapsedColumn

from bench.actions import experiment
from bench.actions.experiment import Plan, experiment_of
from bench.actions.experiment_part import SUFFIX, ExperimentPart
from bench.actions.limits import Limits
from bench.actions.unfinished import Origin, folder_beside, undo
from bench.cli.output import await_end, check_recording
from bench.cli.rest import Rest, patiently
from bench.cli.terminal import Terminal, Told
from bench.config import captures_folder
from bench.errors import BenchError, ConfigError, UnavailableError
from bench.input_file import json_of, read_bytes
from bench.new_file import write_new
from drivers.connect import connect

_PERIOD: Final = 0.1  # s between two looks
_TIMEOUT: Final = 10.0  # s for one answer
_EXPECTED: Final = "expected a diagnosis as `pmsm-bench diagnose --json` writes it"
_console: Final = Terminal(soft_wrap=True)

Show = Callable[[str, float], None]


def by_service(name: str, service: str, file: Path, ambiguity: int | None, out: Path) -> None:
    """Have the service do it, and download the recording. Raises BenchError."""
    check_recording(out)
    asked = asked_of(file, ambiguity)
    with httpx.Client(timeout=_TIMEOUT) as client:
        rest = Rest(client, service)
        body = {key: asked[key] for key in ("holds", "step", "machine") if key in asked}
        said = rest.call("POST", name, "experiments", body=body, key="state")
        id_ = str(said["id"])
        try:
            with _bar() as show:
                while said["state"] == "running":
                    show(said["phase"], said["progress"])
                    time.sleep(_PERIOD)
                    said = patiently(
                        lambda: rest.call("GET", name, "experiments", id_, key="state"), lambda why: show(why, 0.0)
                    )
        except KeyboardInterrupt:
            with contextlib.suppress(BenchError):
                rest.call("DELETE", name, "experiments", id_)
            raise
        if said["state"] != "done":
            kept = f" in {said['file']}" if said["file"] else ""
            raise BenchError(f"the experiment {said['state']}: {said['reason']}{kept}")
        try:
            recording = rest.download(name, "experiments", id_, "file")
            written = write_new(out, lambda part: part.write(recording))
        except (OSError, UnavailableError) as error:
            why = f"{out}: cannot be written: {error.strerror or error}" if isinstance(error, OSError) else str(error)
            raise BenchError(f"{why}; the service still has it, as experiment {id_} of drive {name}") from None
    _tell(written, int(said["samples"]), said["remarks"])


def directly(url: str, file: Path, ambiguity: int | None, out: Path, i_max: float | None = None) -> None:
    """Do it over a drive's bus. Raises BenchError, DriveError."""
    check_recording(out)
    plan = Plan.of(asked_of(file, ambiguity))
    _take_up(out)
    cancelled, ended = threading.Event(), threading.Event()
    limits = Limits(plan.machine.get("i_rated"), raised_by="--i-max")
    if i_max is not None:
        limits = replace(limits, i_max=i_max)
    origin = Origin(folder_beside(captures_folder()), url, f"an experiment on {url}")
    outcome: list[experiment.Recorded | BaseException] = []
    with connect(url) as drive, _bar() as show:
        if left := undo(origin.folder, drive):
            _console.print(left, markup=False)
        experiment.check(drive, plan, limits)
        asked = datetime.now(UTC).isoformat()
        part = experiment.begin(out, plan, drive, {"drive": "drive", "url": url, "asked": asked})

        def work() -> None:
            try:
                outcome.append(experiment.run(
                    drive, plan, lambda far: show(far.phase, far.share), cancelled, part, limits=limits, origin=origin
                ))
            except BaseException as error:  # noqa: BLE001 - told by the thread that waits
                outcome.append(error)
            ended.set()

        threading.Thread(target=work, name="experiment", daemon=True).start()
        try:
            await_end(ended, cancelled.set)
        except KeyboardInterrupt:
            part.remove()
            raise
        (recorded,) = outcome
    if isinstance(recorded, OSError):
        recorded = BenchError(f"{out}: cannot be written: {recorded.strerror or recorded}")
    written, kept = part.settled()
    if written is None or isinstance(recorded, BaseException):
        why = f"{recorded}; " if isinstance(recorded, BaseException) else ""
        if not part.samples and isinstance(recorded, BaseException):
            raise recorded
        raise BenchError(f"{why}{kept}" + (f" in {written}" if written else "")) from None
    _tell(written, recorded.samples, recorded.remarks)


def _take_up(out: Path) -> None:
    """What an experiment to this name has left that was interrupted becomes a recording, which is said."""
    left = out.with_suffix(SUFFIX)
    if not os.path.lexists(left):
        return
    part = ExperimentPart.found(left)
    if part is None:
        raise ConfigError(f"--out: another experiment is under way to {out}")
    file, kept = part.settled()
    _console.print(
        f"an earlier experiment to {out} was interrupted: {kept}" + (f" in {file}" if file else ""), markup=False
    )


def asked_of(file: Path, ambiguity: int | None) -> Mapping[str, Any]:
    """What the diagnosis asks for, told. Raises BenchError."""
    try:
        diagnosis = json_of(read_bytes(file))
    except OSError as error:
        raise ConfigError(f"{file}: cannot be read: {error.strerror or error}") from None
    except ValueError as error:
        raise ConfigError(f"{file}: {_EXPECTED}, got no JSON: {error}") from None
    if not isinstance(diagnosis, dict) or "ambiguous" not in diagnosis:
        raise ConfigError(f"{file}: {_EXPECTED}, got other JSON")
    try:
        asked = experiment_of(cast(dict[str, Any], diagnosis), ambiguity)
        plan = Plan.of(asked)
    except BenchError as error:
        raise ConfigError(f"{file}: {error}") from None
    if sentence := asked.get("sentence"):
        _console.print(f"{sentence[:1].upper()}{sentence[1:]}.", markup=False)
    for k, hold in enumerate(plan.holds, start=1):
        _console.print(
            f"  {k}: {hold.speed_rpm:g} rpm, i_d = {hold.i_d:g} A, i_q = {hold.i_q:g} A for {hold.seconds:.3g} s, "
            f"steps of {plan.step:g} A", markup=False,
        )  # fmt: skip
    return asked


@contextmanager
def _bar() -> Generator[Show]:
    """A bar on standard error, where that is a terminal."""
    console = Terminal(stderr=True)
    columns = (Told(), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda phase, share: bar.update(task, completed=share, description=phase)


def _tell(path: Path, samples: int, remarks: list[str] | tuple[str, ...]) -> None:
    for remark in remarks:
        _console.print(remark, markup=False)
    _console.print(f"{path}: {samples} samples; the drive is stopped; next: pmsm-bench diagnose {path}", markup=False)
