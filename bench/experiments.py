"""The experiments of all drives: asked for, watched, cancelled. One at a time per drive, under the drive's lease.

Recordings go to the folder of the captures. Knows nothing of HTTP.
"""

import threading
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

from bench import experiment
from bench.capture import Link
from bench.capture_file import check_place
from bench.errors import BenchError, ConflictError, UnavailableError, shown
from bench.experiment import CancelledError, Plan, Progress
from bench.lease import Leases
from bench.machine_file import Nominal
from drivers.errors import DriveError

LATEST: Final = "latest"
_RENEWED: Final = 30.0  # s that the lease is taken for, anew with every step ahead
_CANCEL: Final = 5.0  # s for an experiment to end
_REMEMBERED: Final = 50  # experiments, of all drives


class UnknownExperimentError(KeyError):
    """No experiment of that name."""

    def __str__(self) -> str:
        return str(self.args[0])


class State(StrEnum):
    """Where an experiment stands; all but the first are ends."""

    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


@dataclass(frozen=True, slots=True)
class Status:
    """An experiment at one moment."""

    id: str
    drive: str
    plan: Plan
    asked: datetime
    state: State = State.RUNNING
    phase: str = ""  # what is being done, in words
    progress: float = 0.0  # 0 to 1
    reason: str = ""  # why it failed
    remarks: tuple[str, ...] = ()  # what was held otherwise than planned
    samples: int = 0
    file: Path | None = None


@dataclass(frozen=True, slots=True)
class _Run:
    thread: threading.Thread
    cancelled: threading.Event


