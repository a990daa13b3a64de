"""Who writes to a drive: one at a time for its set points and settings, one for its recorder, each until a time told.

Times are monotonic: a clock that is set ends no lease. Knows nothing of drives but their names. The lease in the drive
itself, which keeps other benches away, is in `drivers.lease`.
"""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from enum import StrEnum

from bench.errors import ConflictError


class Part(StrEnum):
    """What of a drive is written to; a capture may wait for the step that another writer makes."""

    CONTROL = "control"  # its set points, settings and state
    RECORDER = "recorder"


@dataclass(frozen=True, slots=True)
class Writer:
    """Who holds a lease."""

    holder: str  # as a sentence names it
    until: datetime  # it ends by itself then, unless renewed
    ends: float  # s, monotonic: the same


class Leases:
    """The leases of every drive, by its name."""

    def __init__(self, device: Callable[[str], object] = lambda name: None) -> None:
        """`device` tells which device has a name, None where that is not known: names of one device share a lease."""
        self._device = device
        self._lock = threading.Lock()
        self._writers: dict[tuple[str, Part], Writer] = {}

    def writer(self, drive: str, part: Part = Part.CONTROL) -> Writer | None:
        """Who writes to a part of a drive at present; None when nobody does."""
        with self._lock:
            return self._present(drive, part)

    def take(self, drive: str, holder: str, seconds: float, *parts: Part) -> None:
        """Be the writer of these parts for so long; who is it already may be so for longer. Raises ConflictError."""
        with self._lock:
            for part in parts:
                writer = self._present(drive, part)
                if writer is not None and writer.holder != holder:
                    what = "" if part is Part.CONTROL else "'s recorder"
                    raise ConflictError(
                        f"drive {drive}{what} takes one writer at a time, and {writer.holder} holds it "
                        f"until {writer.until:%H:%M:%S} UTC at the latest"
                    )
            until = datetime.now(UTC) + timedelta(seconds=seconds)
            self._writers |= dict.fromkeys(
                ((drive, part) for part in parts), Writer(holder, until, time.monotonic() + seconds)
            )

    def release(self, drive: str, holder: str) -> None:
        """Write no longer; without effect for who does not."""
        with self._lock:
            for key in [key for key, writer in self._writers.items() if key[0] == drive and writer.holder == holder]:
                del self._writers[key]

    def _present(self, drive: str, part: Part) -> Writer | None:
        device, now = self._device(drive), time.monotonic()
        for (name, of), writer in self._writers.items():
            same = name == drive or (device is not None and self._device(name) == device)
            if same and of is part and writer.ends > now:
                return writer
        return None
