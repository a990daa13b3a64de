"""Jobs on drives, such as captures and experiments: watched by id, cancelled, waited for, their files handed out.

Knows nothing of what they do, and of HTTP.
"""

import re
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Final, Generic, Protocol, TypeVar

from bench.actions.lease import Leases
from bench.actions.limits import Limits
from bench.errors import ConflictError, RecordingError, UnavailableError, UnknownError, shown
from bench.files import check_place
from bench.machine_file import Nominal
from drivers.drive import Drive

LATEST: Final = "latest"
_CANCEL: Final = 5.0  # s for a job to end
_WHEN: Final = r"-\d{8}-\d{6}-\d{3}"  # in an id, after what it is named after


class Link(Protocol):
    """A way to a drive that comes back by itself when it is lost."""

    def drive(self) -> Drive:
        """The drive, connected. Raises DriveError while it is not."""
        ...


class BenchDrive(Protocol):
    """A drive as the bench has it."""

    url: str
    nominal: Nominal  # what is known of its motor
    limits: Limits  # of its set points

    @property
    def link(self) -> Link:
        """The way to it."""
        ...


class JobStatus(Protocol):
    """A job at one moment."""

    @property
    def id(self) -> str:
        """By which it is asked for."""
        ...

    @property
    def drive(self) -> str:
        """The drive's name."""
        ...

    @property
    def state(self) -> str:
        """In a word."""
        ...

    @property
    def file(self) -> Path | None:
        """The recording, as far as there is one."""
        ...


S = TypeVar("S", bound=JobStatus)


@dataclass(frozen=True, slots=True)
class Running:
    """A job under way."""

    thread: threading.Thread
    cancel: Callable[[], None]  # has it end, and what it has made discarded
    leave: Callable[[], None]  # has it end, since the service does


class DriveJobs(Generic[S]):
    """The jobs of one kind, of all drives; what is known of the latest is kept."""

    def __init__(
        self, kind: str, folder: Path, drives: Mapping[str, BenchDrive], leases: Leases, remembered: int
    ) -> None:
        """`kind`: in a word; `folder`: of their recordings."""
        self._kind, self._folder, self._remembered = kind, folder.absolute(), remembered
        self._drives, self._leases = drives, leases
        self._lock = threading.Lock()  # guards what follows
        self._known: dict[str, S] = {}  # oldest first
        self._runs: dict[str, Running] = {}  # under way
        self._ending = False

    def all(self, drive: str) -> list[S]:
        """A drive's jobs since the service started, the newest first."""
        with self._lock:
            return [status for status in reversed(self._known.values()) if status.drive == drive]

    def latest(self, drive: str) -> S | None:
        """A drive's newest job; None where there was none."""
        return next(iter(self.all(drive)), None)

    def one(self, drive: str, id_: str) -> S:
        """A job by its id, or `latest`. Raises UnknownError."""
        found = self.all(drive)
        for status in found:
            if id_ in (status.id, LATEST):
                return status
        there = f"the latest is {found[0].id}" if found else "there is none"
        raise UnknownError(f"drive {drive} has no {self._kind} {shown(id_)}; {there}")

    def cancel(self, drive: str, id_: str) -> S:
        """End a job that is under way. Raises as `one`, and ConflictError, UnavailableError."""
        status = self.one(drive, id_)
        run = self._under_way(status, "there is nothing to cancel")
        run.cancel()
        run.thread.join(_CANCEL)
        if run.thread.is_alive():
            raise UnavailableError(f"{self._kind} {status.id} is to end, but has not within {_CANCEL:g} s")
        return self.one(drive, status.id)

    def file(self, drive: str, id_: str) -> Path:
        """The recording of a job. Raises as `one`, and ConflictError where there is none."""
        status = self.one(drive, id_)
        if status.file is None or not status.file.is_file():
            why = f": {status.file.name} is no longer there" if status.file is not None else f", it is {status.state}"
            raise ConflictError(f"{self._kind} {status.id} has no recording{why}")
        return status.file

    def leave(self) -> None:
        """Have all end, since the service does."""
        with self._lock:
            self._ending = True
            runs = list(self._runs.values())
        for run in runs:
            run.leave()

    def join(self, timeout: float) -> None:
        """Wait for their end, at most so many seconds."""
        deadline = time.monotonic() + timeout
        with self._lock:
            runs = list(self._runs.values())
        for run in runs:
            run.thread.join(max(0.0, deadline - time.monotonic()))

    # --- for who makes jobs

    def _under_way(self, status: S, otherwise: str) -> Running:
        with self._lock:
            found = self._runs.get(status.id)
        if found is None:
            raise ConflictError(f"{self._kind} {status.id} is {status.state}, {otherwise}")
        return found

    def _know(self, status: S) -> None:
        with self._lock:
            self._known[status.id] = status

    def _change(self, id_: str, **changes: Any) -> None:
        with self._lock:
            status: Any = self._known[id_]
            self._known[id_] = replace(status, **changes)

    def _put(self, status: S, run: Running) -> None:
        """Under the lock: a job is under way; what is too old is forgotten."""
        self._known[status.id], self._runs[status.id] = status, run
        ended = [key for key in self._known if key not in self._runs]
        for key in ended[: max(0, len(self._known) - self._remembered)]:
            del self._known[key]

    def _check_folder(self) -> None:
        """Before anything is recorded, there is a place to put it. Raises UnavailableError."""
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            check_place(self._folder / self._kind)
        except OSError as error:
            raise UnavailableError(f"the folder of captures cannot be written: {error.strerror or error}") from None

    def _take_up(
        self, suffix: str, go_on: Callable[[Path], None], left: Callable[[str, str, str], S], named: str = ""
    ) -> None:
        """What a service before this one has left: go on with each file, or say why it is left alone.

        That is said beside the jobs of the drive whose name, with what is `named` after it, and a time are the id;
        `left` makes the status, by id, drive and why.
        """
        for path in sorted(self._folder.glob(f"*{suffix}")):
            try:
                go_on(path)
            except RecordingError as error:
                for drive in self._drives:
                    if re.fullmatch(re.escape(drive + named) + _WHEN, path.stem):
                        self._know(left(path.stem, drive, str(error)))
            except Exception:  # noqa: BLE001 - what makes no sense is left alone
                continue


def id_at(named: str, asked: datetime) -> str:
    """The id of a job by what it is named after, its drive's name first, and when it was asked for."""
    return f"{named}-{asked:%Y%m%d-%H%M%S}-{asked.microsecond // 1000:03d}"
