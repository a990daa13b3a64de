"""A part file: records one after the other, each with its checksum, of work that outlives its process.

    pmsm-bench part 2\\n
    kind (1 byte), length (4), checksum (4: CRC-32 of all records so far), the record; and again

A record whose checksum is not right, and what follows it, is not there: what a power cut leaves - an end cut off, or
of zeros - is found. `salvaged` goes on behind damage: a record is vouched for by the checksum that is written before
it. On disk at least twice a second. Knows nothing of what records mean.
"""

import contextlib
import fcntl
import os
import re
import struct
import time
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from typing import ClassVar, Final, Self

from bench.errors import RecordingError
from bench.files import first_free, give_name, sync_folder

DAMAGED: Final = ".damaged"  # ends the names of those that are kept for what they are
_MAGIC: Final = b"pmsm-bench part 2\n"
_EARLIER: Final = b"{"  # with which those begin that have no checksums
_FRAME: Final = struct.Struct("<cI")
_CHECK: Final = struct.Struct("<I")
_HEAD: Final = _FRAME.size + _CHECK.size  # bytes before a record's content
_SYNC: Final = 0.5  # s after which records are on disk, whatever befalls the machine
_PIECE: Final = 8192  # bytes
_LARGEST: Final = 1 << 31  # bytes, of one that is taken up

Record = tuple[bytes, bytes]  # kind, content


@dataclass(frozen=True, slots=True)
class Damage:
    """Bytes of a part file that make no record."""

    size: int
    cut: bool  # the file ends within a record, as a kill leaves it


class PartFile:
    """It is locked until `close`, which leaves it to who comes next."""

    def __init__(self, path: Path, file: FileIO) -> None:
        """Use `begun` or `found`."""
        self.path = path
        self.records: list[Record] = []  # those that were found
        self.damaged = 0  # bytes after them that make no record
        self._file, self._end, self._crc = file, len(_MAGIC), zlib.crc32(_MAGIC)
        self._synced = time.monotonic()

    @classmethod
    def begun(cls, path: Path, kind: bytes, content: bytes) -> Self:
        """A new one with a first record, under this name or the next that is free. Raises OSError."""
        path.parent.mkdir(parents=True, exist_ok=True)
        path, file = first_free(path, lambda name: name.open("x+b", buffering=0))
        with contextlib.suppress(OSError):  # where a file system has no locks, one does without
            fcntl.flock(file, fcntl.LOCK_EX)
        part = cls(path, file)
        try:
            file.write(_MAGIC)
            part.append(kind, content)
            part.sync()
            sync_folder(path.parent)
        except OSError:
            part.remove()
            raise
        return part

    @classmethod
    def found(cls, path: Path) -> Self | None:
        """One that was left, with its records; None where it is being worked at. Raises RecordingError, OSError."""
        if (part := cls.locked(path)) is None:
            return None
        with contextlib.ExitStack() as otherwise:
            otherwise.callback(part.close)
            part._read()
            otherwise.pop_all()
        return part

    @classmethod
    def locked(cls, path: Path) -> Self | None:
        """One that was left, unread; None where it is being worked at. Raises RecordingError, OSError."""
        if not path.is_file():
            raise RecordingError(f"{path.name}: expected a file, this is none")
        with contextlib.ExitStack() as otherwise:
            file = otherwise.enter_context(path.open("r+b", buffering=0))
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                return None
            if not os.fstat(file.fileno()).st_nlink:  # it has ended since
                return None
            otherwise.pop_all()
        return cls(path, file)

    @property
    def size(self) -> int:
        """Bytes so far."""
        return self._end

    def append(self, kind: bytes, content: bytes | bytearray) -> None:
        """One more record, on disk within half a second. Raises OSError; what was there is safe then."""
        head = _FRAME.pack(kind, len(content))
        crc = zlib.crc32(content, zlib.crc32(head, self._crc))
        try:
            if self.damaged:
                self._file.truncate(self._end)
                self.damaged = 0
            self._file.seek(self._end)
            left = memoryview(b"".join((head, _CHECK.pack(crc), content)))
            while left:
                left = left[self._file.write(left) :]
        except OSError:
            with contextlib.suppress(OSError):
                os.ftruncate(self._file.fileno(), self._end)
            raise
        self._crc = crc
        self._end += len(head) + _CHECK.size + len(content)
        if time.monotonic() - self._synced > _SYNC:
            self.sync()

    def sync(self) -> None:
        """Have all of it on disk. Raises OSError."""
        os.fsync(self._file.fileno())
        self._synced = time.monotonic()

    def remove(self) -> None:
        """It is needed no longer; one with damaged records is kept, as `NAME.damaged`."""
        try:
            if self.damaged:
                keep_damaged(self.path)
            self.path.unlink(missing_ok=True)
        finally:
            self.close()

    def close(self) -> None:
        """Leave it to who comes next."""
        with contextlib.suppress(OSError):  # of what could not be written, which has been said
            self._file.close()

    def _read(self) -> None:
        """The records up to the first that is damaged. Raises RecordingError where there is none."""
        size = _size(self.path, self._file)
        begin = self._file.read(len(_MAGIC))
        if begin.startswith(_EARLIER):
            raise RecordingError(
                f"{self.path.name} is of an earlier version, without checksums: nothing tells whether it is whole. It "
                "is left as it is"
            )
        if begin != _MAGIC:
            raise RecordingError(f"{self.path.name} is damaged at its beginning, and is left as it is")
        while len(head := self._file.read(_HEAD)) == _HEAD:
            kind, length = _FRAME.unpack_from(head)
            (told,) = _CHECK.unpack_from(head, _FRAME.size)
            if length > size - self._end:
                break
            content = self._file.read(length)
            crc = zlib.crc32(content, zlib.crc32(head[: _FRAME.size], self._crc))
            if crc != told or len(content) != length:
                break
            self.records.append((kind, content))
            self._crc, self._end = crc, self._end + len(head) + length
        self.damaged = size - self._end
        if not self.records:
            raise RecordingError(f"{self.path.name} is damaged in its heading, and is left as it is")