class Experiments:
    """Everything about experiments, until `leave`."""

    def __init__(
        self, folder: Path, urls: Mapping[str, str], links: Mapping[str, Link], leases: Leases,
        nominals: Mapping[str, Nominal],
    ) -> None:  # fmt: skip
        self._folder, self._urls, self._links, self._leases = folder.absolute(), urls, links, leases
        self._nominals = nominals
        self._lock = threading.Lock()  # guards what follows
        self._known: dict[str, Status] = {}  # oldest first
        self._runs: dict[str, _Run] = {}  # under way
        self._ending = False

    def ask(self, drive: str, given: Mapping[str, Any], whom: str = "") -> Status:
        """Have a drive do an experiment. Raises LimitError, ConflictError, UnavailableError, DriveError."""
        plan, asked = Plan.of(given), datetime.now(UTC)
        experiment.check_motor(plan, self._nominals[drive].told, f"drive {drive}'s machine file")
        self._check_folder()
        link = self._links[drive].drive()  # from here on it is known which device that is
        id_ = f"{drive}-experiment-{asked:%Y%m%d-%H%M%S}-{asked.microsecond // 1000:03d}"
        status = Status(id_, drive, plan, asked)
        holder = f"experiment {id_}" + (f" (asked for from {whom})" if whom else "")
        self._leases.take(drive, holder, _RENEWED)
        try:
            experiment.check(link, plan)
            run = _Run(
                threading.Thread(target=lambda: self._work(status, holder), name=holder, daemon=True), threading.Event()
            )
            with self._lock:
                if self._ending:
                    raise UnavailableError("the service is ending")
                self._known[id_] = status
                self._runs[id_] = run
                for key in [k for k in self._known if k not in self._runs][: max(0, len(self._known) - _REMEMBERED)]:
                    del self._known[key]
                run.thread.start()
        except BaseException:
            self._leases.release(drive, holder)
            raise
        return status

    def all(self, drive: str) -> list[Status]:
        """A drive's experiments since the service started, the newest first."""
        with self._lock:
            return [status for status in reversed(self._known.values()) if status.drive == drive]

    def one(self, drive: str, id_: str) -> Status:
        """An experiment by its id, or `latest`. Raises UnknownExperimentError."""
        for status in self.all(drive):
            if id_ in (status.id, LATEST):
                return status
        raise UnknownExperimentError(f"drive {drive} has no experiment {shown(id_)}")

    def cancel(self, drive: str, id_: str) -> Status:
        """End one that is under way; its drive is stopped. Raises UnknownExperimentError, ConflictError."""
        status = self.one(drive, id_)
        with self._lock:
            run = self._runs.get(status.id)
        if run is None:
            raise ConflictError(f"experiment {status.id} is {status.state}, there is nothing to cancel")
        run.cancelled.set()
        run.thread.join(_CANCEL)
        if run.thread.is_alive():
            raise UnavailableError(f"experiment {status.id} is to end, but has not within {_CANCEL:g} s")
        return self.one(drive, status.id)

    def file(self, drive: str, id_: str) -> Path:
        """The recording. Raises UnknownExperimentError; ConflictError where there is none."""
        status = self.one(drive, id_)
        if status.file is None or not status.file.is_file():
            raise ConflictError(f"experiment {status.id} has no recording: it is {status.state}")
        return status.file

    def leave(self) -> None:
        """Have all end, and their drives stopped."""
        with self._lock:
            self._ending = True
            runs = list(self._runs.values())
        for run in runs:
            run.cancelled.set()

    def join(self, timeout: float) -> None:
        """Wait for their end, at most so many seconds."""
        deadline = time.monotonic() + timeout
        with self._lock:
            runs = list(self._runs.values())
        for run in runs:
            run.thread.join(max(0.0, deadline - time.monotonic()))

    def _work(self, status: Status, holder: str) -> None:
        """All of it; the status tells how it went."""
        id_, name = status.id, status.drive
        with self._lock:
            cancelled = self._runs[id_].cancelled

        def tell(far: Progress) -> None:
            self._leases.take(name, holder, _RENEWED)
            self._change(id_, phase=far.phase, progress=far.share)

        ended: dict[str, Any]
        try:
            drive = self._links[name].drive()
            recorded = experiment.run(drive, status.plan, tell, cancelled)
            origin = {"drive": name, "url": self._urls[name], "asked": status.asked.isoformat()}
            file = experiment.write(self._folder / f"{id_}.parquet", recorded, status.plan, drive, origin)
            ended = {"state": State.DONE, "progress": 1.0, "file": file, "samples": recorded.samples,
                     "remarks": recorded.remarks}  # fmt: skip
        except CancelledError as error:
            ended = {"state": State.CANCELLED, "reason": str(error)}
        except (BenchError, DriveError) as error:
            ended = {"state": State.FAILED, "reason": str(error)}
        except OSError as error:
            why = f"the recording cannot be written: {error.strerror or error}"
            ended = {"state": State.FAILED, "reason": why}
        except Exception as error:  # noqa: BLE001 - a fault of ours must not leave an experiment without an end
            why = f"the bench failed on this experiment: {type(error).__name__}: {error}"
            ended = {"state": State.FAILED, "reason": why}
        self._leases.release(name, holder)
        self._change(id_, phase="", **ended)
        with self._lock:
            del self._runs[id_]

    def _change(self, id_: str, **changes: Any) -> None:
        with self._lock:
            self._known[id_] = replace(self._known[id_], **changes)

    def _check_folder(self) -> None:
        """Before anything moves, there is a place to put the recording. Raises UnavailableError."""
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            check_place(self._folder / "experiment")
        except OSError as error:
            raise UnavailableError(f"the folder of captures cannot be written: {error.strerror or error}") from None


def as_json(status: Status) -> dict[str, Any]:
    """An experiment as plain values."""
    return {
        "id": status.id, "drive": status.drive, "state": status.state.value, "phase": status.phase,
        "progress": status.progress, "reason": status.reason, "remarks": list(status.remarks),
        "samples": status.samples, "file": None if status.file is None else str(status.file),
        "asked": status.asked, **asdict(status.plan),
    }  # fmt: skip
