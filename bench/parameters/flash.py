"""A flash is a transaction: the drive ends with the new values in its memory, read back after a reset, or as it was.

    plan -> control lease, bridge off -> image kept -> write -> read back -> store -> reset -> read again -> verdict

Memory is written only while all that is read back is as wanted, and by the drive page by page: it holds the values
before or the new ones, whatever happens. Anything but equality is rolled back to the image, and that is verified. What
cuts the bench itself is in the `journal`: `resume` finishes or rolls back. Knows nothing of services and HTTP.
"""

import contextlib
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from enum import StrEnum
from itertools import islice
from pathlib import Path
from typing import Final

from bench.errors import BenchError, ConflictError, LimitError, UnavailableError
from bench.parameters.journal import CUT, Begun, Journal, Step, done, past
from bench.parameters.parameter_set import FLASHED, LONGEST_NAME, ParameterSet, problem_of, set_of
from bench.parameters.plan import Judge, Plan, different, plan
from bench.parameters.versions import remarks_on, some_of
from drivers import operation
from drivers.drive import Drive, Identity
from drivers.errors import DriveError, FrameError, LostError, NoReplyError
from drivers.lease import HeldError, Lease
from drivers.wire.cia402 import State
from drivers.wire.lease import MOST_VALUES
from drivers.wire.memory import MemoryState

PATIENCE: Final = 30.0  # s in which a drive is to be there again, to be rolled back
_RETRY: Final = 0.1  # s
_YIELDED: Final = 0.3  # s without control, for who has ended it by a stop to see that it has
_UNREASONED: Final = "expected a reason why these are flashed all the same, got none"
_NAMES: Final = frozenset(signal.name for signal in FLASHED)

Link = Callable[[], Drive]
Tell = Callable[[str], None]


