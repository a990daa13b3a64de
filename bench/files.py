"""Files that users name: those of others, read in bounded time and memory, and new ones, written whole or not at all.

Of others regular files are read, whole, up to a size: pipes, devices and folders are refused before they are waited
for. A new file gets a name that is free: what is there is never written over. And where files of the bench are, unless
its configuration says otherwise. Knows nothing of what a file holds.
"""

import contextlib
import errno
import fcntl
import json
import os
import secrets
import shutil
import stat
from collections import Counter
from collections.abc import Callable, Generator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any, BinaryIO, Final, TypeVar

from bench.errors import shown

T = TypeVar("T")

MOST: Final = 10_000_000  # bytes
_KINDS: Final = (
    (stat.S_ISFIFO, "a pipe"), (stat.S_ISSOCK, "a socket"), (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)  # fmt: skip
_BESIDES: Final = 1_000_000  # bytes: what is in a file besides its samples


def data_folder() -> Path:
    """Where the bench keeps things unless the configuration says otherwise: among the user's data, as XDG has it."""
    home = os.environ.get("XDG_DATA_HOME")
    return (Path(home) if home else Path.home() / ".local" / "share") / "pmsm-bench"


def captures_folder() -> Path:
    """Of captures."""
    return data_folder() / "captures"


def catalogue_file() -> Path:
    """Of what the service remembers."""
    return data_folder() / "catalogue.sqlite"


def journals_folder() -> Path:
    """Of what is flashed into drives: of the service, and of whoever flashes without it."""
    return data_folder() / "flash"


def log_folder() -> Path:
    """Of what was written and what was refused."""
    return data_folder() / "log"


def token_file() -> Path:
    """Of the token that is asked for beyond loopback."""
    return data_folder() / "token"


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


class TwiceError(ValueError):
    """JSON with a key more than once in an object: which of its values is meant is not told."""


def json_of(content: bytes) -> Any:
    """JSON as values. Raises TwiceError, and ValueError whatever else came."""
    try:
        return json.loads(content, object_pairs_hook=_keys_once)
    except RecursionError:
        raise ValueError("brackets without end") from None


def _keys_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        twice = next(key for key, times in Counter(key for key, _ in pairs).items() if times > 1)
        raise TwiceError(f"expected every key once in an object, got {shown(twice)} more than once")
    return found


def write_new(path: Path, write: Callable[[BinaryIO], object]) -> Path:
    """Write a file, whole or not at all, under this name or the next that is free; tell which. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with unfinished(path.parent) as (part, file):
        write(file)
        return named(part, file, path)


def named(part: Path, file: BinaryIO, path: Path) -> Path:
    """Have what was written to `part`, open as `file`, on disk, and then under this name or the next that is free.

    Tells which. Raises OSError.
    """
    file.flush()
    os.fsync(file.fileno())
    path = first_free(path, lambda name: give_name(part, name))[0]
    sync_folder(path.parent)
    return path


def check_place(path: Path) -> None:
    """Raise OSError where no new file of this name can be written."""
    with contextlib.suppress(FileNotFoundError):
        path.lstat()
    with unfinished(path.parent):
        pass


def check_room(folder: Path, samples: int, columns: int) -> None:
    """Raise OSError where there is no room for a recording: its counts as they come, then its columns, uncompressed."""
    folder.mkdir(parents=True, exist_ok=True)
    check_free(folder, samples * (2 * columns + 8 * (columns + 1)) + _BESIDES, f"{samples} samples")


def check_free(folder: Path, needed: int, what: str) -> None:
    """Raise OSError where there are fewer bytes than something takes."""
    free = shutil.disk_usage(folder).free
    if free < needed:
        said = f"expected {needed / 1e6:.3g} MB for {what} in {folder}, {free / 1e6:.3g} MB are free"
        raise OSError(errno.ENOSPC, said)


@contextmanager
def unfinished(folder: Path) -> Generator[tuple[Path, BinaryIO]]:
    """A file of a name that nobody else has, locked; that name is gone afterwards."""
    name, file = _unfinished(folder)
    with file:
        try:
            yield name, file
        finally:
            with contextlib.suppress(OSError):
                name.unlink(missing_ok=True)


def free_name(folder: Path) -> Path:
    """Of something unfinished, which `sweep` removes."""
    return folder / f".{secrets.token_hex(4)}.unfinished"


def _unfinished(folder: Path) -> tuple[Path, BinaryIO]:
    while True:
        name = free_name(folder)
        file = name.open("xb")
        with contextlib.suppress(OSError):  # a file system without locks, where nobody sweeps; or swept just now
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.fstat(file.fileno()).st_nlink:
            return name, file
        file.close()


@contextmanager
def unfinished_folder(folder: Path) -> Generator[Path]:
    """A folder in another, of a name that nobody else has, locked; that name is gone afterwards, with all in it.

    The other is made where it is not there. Raises OSError.
    """
    name, lock = _unfinished_folder(folder)
    try:
        yield name
    finally:
        shutil.rmtree(name, ignore_errors=True)
        os.close(lock)


def _unfinished_folder(folder: Path) -> tuple[Path, int]:
    while True:
        name = free_name(folder)
        name.mkdir(parents=True)
        with contextlib.suppress(FileNotFoundError):  # swept just now
            lock = os.open(name, os.O_RDONLY)
            with contextlib.suppress(OSError):  # a file system without locks, where nobody sweeps
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if name.is_dir():
                return name, lock
            os.close(lock)


def sweep(folder: Path) -> None:
    """Remove what processes that were killed have left unfinished; what is being written stays."""
    for path in folder.glob(f".{'[0-9a-f]' * 8}.unfinished"):
        with contextlib.suppress(OSError):
            file = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if path.is_dir():
                    shutil.rmtree(path)
                else:
                    path.unlink()
            finally:
                os.close(file)


def give_name(part: Path, name: Path) -> None:
    """Give a written file its name. Raises FileExistsError where that is another's."""
    try:
        os.link(part, name)
    except FileExistsError:
        raise
    except OSError:  # a file system without links
        name.open("xb").close()
        part.replace(name)


def first_free(path: Path, make: Callable[[Path], T]) -> tuple[Path, T]:
    """Make a file that is not there yet, under this name or `NAME-1`, `NAME-2`. Raises OSError."""
    stem, dot, ends = path.name.partition(".")
    for k in count(1):
        try:
            return path, make(path)
        except FileExistsError:
            path = path.with_name(f"{stem}-{k}{dot}{ends}")
    raise AssertionError


def sync_folder(folder: Path) -> None:
    """Have a folder's names on disk, as far as the file system knows of that."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
