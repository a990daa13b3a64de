"""The recordings of all drives' streams under way: asked for, marked, stopped; those that a service before this one
left are closed.

One at a time per drive; it needs no lease, for nothing is written to the drive. Knows nothing of HTTP.
"""

import contextlib
import shutil
import threading
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from bench.actions.drive_jobs import BenchDrive, DriveJobs
from bench.actions.recording import Run, State, Status, Surroundings, new_status
from bench.actions.recording_request import RecordingRequest
from bench.actions.safety.lease import Leases
from bench.errors import BenchError, ConflictError, UnavailableError
from bench.live.acquisition import Link
from bench.store.closing import closed
from bench.store.segments import FoundSegments, ids_in
from bench.store.write_log import to_standard_error
from drivers.block import Block

_LEAST: Final = 1e6  # bytes of the disk, of the shortest recording
_KILLED: Final = "the bench was killed, or the power failed"


class Recordings(DriveJobs[Status, Run]):
    """Everything about recordings under way; runs from `start` to `leave`."""

    kind, remembered = "recording", 200

    def __init__(
        self, folder: Path, drives: Mapping[str, BenchDrive], leases: Leases, kept_free: float, around: Surroundings
    ) -> None:
        """`kept_free`: bytes of the disk that recordings leave for others."""
        super().__init__(folder, drives, leases)
        self._kept_free, self._around = kept_free, around
        self._of_drive: dict[str, Run] = {}  # those under way, by drive

    def start(self) -> None:
        """Close what a service before this one has left, one after the other."""
        if self._folder.is_dir():
            threading.Thread(target=self._close_left, name="recordings left", daemon=True).start()

    def put(self, drive: str, block: Block, link: Link) -> None:
        """A block of a drive has come. Does not wait."""
        if (run := self._of_drive.get(drive)) is not None:
            run.put(block, link)

    def ask(self, drive: str, given: Mapping[str, Any], whom: str = "") -> Status:
        """Record a drive's stream for `whom`. Raises BenchError, DriveError."""
        request = RecordingRequest.of(given)
        self._drives[drive].link.drive()
        self._check_folder()
        free = shutil.disk_usage(self._folder).free
        if free < (needed := self._kept_free + _LEAST):
            raise UnavailableError(
                f"the disk is nearly full: expected {needed / 1e6:g} MB free in {self._folder}, "
                f"{free / 1e6:.4g} MB are"
            )
        with self._lock:
            if (other := self._of_drive.get(drive)) is not None:
                raise ConflictError(f"drive {drive} is recorded already: {other.status.id}")
            return self._begin(new_status(drive, request, whom))

    def under_way(self, drive: str) -> Status | None:
        """The recording that a drive is in."""
        run = self._of_drive.get(drive)
        return None if run is None else run.status

    def newest_under_way(self) -> Status | None:
        """Of all drives; one that is being closed only where there is no other."""
        live = [status for status in self.known() if not status.state.ended]
        return min(live, key=lambda status: status.state is State.CLOSING, default=None)

    def find(self, id_: str) -> Status | None:
        """One that is known, whatever its drive."""
        with self._lock:
            return self._known.get(id_)

    def known(self) -> list[Status]:
        """All that are under way, or have ended since the service began; the newest first."""
        with self._lock:
            return list(reversed(self._known.values()))

    def stop(self, status: Status, whom: str) -> Status:
        """Have one end and be closed; does not wait for that. Raises ConflictError."""
        self._under_way(status, "there is nothing to stop").stop(f"stopped by {whom}" if whom else "stopped")
        return self._now(status)

    def mark(self, status: Status, text: str, whom: str) -> None:
        """Mark the newest row of one. Raises ConflictError."""
        self._under_way(status, "there is nothing to mark").mark(text, whom)

    def discard(self, status: Status) -> None:
        """End one that is under way, and discard it. Raises ConflictError, UnavailableError."""
        self._cancel(status)

    def _now(self, status: Status) -> Status:
        with self._lock:
            return self._known.get(status.id, status)

    def _begin(self, status: Status, before: Run | None = None) -> Status:
        """Under the lock; `before`: whose rows of another length it goes on with."""
        drive = status.drive
        run = Run(status, self._drives[drive], self._folder, self._kept_free, self._around, self._know)

        def work() -> None:
            run.work()
            with self._lock:
                if run.again and not self._ending:
                    self._go_on(run)
                else:
                    del self._of_drive[drive]
            self._end(status.id)

        if self._ending:
            run.leave()
        if before is not None:
            before.hand_over(run)
        self._of_drive[drive] = run
        self._put(status, run, work)
        return run.status

    def _go_on(self, run: Run) -> None:
        """With another recording, of rows of another length."""
        before = run.status
        request = replace(before.request, trigger="now", pre_trigger_s=0.0)
        self._begin(new_status(before.drive, request, before.whom, before.id), run)

    def _close_left(self) -> None:
        for id_ in ids_in(self._folder):
            if self._ending:
                return
            with contextlib.suppress(OSError, BenchError):  # left as it is, for `recordings verify` to tell
                found = FoundSegments.found(self._folder, id_)
                if found is not None and found.heading.id == id_:
                    with contextlib.closing(found):
                        path = closed(found, _KILLED, cut=True)
                    what = "it held no row" if path is None else "it is closed, as far as it came"
                    to_standard_error(f"recording {id_}: cut, {_KILLED}; {what}")
