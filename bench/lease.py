"""Who writes to a drive: one at a time, each until a time that is told. Knows nothing of drives but their names."""

import threading
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from bench.errors import ConflictError


@dataclass(frozen=True, slots=True)
class Writer:
    """Who holds a lease."""

    holder: str  # as a sentence names it
    until: datetime  # it ends by itself then, unless renewed


class Leases:
    """The lease of every drive, by its name: for whatever changes it, be it the recorder, a parameter or its state."""

    def __init__(self, device: Callable[[str], object] = lambda name: None) -> None:
        """`device` tells which device has a name, None where that is not known: names of one device share a lease."""
        self._device = device
        self._lock = threading.Lock()
        self._writers: dict[str, Writer] = {}

    def writer(self, drive: str) -> Writer | None:
        """Who writes to a drive at present; None when nobody does."""
        with self._lock:
            return self._present(drive)

    def take(self, drive: str, holder: str, seconds: float) -> None:
        """Be the writer for so long; who is it already may be so for longer. Raises ConflictError."""
        with self._lock:
            writer = self._present(drive)
            if writer is not None and writer.holder != holder:
                raise ConflictError(
                    f"drive {drive} takes one writer at a time, and {writer.holder} holds it "
                    f"until {writer.until:%H:%M:%S} UTC at the latest"
                )
            self._writers[drive] = Writer(holder, datetime.now(UTC) + timedelta(seconds=seconds))

    def release(self, drive: str, holder: str) -> None:
        """Write no longer; without effect for who does not."""
        with self._lock:
            if drive in self._writers and self._writers[drive].holder == holder:
                del self._writers[drive]

    def _present(self, drive: str) -> Writer | None:
        device, now = self._device(drive), datetime.now(UTC)
        for name, writer in self._writers.items():
            same = name == drive or (device is not None and self._device(name) == device)
            if same and writer.until > now:
                return writer
        return None
