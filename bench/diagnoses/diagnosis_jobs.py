"""Diagnoses of the service's recordings: asked for, worked on one at a time in a process, watched, cancelled.

The process lives as long as its job; nothing of the service waits for it. Of each recording there is the latest
diagnosis, of the last twenty, until the service ends; its result stays until another one is done. Knows nothing of
HTTP.
"""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Any, Final, cast

from bench.diagnoses.diagnosis_request import WORK, Request, Result, check_whole, checked_trust
from bench.diagnoses.worker import Failed, Progress, Worker
from bench.errors import ConfigError, ConflictError, LimitError, UnavailableError, UnknownError, shown
from bench.jobs import LATEST, Jobs
from bench.machine_file import Nominal, nominal_of
from bench.recordings.table import notes
from bench.store.closing import notes_of

WAITING: Final = 10  # diagnoses
_REMEMBERED: Final = 20  # diagnoses, each with its report


class JobState(StrEnum):
    """Where a diagnosis stands; the last three are ends."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


@dataclass(frozen=True, slots=True)
class Job:
    """A diagnosis at one moment."""

    id: str  # of the recording
    asked: datetime
    state: JobState = JobState.QUEUED
    progress: float = 0.0  # 0 to 1
    phase: str = ""  # what is being done, in words
    reason: str = ""  # why it failed
    content: Mapping[str, Any] | None = None  # as `bench.diagnoses.published` says
    machine: str | None = None  # a machine file
    packed: bytes = b""  # the report
    packed_figures: bytes = b""  # JSON, as `bench.diagnoses.figures.figure` says
    earlier: "Job | None" = None  # the latest before this one that has a result, while this one has none

    @property
    def done(self) -> "Job | None":
        """The recording's latest diagnosis that has a result."""
        return self if self.state is JobState.DONE else self.earlier


@dataclass(slots=True, eq=False)
class _Run:
    """A diagnosis that has not ended, and who works on it."""

    request: Request
    cancelled: bool = False
    worker: Worker | None = None

    def cancel(self) -> None:
        """Have it end."""
        self.cancelled = True
        if self.worker is not None:
            self.worker.kill()

    leave = cancel


class DiagnosisJobs(Jobs[Job, _Run]):
    """Everything about diagnoses, until `leave`."""

    def __init__(self, folder: Path, nominals: Mapping[str, Nominal], work: str = WORK) -> None:
        """`folder` has the recordings; `nominals`, by drive, are for those that say whose they are."""
        super().__init__("the diagnosis of")
        self._folder, self._nominals, self._work = folder.absolute(), nominals, work

    def ask(self, id_: str, given: Mapping[str, Any]) -> Job:
        """Have a recording diagnosed. Raises UnknownError, LimitError, ConflictError, UnavailableError."""
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
            before = self._known.pop(id_, None)  # a new one is the newest
            job, run = Job(id_, datetime.now(UTC), earlier=before and before.done), _Run(request)
            self._put(job, run, lambda: self._work_on(id_, run))
            return job

    def one(self, id_: str) -> Job:
        """The latest diagnosis of a recording. Raises UnknownError."""
        id_ = self._file(id_).stem if id_ == LATEST else id_
        with self._lock:
            job = self._known.get(id_)
        if job is None:
            raise UnknownError(f"no diagnosis of a recording {shown(id_)}")
        return job

    def done(self, id_: str) -> Job:
        """A recording's latest diagnosis that was done. Raises UnknownError; ConflictError while none is."""
        job = self.one(id_)
        if job.done is None:
            why = f": {job.reason}" if job.reason else ""
            raise ConflictError(f"{self._kind} {job.id} is {job.state}{why}, there is no result")
        return job.done

    def report(self, id_: str) -> str:
        """The page of a diagnosis. Raises as `done`."""
        return zlib.decompress(self.done(id_).packed).decode()

    def figures(self, id_: str) -> str:
        """The pictures of a diagnosis, as JSON. Raises as `done`."""
        return zlib.decompress(self.done(id_).packed_figures).decode()

    def machine(self, id_: str) -> str:
        """The machine file of a diagnosis. Raises as `done`, and ConflictError where nothing could be fitted."""
        job = self.done(id_)
        if job.machine is None:
            raise ConflictError(f"{self._kind} {job.id} has no machine file: nothing could be fitted")
        return job.machine

    def cancel(self, id_: str) -> Job:
        """End a diagnosis. Raises UnknownError; ConflictError where it has ended; UnavailableError."""
        job = self.one(id_)
        self._cancel(job)
        return self.one(job.id)

    def _file(self, id_: str) -> Path:
        """A recording in the folder. Raises UnknownError."""
        there = {path.stem: path for path in self._folder.glob("*.parquet")}
        if id_ == LATEST:
            newest_first = sorted(there.values(), key=lambda path: (path.stat().st_mtime, path.name), reverse=True)
            for path in newest_first:  # a stream's rows cover several control periods
                if notes_of(path).get("kind") != "stream":
                    return path
        if id_ not in there:
            raise UnknownError(f"no recording {shown(id_)} among the service's captures")
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

    def _work_on(self, id_: str, run: _Run) -> None:
        try:
            ended = self._ended(id_, run)
        except Exception as error:  # noqa: BLE001 - a fault of ours must not leave a diagnosis without an end
            why = f"the bench failed on it: {type(error).__name__}: {error}"
            ended = {"state": JobState.FAILED, "reason": why}
        with self._lock:
            if run.cancelled and ended["state"] is not JobState.DONE:
                ended = {"state": JobState.CANCELLED, "reason": "the service has ended" if self._ending else ""}
            self._end(id_, **ended)
            self._forget(_REMEMBERED)

    def _ended(self, id_: str, run: _Run) -> dict[str, Any]:
        """Wait its turn, and for its worker; how it went."""
        with self._lock:
            self._lock.wait_for(lambda: run.cancelled or run is next(iter(self._runs.values())))
            if run.cancelled:
                return {"state": JobState.CANCELLED}
        with Worker(self._work) as worker:
            with self._lock:
                run.worker = worker
                if run.cancelled:
                    worker.kill()
                self._change(id_, state=JobState.RUNNING)
            worker.begin(run.request)
            while isinstance(heard := worker.hear(), Progress):
                self._change(id_, progress=heard.share, phase=heard.phase)
            with self._lock:
                run.worker = None
        if isinstance(heard, Failed):
            return {"state": JobState.FAILED, "reason": heard.why}
        result: Result = heard.result
        return {
            "state": JobState.DONE, "progress": 1.0, "phase": "", "content": result.content, "machine": result.machine,
            "packed": zlib.compress((result.report or "").encode(), 1),
            "packed_figures": zlib.compress(result.figures.encode(), 1), "earlier": None,
        }


def _object(given: Mapping[str, Any], key: str) -> dict[str, object] | None:
    """A part of the body. Raises LimitError where it is no object."""
    value = given.get(key)
    if value is not None and not isinstance(value, dict):
        raise LimitError(f"{key}: expected an object, got {shown(value)}")
    return cast(dict[str, object] | None, value)
