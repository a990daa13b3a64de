"""Diagnoses of the service's recordings: asked for, worked on one at a time in a process, watched, cancelled, kept.

The process lives as long as its job; nothing of the service waits for it. One that has ended is on disk, see
`bench.store.diagnoses`, unless the disk does not take it: then the last twenty such are known until the service ends.
Of one recording there may be several. Knows nothing of HTTP.
"""

import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from enum import StrEnum
from importlib import metadata
from pathlib import Path
from typing import Any, Final, NoReturn, Self, cast

from bench.diagnoses.diagnosis_request import WORK, Request, Result, check_whole, checked_trust, json_text
from bench.diagnoses.worker import Failed, Progress, Worker
from bench.errors import ConfigError, ConflictError, LimitError, RecordingError, UnavailableError, UnknownError, shown
from bench.jobs import LATEST, Jobs
from bench.machine_file import Nominal, nominal_of, toml_of
from bench.recordings.recording import check_every_period, periods_said
from bench.recordings.table import notes
from bench.store.closing import notes_of
from bench.store.diagnoses import Diagnoses, Heading
from bench.witness import from_table, text_of

WAITING: Final = 10  # diagnoses
RESULT, FIGURES, REPORT, MACHINE = "result.json", "figures.json", "report.html", "machine.toml"
"""Files of a diagnosis, by name."""
_TAKEN: Final = ("trust", "nominal", "witness")  # what a body may have
_FILE: Final = "nominal, a machine file's text"
_REMEMBERED: Final = 20  # diagnoses that could not be kept on disk, each with its report
_MADE_WITH: Final = ("pmsm-bench", "numpy", "scipy", "numba")


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

    id: str
    recording: str  # id
    drive: str  # that made it; empty where the recording does not say
    asked: datetime
    request: Mapping[str, Any]  # trust, nominal and witness, as they are asked for
    state: JobState = JobState.QUEUED
    started: datetime | None = None
    ended: datetime | None = None
    progress: float = 0.0  # 0 to 1
    phase: str = ""  # what is being done, in words
    reason: str = ""  # why it failed
    verdict: str | None = None  # once it is done
    sentence: str | None = None
    lost: str = ""  # why it is not kept on disk, a sentence; empty: it is, or has not ended
    files: Mapping[str, bytes] = field(default_factory=dict[str, bytes])  # of one that is not kept on disk

    @classmethod
    def of(cls, kept: Heading) -> Self:
        """One that is on disk."""
        return cls(
            kept.id, kept.recording, kept.drive, kept.asked, kept.request, JobState(kept.state), kept.started,
            kept.ended, float(kept.state == JobState.DONE), "", kept.reason, kept.verdict, kept.sentence,
        )  # fmt: skip

    @property
    def heading(self) -> Heading:
        """As it is kept on disk, once it has ended."""
        assert self.ended is not None, "it has"
        versions = {name: metadata.version(name) for name in _MADE_WITH} | {"python": platform.python_version()}
        return Heading(
            self.id, self.recording, self.drive, self.asked, self.started, self.ended, self.state.value, self.reason,
            self.verdict, self.sentence, dict(self.request), versions,
        )  # fmt: skip


