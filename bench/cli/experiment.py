"""`pmsm-bench experiment`: what a diagnosis asks for, done on a drive, by the running service or by the drive's bus."""

import contextlib
import json
import threading
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, cast

import httpx
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from bench import experiment
from bench.capture_file import write_new
from bench.cli.output import await_end, check_recording
from bench.cli.rest import Rest
from bench.errors import BenchError, ConfigError, UnavailableError
from bench.experiment import Plan, experiment_of
from drivers.connect import connect

_PERIOD: Final = 0.1  # s between two looks
_TIMEOUT: Final = 10.0  # s for one answer
_EXPECTED: Final = "expected a diagnosis as `pmsm-bench diagnose --json` writes it"
_console: Final = Console(highlight=False, soft_wrap=True)

Show = Callable[[str, float], None]


def by_service(name: str, service: str, file: Path, ambiguity: int | None, out: Path) -> None:
    """Have the service do it, and download the recording. Raises BenchError."""
    check_recording(out)
    asked = _asked(file, ambiguity)
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
                    said = rest.call("GET", name, "experiments", id_, key="state")
        except KeyboardInterrupt:
            with contextlib.suppress(BenchError):
                rest.call("DELETE", name, "experiments", id_)
            raise
        if said["state"] != "done":
            raise BenchError(f"the experiment {said['state']}: {said['reason']}")
        try:
            recording = rest.download(name, "experiments", id_, "file")
            written = write_new(out, lambda part: part.write(recording))
        except (OSError, UnavailableError) as error:
            why = f"{out}: cannot be written: {error.strerror or error}" if isinstance(error, OSError) else str(error)
            raise BenchError(f"{why}; the service still has it, as experiment {id_} of drive {name}") from None
    _tell(written, int(said["samples"]), said["remarks"])


def directly(url: str, file: Path, ambiguity: int | None, out: Path) -> None:
    """Do it over a drive's bus. Raises BenchError, DriveError."""
    check_recording(out)
    plan = Plan.of(_asked(file, ambiguity))
    cancelled, ended = threading.Event(), threading.Event()
    outcome: list[experiment.Recorded | BaseException] = []
    with connect(url) as drive, _bar() as show:

        def work() -> None:
            try:
                outcome.append(experiment.run(drive, plan, lambda far: show(far.phase, far.share), cancelled))
            except BaseException as error:  # noqa: BLE001 - told by the thread that waits
                outcome.append(error)
            ended.set()

        threading.Thread(target=work, name="experiment", daemon=True).start()
        await_end(ended, cancelled.set)
        (recorded,) = outcome
        if isinstance(recorded, BaseException):
            raise recorded
        origin = {"drive": "drive", "url": url, "asked": datetime.now(UTC).isoformat()}
        try:
            written = experiment.write(out, recorded, plan, drive, origin)
        except OSError as error:
            raise BenchError(f"{out}: cannot be written: {error.strerror or error}") from None
    _tell(written, recorded.samples, recorded.remarks)


def _asked(file: Path, ambiguity: int | None) -> Mapping[str, Any]:
    """What the diagnosis asks for, told. Raises BenchError."""
    try:
        diagnosis = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{file}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
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
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda phase, share: bar.update(task, completed=share, description=phase)


def _tell(path: Path, samples: int, remarks: list[str] | tuple[str, ...]) -> None:
    for remark in remarks:
        _console.print(remark, markup=False)
    _console.print(f"{path}: {samples} samples; the drive is stopped; next: pmsm-bench diagnose {path}", markup=False)
