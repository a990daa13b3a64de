"""The drive's memory for parameters: two pages, written in turn, each with a count and a checksum.

A page is erased, its values are written, and its heading last: whatever is cut, at any byte, leaves a page whose
checksum is wrong, and the other page as it was. What is read after a power-on is the newest whole page.

    <I mark  I count  I length  I CRC-32 of count, length and values>  values

No values: parameters as delivered. Writing takes the drive's time, `SPEED` bytes a second. Where there is a file, it is
written byte for byte as the memory is: an emulator that is killed is a drive whose power fails. Knows nothing of
signals.
"""

import struct
import zlib
from pathlib import Path
from typing import Final

from drivers.wire.memory import MemoryState

PAGE: Final = 4096  # bytes
SPEED: Final = 100_000.0  # bytes/s
_HEADING: Final = struct.Struct("<IIII")
_MARK: Final = 0x4D534D50
_BLANK: Final = 0xFF
ROOM: Final = PAGE - _HEADING.size


class Memory:
    """Both pages, and what is being written to them."""

    def __init__(self, path: Path | None = None) -> None:
        """Read from a file, which is made where there is none. Raises ValueError, in a sentence, and OSError."""
        self._bytes, self._path = bytearray([_BLANK]) * (2 * PAGE), path
        self._left: list[tuple[int, bytes]] = []  # what is to be written where
        self._owed = 0.0  # bytes that may be written by now
        if path is not None and path.exists():
            with path.open("rb") as file:
                content = file.read(2 * PAGE + 1)
            if len(content) != 2 * PAGE:
                raise ValueError(f"{path}: expected a drive's memory of {2 * PAGE} bytes, got another file")
            self._bytes[:] = content
        elif path is not None:
            path.write_bytes(self._bytes)
        self.state, self.count, self.checksum, self.values = MemoryState.DELIVERED, 0, 0, b""
        self._read()

    @property
    def writing(self) -> bool:
        """Something is being written."""
        return bool(self._left)

    def store(self, values: bytes) -> None:
        """Begin to write values, `ROOM` bytes at most, to the page that is not the newest. Raises ValueError."""
        if len(values) > ROOM:
            raise ValueError(f"a page holds {ROOM} bytes, got {len(values)}")
        if self.writing:
            raise ValueError("parameters are being stored")
        count = self.count + 1
        at = PAGE * (count % 2)
        heading = _HEADING.pack(_MARK, count, len(values), _checksum(count, values))
        self._left = [(at, bytes([_BLANK]) * PAGE), (at + _HEADING.size, values), (at, heading)]
        self._owed = 0.0

    def pass_(self, seconds: float) -> bool:
        """Time passes, and what is being written goes on; whether all of it is there now."""
        if not self._left:
            return False
        self._owed += SPEED * seconds
        while self._left and self._owed >= 1.0:
            at, data = self._left.pop(0)
            n = int(min(len(data), self._owed))
            self._write(at, data[:n])
            self._owed -= n
            if n < len(data):
                self._left.insert(0, (at + n, data[n:]))
        if self._left:
            return False
        self._read()
        return True

    def restart(self) -> None:
        """As after a power-on: what was being written stays as far as it came."""
        self._left = []
        self._read()

    def _write(self, at: int, data: bytes) -> None:
        self._bytes[at : at + len(data)] = data
        if self._path is not None:
            with self._path.open("r+b") as file:
                file.seek(at)
                file.write(data)

    def _read(self) -> None:
        pages = [bytes(self._bytes[at : at + PAGE]) for at in (0, PAGE)]
        whole = sorted(found for page in pages if (found := _values(page)) is not None)
        cut = any(_values(page) is None and page.strip(bytes([_BLANK])) for page in pages)
        self.count, self.values = whole[-1] if whole else (0, b"")
        self.checksum = _checksum(self.count, self.values) if whole else 0
        self.state = MemoryState.OLDER if cut else MemoryState.NEWEST if self.values else MemoryState.DELIVERED


def _checksum(count: int, values: bytes) -> int:
    return zlib.crc32(struct.pack("<II", count, len(values)) + values)


def _values(page: bytes) -> tuple[int, bytes] | None:
    """Count and values of a page; None where it is not whole."""
    mark, count, length, checksum = _HEADING.unpack_from(page)
    values = page[_HEADING.size : _HEADING.size + length]
    if mark != _MARK or length > ROOM or _checksum(count, values) != checksum:
        return None
    return count, values
