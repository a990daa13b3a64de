"""The journal of a flash: on disk before each step, so that whatever cuts it, the next start knows where it stood.

One file a drive, lines of JSON, each with a checksum and fsynced; locked while its process works at it. A last line
that is cut is left out: what it would have said was not done yet. Done, the file goes to the history beside it; where
that was cut, whoever finds it next puts it away.
"""

import contextlib
import fcntl
import json
import os
import re
import time
import zlib
from bisect import bisect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Any, BinaryIO, Final, Self, cast

from bench.errors import ConflictError, LimitError, UnavailableError, shown
from bench.files import sync_folder
from drivers.drive import Identity

UNDER_WAY: Final = "a flash of this drive is under way"
CUT: Final = "a flash of this drive was cut, and has to be finished or rolled back first: `pmsm-bench params resume`"
BEGINNING: Final = r"^[0-9]{4}-[0-9]{2}-[0-9]{2}(T[0-9:.]{0,15})?(Z|\+00:00)?$"
"""Of a flash's time, by which it is named: the day at least."""
_NONE: Final = "nothing was flashed into this drive from here: there is nothing to go back to"
_ONE: Final = "expected the time of one flash that was done, as the history has it"
_NAMED: Final = 4  # of the times that could have been meant
_SUFFIX: Final = ".flash.jsonl"
_HISTORY: Final = ".flashed.jsonl"
_PATIENCE: Final = 0.5  # s for who only looks at a journal to have done so
_RETRY: Final = 0.01  # s


class Step(StrEnum):
    """What is about to be done, or has ended."""

    BEGUN = "begun"
    WRITE = "write"
    STORE = "store"
    RESET = "reset"
    VERIFY = "verify"
    ROLL_BACK = "roll back"
    DONE = "done"
    ROLLED_BACK = "rolled back"


_ENDS: Final = (Step.DONE, Step.ROLLED_BACK)


@dataclass(frozen=True, slots=True)
class Begun:
    """What a flash was to do."""

    drive: str  # its name, or URL
    name: str  # of the set
    version: int
    whom: str
    since: str  # RFC 3339
    image: dict[str, float]  # of the drive before, SI
    wanted: dict[str, float]  # of all of it then, SI
    override: str = ""  # why doubts did not forbid it


@dataclass(frozen=True, slots=True)
class Past:
    """A flash that has ended."""

    begun: Begun
    step: Step  # how: done, or rolled back
    at: str  # RFC 3339
    said: str  # a sentence


class Journal:
    """A flash's journal, open and locked, from `begin` or `found` to `close`."""

    def __init__(self, path: Path, file: BinaryIO, begun: Begun, step: Step) -> None:
        self._path, self._file = path, file
        self.begun, self.step = begun, step

    @classmethod
    def begin(cls, folder: Path, identity: Identity, begun: Begun) -> Self:
        """Raises ConflictError where one is there already, UnavailableError where it cannot be written."""
        path = _path(folder, identity)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            file = _locked(lambda: path.open("x+b", buffering=0))
        except FileExistsError:
            raise ConflictError(CUT) from None
        except OSError as error:
            raise UnavailableError(f"the journal cannot be written in {folder}: {error.strerror or error}") from None
        journal = cls(path, file, begun, Step.BEGUN)
        try:
            journal.note(Step.BEGUN, **{name: getattr(begun, name) for name in Begun.__dataclass_fields__})
        except UnavailableError:
            path.unlink(missing_ok=True)
            journal.close()
            raise
        sync_folder(folder)
        return journal

    @classmethod
    def found(cls, folder: Path, identity: Identity, patience: float = _PATIENCE) -> Self | None:
        """What was cut; None where nothing was. Raises ConflictError where somebody is at it for longer (s)."""
        path = _path(folder, identity)
        try:
            file = _locked(lambda: path.open("r+b", buffering=0), patience)
        except FileNotFoundError:
            return None
        lines, length = _lines(file)
        if not lines:  # nothing was done yet
            path.unlink()
            file.close()
            return None
        file.truncate(length)
        journal = cls(path, file, _begun(lines[0]), Step(lines[-1]["step"]))
        if journal.step not in _ENDS:
            return journal
        with contextlib.suppress(UnavailableError):  # the next look does it
            journal._put_away()
        journal.close()
        return None

    def note(self, step: Step, **more: Any) -> None:
        """A step is about to be done. Raises UnavailableError: then it must not be."""
        text = json.dumps({"step": step, "at": datetime.now(UTC).isoformat(), **more})
        try:
            self._file.seek(0, os.SEEK_END)
            self._file.write(f"{zlib.crc32(text.encode()):08x} {text}\n".encode())
            os.fsync(self._file.fileno())
        except OSError as error:
            raise UnavailableError(f"the journal cannot be written: {error.strerror or error}") from None
        self.step = step

    def end(self, step: Step, said: str) -> None:
        """It is over; what it was is in the history. Raises UnavailableError where it cannot be noted."""
        self.note(step, said=said)
        with contextlib.suppress(UnavailableError):  # whoever finds it next does it
            self._put_away()
        self.close()

    def withdraw(self) -> None:
        """Nothing was done: there is none then."""
        if self.step is Step.BEGUN:
            self._path.unlink(missing_ok=True)

    def close(self) -> None:
        """Leave it to a later start, where it is still there."""
        self._file.close()

    def _put_away(self) -> None:
        """It goes to the history, once, also where that was cut before. Raises UnavailableError."""
        self._file.seek(0)
        whole = self._file.read()
        try:
            with _history_at(self._path).open("a+b") as file:
                length = _lines(file)[1]
                file.seek(0)
                before = file.read(length)
                there = before.rfind(whole.splitlines(keepends=True)[0])
                file.truncate(length if there < 0 else there)
                file.write(whole)
                file.flush()
                os.fsync(file.fileno())
            self._path.unlink()
        except OSError as error:
            raise UnavailableError(f"the history cannot be written: {error.strerror or error}") from None
        sync_folder(self._path.parent)


