"""What a bench has changed in a drive and has to undo, on disk before it is changed, so that a later start can undo it.

One file a drive, locked while its process lives: what is locked is under way, what is not was left by a bench that has
died. What was before that bench is before all that follow, until it is undone. Knows nothing of services and HTTP.
"""

import contextlib
import errno
import fcntl
import itertools
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO, Final, cast

from bench.errors import ConflictError, UnavailableError
from bench.files import sync_folder
from drivers import lease as control
from drivers import operation
from drivers.drive import Drive, Identity
from drivers.errors import RefusedError
from drivers.lease import HeldError, Lease
from drivers.wire.cia402 import State
from drivers.wire.lease import Action, Record

_SUFFIX: Final = ".control.json"
_AT_WORK: Final = "another bench on this machine is at work with this drive, and has changed settings of it meanwhile"


@dataclass(frozen=True, slots=True)
class Note:
    """Who controls a drive, and what it was like before."""

    drive: str  # its name, or URL
    what: str  # that is done with it, in words
    whom: str  # who asked
    since: str  # RFC 3339
    holder: str  # of the control lease
    token: int
    settings: dict[str, float]  # before, SI


@dataclass(frozen=True, slots=True)
class Origin:
    """Of what is noted: what is done, for whom, and where notes are kept."""

    folder: Path  # that of journals, which is one for all benches of a user
    drive: str  # its name, or URL
    what: str
    whom: str = ""


class Noted:
    """A note on disk, from construction to `close`; `undone` removes it. It is left where something is left to undo.

    What a bench before left to undo is in it as well, and stays for the next start.
    """

    def __init__(self, origin: Origin, drive: Drive, lease: Lease, settings: Mapping[str, float]) -> None:
        """Raises UnavailableError where it cannot be written, ConflictError where another bench is at the drive."""
        self._path = origin.folder / _name(drive.identity)
        since = datetime.now(UTC).isoformat()
        with contextlib.ExitStack() as stack:
            try:
                origin.folder.mkdir(parents=True, exist_ok=True)
                old = stack.enter_context(_locked(self._path))
                left = _note_in(old)
                if left is None:
                    _set_aside(self._path)
                self._left = left.settings if left else {}
                before = dict(settings) | self._left
                note = Note(origin.drive, origin.what, origin.whom, since, lease.holder, lease.token, before)
                self._file = stack.enter_context(_written(self._path, json.dumps(asdict(note)).encode()))
                old.close()
            except BlockingIOError:
                raise ConflictError(_AT_WORK) from None
            except OSError as error:
                raise UnavailableError(
                    f"what is to be undone later cannot be noted in {origin.folder}: {error.strerror or error}"
                ) from None
            stack.pop_all()

    def undone(self) -> None:
        """Nothing is left to undo of what this one changed."""
        if self._left:
            self.close()
            return
        with contextlib.suppress(OSError):  # then a later start looks once more
            self._path.unlink(missing_ok=True)
        self.close()

    def close(self) -> None:
        """Leave it to a later start, where it is still there."""
        self._file.close()


def freed(drive: Drive, folder: Path) -> None:
    """See that a drive is as before, and nobody's. Raises as `undo`; HeldError where another has control."""
    try:
        undo(folder, drive)
    except ConflictError:
        if control.held(drive) is None:
            raise
    if (held := control.held(drive)) is not None:
        raise HeldError(held.words, 0)


def take(drive: Drive, lease: Lease, origin: Origin, settings: Mapping[str, float]) -> Noted:
    """Take control of a drive that is `freed`, noted before. Raises as `Noted`; HeldError, DriveError."""
    noted = Noted(origin, drive, lease, settings)
    try:
        lease.take(drive)
    except BaseException:
        noted.undone()
        raise
    return noted


