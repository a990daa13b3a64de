"""A serial line that this process makes: a pseudo-terminal, and a link to it at a path."""

import contextlib
import os
import re
import termios
import tty
from pathlib import Path
from typing import Final

from emulator.errors import BusError

_TERMINALS: Final = "/dev/pts/"
_SPEEDS: Final = {getattr(termios, name): int(name[1:]) for name in dir(termios) if re.fullmatch("B[0-9]+", name)}


class Terminal:
    """A line from construction to `close`. Raises BusError where there can be none.

    `near` is the drive's end, which whoever takes it closes; `far` stays open, so that clients may come and go.
    """

    def __init__(self, link: Path) -> None:
        self._link = link
        try:
            if _in_use(link):
                raise BusError(f"cannot serve a serial line at {link}: it is already in use")
            self.near, self.far = os.openpty()
        except OSError as error:
            raise _refusal(link, error) from None
        try:
            tty.setraw(self.far)
            os.set_blocking(self.near, False)
            self._target = os.ttyname(self.far)
            link.symlink_to(self._target)
        except OSError as error:
            os.close(self.near)
            os.close(self.far)
            raise _refusal(link, error) from None

    def at(self, baudrate: int) -> bool:
        """Whether the client has set this baud rate, or one that the system has no number for."""
        return _SPEEDS.get(termios.tcgetattr(self.far)[5]) in (baudrate, None)

    def close(self) -> None:
        """Remove the link, if it is still ours, and close the far end."""
        with contextlib.suppress(OSError):
            if str(self._link.readlink()) == self._target:
                self._link.unlink()
        os.close(self.far)


def at_another_speed(data: bytes) -> bytes:
    """What arrives at an end that is set to another baud rate: other bytes, and another number of them."""
    return bytes(byte ^ 0x5A for byte in data[::2])


def _in_use(link: Path) -> bool:
    """Whether a line is served at the path. The link that a killed emulator has left there is removed."""
    if not link.is_symlink() or not str(link.readlink()).startswith(_TERMINALS):
        return False  # what else is there stays, and is in the way
    with contextlib.suppress(FileNotFoundError):
        if link.stat().st_ctime_ns <= link.lstat().st_mtime_ns:
            return True  # a terminal that is younger than the link has merely been given the same number
    link.unlink()
    return False


def _refusal(link: Path, error: OSError) -> BusError:
    return BusError(f"cannot serve a serial line at {link}: {error.strerror}")