class End(StrEnum):
    """How a flash ended."""

    FLASHED = "flashed"
    ROLLED_BACK = "rolled back"
    CUT = "cut"  # the drive is not to be had: it has the values before or the new ones, and the journal stays


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of it."""

    end: End
    changed: int  # values
    said: str  # a sentence


@dataclass(frozen=True, slots=True)
class Around:
    """What a flash is done for, and where it is noted."""

    folder: Path  # of journals
    drive: str  # its name, or URL
    whom: str = ""
    override: str = ""  # why doubts do not forbid it
    judge: Judge = lambda _values, _changed: []
    tell: Tell = lambda _: None  # hears of each step
    planned: Callable[[Plan], object] = lambda _: None  # hears what it will do, before it is done
    yield_: Callable[[], object] = lambda: None  # called before control is taken again: others may go first
    given_up: Callable[[], bool] = lambda: False  # nobody waits for it any more, and no link will come back
    patience: float = PATIENCE


class DifferentError(DriveError):
    """The drive has other values than it was given."""


def parameters(drive: Drive) -> dict[str, float]:
    """All that a set may hold, as the drive has it now, SI. Raises DriveError."""
    return {name: value for name, value in drive.parameters().items() if name in _NAMES}


def pulled(drive: Drive, name: str) -> ParameterSet:
    """All of them as a set of this drive. Raises DriveError."""
    return set_of(parameters(drive), name, "", layout_id=drive.identity.layout_id, serial=drive.identity.serial)


def before(folder: Path, identity: Identity, since: str | None = None) -> ParameterSet:
    """What a drive had before the latest flash that was done, or the one whose time begins so. Raises as `done`."""
    one = done(folder, identity, since)
    values = {name: value for name, value in one.image.items() if not problem_of(name, value)}
    return set_of(values, f"before {one.name}"[:LONGEST_NAME], f"of {one.since[:19]}Z")


def planned(link: Link, given: ParameterSet, around: Around) -> Plan:
    """What it would do. Raises DriveError."""
    drive = link()
    return _plan(given, drive.identity, parameters(drive), around)


def _plan(given: ParameterSet, identity: Identity, present: Mapping[str, float], around: Around) -> Plan:
    """With what the history says of it."""
    to_do = plan(given, identity, present, around.judge)
    return replace(to_do, remarks=remarks_on(given, present, past(around.folder, identity)))


def flash(link: Link, given: ParameterSet, around: Around) -> Verdict:
    """Do it. Raises as `begin`."""
    return begin(link, given, around).forward()


def resume(link: Link, around: Around, *, finish: bool) -> Verdict:
    """Finish a flash that was cut, or roll it back. Raises as `taken_up`."""
    one = taken_up(link, around)
    return one.forward() if finish else one.back("it was cut")


def begin(link: Link, given: ParameterSet, around: Around) -> "UnderWay":
    """Judge it, and take what it needs: the drive's control lease, an image, a journal. Nothing is written yet.

    Raises LimitError, ConflictError, UnavailableError, DriveError.
    """
    drive = link()
    if (left := Journal.found(around.folder, drive.identity)) is not None:
        left.close()
        raise ConflictError(CUT)
    if not drive.identity.has_memory:
        raise LimitError("\n".join(plan(given, drive.identity, {}).problems))
    _check_off(drive)
    with _control(link) as lease:
        image = parameters(drive)
        to_do = _plan(given, drive.identity, image, around)
        check(to_do, around.override)
        around.planned(to_do)
        since = datetime.now(UTC).isoformat()
        begun = Begun(
            around.drive, given.name, given.version, around.whom, since, image, image | to_do.values, around.override
        )
        return UnderWay(link, lease, Journal.begin(around.folder, drive.identity, begun), around, image)


def check(to_do: Plan, override: str) -> None:
    """Raise LimitError, with all that forbids it."""
    if to_do.problems:
        raise LimitError("\n".join(to_do.problems))
    if to_do.doubts and not override:
        raise LimitError("\n".join((*to_do.doubts, _UNREASONED)))


def cut(identity: Identity, folder: Path, patience: float = 0.5) -> Begun | None:
    """A flash of this drive that was cut; None where there is none. Raises ConflictError where one is under way."""
    journal = Journal.found(folder, identity, patience)
    if journal is None:
        return None
    journal.close()
    return journal.begun


def taken_up(link: Link, around: Around) -> "UnderWay":
    """One that was cut, and what it needs. Raises as `begin`, and ConflictError where none was."""
    drive = link()
    journal = Journal.found(around.folder, drive.identity)
    if journal is None:
        raise ConflictError("no flash of this drive was cut")
    with contextlib.ExitStack() as otherwise:
        otherwise.callback(journal.close)
        _check_off(drive)
        with _control(link) as lease:
            otherwise.pop_all()
            return UnderWay(link, lease, journal, around)


class UnderWay:
    """A flash that has the drive's control lease and its journal; `forward` or `back` ends it, and gives both up."""

    def __init__(
        self, link: Link, lease: Lease, journal: Journal, around: Around, present: Mapping[str, float] | None = None
    ) -> None:
        """`present`: all parameters as the drive has them now, where they are known."""
        self._link, self._lease, self._journal, self._around, self._present = link, lease, journal, around, present
        self.was_reset = False  # with which links to the drive end

    @property
    def begun(self) -> Begun:
        """What it is to do."""
        return self._journal.begun

    def forward(self) -> Verdict:
        """From the values that the drive has now to the wanted ones; to the image where that does not come out."""
        with self._given_up():
            return self._forward()

    def back(self, why: str) -> Verdict:
        """To the image."""
        with self._given_up():
            return self._back(why, stored=True)

    def withdraw(self) -> None:
        """Nothing has been done: it is as if it had not begun; one that was taken up stays to be."""
        with self._given_up():
            self._journal.withdraw()

    def _forward(self) -> Verdict:
        begun, stored = self.begun, False
        changed = len(different(begun.wanted, begun.image))
        try:
            self._journal.note(Step.WRITE)
            self._around.tell(f"writing {values_words(changed)}")
            self._written(self._link(), begun.wanted, self._present)
            self._journal.note(Step.STORE)
            self._around.tell("storing")
            stored = True
            self._stored_and_read(begun.wanted)
            said = f"{values_words(changed)} changed, stored, and read back after a reset"
            self._journal.end(Step.DONE, said)
        except (DriveError, BenchError) as error:
            if isinstance(error, HeldError):
                time.sleep(_YIELDED)
            return self._back(str(error), stored=stored)
        return Verdict(End.FLASHED, changed, said)

    def _back(self, why: str, *, stored: bool) -> Verdict:
        """Also in memory, where that may hold the new values. As long as it takes, within patience."""
        deadline, image = time.monotonic() + self._around.patience, self.begun.image
        with contextlib.suppress(UnavailableError):  # the drive comes first
            self._journal.note(Step.ROLL_BACK, why=why)
        self._around.tell(f"rolling back: {why}")
        while True:
            try:
                drive = self._link()
                _off(drive)
                self._written(drive, image)
                if stored:
                    self._stored_and_read(image)
                said = f"{why}; the drive has all values as before, which was read back"
                self._journal.end(Step.ROLLED_BACK, said)
            except (DriveError, BenchError) as error:
                if time.monotonic() > deadline or self._around.given_up():
                    said = (
                        f"{why}; it could not be rolled back ({error}): the drive's memory holds the values before or "
                        "the new ones, `pmsm-bench params resume` finishes or rolls back"
                    )
                    return Verdict(End.CUT, 0, said)
                time.sleep(_RETRY)
            else:
                return Verdict(End.ROLLED_BACK, 0, said)

    def _written(self, drive: Drive, wanted: Mapping[str, float], present: Mapping[str, float] | None = None) -> None:
        """Written where it is not so, and read back. Raises DifferentError, DriveError."""
        names = iter(different(wanted, parameters(drive) if present is None else present))
        self._take(drive)
        while part := {name: wanted[name] for name in islice(names, MOST_VALUES)}:
            self._lease.write(drive, part)
        _check_same(wanted, parameters(drive), "after it was written")

    def _stored_and_read(self, wanted: Mapping[str, float]) -> None:
        """Stored, the drive reset, and all of it read again. Raises DifferentError, DriveError, UnavailableError."""
        drive, lease = self._link(), self._lease
        self._take(drive)
        operation.store(drive, lambda name, value: lease.write(drive, {name: value}))
        self._journal.note(Step.RESET)
        self._around.tell("resetting")
        self._take(drive)
        self.was_reset = True
        operation.reset(self._link, lambda name, value: lease.write(drive, {name: value}))
        self._journal.note(Step.VERIFY)
        self._around.tell("reading back")
        found, state = self._read_again()
        _check_same(wanted, found, "after a reset")
        if state is not MemoryState.NEWEST:
            raise DifferentError(f"the drive does not run what was stored: its parameters are {state.words}")

    def _read_again(self) -> tuple[dict[str, float], MemoryState]:
        """All of it after a reset, once the link that has ended with the reset is back. Raises DriveError."""
        deadline = time.monotonic() + operation.BOOT
        while True:
            try:
                drive = self._link()
                self._take(drive)
                return parameters(drive), _memory_state(drive)
            except (LostError, NoReplyError):
                if time.monotonic() > deadline or self._around.given_up():
                    raise
                time.sleep(_RETRY)

    def _take(self, drive: Drive) -> None:
        self._around.yield_()
        self._lease.take(drive)

    @contextmanager
    def _given_up(self) -> Generator[None]:
        """At the end; control as far as the drive is to be had, else it ends by itself."""
        try:
            yield
        finally:
            self._journal.close()
            with contextlib.suppress(DriveError):
                self._lease.release(self._link())


