"""The journal of a flash: on disk before each step, so that whatever cuts it, the next start knows where it stood.

One file a drive, lines of JSON, each with a checksum and fsynced; locked while its process works at it. A last line
that is cut is left out: what it would have said was not done yet. Done, the file goes to the history beside it.
"""

import fcntl
import json
import os
import zlib
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Any, BinaryIO, Final, Self, cast

from bench.errors import ConflictError, UnavailableError
from bench.files import sync_folder
from drivers.drive import Identity

CUT: Final = "a flash of this drive was cut, and has to be finished or rolled back first: `pmsm-bench params resume`"
_SUFFIX: Final = ".flash.jsonl"
_HISTORY: Final = ".flashed.jsonl"


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
            file = cast(BinaryIO, path.open("x+b", buffering=0))
        except FileExistsError:
            raise ConflictError(CUT) from None
        except OSError as error:
            raise UnavailableError(f"the journal cannot be written in {folder}: {error.strerror or error}") from None
        _lock(file)
        journal = cls(path, file, begun, Step.BEGUN)
        journal.note(Step.BEGUN, **{name: getattr(begun, name) for name in Begun.__dataclass_fields__})
        sync_folder(folder)
        return journal

    @classmethod
    def found(cls, folder: Path, identity: Identity) -> Self | None:
        """What was cut; None where nothing was. Raises ConflictError where somebody is at it."""
        path = _path(folder, identity)
        try:
            file = cast(BinaryIO, path.open("r+b", buffering=0))
        except FileNotFoundError:
            return None
        _lock(file)
        lines, length = _lines(file)
        if not lines:  # nothing was done yet
            path.unlink()
            file.close()
            return None
        file.truncate(length)
        first = {key: value for key, value in lines[0].items() if key in Begun.__dataclass_fields__}
        return cls(path, file, Begun(**first), Step(lines[-1]["step"]))

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
        """It is over; what it was is in the history. Raises UnavailableError."""
        self.note(step, said=said)
        self._file.seek(0)
        with _history_at(self._path).open("ab") as file:
            file.write(self._file.read())
            os.fsync(file.fileno())
        self._path.unlink()
        sync_folder(self._path.parent)
        self.close()

    def close(self) -> None:
        """Leave it to a later start, where it is still there."""
        self._file.close()


def history(folder: Path, identity: Identity) -> list[dict[str, Any]]:
    """All that was flashed in a drive and noted here, line by line, in order."""
    try:
        with _history_at(_path(folder, identity)).open("rb") as file:
            return _lines(file)[0]
    except FileNotFoundError:
        return []


def _path(folder: Path, identity: Identity) -> Path:
    return folder / f"{identity.product_code:08X}-{identity.serial:08X}{_SUFFIX}"


def _history_at(path: Path) -> Path:
    return path.with_name(path.name.removesuffix(_SUFFIX) + _HISTORY)


def _lock(file: BinaryIO) -> None:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        file.close()
        raise ConflictError("a flash of this drive is under way") from None


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
