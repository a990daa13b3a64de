"""Who writes to a drive: one at a time, each until a time that is told. Knows nothing of drives but their names."""

import threading
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from bench.errors import ConflictError


@dataclass(frozen=True, slots=True)
class Writer:
    """Who holds a lease."""

    holder: str  # as a sentence names it
    until: datetime  # it ends by itself then, unless renewed


class Lease:
    """The lease of one drive: for whatever changes it, be it the recorder, a parameter or its state."""

    def __init__(self, drive: str) -> None:
        self._drive = drive
        self._lock = threading.Lock()
        self._writer: Writer | None = None

    @property
    def writer(self) -> Writer | None:
        """Who writes at present; None when nobody does."""
        with self._lock:
            return self._present()

    def take(self, holder: str, seconds: float) -> None:
        """Be the writer for so long; who is it already may be so for longer. Raises ConflictError."""
        with self._lock:
            writer = self._present()
            if writer is not None and writer.holder != holder:
                raise ConflictError(
                    f"drive {self._drive} takes one writer at a time, and {writer.holder} holds it "
                    f"until {writer.until:%H:%M:%S} UTC at the latest"
                )
            self._writer = Writer(holder, datetime.now(UTC) + timedelta(seconds=seconds))

    def release(self, holder: str) -> None:
        """Write no longer; without effect for who does not."""
        with self._lock:
            if self._writer is not None and self._writer.holder == holder:
                self._writer = None

    def _present(self) -> Writer | None:
        return self._writer if self._writer is not None and self._writer.until > datetime.now(UTC) else None
