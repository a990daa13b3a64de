"""A drive by its URL alone, connected anew whenever its link has ended: for who has no service."""

import contextlib
from types import TracebackType
from typing import Self

from drivers.connect import connect
from drivers.drive import Drive
from drivers.errors import DriveError


class OwnLink:
    """Called, it gives the drive as it is to be had now. A context manager, which closes it."""

    def __init__(self, url: str) -> None:
        """Raises ValueError for what is no URL of a drive, DriveError."""
        self._url = url
        self._drive: Drive | None = connect(url)

    def __call__(self) -> Drive:
        """Raises DriveError where it is not to be had."""
        if self._drive is not None:
            with contextlib.suppress(DriveError):
                self._drive.read("tick")
                return self._drive
            self._drive.close()
            self._drive = None
        self._drive = connect(self._url)
        return self._drive

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._drive is not None:
            self._drive.close()