class OnPartFile:
    """What stands on a part file while it is worked at."""

    what: ClassVar[str]  # it is, as a sentence names it

    def __init__(self, file: PartFile) -> None:
        self._file = file

    @classmethod
    def of(cls, file: PartFile) -> Self:
        """From a file's records. Raises ValueError, TypeError, LookupError or AttributeError where they are others."""
        raise NotImplementedError

    @classmethod
    def found(cls, path: Path) -> Self | None:
        """One that was left; None where it is being worked at. Raises RecordingError where it cannot be read."""
        if (file := PartFile.found(path)) is None:
            return None
        try:
            return cls.of(file)
        except (ValueError, TypeError, LookupError, AttributeError, ZeroDivisionError):
            file.close()
            raise RecordingError(f"{path.name}: expected {cls.what} under way, it is something else") from None

    @property
    def path(self) -> Path:
        """Of the part file."""
        return self._file.path

    def remove(self) -> None:
        """It is needed no longer."""
        self._file.remove()

    def close(self) -> None:
        """Leave it to who comes next, on disk."""
        with contextlib.suppress(OSError, ValueError):
            self._file.sync()
        self._file.close()


def salvaged(path: Path, kinds: bytes) -> Iterator[Record | Damage]:
    """Every record of these kinds that is whole, and the damage between them, whoever works at it.

    Raises RecordingError, OSError.
    """
    with path.open("rb", buffering=0) as file:
        _size(path, file)
        content = memoryview(file.read())
    at, before = len(_MAGIC), zlib.crc32(_MAGIC)
    if (begin := bytes(content[:at])) != _MAGIC:
        yield Damage(len(begin), cut=_MAGIC.startswith(begin))
    while at < len(content):
        frame = _Frame.at(content, at)
        if frame is not None and frame.follows(before):
            yield bytes(frame.kind), bytes(frame.content)
            at, before = frame.end, frame.told
            continue
        damaged, (at, before) = at, _next_whole(content, at, before, kinds)
        yield Damage(at - damaged, cut=frame is None and at == len(content))


@dataclass(frozen=True, slots=True)
class _Frame:
    """What may be a record."""

    head: memoryview
    told: int  # its checksum
    content: memoryview
    end: int  # its place in the file

    @classmethod
    def at(cls, content: memoryview, place: int) -> Self | None:
        """None where the file ends before it does."""
        if place + _HEAD > len(content):
            return None
        _, length = _FRAME.unpack_from(content, place)
        (told,) = _CHECK.unpack_from(content, place + _FRAME.size)
        begin, end = place + _HEAD, place + _HEAD + length
        return None if end > len(content) else cls(content[place : place + _FRAME.size], told, content[begin:end], end)

    @property
    def kind(self) -> memoryview:
        return self.head[:1]

    def checksum(self, before: int) -> int:
        """That it is to have after records of a checksum."""
        return zlib.crc32(self.content, zlib.crc32(self.head, before))

    def follows(self, before: int) -> bool:
        """It is whole, after records of a checksum."""
        return self.checksum(before) == self.told


def _next_whole(content: memoryview, at: int, before: int, kinds: bytes) -> tuple[int, int]:
    """Where the next whole record is after a damaged one at a place, and the checksum before it; else the file's end.

    That is the damaged record's, as it is written there or as it should be; or one that a frame has right before it.
    """
    befores = {_CHECK.unpack_from(content, at + _FRAME.size)[0]} if at + _HEAD <= len(content) else set[int]()
    if (damaged := _Frame.at(content, at)) is not None:
        befores.add(damaged.checksum(before))
    for found in re.compile(b"[" + re.escape(kinds) + b"]").finditer(content, at):
        place = found.start()
        if (frame := _Frame.at(content, place)) is None:
            continue
        after = _Frame.at(content, frame.end)
        if after is None and frame.end != len(content):
            continue
        if place > at and (vouched := next((crc for crc in befores if frame.follows(crc)), None)) is not None:
            return place, vouched
        if after is not None and bytes(after.kind) in kinds and after.follows(frame.told):
            return frame.end, frame.told
    return len(content), 0


def keep_damaged(path: Path) -> None:
    """Give a file that is damaged the name under which it stays, `NAME.damaged`. Raises OSError."""
    first_free(damaged_name(path), lambda name: give_name(path, name))
    path.unlink(missing_ok=True)


def damaged_name(path: Path) -> Path:
    """Of a file that is damaged."""
    return path.with_suffix(DAMAGED)


def _size(path: Path, file: FileIO) -> int:
    """In bytes. Raises RecordingError for one that is too large to be read."""
    size = os.fstat(file.fileno()).st_size
    if size > _LARGEST:
        raise RecordingError(f"{path.name}: expected at most {_LARGEST} bytes, it has {size}")
    return size


def piece_size(sample: int) -> int:
    """Bytes of a record of whole samples of so many bytes: what damage, or a full disk, costs at most."""
    return max(1, _PIECE // sample) * sample
