"""The captures of all drives: asked for, watched, cancelled; those that a service before this one left unfinished.

One at a time per drive, under the drive's lease. Knows nothing of HTTP.
"""

import contextlib
import re
import threading
import time
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from bench.actions.capture import Link, Run, State, Status, new_status
from bench.actions.capture_request import Request
from bench.actions.lease import Leases, Part
from bench.errors import ConflictError, RecordingError, UnavailableError, shown
from bench.new_file import check_place
from bench.recordings.capture_file import CapturePart

LATEST: Final = "latest"
_WHEN: Final = r"-\d{8}-\d{6}-\d{3}"  # in an id, after the drive's name
_CANCEL: Final = 5.0  # s for a capture to end
_REMEMBERED: Final = 200  # captures, of all drives


class UnknownCaptureError(KeyError):
    """No capture of that name."""

    def __str__(self) -> str:
        return str(self.args[0])


class Captures:
    """Everything about captures; runs from `start` to `end`."""

    def __init__(
        self, folder: Path, urls: Mapping[str, str], links: Mapping[str, Link], leases: Leases
    ) -> None:
        self._folder, self._urls, self._links, self._leases = folder.absolute(), urls, links, leases
        self._lock = threading.Lock()  # guards what follows
        self._known: dict[str, Status] = {}  # oldest first
        self._runs: dict[str, tuple[Run, threading.Thread]] = {}  # under way
        self._ending = False

    def start(self) -> None:
        """Go on with what was under way when a service before this one ended; say what cannot go on."""
        for path in sorted(self._folder.glob("*.part")):
            try:
                self._go_on(path)
            except RecordingError as error:
                self._say_left(path.stem, str(error))
            except Exception:  # noqa: BLE001 - what makes no sense is left alone
                continue

    def leave(self) -> None:
        """Have all runs end: what waits for its trigger is cancelled, what is recorded goes on at the next start."""
        with self._lock:
            self._ending = True
            runs = list(self._runs.values())
        for run, _ in runs:
            run.leave()

    def join(self, timeout: float) -> None:
        """Wait for the end of all runs, at most so many seconds."""
        deadline = time.monotonic() + timeout
        with self._lock:
            runs = list(self._runs.values())
        for _, thread in runs:
            thread.join(max(0.0, deadline - time.monotonic()))

    def ask(self, drive: str, given: Mapping[str, Any], whom: str = "") -> Status:
        """Arm a drive's recorder, for `whom`; the rest happens by itself. Raises BenchError, DriveError."""
        status = new_status(drive, Request.of(given))
        self._check_folder()
        holder = f"capture {status.id}" + (f" (asked for from {whom})" if whom else "")
        run = self._run(status, holder)
        self._links[drive].drive()  # from here on it is known which device that is
        self._leases.take(drive, holder, run.most_seconds, Part.RECORDER)
        try:
            run.arm()
            self._leases.take(drive, holder, run.most_seconds, Part.RECORDER)  # now it is known how long a sample takes
        except BaseException:
            self._leases.release(drive, holder)
            raise
        self._begin(run)
        return run.status

    def all(self, drive: str) -> list[Status]:
        """A drive's captures, the newest first."""
        with self._lock:
            return [status for status in reversed(self._known.values()) if status.drive == drive]

    def latest(self, drive: str) -> Status | None:
        """A drive's newest capture; None where there was none."""
        return next(iter(self.all(drive)), None)

    def one(self, drive: str, id_: str) -> Status:
        """A capture by its id, or `latest`. Raises UnknownCaptureError."""
        found = self.all(drive)
        for status in found:
            if id_ in (status.id, LATEST):
                return status
        there = f"the latest is {found[0].id}" if found else "there is none"
        raise UnknownCaptureError(f"drive {drive} has no capture {shown(id_)}; {there}")

    def trigger(self, drive: str, id_: str) -> Status:
        """Trigger now. Raises UnknownCaptureError, ConflictError, DriveError."""
        self._under_way(self.one(drive, id_), "there is nothing to trigger")[0].trigger()
        return self.one(drive, id_)

    def cancel(self, drive: str, id_: str) -> Status:
        """End a capture that is under way. Raises UnknownCaptureError, ConflictError, UnavailableError."""
        status = self.one(drive, id_)
        run, thread = self._under_way(status, "there is nothing to cancel")
        run.cancel()
        thread.join(_CANCEL)
        if thread.is_alive():
            raise UnavailableError(f"capture {status.id} is to end, but has not within {_CANCEL:g} s")
        return run.status

    def file(self, drive: str, id_: str) -> Path:
        """The recording of a capture. Raises UnknownCaptureError; ConflictError where there is none."""
        status = self.one(drive, id_)
        if status.file is None or not status.file.is_file():
            why = f": {status.file.name} is no longer there" if status.file is not None else f", it is {status.state}"
            raise ConflictError(f"capture {status.id} has no recording{why}")
        return status.file

    def _under_way(self, status: Status, otherwise: str) -> tuple[Run, threading.Thread]:
        with self._lock:
            found = self._runs.get(status.id)
        if found is None:
            raise ConflictError(f"capture {status.id} is {status.state}, {otherwise}")
        return found

    def _go_on(self, path: Path) -> None:
        """Take up a capture, unless it is of another service, or drive.

        Raises RecordingError where its file cannot be read as one, or whatever an odd file leads to.
        """
        part = CapturePart.found(path)
        if part is None:
            return
        with contextlib.ExitStack() as otherwise:
            otherwise.callback(part.close)
            heading = part.heading
            if self._urls.get(heading.drive) != heading.url or heading.id != path.stem:
                return
            if path.with_suffix(".parquet").exists():
                part.remove()
                return
            request, asked = Request.of(heading.request), datetime.fromisoformat(heading.asked)
            state = State.ARMED if heading.count is None else State.UPLOADING
            status = Status(heading.id, heading.drive, request, asked, state, part.samples)
            if not heading.number:
                why = "the service ended before the drive's recorder was armed"
                self._know(replace(status, state=State.FAILED, reason=why))
                part.remove()
                return
            run = self._run(status, holder := f"capture {heading.id}", part)
            # A second one of a drive waits for the next start
            self._leases.take(heading.drive, holder, run.most_seconds, Part.RECORDER)
            self._begin(run)
            otherwise.pop_all()

    def _say_left(self, id_: str, why: str) -> None:
        """Say of a file that is left alone why, beside the captures of the drive that it is named after."""
        named = [drive for drive in self._urls if re.fullmatch(re.escape(drive) + _WHEN, id_)]
        if named:
            self._know(Status(id_, named[0], Request(), datetime.now(UTC), State.FAILED, reason=why))

    def _know(self, status: Status) -> None:
        with self._lock:
            self._known[status.id] = status

    def _run(self, status: Status, holder: str, interrupted: CapturePart | None = None) -> Run:
        def changed(status: Status) -> None:
            if status.state.ended:
                self._leases.release(status.drive, holder)
            else:
                self._leases.take(status.drive, holder, run.most_seconds, Part.RECORDER)
            self._know(status)

        path, url, link = self._folder / f"{status.id}.parquet", self._urls[status.drive], self._links[status.drive]
        run = Run(status, url, link, path, changed, interrupted)  # of which `changed` asks
        return run

    def _begin(self, run: Run) -> None:
        id_ = run.status.id

        def work() -> None:
            run.finish()
            with self._lock:
                self._runs.pop(id_)

        thread = threading.Thread(target=work, name=f"capture {id_}", daemon=True)
        with self._lock:
            self._known[id_] = run.status
            self._runs[id_] = (run, thread)
            ended = [key for key in self._known if key not in self._runs]
            for key in ended[: max(0, len(self._known) - _REMEMBERED)]:
                del self._known[key]
            if self._ending:
                run.leave()
            thread.start()

    def _check_folder(self) -> None:
        """Before anything is recorded, there is a place to put it. Raises UnavailableError."""
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            check_place(self._folder / "capture")
        except OSError as error:
            raise UnavailableError(f"the folder of captures cannot be written: {error.strerror or error}") from None
