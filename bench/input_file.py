"""Files that others have made, read in bounded time and memory: regular files, whole, up to a size.

Pipes, devices and folders are refused before they are waited for. Knows nothing of what a file holds.
"""

import errno
import json
import os
import stat
from pathlib import Path
from typing import Any, Final

MOST: Final = 10_000_000  # bytes
_KINDS: Final = (
    (stat.S_ISFIFO, "a pipe"), (stat.S_ISSOCK, "a socket"), (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)  # fmt: skip


def check_regular(path: str | Path) -> None:
    """Raise OSError, with a sentence for its reason, where a path leads to no regular file."""
    mode = os.stat(path).st_mode  # noqa: PTH116 - the path as it was given
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(mode):
        kind = next((name for is_one, name in _KINDS if is_one(mode)), "something else")
        raise OSError(errno.EINVAL, f"expected a file, this is {kind}")


def read_bytes(path: str | Path, most: int = MOST) -> bytes:
    """A file's content. Raises OSError, with a sentence for its reason, where it is no file or longer than `most`."""
    check_regular(path)
    with Path(path).open("rb") as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise OSError(errno.EFBIG, f"expected at most {most} bytes, it has more")
    return content


def json_of(content: bytes) -> Any:
    """JSON as values. Raises ValueError whatever else came."""
    try:
        return json.loads(content)
    except RecursionError:
        raise ValueError("brackets without end") from None
