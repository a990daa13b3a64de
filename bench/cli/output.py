"""Files that a command writes because an option says so, and the wait for what fills them."""

import errno
import json
import math
import os
import stat
import threading
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import Future, wait
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, Final, TextIO, TypeVar, cast

from bench.errors import ConfigError
from bench.files import check_place, give_name, unfinished

T = TypeVar("T")

STANDARD_OUTPUT: Final = Path("-")  # as an option names it: then nothing else is written there
_PERIOD: Final = 0.1  # s between two looks
_READER: Final = 5.0  # s for somebody to read from a pipe


def check_new(option: str, path: Path) -> None:
    """Raise ConfigError where a file with something in it would be lost. Pipes and devices take what they are given."""
    if _taken(path):
        raise ConfigError(f"{option}: {path} exists already, expected a new file")


def takes_all(path: Path) -> bool:
    """A pipe or a device."""
    try:
        return path.exists() and not path.is_file() and not path.is_dir()
    except OSError:
        return False


def check_output(path: Path) -> None:
    """Raise OSError, before any work, where no file of that name can be written."""
    if takes_all(path):
        return
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    check_place(path)


def write_whole(path: Path, text: str, *, over: bool) -> None:
    """Write a file whole or not at all. Raises OSError; FileExistsError where one is there that is not to be written
    `over`, also if it has appeared since it was looked for.
    """
    if takes_all(path):
        with opened(path) as file:
            file.write(text)
        return
    with unfinished(path.parent) as (part, written):
        written.write(text.encode("utf-8", "backslashreplace"))  # names may have bytes that are no text
        written.close()
        if over:
            part.replace(path)
            return
        try:
            give_name(part, path)
        except FileExistsError:
            if _taken(path):
                raise
            part.replace(path)  # an empty file


@contextmanager
def as_refusal(path: Path) -> Generator[None]:
    """What keeps a file from being written is a ConfigError."""
    try:
        yield
    except FileExistsError:
        raise ConfigError(f"{path} exists already, expected a new file") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror or error}") from None


@contextmanager
def opened(path: Path) -> Generator[TextIO]:
    """A file to be written as it comes. Raises OSError, also where nobody reads from a pipe."""
    deadline = time.monotonic() + _READER
    piped = takes_all(path) and stat.S_ISFIFO(path.stat().st_mode)
    while True:
        try:
            handle = os.open(path, os.O_WRONLY | (os.O_NONBLOCK if piped else os.O_CREAT | os.O_TRUNC), 0o666)
            break
        except OSError as error:
            if error.errno != errno.ENXIO or not piped:
                raise
            if time.monotonic() > deadline:
                raise OSError(errno.ENXIO, f"nobody has read from this pipe within {_READER:g} s") from None
            time.sleep(_PERIOD)
    os.set_blocking(handle, True)
    with open(handle, "w", newline="", encoding="utf-8", errors="backslashreplace") as file:  # noqa: PTH123 - a handle
        yield file


def _taken(path: Path) -> bool:
    """A file with something in it, or a link that leads nowhere yet."""
    try:
        return path.stat().st_size > 0 if path.is_file() else path.is_symlink() and not path.exists()
    except OSError:
        return False  # writing it says why


def print_json(content: object) -> None:
    """One JSON document on standard output; dataclasses, paths and what is not finite as JSON has them."""
    print(json.dumps(_plain(content), indent=2, allow_nan=False))


def _plain(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in cast(Mapping[Any, Any], value).items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in cast(Sequence[Any], value)]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return str(value) if isinstance(value, Path) else value


def check_recording(path: Path) -> None:
    """Raise ConfigError, before anything is recorded, where `--out` is no new Parquet file that can be written."""
    if path.suffix != ".parquet":
        raise ConfigError(f"--out: expected a file name that ends in .parquet, got {str(path)!r}")
    if path.exists():
        raise ConfigError(f"--out: {path} exists already, expected a new file")
    if not path.parent.is_dir():
        raise ConfigError(f"--out: there is no folder {path.parent}")
    try:
        check_place(path)
    except OSError as error:
        raise ConfigError(f"no recording can be written in {path.parent}: {error.strerror or error}") from None


def in_thread(work: Callable[[], T]) -> Future[T]:
    """What a thread of its own, which holds up no end of the process, makes of this work."""
    made = Future[T]()

    def run() -> None:
        try:
            made.set_result(work())
        except BaseException as error:  # noqa: BLE001 - raised again for who asks for the result
            made.set_exception(error)

    threading.Thread(target=run, daemon=True).start()
    return made


def awaited(work: Callable[[], T], cancel: Callable[[], object]) -> T:
    """The result of work that a thread does; Ctrl-C cancels it, and goes on when it has ended.

    Not by a join, which takes the thread for ended where Ctrl-C interrupts it (Python 3.11).
    """
    made = in_thread(work)
    try:
        while not wait((made,), _PERIOD).done:
            pass
    except KeyboardInterrupt:
        cancel()
        wait((made,))
        raise
    return made.result()
