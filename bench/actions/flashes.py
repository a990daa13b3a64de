"""The flashes of all drives: judged, done, and finished or rolled back where one was cut.

One at a time per drive, under the service's lease on it; journals and history are `bench.parameters`'. A flash is not
cancelled. Somebody's Stop goes before it: the drive's control is not taken again until that is over. Knows nothing of
HTTP.
"""

import contextlib
import threading
import time
from collections import Counter
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

from bench.actions.drive_jobs import BenchDrive, DriveJobs, Link, Step, id_at
from bench.actions.safety.lease import Leases, Part
from bench.actions.safety.unfinished import undo
from bench.errors import BenchError, LimitError, UnavailableError, shown
from bench.parameters import flash, journal
from bench.parameters.flash import Around, End, UnderWay, Verdict
from bench.parameters.journal import Begun, Past
from bench.parameters.parameter_set import ParameterSet
from bench.parameters.plan import Plan
from bench.parameters.told import changes_of
from drivers.drive import Drive, Identity
from drivers.errors import DriveError

_RENEWED: Final = 120.0  # s that the lease is taken for, anew with every step
_STOP: Final = 10.0  # s that somebody's Stop is waited for, at most
_BACK: Final = 5.0  # s that the link is waited for, which has ended with the reset
_RETRY: Final = 0.02  # s
_STEPS: Final = 5  # of a flash that goes well, with its end
_REASON: Final = 200  # characters


class Kind(StrEnum):
    """What is done."""

    FLASH = "flash"
    FINISH = "finish"  # one that was cut
    ROLL_BACK = "roll back"  # one that was cut


_WORDS: Final = {
    Kind.FLASH: "flash", Kind.FINISH: "finishing the flash", Kind.ROLL_BACK: "rolling back the flash",
}  # fmt: skip


class State(StrEnum):
    """Where it stands; all but the first are ends."""

    RUNNING = "running"
    FLASHED = "flashed"
    ROLLED_BACK = "rolled back"
    CUT = "cut"  # the drive has the values before or the new ones


@dataclass(frozen=True, slots=True)
class Status:
    """A flash at one moment."""

    id: str
    drive: str
    kind: Kind
    asked: datetime
    whom: str
    begun: Begun
    steps: tuple[Step, ...] = ()
    state: State = State.RUNNING
    progress: float = 0.0  # 0 to 1
    said: str = ""  # how it ended, a sentence
    ended: datetime | None = None
    file: Path | None = None  # it makes no recording

    @property
    def phase(self) -> str:
        """What is being done, in words; empty where it has ended."""
        return self.steps[-1].said if self.steps and self.state is State.RUNNING else ""

    @property
    def words(self) -> str:
        """Which one it is, as a sentence begins."""
        return f"{_WORDS[self.kind]} of {set_words(self.begun)}"


@dataclass(frozen=True, slots=True)
class Run:
    """A flash under way."""

    holder: str  # as it is named where it holds a lease
    given_up: threading.Event = field(default_factory=threading.Event)

    def cancel(self) -> None:
        """It ends by itself."""

    leave = cancel


Happened = Callable[[str, str], None]  # hears of a drive, by its name, what has become of a flash; does not wait