def values_words(count: int) -> str:
    """So many, in words."""
    return "1 value" if count == 1 else f"{count} values"


def _check_same(wanted: Mapping[str, float], found: Mapping[str, float], when: str) -> None:
    names = different(wanted, found)
    if not names:
        return
    told = some_of([f"{name} = {found.get(name)!r} (wanted {wanted[name]!r})" for name in names])
    raise DifferentError(f"the drive has other values {when}: {told}")


def _memory_state(drive: Drive) -> MemoryState:
    told = drive.read("memory_state")
    try:
        return MemoryState(int(told))
    except ValueError:
        raise FrameError(f"expected a memory_state of 0 to {max(MemoryState)}, got {told:g}") from None


def _check_off(drive: Drive) -> None:
    if operation.state(drive) is State.OPERATION_ENABLED:
        raise ConflictError("the drive is on: it is flashed with its bridge off, stop it first")


def _off(drive: Drive) -> None:
    """Somebody may have started it meanwhile: it is not written to then. Raises NoReplyError."""
    if operation.state(drive) is State.OPERATION_ENABLED:
        raise NoReplyError("the drive has been started by somebody meanwhile")


@contextmanager
def _control(link: Link) -> Generator[Lease]:
    """The drive's control lease, which is given up where it comes to nothing; else it is kept."""
    lease = Lease()
    lease.take(link())
    try:
        yield lease
    except BaseException:
        with contextlib.suppress(DriveError):
            lease.release(link())
        raise
