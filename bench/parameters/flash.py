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
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from itertools import islice
from pathlib import Path
from typing import Final

from bench.errors import BenchError, ConflictError, LimitError, UnavailableError
from bench.parameters.journal import CUT, Begun, Journal, Step
from bench.parameters.parameter_set import FLASHED, ParameterSet
from bench.parameters.plan import Judge, Plan, different, plan
from drivers import operation
from drivers.drive import Drive
from drivers.errors import DriveError, NoReplyError
from drivers.lease import Lease
from drivers.wire.cia402 import State
from drivers.wire.lease import MOST_VALUES
from drivers.wire.memory import MemoryState

PATIENCE: Final = 30.0  # s in which a drive is to be there again, to be rolled back
_RETRY: Final = 0.1  # s
_NAMED: Final = 5  # of what is different
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
    judge: Judge = lambda _: []
    tell: Tell = lambda _: None  # hears of each step
    patience: float = PATIENCE


class DifferentError(DriveError):
    """The drive has other values than it was given."""


def parameters(drive: Drive) -> dict[str, float]:
    """All that a set may hold, as the drive has it now, SI. Raises DriveError."""
    return {name: value for name, value in drive.parameters().items() if name in _NAMES}


def planned(link: Link, given: ParameterSet, around: Around) -> Plan:
    """What it would do. Raises DriveError."""
    drive = link()
    return plan(given, drive.identity, parameters(drive), around.judge)


def flash(link: Link, given: ParameterSet, around: Around) -> Verdict:
    """Do it. Raises LimitError, ConflictError, UnavailableError, DriveError before anything is written."""
    drive = link()
    if (left := Journal.found(around.folder, drive.identity)) is not None:
        left.close()
        raise ConflictError(CUT)
    to_do = planned(link, given, around)
    if to_do.problems:
        raise LimitError("\n".join(to_do.problems))
    if to_do.doubts and not around.override:
        raise LimitError("\n".join((*to_do.doubts, "expected a reason why these are flashed all the same, got none")))
    _check_off(drive)
    lease = Lease()
    lease.take(drive)
    with _released(link, lease):
        image = parameters(drive)
        since = datetime.now(UTC).isoformat()
        begun = Begun(
            around.drive, given.name, given.version, around.whom, since, image, image | to_do.values, around.override
        )
        journal = Journal.begin(around.folder, drive.identity, begun)
        try:
            return _forward(link, lease, journal, around)
        finally:
            journal.close()


def cut(drive: Drive, folder: Path) -> Begun | None:
    """A flash of this drive that was cut; None where there is none. Raises ConflictError where one is under way."""
    journal = Journal.found(folder, drive.identity)
    if journal is None:
        return None
    journal.close()
    return journal.begun


def resume(link: Link, around: Around, *, finish: bool) -> Verdict:
    """Finish a flash that was cut, or roll it back. Raises as `flash`, and ConflictError where none was."""
    drive = link()
    journal = Journal.found(around.folder, drive.identity)
    if journal is None:
        raise ConflictError("no flash of this drive was cut")
    try:
        _check_off(drive)
        lease = Lease()
        lease.take(drive)
        with _released(link, lease):
            if finish:
                return _forward(link, lease, journal, around)
            return _back(link, lease, journal, around, "it was cut", stored=True)
    finally:
        journal.close()


def _forward(link: Link, lease: Lease, journal: Journal, around: Around) -> Verdict:
    """From the values that the drive has now to the wanted ones; back to the image where that does not come out."""
    begun, stored = journal.begun, False
    changed = len(different(begun.wanted, begun.image))
    try:
        journal.note(Step.WRITE)
        around.tell(f"writing {changed} values")
        drive = link()
        _written(drive, lease, begun.wanted)
        journal.note(Step.STORE)
        around.tell("storing")
        stored = True
        _stored_and_read(link, lease, journal, around, begun.wanted)
        journal.end(Step.DONE, said := f"{changed} values changed, stored, and read back after a reset")
    except (DriveError, BenchError) as error:
        return _back(link, lease, journal, around, str(error), stored=stored)
    return Verdict(End.FLASHED, changed, said)


def _back(link: Link, lease: Lease, journal: Journal, around: Around, why: str, *, stored: bool) -> Verdict:
    """To the image; also in memory, where that may hold the new values. As long as it takes, within patience."""
    deadline, image = time.monotonic() + around.patience, journal.begun.image
    with contextlib.suppress(UnavailableError):  # the drive comes first
        journal.note(Step.ROLL_BACK, why=why)
    around.tell(f"rolling back: {why}")
    while True:
        try:
            drive = link()
            _off(drive)
            lease.take(drive)
            _written(drive, lease, image)
            if stored:
                _stored_and_read(link, lease, journal, around, image)
            journal.end(Step.ROLLED_BACK, said := f"{why}; the drive has all values as before, which was read back")
        except (DriveError, BenchError) as error:
            if time.monotonic() > deadline:
                said = (
                    f"{why}; it could not be rolled back ({error}): the drive's memory holds the values before or the "
                    "new ones, `pmsm-bench params resume` finishes or rolls back"
                )
                return Verdict(End.CUT, 0, said)
            time.sleep(_RETRY)
        else:
            return Verdict(End.ROLLED_BACK, 0, said)


def _written(drive: Drive, lease: Lease, wanted: Mapping[str, float]) -> None:
    """Written where it is not so, and read back. Raises DifferentError, DriveError."""
    names = iter(different(wanted, parameters(drive)))
    lease.take(drive)
    while part := {name: wanted[name] for name in islice(names, MOST_VALUES)}:
        lease.write(drive, part)
    _check_same(wanted, parameters(drive), "after it was written")


def _stored_and_read(
    link: Link, lease: Lease, journal: Journal, around: Around, wanted: Mapping[str, float]
) -> None:
    """Stored, the drive reset, and all of it read again. Raises DifferentError, DriveError, UnavailableError."""
    drive = link()
    lease.take(drive)
    operation.store(drive, lambda name, value: lease.write(drive, {name: value}))
    journal.note(Step.RESET)
    around.tell("resetting")
    lease.take(drive)
    drive = operation.reset(link, lambda name, value: lease.write(drive, {name: value}))
    journal.note(Step.VERIFY)
    around.tell("reading back")
    lease.take(drive)
    _check_same(wanted, parameters(drive), "after a reset")
    if (state := int(drive.read("memory_state"))) != MemoryState.NEWEST:
        raise DifferentError(f"the drive does not run what was stored: its memory_state is {state}")


def _check_same(wanted: Mapping[str, float], found: Mapping[str, float], when: str) -> None:
    names = different(wanted, found)
    if not names:
        return
    told = ", ".join(f"{name} = {found.get(name)!r} (wanted {wanted[name]!r})" for name in names[:_NAMED])
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    raise DifferentError(f"the drive has other values {when}: {told}{more}")


def _check_off(drive: Drive) -> None:
    if operation.state(drive) is State.OPERATION_ENABLED:
        raise ConflictError("the drive is on: it is flashed with its bridge off, stop it first")


def _off(drive: Drive) -> None:
    """Somebody may have started it meanwhile: it is not written to then. Raises NoReplyError."""
    if operation.state(drive) is State.OPERATION_ENABLED:
        raise NoReplyError("the drive has been started by somebody meanwhile")


@contextmanager
def _released(link: Link, lease: Lease) -> Generator[None]:
    """Control is given up at the end, as far as the drive is to be had; else it ends by itself."""
    try:
        yield
    finally:
        with contextlib.suppress(DriveError):
            lease.release(link())
