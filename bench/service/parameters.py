"""Snapshots of drives' parameters: read when something begins, told where they are other than before.

One thread reads, one drive after the other; nobody waits for it. Knows nothing of where they are kept.
"""

import contextlib
import queue
import threading
from collections.abc import Callable, Iterable, Mapping
from datetime import UTC, datetime
from typing import Final

from bench.actions.drive_jobs import BenchDrive, parameters_of
from bench.recordings.capture_file import device_of
from bench.store.catalogue.chronicle import ParameterSet
from drivers.drive import Identity
from drivers.errors import DriveError

_WAITING: Final = 100  # drives to read; beyond, what begins is not read for


class Snapshots:
    """Runs from `start` to `end`."""

    def __init__(self, drives: Mapping[str, BenchDrive], on_change: Callable[[ParameterSet], None]) -> None:
        """`on_change` hears of parameters that are other than before; it does not wait."""
        self._drives, self._on_change = drives, on_change
        self._queue: queue.Queue[tuple[str, str] | None] = queue.Queue(_WAITING)
        self._ending = threading.Event()
        self._lock = threading.Lock()
        self._latest: dict[str, tuple[str, Mapping[str, float | None]]] = {}  # by drive: its device, and what was told
        self.thread = threading.Thread(target=self._run, name="parameters", daemon=True)

    def recall(self, latest: Iterable[ParameterSet]) -> None:
        """What a service before this one told last; what this one has told stays."""
        with self._lock:
            for one in latest:
                self._latest.setdefault(one.drive, (one.device, one.values))

    def start(self) -> None:
        """Begin."""
        self.thread.start()

    def end(self) -> None:
        """Have it end; does not wait."""
        self._ending.set()
        with contextlib.suppress(queue.Full):
            self._queue.put_nowait(None)

    def join(self, timeout: float) -> None:
        """Wait for its end, at most so many seconds."""
        if self.thread.ident is not None:
            self.thread.join(timeout)

    def ask(self, drive: str, why: str) -> None:
        """Have a drive read, since something has begun. Never waits."""
        with contextlib.suppress(queue.Full):
            self._queue.put_nowait((drive, why))

    def read(self, drive: str, why: str, identity: Identity, values: Mapping[str, float | None]) -> None:
        """Parameters were read: they are told where they are other than before. Those that were not read stay."""
        device = device_of(identity)
        with self._lock:
            whose, before = self._latest.get(drive, ("", {}))
            now = {**(before if whose == device else {}), **values}
            if (whose, before) == (device, now):
                return
            self._latest[drive] = device, now
        self._on_change(ParameterSet(drive, datetime.now(UTC), why, device, now))

    def _run(self) -> None:
        while (asked := self._queue.get()) is not None and not self._ending.is_set():
            name, why = asked
            with contextlib.suppress(DriveError):  # without a link it is read when that is back
                drive = self._drives[name].link.drive()
                values = parameters_of(drive, self._ending.is_set)
                if values and not self._ending.is_set():
                    self.read(name, why, drive.identity, values)