def undo(folder: Path, drive: Drive) -> str:
    """Stop a drive that a bench before this one left, and restore it; what was done, in a sentence, empty for nothing.

    Where somebody else controls the drive by now, nothing is written to it, and the note stays. Raises ConflictError
    where that bench is still at work, DriveError where the drive cannot be had: then it stays as well.
    """
    path = folder / _name(drive.identity)
    try:
        file = _locked(path, new=False)
    except BlockingIOError:
        raise ConflictError(_AT_WORK) from None
    except OSError:  # there is none
        return ""
    with file:
        note = _note_in(file)
        if note is None:
            said = _set_aside(path)
            path.unlink(missing_ok=True)
            return said
        stopped = _stopped(drive, note)
        if stopped is None:
            who = control.held(drive)
            by = who.holder if who else "another client"
            return f"{_began(note)}; {by} controls the drive since: its settings stay as they are until the next start"
        restored, refused = _restored(drive, note)
        path.unlink(missing_ok=True)
    was = "was on and has been stopped" if stopped else "was off already"
    settings = f"{', '.join(restored)} restored as before" if restored else "its settings as before"
    return f"{_began(note)}: the drive {was}, {settings}" + (f", but not {refused}" if refused else "")


def _began(note: Note) -> str:
    """Whose end it was that nobody told, the beginning of a sentence."""
    return f"a bench ended without notice in {note.what.partition(' (')[0]}, since {note.since[:19].replace('T', ' ')}Z"


def _stopped(drive: Drive, note: Note) -> bool | None:
    """Whether it was on; None where somebody else controls it."""
    on = operation.state(drive) is State.OPERATION_ENABLED
    if not drive.identity.has_lease:
        control.stop(drive)
        return on
    try:
        drive.control(Record(note.token, Action.RELEASE))
    except RefusedError:
        return None
    if operation.state(drive) is State.OPERATION_ENABLED and control.held(drive) is not None:
        return None
    operation.await_state(drive, set(State) - {State.OPERATION_ENABLED})
    return on


def _restored(drive: Drive, note: Note) -> tuple[list[str], str]:
    """The settings that were other than before, by name, and what was refused."""
    restored, refused = list[str](), list[str]()
    for name, value in note.settings.items():
        try:
            if drive.read(name) != value:
                drive.write(name, value)
                restored.append(name)
        except RefusedError as error:
            refused.append(f"{name} ({error})")
    return restored, ", ".join(refused)


def _locked(path: Path, *, new: bool = True) -> BinaryIO:
    """A note's file, made where it may be `new`, locked, and still in its place. Raises OSError."""
    while True:
        file = path.open("a+b" if new else "r+b")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.fstat(file.fileno()).st_nlink:  # not removed by who held it until now
                return file
        except BaseException:
            file.close()
            raise
        file.close()


def _written(path: Path, content: bytes) -> BinaryIO:
    """A file in another's place, whole or not at all, locked from the beginning. Raises OSError."""
    new = path.with_suffix(".new")
    file = cast(BinaryIO, new.open("wb", buffering=0))
    try:
        new.chmod(0o600)  # of the token
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if file.write(content) != len(content):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        os.fsync(file.fileno())
        new.replace(path)
        sync_folder(path.parent)
    except BaseException:
        file.close()
        raise
    return file


def _note_in(file: BinaryIO) -> Note | None:
    """What a note says; None where it is empty, as before anything is changed, or damaged."""
    file.seek(0)
    try:
        content: Any = json.loads(file.read())
        note = Note(**content)
        return replace(note, settings={str(name): float(value) for name, value in note.settings.items()})
    except (ValueError, TypeError, AttributeError):
        return None


def _set_aside(path: Path) -> str:
    """Keep a copy of a note that cannot be read; a sentence, empty where nothing was changed: then it is empty."""
    kept = next(p for k in itertools.count() if not (p := path.with_suffix(f".damaged{k or ''}")).exists())
    with contextlib.suppress(OSError):
        content = path.read_bytes()
        if not content:
            return ""
        kept.write_bytes(content)
    return f"what a bench before this one has changed cannot be read: see the drive's settings; its note is {kept}"


def _name(identity: Identity) -> str:
    return f"{identity.vendor_id:08x}-{identity.product_code:08x}-{identity.serial:08x}{_SUFFIX}"
