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
    momentary: bool = False  # for one write


@dataclass(frozen=True, slots=True)
class Change:
    """Somebody has become the writer of a part of a drive, or is it no longer."""

    drive: str
    part: Part
    holder: str
    at: datetime
    how: str  # it ended; empty: it began


class Leases:
    """The leases of every drive, by its name."""

    def __init__(
        self, device: Callable[[str], object] = lambda name: None, on_change: Callable[[Change], None] = lambda _: None
    ) -> None:
        """`device` tells which device has a name, None where that is not known: names of one device share a lease.

        `on_change` hears who becomes a writer, but for a moment's; it does not wait.
        """
        self._device, self._on_change = device, on_change
        self._lock = threading.Lock()
        self._writers: dict[tuple[str, Part], Writer] = {}

    def writer(self, drive: str, part: Part = Part.CONTROL) -> Writer | None:
        """Who writes to a part of a drive at present; None when nobody does."""
        with self._lock:
            return self._present(drive, part)

    def take(self, drive: str, holder: str, seconds: float, *parts: Part, momentary: bool = False) -> None:
        """Be the writer of these parts for so long; who is it already may be so for longer. Raises ConflictError.

        `momentary`: for one write, which is told elsewhere.
        """
        with self._lock:
            for part in parts:
                writer = self._present(drive, part)
                if writer is not None and writer.holder != holder:
                    what = "" if part is Part.CONTROL else "'s recorder"
                    raise ConflictError(
                        f"drive {drive}{what} takes one writer at a time, and {writer.holder} holds it "
                        f"until {writer.until:%H:%M:%S} UTC at the latest"
                    )
            now = datetime.now(UTC)
            writer = Writer(holder, now + timedelta(seconds=seconds), time.monotonic() + seconds, momentary)
            for part in parts:
                before = self._writers.get((drive, part))
                self._writers[drive, part] = writer
                if before is not None and before.holder == holder:
                    continue
                if before is not None and not before.momentary:
                    self._on_change(Change(drive, part, before.holder, before.until, "it was not renewed"))
                if not momentary:
                    self._on_change(Change(drive, part, holder, now, ""))

    def release(self, drive: str, holder: str, how: str = "given up") -> None:
        """Write no longer; without effect for who does not. `how` it ended, in words."""
        with self._lock:
            for key in [key for key, writer in self._writers.items() if key[0] == drive and writer.holder == holder]:
                writer = self._writers.pop(key)
                if not writer.momentary:
                    self._on_change(Change(*key, holder, datetime.now(UTC), how or "given up"))

    def _present(self, drive: str, part: Part) -> Writer | None:
        device, now = self._device(drive), time.monotonic()
        for (name, of), writer in self._writers.items():
            same = name == drive or (device is not None and self._device(name) == device)
            if same and of is part and writer.ends > now:
                return writer
        return None
