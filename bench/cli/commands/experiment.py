"""`pmsm-bench experiment`: what a diagnosis asks for, done on a drive, by the running service or by the drive's bus."""

import os
import threading
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, cast

from rich.progress import TimeElapsedColumn

from bench.actions import experiment
from bench.actions.experiment import Plan, experiment_of
from bench.actions.experiment_part import SUFFIX, ExperimentPart
from bench.actions.safety.limits import Limits
from bench.actions.safety.unfinished import Origin, undo
from bench.cli.output import awaited, check_recording
from bench.cli.rest import Job, rest_at
from bench.cli.terminal import Terminal, bar
from bench.errors import BenchError, ConfigError
from bench.files import journals_folder, json_of, read_bytes
from drivers.connect import connect

_TIMEOUT: Final = 10.0  # s for one answer
_EXPECTED: Final = "expected a diagnosis as `pmsm-bench diagnose --json` writes it"
_console: Final = Terminal(soft_wrap=True)

Show = Callable[[str, float], None]


def by_service(name: str, service: str | None, file: Path, ambiguity: int | None, out: Path) -> None:
    """Have the service do it, and download the recording. Raises BenchError."""
    check_recording(out)
    asked = asked_of(file, ambiguity)
    body = {key: asked[key] for key in ("holds", "step", "machine") if key in asked}
    with rest_at(service, _TIMEOUT) as rest:
        job = Job(rest, name, "experiments", body)
        with _bar() as show:
            job.follow(lambda said: show(said["phase"], said["progress"]), lambda why: show(why, 0.0))
        said = job.said
        if said["state"] != "done":
            kept = f" in {said['file']}" if said["file"] else ""
            raise BenchError(f"the experiment {said['state']}: {said['reason']}{kept}")
        written = job.fetch(out, "it, as experiment")
    _tell(written, int(said["samples"]), said["remarks"])


def directly(url: str, file: Path, ambiguity: int | None, out: Path, i_max: float | None = None) -> None:
    """Do it over a drive's bus. Raises BenchError, DriveError."""
    check_recording(out)
    plan = Plan.of(asked_of(file, ambiguity))
    _take_up(out)
    cancelled = threading.Event()
    limits = Limits(plan.machine.get("i_rated") if i_max is None else i_max, raised_by="--i-max")
    origin = Origin(journals_folder(), url, f"an experiment on {url}")
    with connect(url) as drive, _bar() as show:
        if left := undo(origin.folder, drive):
            _console.print(left)
        experiment.check(drive, plan, limits)
        asked = datetime.now(UTC).isoformat()
        part = experiment.begin(out, plan, drive, {"drive": "drive", "url": url, "asked": asked})
        recorded: experiment.Recorded | Exception
        try:
            recorded = awaited(lambda: experiment.run(
                drive, plan, lambda far: show(far.phase, far.share), cancelled, part, limits=limits, origin=origin
            ), cancelled.set)  # fmt: skip
        except KeyboardInterrupt:
            part.remove()
            raise
        except OSError as error:
            recorded = BenchError(f"{out}: cannot be written: {error.strerror or error}")
        except Exception as error:  # noqa: BLE001 - told below, with what was kept
            recorded = error
    written, kept = part.settled()
    if isinstance(recorded, Exception) and not part.samples:
        raise recorded
    if written is None or isinstance(recorded, Exception):
        why = f"{recorded}; " if isinstance(recorded, Exception) else ""
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
    _console.print(f"an earlier experiment to {out} was interrupted: {kept}" + (f" in {file}" if file else ""))


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
        _console.print(f"{sentence[:1].upper()}{sentence[1:]}.")
    for k, hold in enumerate(plan.holds, start=1):
        _console.print(
            f"  {k}: {hold.speed_rpm:g} rpm, i_d = {hold.i_d:g} A, i_q = {hold.i_q:g} A for {hold.seconds:.3g} s, "
            f"steps of {plan.step:g} A",
        )  # fmt: skip
    return asked


@contextmanager
def _bar() -> Generator[Show]:
    with bar("", 1.0, TimeElapsedColumn()) as update:
        yield lambda phase, share: update(completed=share, description=phase)


def _tell(path: Path, samples: int, remarks: list[str] | tuple[str, ...]) -> None:
    for remark in remarks:
        _console.print(remark)
    _console.print(f"{path}: {samples} samples; the drive is stopped; next: pmsm-bench diagnose {path}")
