"""Jobs that move a drive, such as experiments: somebody's Stop ends them, also where they are only about to begin.

Knows nothing of what they do, and of HTTP.
"""

import threading
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import TypeVar

from bench.actions.drive_jobs import BenchDrive, DriveJobs, DriveJobStatus, Ended
from bench.actions.safety.lease import Leases
from bench.errors import ConflictError, UnavailableError


class State(StrEnum):
    """Where such a job stands; all but the first are ends."""

    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


@dataclass(frozen=True, slots=True)
class Run:
    """Such a job under way."""

    holder: str  # as it is named where it holds a lease
    cancelled: threading.Event = field(default_factory=threading.Event)

    def cancel(self) -> None:
        """Have it end."""
        self.cancelled.set()

    leave = cancel


S = TypeVar("S", bound=DriveJobStatus)


class MovingJobs(DriveJobs[S, Run]):
    """The jobs of one kind that move their drives."""

    def __init__(
        self, folder: Path, notes: Path, drives: Mapping[str, BenchDrive], leases: Leases,
        on_end: Ended = lambda _: None,
    ) -> None:  # fmt: skip
        """`folder`: of what they make; `notes`: of what they have to undo, see `unfinished`."""
        super().__init__(folder, drives, leases, on_end)
        self._notes = notes
        self._stops = Counter[str]()  # under the lock: so often has somebody asked for a drive's Stop

    @property
    def holders(self) -> set[str]:
        """Those under way, as they are named where they hold a lease."""
        with self._lock:
            return {run.holder for run in self._runs.values()}

    def stop(self, drive: str) -> None:
        """Have one that is under way, or asked for, end, without waiting for it."""
        with self._lock:
            self._stops[drive] += 1
            for id_, run in self._runs.items():
                if self._known[id_].drive == drive:
                    run.cancel()

    # --- for who makes jobs

    def _put_unless_stopped(self, status: S, run: Run, work: Callable[[], None], stops: int | None) -> None:
        """Have a thread do its work. `stops`: so many were there when it was asked for, None: it moves nothing.

        Raises UnavailableError, ConflictError.
        """
        with self._lock:
            if self._ending:
                raise UnavailableError("the service is ending")
            if stops is not None and stops != self._stops[status.drive]:
                raise ConflictError(f"drive {status.drive} was stopped meanwhile: ask again where that is meant")
            self._put(status, run, work)