@dataclass(slots=True, eq=False)
class _Run:
    """A diagnosis that has not ended, and who works on it."""

    request: Request
    recording: str
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

    def __init__(
        self, folder: Path, nominals: Mapping[str, Nominal], work: str = WORK, kept: Diagnoses | None = None
    ) -> None:
        """`folder` has the recordings; `nominals`, by drive, are for those that say whose they are.

        `kept`: those on disk; by default in the folder of the recordings.
        """
        super().__init__("diagnosis")
        self._folder, self._nominals, self._work = folder.absolute(), nominals, work
        self._kept = kept or Diagnoses(folder)

    def start(self) -> None:
        """Clear away what a service before this one had not written whole."""
        self._kept.tidy()

    def ask(self, recording: str, given: Mapping[str, Any]) -> Job:
        """Have a recording diagnosed. Raises UnknownError, LimitError, ConflictError, UnavailableError."""
        file = self._file(recording)
        recording = file.stem
        request = self._request(file, given)
        asked_for = {
            "trust": dict(request.trust), "nominal": request.nominal.tables,
            "witness": {name: text_of(one) for name, one in request.witnesses.items()},
        }  # fmt: skip
        drive = str(notes_of(file).get("drive", ""))
        with self._lock:
            if self._ending:
                raise UnavailableError("the service is ending")
            if any(run.recording == recording for run in self._runs.values()):
                raise ConflictError(
                    f"recording {recording} is being diagnosed, expected it to have ended or been cancelled"
                )
            if len(self._runs) > WAITING:
                raise UnavailableError(f"{WAITING} diagnoses are waiting, expected fewer before another one")
            id_, asked = self._free_id(datetime.now(UTC))
            job, run = Job(id_, recording, drive, asked, asked_for), _Run(request, recording)
            self._put(job, run, lambda: self._work_on(id_, run))
            return job

    def all(self) -> list[Job]:
        """All that are under way, or have ended and not been deleted; the newest first."""
        with self._lock:
            here = dict(self._known)
        every = {kept.id: Job.of(kept) for kept in self._kept.all()} | here  # under way until its run has ended
        return _newest_first(every.values())

    def named(self, id_: str) -> Job:
        """A diagnosis by its id, or `latest`. Raises UnknownError."""
        if id_ == LATEST and (every := self.all()):
            return _latest(every)
        with self._lock:
            job = self._known.get(id_)
        return Job.of(self._kept.one(id_)) if job is None else job

    def one(self, recording: str) -> Job:
        """The latest diagnosis of a recording. Raises UnknownError."""
        return _latest(self._of(recording))

    def done(self, recording: str) -> Job:
        """A recording's latest diagnosis that was done. Raises UnknownError; ConflictError while none is."""
        every = self._of(recording)
        return next((job for job in every if job.state is JobState.DONE), None) or self._without_result(_latest(every))

    def file(self, job: Job, name: str) -> bytes:
        """A file of a diagnosis, `RESULT`, `FIGURES`, `REPORT` or `MACHINE`.

        Raises UnknownError where it was deleted, ConflictError where it has none, UnavailableError.
        """
        if job.state is not JobState.DONE:
            self._without_result(job)
        try:
            content = job.files.get(name) if job.lost else self._kept.file(job.id, name)
        except RecordingError as error:
            raise UnavailableError(str(error)) from None
        if content is None:
            why = ": nothing could be fitted" if name == MACHINE else ""
            raise ConflictError(f"{_named(job)} has no {name}{why}")
        return content

    def has_recording(self, job: Job) -> bool:
        """Whether what it is of has not been deleted since."""
        return (self._folder / f"{job.recording}.parquet").is_file()

    def cancel(self, recording: str) -> Job:
        """End the latest diagnosis of a recording. Raises UnknownError; ConflictError where it has ended;
        UnavailableError.
        """
        job = self.one(recording)
        self._cancel(job)
        return self.named(job.id)

    def remove(self, id_: str) -> Job:
        """End one that is under way; delete one that has ended. Tells what it is then, or was.

        Raises UnknownError, UnavailableError.
        """
        if id_ == LATEST:
            raise UnknownError("expected the id of the diagnosis that is to be deleted, got latest")
        job = self.named(id_)
        if not job.state.ended:
            try:
                self._cancel(job)
                return self.named(id_)
            except ConflictError:  # it has just ended
                job = self.named(id_)
        if not job.lost:
            try:
                self._kept.delete(id_)
            except OSError as error:
                raise UnavailableError(f"{_named(job)} cannot be deleted: {error.strerror or error}") from None
        with self._lock:
            self._known.pop(id_, None)
        return job

    def _of(self, recording: str) -> list[Job]:
        """The diagnoses of a recording, the newest first. Raises UnknownError where there is none."""
        recording = self._file(recording).stem if recording == LATEST else recording
        with self._lock:
            here = {id_: job for id_, job in self._known.items() if job.recording == recording}
        found = {kept.id: Job.of(kept) for kept in self._kept.all() if kept.recording == recording} | here
        if not found:
            raise UnknownError(f"no diagnosis of a recording {shown(recording)}")
        return _newest_first(found.values())

    def _without_result(self, job: Job) -> NoReturn:
        why = f": {job.reason}" if job.reason else ""
        raise ConflictError(f"{_named(job)} is {job.state}{why}, there is no result")

    def _free_id(self, asked: datetime) -> tuple[str, datetime]:
        """Under the lock: an id that no other has, and when it was asked for by that."""
        while True:
            id_ = f"{asked:%Y%m%d-%H%M%S}-{asked.microsecond // 1000:03d}"
            if id_ not in self._known and not self._kept.has(id_):
                return id_, asked
            asked += timedelta(milliseconds=1)

    def _file(self, id_: str) -> Path:
        """A recording in the folder. Raises UnknownError."""
        there = {path.stem: path for path in self._folder.glob("*.parquet")}
        if id_ == LATEST:
            newest_first = sorted(there.values(), key=lambda path: (path.stat().st_mtime, path.name), reverse=True)
            for path in newest_first:
                if _periods(path) <= 1:
                    return path
        if id_ not in there:
            raise UnknownError(f"no recording {shown(id_)} among the service's captures")
        return there[id_]

    def _request(self, file: Path, given: Mapping[str, Any]) -> Request:
        """Raises LimitError."""
        for key in given:
            if key not in _TAKEN:
                raise LimitError(f"a diagnosis takes trust, nominal and witness, got {shown(key)}")
        try:
            text = given.get("nominal")
            given = {**given, "nominal": toml_of(text, _FILE)} if isinstance(text, str) else given
            trust, nominal, witness = (_object(given, key) for key in _TAKEN)
            check_every_period(Path(file.stem), _periods(file))
            known = self._nominal(file) if nominal is None else nominal_of(nominal, "nominal")
            check_whole(known)
            witnesses = {**known.witnesses, **from_table(witness or {}, "witness")}
            return Request(file, known, checked_trust(trust or {}), report=True, witnesses=witnesses)
        except (ConfigError, RecordingError) as error:
            raise LimitError(str(error)) from None

    def _nominal(self, file: Path) -> Nominal:
        """What is known of the drive that made a recording."""
        return self._nominals.get(str(notes(file).get("drive")), Nominal({}))

    def _work_on(self, id_: str, run: _Run) -> None:
        files: dict[str, bytes] = {}
        try:
            ended, files = self._ended(id_, run)
        except Exception as error:  # noqa: BLE001 - a fault of ours must not leave a diagnosis without an end
            why = f"the bench failed on it: {type(error).__name__}: {error}"
            ended = {"state": JobState.FAILED, "reason": why}
        with self._lock:
            if run.cancelled and ended["state"] is not JobState.DONE:
                ended = {"state": JobState.CANCELLED, "reason": "the service has ended" if self._ending else ""}
            job = replace(self._known[id_], ended=datetime.now(UTC), phase="", **ended)
        lost = self._put_on_disk(job, files)
        with self._lock:
            self._end(id_, ended=job.ended, phase="", lost=lost, files=files if lost else {}, **ended)
            if not lost:  # from here on it is told as it is on disk
                del self._known[id_]
            self._forget(_REMEMBERED)

    def _put_on_disk(self, job: Job, files: Mapping[str, bytes]) -> str:
        """Keep one that has ended; why it cannot be, a sentence, empty where it is."""
        try:
            self._kept.keep(job.heading, files)
        except OSError as error:
            why = error.strerror or error
            return f"it could not be kept on disk, and is gone when the service ends: {why}"
        return ""

    def _ended(self, id_: str, run: _Run) -> tuple[dict[str, Any], dict[str, bytes]]:
        """Wait its turn, and for its worker; how it went, and its files."""
        with self._lock:
            self._lock.wait_for(lambda: run.cancelled or run is next(iter(self._runs.values())))
            if run.cancelled:
                return {"state": JobState.CANCELLED}, {}
        with Worker(self._work) as worker:
            with self._lock:
                run.worker = worker
                if run.cancelled:
                    worker.kill()
                self._change(id_, state=JobState.RUNNING, started=datetime.now(UTC))
            worker.begin(run.request)
            while isinstance(heard := worker.hear(), Progress):
                self._change(id_, progress=heard.share, phase=heard.phase)
            with self._lock:
                run.worker = None
        if isinstance(heard, Failed):
            return {"state": JobState.FAILED, "reason": heard.why}, {}
        result: Result = heard.result
        said = {key: result.content.get(key) for key in ("verdict", "sentence")}
        return {"state": JobState.DONE, "progress": 1.0, **said}, _files(result)


