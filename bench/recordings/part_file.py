"""A part file: records one after the other, each with its checksum, of work that outlives its process.

    pmsm-bench part 2\\n
    kind (1 byte), length (4), checksum (4: CRC-32 of all records so far), the record; and again

A record whose checksum is not right, and what follows it, is not there: what a power cut leaves - an end cut off, or
of zeros - is found. On disk at least twice a second. Knows nothing of what records mean.
"""

import contextlib
import fcntl
import os
import struct
import time
import zlib
from io import FileIO
from pathlib import Path
from typing import ClassVar, Final, Self

from bench.errors import RecordingError
from bench.files import first_free, give_name, sync_folder

_MAGIC: Final = b"pmsm-bench part 2\n"
_EARLIER: Final = b"{"  # with which those begin that have no checksums
_FRAME: Final = struct.Struct("<cI")
_CHECK: Final = struct.Struct("<I")
_SYNC: Final = 0.5  # s after which records are on disk, whatever befalls the machine
_PIECE: Final = 8192  # bytes
_LARGEST: Final = 1 << 31  # bytes, of one that is taken up

Record = tuple[bytes, bytes]  # kind, content


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
            part = cls(path, file)
            part._read()
            otherwise.pop_all()
        return part

    @classmethod
    def contents(cls, path: Path) -> tuple[list[Record], int]:
        """The records of one, and the bytes after them that make none, whoever works at it. Raises as `found`."""
        with path.open("rb", buffering=0) as file:
            part = cls(path, file)
            part._read()
            return part.records, part.damaged

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
                first_free(self.path.with_suffix(".damaged"), lambda name: give_name(self.path, name))
            self.path.unlink(missing_ok=True)
        finally:
            self.close()

    def close(self) -> None:
        """Leave it to who comes next."""
        with contextlib.suppress(OSError):  # of what could not be written, which has been said
            self._file.close()

    def _read(self) -> None:
        """The records up to the first that is damaged. Raises RecordingError where there is none."""
        size = os.fstat(self._file.fileno()).st_size
        if size > _LARGEST:
            raise RecordingError(f"{self.path.name}: expected at most {_LARGEST} bytes, it has {size}")
        begin = self._file.read(len(_MAGIC))
        if begin.startswith(_EARLIER):
            raise RecordingError(
                f"{self.path.name} is of an earlier version, without checksums: nothing tells whether it is whole. It "
                "is left as it is"
            )
        if begin != _MAGIC:
            raise RecordingError(f"{self.path.name} is damaged at its beginning, and is left as it is")
        while len(head := self._file.read(_FRAME.size + _CHECK.size)) == _FRAME.size + _CHECK.size:
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


def piece_size(sample: int) -> int:
    """Bytes of a record of whole samples of so many bytes: what damage, or a full disk, costs at most."""
    return max(1, _PIECE // sample) * sample
