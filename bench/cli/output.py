"""Files that a command writes because an option says so, and the wait for what fills them."""

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Final

from bench.capture_file import check_place
from bench.errors import ConfigError

_PERIOD: Final = 0.1  # s between two looks


def check_new(option: str, path: Path) -> None:
    """Raise ConfigError where a file with something in it would be lost. Pipes and devices take what they are given."""
    try:
        lost = path.is_file() and path.stat().st_size > 0
    except OSError:
        return  # writing it says why
    if lost:
        raise ConfigError(f"{option}: {path} exists already, expected a new file")


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


def await_end(ended: threading.Event, cancel: Callable[[], object]) -> None:
    """Wait for what a thread does; Ctrl-C cancels it, and goes on when it has ended.

    Not by a join, which takes the thread for ended where Ctrl-C interrupts it (Python 3.11).
    """
    try:
        while not ended.wait(_PERIOD):
            pass
    except KeyboardInterrupt:
        cancel()
        ended.wait()
        raise
