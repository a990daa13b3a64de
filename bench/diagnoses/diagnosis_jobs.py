"""Diagnoses of the service's recordings: asked for, worked on one at a time in a process, watched, cancelled.

The process lives as long as its job; nothing of the service waits for it. Of each recording there is the latest
diagnosis, of the last twenty, until the service ends; its result stays until another one is done. Knows nothing of
HTTP.
"""

import threading
import time
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Any, Final, cast

from bench.diagnoses.diagnosis_request import WORK, Request, Result, check_whole, checked_trust
from bench.diagnoses.worker import Failed, Progress, Worker
from bench.errors import ConfigError, ConflictError, LimitError, UnavailableError, shown
from bench.machine_file import Nominal, nominal_of
from bench.recordings.table import notes

LATEST: Final = "latest"
WAITING: Final = 10  # diagnoses
_REMEMBERED: Final = 20  # diagnoses, each with its report
_CANCEL: Final = 5.0  # s for a process that is killed to be gone


class UnknownRecordingError(KeyError):
    """No recording, or no diagnosis of it."""

    def __str__(self) -> str:
        return str(self.args[0])


class JobState(StrEnum):
    """Where a diagnosis stands; the last three are ends."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"

    @property
    def ended(self) -> bool:
        """Nothing more will come of it."""
        return self in (JobState.DONE, JobState.FAILED, JobState.CANCELLED)


@dataclass(frozen=True, slots=True)
class Job:
    """A diagnosis at one moment."""

    recording: str  # its id
    asked: datetime
    state: JobState = JobState.QUEUED
    progress: float = 0.0  # 0 to 1
    phase: str = ""  # what is being done, in words
    reason: str = ""  # why it failed
    content: Mapping[str, Any] | None = None  # as `bench.diagnoses.published` says
    machine: str | None = None  # a machine file
    packed: bytes = b""  # the report


@dataclass(slots=True)
class _Run:
    """A job that has not ended, and who works on it."""

    request: Request
    job: Job
    ended: threading.Event
    cancelled: bool = False
    worker: Worker | None = None


class DiagnosisJobs:
    """Everything about diagnoses, until `leave`."""

    def __init__(self, folder: Path, nominals: Mapping[str, Nominal], work: str = WORK) -> None:
        """`folder` has the recordings; `nominals`, by drive, are for those that say whose they are."""
        self._folder, self._nominals, self._work = folder.absolute(), nominals, work
        self._lock = threading.Lock()  # guards what follows
        self._jobs: dict[str, Job] = {}  # by recording, the oldest first
        self._done: dict[str, Job] = {}  # those of them, or their forerunners, that have a result
        self._runs: dict[str, _Run] = {}  # that have not ended
        self._current: _Run | None = None
        self._thread: threading.Thread | None = None
        self._ending = False

    def ask(self, id_: str, given: Mapping[str, Any]) -> Job:
        """Have a recording diagnosed. Raises UnknownRecordingError, LimitError, ConflictError, UnavailableError."""
        file = self._file(id_)
        id_ = file.stem
        request = self._request(file, given)
        with self._lock:
            if self._ending:
                raise UnavailableError("the service is ending")
            if id_ in self._runs:
                raise ConflictError(f"recording {id_} is being diagnosed, expected it to have ended or been cancelled")
            if len(self._runs) > WAITING:
                raise UnavailableError(f"{WAITING} diagnoses are waiting, expected fewer before another one")
            run = _Run(request, Job(id_, datetime.now(UTC)), threading.Event())
            self._runs[id_] = run
            self._keep(run.job)
            if self._thread is None:
                self._thread = threading.Thread(target=self._work_off, name="diagnoses", daemon=True)
                self._thread.start()
            return run.job

    def one(self, id_: str) -> Job:
        """The latest diagnosis of a recording. Raises UnknownRecordingError."""
        id_ = self._file(id_).stem if id_ == LATEST else id_
        with self._lock:
            job = self._jobs.get(id_)
        if job is None:
            raise UnknownRecordingError(f"no diagnosis of a recording {shown(id_)}")
        return job

    def done(self, id_: str) -> Job:
        """A recording's latest diagnosis that was done. Raises UnknownRecordingError; ConflictError while none is."""
        job = self.one(id_)
        with self._lock:
            job = self._done.get(job.recording, job)
        if job.state is not JobState.DONE:
            why = f": {job.reason}" if job.reason else ""
            raise ConflictError(f"the diagnosis of {job.recording} is {job.state}{why}, there is no result")
        return job

    def report(self, id_: str) -> str:
        """The page of a diagnosis. Raises as `done`."""
        return zlib.decompress(self.done(id_).packed).decode()

    def machine(self, id_: str) -> str:
        """The machine file of a diagnosis. Raises as `done`, and ConflictError where nothing could be fitted."""
        job = self.done(id_)
        if job.machine is None:
            raise ConflictError(f"the diagnosis of {job.recording} has no machine file: nothing could be fitted")
        return job.machine

    def cancel(self, id_: str) -> Job:
        """End a diagnosis. Raises UnknownRecordingError; ConflictError where it has ended; UnavailableError."""
        job = self.one(id_)
        with self._lock:
            run = self._runs.get(job.recording)
            if run is not None:
                self._stop(run)
        if run is None:
            raise ConflictError(f"the diagnosis of {job.recording} is {job.state}, there is nothing to cancel")
        if not run.ended.wait(_CANCEL):
            raise UnavailableError(f"the diagnosis of {job.recording} is to end, but has not within {_CANCEL:g} s")
        return self.one(job.recording)

    def leave(self) -> None:
        """Have all end."""
        with self._lock:
            self._ending = True
            for run in list(self._runs.values()):
                self._stop(run)

    def join(self, timeout: float) -> None:
        """Wait for their end, at most so many seconds."""
        deadline = time.monotonic() + timeout
        with self._lock:
            thread = self._thread
        if thread is not None:
            thread.join(max(0.0, deadline - time.monotonic()))

    def _file(self, id_: str) -> Path:
        """A recording in the folder. Raises UnknownRecordingError."""
        there = {path.stem: path for path in self._folder.glob("*.parquet")}
        if id_ == LATEST and there:
            return max(there.values(), key=lambda path: (path.stat().st_mtime, path.name))
        if id_ not in there:
            raise UnknownRecordingError(f"no recording {shown(id_)} among the service's captures")
        return there[id_]

    def _request(self, file: Path, given: Mapping[str, Any]) -> Request:
        """Raises LimitError."""
        for key in given:
            if key not in ("trust", "nominal"):
                raise LimitError(f"a diagnosis takes trust and nominal, got {shown(key)}")
        trust, nominal = _object(given, "trust") or {}, _object(given, "nominal")
        try:
            known = self._nominal(file) if nominal is None else nominal_of(nominal, "nominal")
            check_whole(known)
            return Request(file, known, checked_trust(trust), report=True)
        except ConfigError as error:
            raise LimitError(str(error)) from None

    def _nominal(self, file: Path) -> Nominal:
        """What is known of the drive that made a recording."""
        return self._nominals.get(str(notes(file).get("drive")), Nominal({}))

    def _stop(self, run: _Run) -> None:
        """Under the lock."""
        run.cancelled = True
        if run.worker is not None:
            run.worker.kill()
        if run is not self._current:
            self._end(run, run.job)

    def _work_off(self) -> None:
        while True:
            with self._lock:
                run = self._current = next(iter(self._runs.values()), None)
                if run is None:
                    self._thread = None
                    return
            try:
                ended = self._ended(run)
            except Exception as error:  # noqa: BLE001 - a fault of ours must not leave a diagnosis without an end
                why = f"the bench failed on it: {type(error).__name__}: {error}"
                ended = replace(run.job, state=JobState.FAILED, reason=why)
            with self._lock:
                self._end(run, ended)

    def _end(self, run: _Run, ended: Job) -> None:
        """Under the lock."""
        if run.cancelled and ended.state is not JobState.DONE:
            why = "the service has ended" if self._ending else ""
            ended = replace(ended, state=JobState.CANCELLED, reason=why)
        del self._runs[ended.recording]
        self._keep(ended)
        run.ended.set()

    def _ended(self, run: _Run) -> Job:
        """The job when its worker has done with it."""
        with Worker(self._work) as worker:
            with self._lock:
                run.worker = worker
                if run.cancelled:
                    worker.kill()
                self._tell(run, state=JobState.RUNNING)
            worker.begin(run.request)
            while isinstance(heard := worker.hear(), Progress):
                with self._lock:
                    self._tell(run, progress=heard.share, phase=heard.phase)
            with self._lock:
                run.worker = None
        if isinstance(heard, Failed):
            return replace(run.job, state=JobState.FAILED, reason=heard.why)
        result: Result = heard.result
        return replace(
            run.job, state=JobState.DONE, progress=1.0, phase="", content=result.content, machine=result.machine,
            packed=zlib.compress((result.report or "").encode(), 1),
        )

    def _tell(self, run: _Run, **changes: Any) -> None:
        """Under the lock."""
        run.job = replace(run.job, **changes)
        self._keep(run.job)

    def _keep(self, job: Job) -> None:
        """Under the lock."""
        if job.state is JobState.QUEUED:
            self._jobs.pop(job.recording, None)  # a new one is the newest
        self._jobs[job.recording] = job
        if job.state is JobState.DONE:
            self._done[job.recording] = job
        ended = [id_ for id_ in self._jobs if id_ not in self._runs]
        for id_ in ended[: max(0, len(ended) - _REMEMBERED)]:
            del self._jobs[id_]
            self._done.pop(id_, None)


def _object(given: Mapping[str, Any], key: str) -> dict[str, object] | None:
    """A part of the body. Raises LimitError where it is no object."""
    value = given.get(key)
    if value is not None and not isinstance(value, dict):
        raise LimitError(f"{key}: expected an object, got {shown(value)}")
    return cast(dict[str, object] | None, value)