def _periods(file: Path) -> float:
    """Control periods that a row covers; 1 where the file cannot be read, which a diagnosis of it says."""
    try:
        return periods_said(file)
    except (RecordingError, OSError):
        return 1.0


def _files(result: Result) -> dict[str, bytes]:
    """What is kept of a result, by name; what it does not have is left out."""
    made = {
        RESULT: json_text(result.content), FIGURES: result.figures, REPORT: result.report, MACHINE: result.machine,
    }
    return {name: text.encode() for name, text in made.items() if text is not None}


def _newest_first(jobs: Iterable[Job]) -> list[Job]:
    return sorted(jobs, key=lambda job: (job.asked, job.id), reverse=True)


def _latest(newest_first: Sequence[Job]) -> Job:
    """One that has not ended goes before those that have."""
    return min(newest_first, key=lambda job: job.state.ended)


def _named(job: Job) -> str:
    """As a sentence names it."""
    return f"diagnosis {job.id} of {job.recording}"


def _object(given: Mapping[str, Any], key: str) -> dict[str, object] | None:
    """A part of the body. Raises LimitError where it is no object."""
    value = given.get(key)
    if value is not None and not isinstance(value, dict):
        raise LimitError(f"{key}: expected an object, got {shown(value)}")
    return cast(dict[str, object] | None, value)
