"""Files that others have made, read in bounded time and memory, and names of theirs as a terminal may show them.

Knows nothing of what a file holds.
"""

import errno
import os
import re
from pathlib import Path

MOST = 2_000_000  # bytes, of a text
_HIDDEN = re.compile("[\x00-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


def check_regular(path: Path, most: int) -> None:
    """Raise OSError where a path leads to no file of at most so many bytes; pipes and devices are not waited for."""
    told = path.stat()
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not path.is_file():
        raise OSError(errno.EINVAL, "expected a file, this is a pipe or a device")
    if told.st_size > most:
        raise OSError(errno.EFBIG, f"expected at most {most} bytes, it has {told.st_size}")


def read_text(path: Path) -> str:
    """A text of a bounded size. Raises OSError, UnicodeDecodeError."""
    check_regular(path, MOST)
    with path.open("rb") as file:
        return file.read(MOST + 1).decode("utf-8-sig")


def shown(value: object) -> str:
    """A foreign value as a sentence shows it: short, whatever came."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # a number of thousands of digits; nesting without end
        return f"something too long to show ({type(value).__name__})"
    return text if len(text) <= 80 else f"{text[:77]}..."


def one_line(text: object) -> str:
    """A sentence with names in it: on one line, no character of it hidden."""
    return _HIDDEN.sub(lambda found: ascii(found[0])[1:-1], str(text))