class Flashes(DriveJobs[Status, Run]):
    """Everything about flashes, until `leave`."""

    kind, remembered = "flash", 50

    def __init__(
        self, folder: Path, drives: Mapping[str, BenchDrive], leases: Leases,
        happened: Happened = lambda _drive, _said: None, undone: Happened = lambda _drive, _said: None,
    ) -> None:  # fmt: skip
        """`folder`: of the journals; `undone` hears what a bench before had left in a drive."""
        super().__init__(folder, drives, leases)
        self._happened, self._has_undone = happened, undone
        self._identities = dict[str, Identity]()  # of drives that have been connected
        self._told = dict[str, Begun | None]()  # by drive: the one that was cut of which it was told last
        self._stopping = Counter[str]()  # under the lock: so many are about to stop a drive

    def planned(self, drive: str, given: ParameterSet) -> Plan:
        """What a set would change. Raises ConflictError, DriveError."""
        return flash.planned(self._as_it_was(drive), given, self._around(drive))

    def planned_back(self, drive: str, since: str | None = None) -> Plan:
        """What would be changed back; `since` as of `ask_back`. Raises ConflictError, LimitError, DriveError."""
        link = self._as_it_was(drive)
        given = flash.before(self._folder, link().identity, since)
        return flash.planned(link, given, self._around(drive, judged=False))

    def present(self, drive: str, name: str) -> ParameterSet:
        """A drive's parameters as a set of this name. Raises ConflictError, DriveError."""
        return flash.pulled(self._as_it_was(drive)(), name)

    def ask(self, drive: str, given: ParameterSet, whom: str = "", reason: str = "") -> Status:
        """Have a set flashed; `reason`: why doubts do not forbid it. Raises BenchError, DriveError."""
        return self._begin(drive, Kind.FLASH, whom, reason, lambda link, around: flash.begin(link, given, around))

    def ask_back(self, drive: str, whom: str = "", since: str | None = None) -> Status:
        """Have the values before the latest flash, or the one whose time begins so, flashed.

        Limits do not judge them: the drive had them. Raises BenchError, DriveError.
        """

        def begin(link: Callable[[], Drive], around: Around) -> UnderWay:
            return flash.begin(link, flash.before(self._folder, link().identity, since), around)

        return self._begin(drive, Kind.FLASH, whom, "", begin, judged=False)

    def resume(self, drive: str, whom: str = "", *, finish: bool) -> Status:
        """Have one that was cut finished, or rolled back. Raises ConflictError, DriveError."""
        return self._begin(drive, Kind.FINISH if finish else Kind.ROLL_BACK, whom, "", flash.taken_up)

    @property
    def holders(self) -> set[str]:
        """Those under way, as they are named where they hold a lease."""
        with self._lock:
            return {run.holder for run in self._runs.values()}

    def connected(self, drive: str, identity: Identity) -> None:
        """A drive is there: whether a flash of it was cut is told once."""
        self._identities[drive] = identity
        left = self.cut(drive)
        if left is not None and self._told.get(drive) != left:
            self._happened(drive, cut_words(left))
        self._told[drive] = left

    def cut(self, drive: str) -> Begun | None:
        """A flash of a drive that was cut, here or at a command line; None where none was, as far as is known."""
        identity = self._identities.get(drive)
        if identity is None or not journal.is_there(self._folder, identity):
            return None
        with contextlib.suppress(BenchError, OSError):  # one is under way, or its journal cannot be read
            return flash.cut(identity, self._folder, 0.0)
        return None

    def past(self, drive: str) -> list[Past]:
        """All that was flashed and noted here, the newest first; empty until the drive was there. UnavailableError."""
        identity = self._identities.get(drive)
        return [] if identity is None else list(reversed(journal.past(self._folder, identity)))

    @contextmanager
    def stopping(self, *drives: str) -> Generator[None]:
        """While somebody stops drives, no flash takes their control."""
        with self._lock:
            self._stopping.update(drives)
        try:
            yield
        finally:
            with self._lock:
                self._stopping.subtract(drives)
                self._lock.notify_all()

    def join(self, timeout: float) -> None:
        """Wait for their end, at most so many seconds; after that none waits for its drive any more."""
        super().join(timeout)
        with self._lock:
            for run in self._runs.values():
                run.given_up.set()

    def _begin(
        self, drive: str, kind: Kind, whom: str, reason: str, begin: Callable[[Callable[[], Drive], Around], UnderWay],
        *, judged: bool = True,
    ) -> Status:  # fmt: skip
        """Judged here, done by a thread."""
        if len(reason) > _REASON or not reason.isprintable():
            raise LimitError(f"override: expected a reason of up to {_REASON} characters, got {shown(reason)}")
        if self._ending:
            raise UnavailableError("the service is ending")
        link, asked = self._as_it_was(drive), datetime.now(UTC)
        id_ = id_at(f"{drive}-flash", asked)
        run = Run(f"flash {id_}" + (f" (asked for from {whom})" if whom else ""))
        self._leases.take(drive, run.holder, _RENEWED, *Part)
        try:
            one = begin(link, self._around(drive, whom, reason, (id_, run), judged=judged))
        except BaseException:
            self._leases.release(drive, run.holder, "refused")
            raise
        status = Status(id_, drive, kind, asked, whom, one.begun)
        with self._lock:
            if self._ending:
                one.withdraw()
                self._leases.release(drive, run.holder, "the service is ending")
                raise UnavailableError("the service is ending")
            self._happened(drive, f"{status.words}, {_asked_words(status)}")
            self._put(status, run, lambda: self._done(status, run, one))
        return status

    def _as_it_was(self, drive: str) -> Callable[[], Drive]:
        """A drive's link, once all is undone that a bench before had left in it. Raises ConflictError, DriveError."""
        link = self._drives[drive].link.drive
        found = link()
        if self._leases.writer(drive) is None:  # else the note is of this service's own control
            self._has_undone(drive, undo(self._folder, found))
        return link

    def _around(
        self, drive: str, whom: str = "", reason: str = "", of: tuple[str, Run] | None = None, *, judged: bool = True
    ) -> Around:
        """`of`: of which flash, where it is not only planned."""
        around = Around(self._folder, drive, whom, reason)
        if judged:
            around = replace(around, judge=self._drives[drive].limits.problems)
        if of is None:
            return around
        id_, run = of

        def tell(said: str) -> None:
            self._leases.take(drive, run.holder, _RENEWED, *Part)
            self._step(id_, said)

        return replace(around, tell=tell, given_up=run.given_up.is_set, yield_=lambda: self._yield(drive))

    def _step(self, id_: str, said: str) -> None:
        with self._lock:
            before = self._known[id_]
            share = min((len(before.steps) + 1) / _STEPS, 1.0 - 1.0 / _STEPS)
            self._change(id_, steps=(*before.steps, Step(datetime.now(UTC), said)), progress=share)

    def _yield(self, drive: str) -> None:
        with self._lock:
            self._lock.wait_for(lambda: self._stopping[drive] <= 0, _STOP)

    def _done(self, status: Status, run: Run, one: UnderWay) -> None:
        """Do it; how it went is known then, and the drive can be asked again."""
        link = self._drives[status.drive].link
        try:
            before = link.drive()
        except DriveError:
            before = None
        try:
            verdict = one.back("it was cut") if status.kind is Kind.ROLL_BACK else one.forward()
        except Exception as error:  # noqa: BLE001 - a fault of ours must not leave a flash without an end
            why = f"the bench failed on this flash: {type(error).__name__}: {error}"
            verdict = Verdict(End.CUT, 0, f"{why}; it has to be finished or rolled back")
        state = State(verdict.end.value)
        if before is not None and state is not State.CUT and one.was_reset:
            _await_another(link, before, run.given_up)
        self._leases.release(status.drive, run.holder, state)
        share: dict[str, Any] = {} if state is State.CUT else {"progress": 1.0}
        with self._lock:  # who waits for its end finds it told
            self._told[status.drive] = one.begun if state is State.CUT else None
            self._happened(status.drive, f"{status.words}: {state}: {verdict.said}")
            self._end(status.id, state=state, said=verdict.said, ended=datetime.now(UTC), **share)


def set_words(begun: Begun) -> str:
    """Which set, in words."""
    return f"{begun.name!r}, version {begun.version}"


def cut_words(begun: Begun) -> str:
    """That a flash was cut, a sentence."""
    return (
        f"a flash of {set_words(begun)} was cut, since {begun.since[:19].replace('T', ' ')}Z: it has to be finished or "
        "rolled back"
    )


def _await_another(link: Link, before: Drive, given_up: threading.Event) -> None:
    """The link that has ended with a reset is there again, as another connection."""
    deadline = time.monotonic() + _BACK
    while time.monotonic() < deadline and not given_up.is_set():
        with contextlib.suppress(DriveError):
            if link.drive() is not before:
                return
        given_up.wait(_RETRY)


def _asked_words(status: Status) -> str:
    reason = f", with the reason {status.begun.override!r}" if status.begun.override else ""
    whom = f"asked for from {status.whom}" if status.whom else "asked for"
    changed = len(changes_of(status.begun))
    return f"{whom}{reason}: {flash.values_words(changed)} to change"
