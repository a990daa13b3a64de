"""Jobs on drives, such as captures and experiments: each by drive and id, their files handed out, and taken up again.

Knows nothing of what they do, and of HTTP.
"""

import contextlib
import math
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Final, Protocol, TypeVar

from bench.actions.safety.lease import Leases
from bench.actions.safety.limits import Limits
from bench.errors import BenchError, ConflictError, RecordingError, UnavailableError, UnknownError, shown
from bench.files import check_place
from bench.jobs import LATEST, JobRun, Jobs, JobStatus
from bench.machine_file import Nominal
from bench.store.catalogue.ended import EndedJob
from bench.store.shelf import Recording
from drivers.drive import Drive
from drivers.errors import DriveError
from drivers.wire.dictionary import CONTROL, signal_at

_BETWEEN: Final = 2e-3  # s between two parameters that are read
_CONTROL: Final = signal_at(*CONTROL)
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


class DriveJobStatus(JobStatus, Protocol):
    """A job on a drive at one moment."""

    @property
    def drive(self) -> str:
        """The drive's name."""
        ...

    @property
    def asked(self) -> datetime:
        """When it was asked for."""
        ...

    @property
    def file(self) -> Path | None:
        """The recording, as far as there is one."""
        ...


@dataclass(frozen=True, slots=True)
class Step:
    """Something that has begun."""

    at: datetime
    said: str  # in words


Ended = Callable[[EndedJob], None]  # hears of a job that has ended; does not wait
S = TypeVar("S", bound=DriveJobStatus)
R = TypeVar("R", bound=JobRun)
T = TypeVar("T")


class DriveJobs(Jobs[S, R]):
    """The jobs of one kind, of all drives; what is known of the latest is kept."""

    kind: str  # in a word
    remembered: int  # jobs, of all drives

    def __init__(
        self, folder: Path, drives: Mapping[str, BenchDrive], leases: Leases, on_end: Ended = lambda _: None
    ) -> None:
        """`folder`: of their recordings; `on_end` hears of each that has ended."""
        super().__init__(self.kind)
        self._folder, self._on_end = folder.absolute(), on_end
        self.on_begin: Callable[[str, str], None] = lambda _drive, _what: None  # hears of each; does not wait
        self._drives, self._leases = drives, leases

    def all(self, drive: str) -> list[S]:
        """A drive's jobs, as far as they are known, the newest first."""
        with self._lock:
            return [status for status in reversed(self._known.values()) if status.drive == drive]

    def remember(self, past: Iterable[S]) -> None:
        """Know jobs of a service before this one, that have ended; those that are known stay as they are."""
        with self._lock:
            every = {status.id: status for status in past if status.drive in self._drives} | self._known
            self._known = dict(sorted(every.items(), key=lambda item: item[1].asked))
            self._forget(self.remembered)

    def unknown(self, recordings: Iterable[Recording]) -> list[Recording]:
        """Of recordings, the newest that jobs of this kind have made and that are not known by these."""
        made = [one for one in recordings if one.kind == self._kind and one.drive in self._drives]
        made.sort(key=lambda one: one.begun, reverse=True)
        with self._lock:
            files = {status.file for status in self._known.values()}
        return [one for one in made[: self.remembered] if one.path not in files]

    def latest(self, drive: str) -> S | None:
        """A drive's newest job, one under way before those that have ended; None where there was none."""
        with self._lock:
            live = set(self._runs)
        return min(self.all(drive), key=lambda status: status.id not in live, default=None)

    def one(self, drive: str, id_: str) -> S:
        """A job by its id, or `latest`. Raises UnknownError."""
        latest = self.latest(drive)
        if id_ == LATEST and latest is not None:
            return latest
        if (found := next((status for status in self.all(drive) if status.id == id_), None)) is not None:
            return found
        there = f"the latest is {latest.id}" if latest is not None else "there is none"
        raise UnknownError(f"drive {drive} has no {self._kind} {shown(id_)}; {there}")

    def cancel(self, drive: str, id_: str) -> S:
        """End a job that is under way. Raises as `one`, and ConflictError, UnavailableError."""
        status = self.one(drive, id_)
        self._cancel(status)
        return self.one(drive, status.id)

    def file(self, drive: str, id_: str) -> Path:
        """The recording of a job. Raises as `one`, and ConflictError where there is none."""
        status = self.one(drive, id_)
        if status.file is None or not status.file.is_file():
            why = f": {status.file.name} is no longer there" if status.file is not None else f", it is {status.state}"
            raise ConflictError(f"{self._kind} {status.id} has no recording{why}")
        return status.file

    # --- for who makes jobs

    def _know(self, status: S) -> None:
        with self._lock:
            self._known[status.id] = status

    def _put(self, status: S, run: R, work: Callable[[], None]) -> None:
        super()._put(status, run, work)
        self.on_begin(status.drive, f"{self._kind} {status.id}")
        self._forget(self.remembered - len(self._runs))

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


def sensible(make: Callable[[T], S], given: Iterable[T]) -> Iterator[S]:
    """What is made of each, but of what makes no sense."""
    for one in given:
        with contextlib.suppress(BenchError, OSError, ValueError, LookupError, TypeError):
            yield make(one)


def ended_words(state: str, reason: str) -> str:
    """How a job ended."""
    return f"{state}: {reason}" if reason else str(state)


def parameters_of(drive: Drive, ended: Callable[[], bool]) -> dict[str, float | None]:
    """The drive's own settings but its tables, SI, as far as they can be read, until it is to end; None: not finite.

    On a line that it shares with the stream: this takes a while.
    """
    values: dict[str, float | None] = {}
    for signal in drive.identity.signals:
        if ended():
            break
        if signal.is_parameter and not signal.table and signal != _CONTROL:
            time.sleep(_BETWEEN)
            with contextlib.suppress(DriveError):
                value = drive.read(signal.name)
                values[signal.name] = value if math.isfinite(value) else None
    return values


def id_at(named: str, asked: datetime) -> str:
    """The id of a job by what it is named after, its drive's name first, and when it was asked for."""
    return f"{named}-{asked:%Y%m%d-%H%M%S}-{asked.microsecond // 1000:03d}"