def history(folder: Path, identity: Identity) -> list[dict[str, Any]]:
    """All that was flashed in a drive and noted here, line by line, in order. Raises UnavailableError."""
    try:
        with _history_at(_path(folder, identity)).open("rb") as file:
            return _lines(file)[0]
    except FileNotFoundError:
        return []
    except OSError as error:
        raise UnavailableError(f"the history cannot be read: {error.strerror or error}") from None


def past(folder: Path, identity: Identity) -> list[Past]:
    """The flashes that have ended, the newest last. Raises UnavailableError."""
    found, begun = list[Past](), None
    for line in history(folder, identity):
        if (step := Step(line["step"])) is Step.BEGUN:
            begun = _begun(line)
        elif step in _ENDS and begun is not None:
            found.append(Past(begun, step, str(line["at"]), str(line["said"])))
    return found


def done(folder: Path, identity: Identity, since: str | None = None) -> Begun:
    """The latest flash that was done; with `since` the one whose time begins so.

    Raises ConflictError where there is none such, or more than one; LimitError, UnavailableError.
    """
    if since is not None and not re.fullmatch(BEGINNING, since):
        raise LimitError(f"{_ONE}, such as 2026-01-31T12:00:00Z, or its beginning, got {shown(since)}")
    flashed = [one.begun for one in past(folder, identity) if one.step is Step.DONE]
    if not flashed:
        raise ConflictError(_NONE)
    if since is None:
        return flashed[-1]
    beginning = since.removesuffix("Z").removesuffix("+00:00")
    found = [one for one in flashed if one.since.startswith(beginning)]
    if not found:
        raise ConflictError(f"{_ONE}, such as {_nearest(beginning, flashed)}, got {shown(since)}")
    if len(found) > 1:
        times = ", ".join(one.since.replace("+00:00", "Z") for one in found[-_NAMED:])
        raise ConflictError(f"{_ONE}, got {shown(since)}, which is the beginning of {len(found)}, the latest {times}")
    return found[0]


def is_there(folder: Path, identity: Identity) -> bool:
    """Whether there is a journal of this drive at all, under way or cut: which costs little to ask."""
    return _path(folder, identity).exists()


def _nearest(beginning: str, flashed: Sequence[Begun]) -> str:
    """The times before and after one."""
    times = sorted(one.since for one in flashed)
    after = bisect(times, beginning)
    return ", ".join(f"{one[:19]}Z" for one in times[max(after - _NAMED // 2, 0) : after + _NAMED // 2])


def _begun(line: dict[str, Any]) -> Begun:
    return Begun(**{key: value for key, value in line.items() if key in Begun.__dataclass_fields__})


def _path(folder: Path, identity: Identity) -> Path:
    return folder / f"{identity.product_code:08X}-{identity.serial:08X}{_SUFFIX}"


def _history_at(path: Path) -> Path:
    return path.with_name(path.name.removesuffix(_SUFFIX) + _HISTORY)


def _locked(opened: Callable[[], Any], patience: float = _PATIENCE) -> BinaryIO:
    """A journal's file, locked and still in its place. Raises OSError, ConflictError where somebody is at it."""
    deadline = time.monotonic() + patience
    while True:
        file = cast(BinaryIO, opened())
        try:
            while not _lock(file):
                if time.monotonic() > deadline:
                    raise ConflictError(UNDER_WAY)
                time.sleep(_RETRY)
            if os.fstat(file.fileno()).st_nlink:  # not put away by who held it until now
                return file
        except BaseException:
            file.close()
            raise
        file.close()


def _lock(file: BinaryIO) -> bool:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _lines(file: BinaryIO) -> tuple[list[dict[str, Any]], int]:
    """Lines whose checksum is right, up to the first that is not, and how many bytes they are."""
    found, length = list[dict[str, Any]](), 0
    file.seek(0)
    for line in file.read().splitlines(keepends=True):
        checksum, _, text = line.removesuffix(b"\n").partition(b" ")
        try:
            if not line.endswith(b"\n") or int(checksum, 16) != zlib.crc32(text):
                break
            found.append(json.loads(text))
        except ValueError:
            break
        length += len(line)
    return found, length
