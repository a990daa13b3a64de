"""The seal of a Parquet file of the bench's: a checksum of all its other bytes, between its pages and its footer.

Parquet finds pages by their place from the file's beginning and the footer by its end, so that other readers pass
over what is between. Who writes the columns anew, writes no seal. Knows nothing of what a file holds.
"""

import os
import zlib
from pathlib import Path
from typing import BinaryIO, Final

from bench.errors import RecordingError

_MARK: Final = b"pmsm-bench crc32 "
_DIGITS: Final = 8
_TAIL: Final = 8  # bytes: the footer's length and PAR1
_WITHIN: Final = 1 << 22  # bytes at the end in which a seal is looked for
_PIECE: Final = 1 << 20  # bytes


def sealed(content: bytes) -> bytes:
    """A whole Parquet file with its seal."""
    footer = len(content) - _TAIL - int.from_bytes(content[-_TAIL:-4], "little")
    before, after = content[:footer] + _MARK, content[footer:]
    return before + b"%08x" % zlib.crc32(after, zlib.crc32(before)) + after


def seal(file: BinaryIO) -> None:
    """Give a Parquet file that has been written its seal. Raises OSError."""
    size = file.seek(-_TAIL, os.SEEK_END) + _TAIL
    footer = size - _TAIL - int.from_bytes(file.read(4), "little")
    file.seek(footer)
    after = file.read()
    crc = _crc_of(file, footer)
    file.seek(footer)
    file.write(_MARK + b"%08x" % zlib.crc32(after, zlib.crc32(_MARK, crc)) + after)


def check_seal(path: Path) -> None:
    """Raise RecordingError where a file has a seal and is not what was sealed, OSError where it cannot be read."""
    if not _is_whole(path):
        raise RecordingError(f"{path}: damaged: its bytes have another checksum than when it was written")


def _is_whole(path: Path) -> bool:
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - _WITHIN))
        tail = file.read()
        at = tail.rfind(_MARK)
        if at < 0:
            return True
        digits = slice(at + len(_MARK), at + len(_MARK) + _DIGITS)
        crc = _crc_of(file, size - len(tail) + digits.start)
        return tail[digits] == b"%08x" % zlib.crc32(tail[digits.stop :], crc)


def _crc_of(file: BinaryIO, left: int) -> int:
    """CRC-32 of a file's first bytes."""
    crc = 0
    file.seek(0)
    while left > 0 and (piece := file.read(min(_PIECE, left))):
        crc = zlib.crc32(piece, crc)
        left -= len(piece)
    return crc
