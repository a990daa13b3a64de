"""The token that is asked for beyond loopback: a line in a file that its owner alone may read."""

import contextlib
import hmac
import os
import re
import secrets
import stat
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from bench.errors import ConfigError

_TOKEN: Final = re.compile(r"[A-Za-z0-9_-]{32,200}")
_LONGEST: Final = 400  # bytes of the file
_LOOK: Final = 1.0  # s between two looks at the file, after which a new token counts


def made(path: Path) -> str:
    """The token of a file, which is made where there is none. Raises ConfigError."""
    if not os.path.lexists(path):
        with _writing(path), contextlib.suppress(FileExistsError):
            _put(path)  # unless somebody else's was made meanwhile
    return read(path)


def renewed(path: Path) -> str:
    """Another token in the file's place: the one before counts no longer. Raises ConfigError."""
    beside = path.with_name(f"{path.name}.{os.getpid()}.new")
    with _writing(path):
        _put(beside)
        beside.replace(path)
    return read(path)


def read(path: Path) -> str:
    """The token of a file. Raises ConfigError."""
    try:
        file = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            told = os.fstat(file)
            text = os.read(file, _LONGEST) if stat.S_ISREG(told.st_mode) else b""
        finally:
            os.close(file)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ConfigError(f"{path}: the token cannot be read: {reason}") from None
    if not stat.S_ISREG(told.st_mode):
        raise ConfigError(f"{path}: expected a file with a token, got something else")
    if told.st_mode & 0o077:
        mode = stat.S_IMODE(told.st_mode)
        raise ConfigError(f"{path}: expected a token that its owner alone may read (chmod 600), got mode {mode:04o}")
    token = text.decode("ascii", "replace").strip()
    if not _TOKEN.fullmatch(token):
        raise ConfigError(f"{path}: expected a token as `pmsm-bench token` makes it, got another text")
    return token


class Known:
    """The token that counts now, for a service that goes on while the file changes."""

    def __init__(self, path: Path, clock: Callable[[], float] = time.monotonic) -> None:
        self._path, self._clock = path, clock
        self._token, self._looked = made(path), clock()

    @property
    def now(self) -> str | None:
        """None where there is none that counts: then nobody has it."""
        if self._clock() - self._looked > _LOOK:
            self._looked = self._clock()
            try:
                self._token = read(self._path)
            except ConfigError:
                self._token = ""
        return self._token or None

    def is_it(self, said: str) -> bool:
        """Whether this is it; how long that takes does not tell."""
        token = self.now
        return token is not None and hmac.compare_digest(said.encode(), token.encode())


def checked(said: str, where: str) -> str:
    """A token that a user gives. Raises ConfigError."""
    if not _TOKEN.fullmatch(said):
        raise ConfigError(f"{where}: expected a token as `pmsm-bench token` prints it, got another text")
    return said


@contextmanager
def _writing(path: Path) -> Generator[None]:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield
    except OSError as error:
        raise ConfigError(f"{path}: the token cannot be written: {error.strerror or error}") from None


def _put(path: Path) -> None:
    """A new token in a new file."""
    file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
    try:
        os.write(file, f"{secrets.token_urlsafe(32)}\n".encode())
        os.fsync(file)
    finally:
        os.close(file)
