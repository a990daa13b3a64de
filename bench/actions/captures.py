"""The captures of all drives: asked for, watched, cancelled; those that a service before this one left unfinished.

One at a time per drive, under the drive's lease. Knows nothing of HTTP.
"""

import contextlib
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from bench.actions.capture import Run, State, Status, new_status
from bench.actions.capture_request import Request
from bench.actions.drive_jobs import DriveJobs, ended_words
from bench.actions.safety.lease import Part
from bench.recordings.capture_file import CapturePart
from bench.recordings.recording import off_remark
from bench.recordings.table import notes
from bench.store.catalogue.ended import EndedJob


class Captures(DriveJobs[Status, Run]):
    """Everything about captures; runs from `start` to `leave`."""

    kind, remembered = "capture", 200

    def start(self) -> None:
        """Go on with what was under way when a service before this one ended; say what cannot go on."""
        self._take_up(".part", self._go_on, lambda id_, drive, why: Status(
            id_, drive, Request(), datetime.now(UTC), State.FAILED, reason=why
        ))  # fmt: skip

    def ask(self, drive: str, given: Mapping[str, Any], whom: str = "") -> Status:
        """Arm a drive's recorder, for `whom`; the rest happens by itself. Raises BenchError, DriveError."""
        status = new_status(drive, Request.of(given))
        self._check_folder()
        holder = f"capture {status.id}" + (f" (asked for from {whom})" if whom else "")
        run = self._run(status, holder)
        self._drives[drive].link.drive()  # from here on it is known which device that is
        self._leases.take(drive, holder, run.most_seconds, Part.RECORDER)
        try:
            run.arm()
            self._leases.take(drive, holder, run.most_seconds, Part.RECORDER)  # now it is known how long a sample takes
        except BaseException:
            self._leases.release(drive, holder)
            raise
        self._begin(run)
        return run.status

    def trigger(self, drive: str, id_: str) -> Status:
        """Trigger now. Raises UnknownError, ConflictError, DriveError."""
        status = self.one(drive, id_)
        self._under_way(status, "there is nothing to trigger").trigger()
        return self.one(drive, id_)

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
            drive = self._drives.get(heading.drive)
            if drive is None or drive.url != heading.url or heading.id != path.stem:
                return
            if path.with_suffix(".parquet").exists():
                part.remove()
                return
            request, asked = Request.of(heading.request), datetime.fromisoformat(heading.asked)
            state = State.ARMED if heading.count is None else State.UPLOADING
            status = Status(heading.id, heading.drive, request, asked, state, part.samples)
            if not heading.number:
                why = "the service ended before the drive's recorder was armed"
                status = replace(status, state=State.FAILED, reason=why)
                self._know(status)
                self._on_end(as_ended(status))
                part.remove()
                return
            run = self._run(status, holder := f"capture {heading.id}", part)
            # A second one of a drive waits for the next start
            self._leases.take(heading.drive, holder, run.most_seconds, Part.RECORDER)
            self._begin(run)
            otherwise.pop_all()

    def _run(self, status: Status, holder: str, interrupted: CapturePart | None = None) -> Run:
        def changed(status: Status) -> None:
            if status.state.ended:
                self._leases.release(status.drive, holder, ended_words(status.state, status.reason))
            else:
                self._leases.take(status.drive, holder, run.most_seconds, Part.RECORDER)
            self._know(status)

        path, drive = self._folder / f"{status.id}.parquet", self._drives[status.drive]
        run = Run(status, drive.url, drive.link, path, changed, interrupted)  # of which `changed` asks
        return run

    def _begin(self, run: Run) -> None:
        def work() -> None:
            run.finish()
            with self._lock:  # who waits for its end finds it told
                self._end(run.status.id)
                if run.status.state.ended:
                    self._on_end(as_ended(run.status))

        with self._lock:
            if self._ending:
                run.leave()
            self._put(run.status, run, work)


def as_ended(status: Status) -> EndedJob:
    """A capture that has ended, as it is remembered."""
    return EndedJob(
        "capture", status.id, status.drive, status.asked, status.state.value, status.progress, status.samples,
        status.reason, (status.remark,), None if status.file is None else str(status.file), status.request.as_json(),
    )  # fmt: skip


def of_ended(job: EndedJob) -> Status:
    """A capture as it was remembered. Raises LimitError where it makes no sense any more."""
    return Status(
        job.id, job.drive, Request.of(job.request), job.asked, State(job.state), job.samples, job.reason,
        None if job.file is None else Path(job.file), " ".join(job.remarks),
    )  # fmt: skip


def of_recording(path: Path) -> Status:
    """What a recording tells of the capture that made it.

    Raises RecordingError, LimitError, ValueError, LookupError.
    """
    told = notes(path)
    whole, samples = told["samples"] == told["expected"], int(told["samples"])
    return Status(
        str(told["capture"]), str(told["drive"]), Request.of(told["request"]), datetime.fromisoformat(told["asked"]),
        State.DONE if whole else State.FAILED, samples,
        "" if whole else f"the first {samples} of {told['expected']} samples are kept", path,
        off_remark(told["off_before"], told["off_after"]),
    )  # fmt: skip
