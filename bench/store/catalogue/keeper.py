"""The thread that writes to the catalogue: once a second it asks for points of the history, and writes them and what it
was told; where there is nothing to write, it looks whether the catalogue is still there.

What cannot be written waits, an hour's at most, and is tried again: the service lives without its catalogue.
"""

import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

from bench.errors import BenchError, UnavailableError
from bench.store.catalogue.database import opened
from bench.store.catalogue.memory import Memory, Point

_PERIOD: Final = 1.0  # s
_RETRY: Final = 10.0  # s, after a failure
_CONDENSE: Final = 60.0  # s
_PRUNE: Final = 3600.0  # s
_WAITING: Final = 4 * 4 * 3600  # points
_SLOW: Final = 10.0  # s, within which a catalogue answers
_TOLD: Final = 20_000  # that wait besides

Write = Callable[[Memory], object]


class Keeper:
    """It runs from `start` to `end`; `failure` tells what is wrong at present."""

    def __init__(
        self, address: str, bench: str, points: Callable[[], Iterable[Point]],
        on_open: Callable[[Memory], None] = lambda _: None,
    ) -> None:
        """`on_open` hears, once, that the catalogue is open and can be read."""
        self.bench = bench
        self._address, self._points, self._on_open = address, points, on_open
        self._waiting: deque[Point] = deque(maxlen=_WAITING)
        self._told: deque[Write] = deque()
        self._opening = threading.Lock()
        self._ending = threading.Event()
        self._failure: str | None = None
        self._asked: float | None = None  # s, monotonic, since when an answer of the catalogue is waited for
        self._away = False  # the latest failure was that the catalogue cannot be had
        self.memory: Memory | None = None  # as soon as the catalogue is open
        self._heard = False  # whether `on_open` has been
        self.thread = threading.Thread(target=self._run, name="history", daemon=True)

    @property
    def failure(self) -> str | None:
        """What is wrong; None where nothing is."""
        asked = self._asked
        waited = 0.0 if asked is None else time.monotonic() - asked
        return self._failure if waited < _SLOW else f"the catalogue has not answered for {waited:.0f} s"

    def open(self) -> Memory | None:
        """The catalogue, once; None where it cannot be had now."""
        with self._opening:
            if self.memory is None:
                try:
                    self.memory, self._failure = Memory(opened(self._address), self.bench), None
                except BenchError as error:
                    self._failure = str(error)
            return self.memory

    def tell(self, write: Write) -> None:
        """Have something written, soon, by this thread. Never waits; what is too much to wait is not written."""
        if len(self._told) < _TOLD:
            self._told.append(write)

    def window(self, drive: str, configured: Mapping[str, Any]) -> dict[str, Any] | None:
        """The settings chosen last, see `Memory.window`; None where they cannot be had."""
        found: list[dict[str, Any] | None] = [None]
        if (memory := self.open()) is not None:
            self._guarded(lambda: found.append(memory.window(drive, configured)))
        return found[-1]

    def remember_window(self, drive: str, configured: Mapping[str, Any], settings: Mapping[str, Any]) -> None:
        """Settings that somebody has chosen; `failure` tells where they cannot be remembered."""
        self.tell(lambda memory: memory.remember_window(drive, configured, settings))

    def read(self) -> None:
        """Have `on_open` hear that the catalogue is open, where it is and that has not been."""
        if (memory := self.memory) is not None and not self._heard:
            self._heard = self._guarded(lambda: self._on_open(memory))

    def start(self) -> None:
        """Begin."""
        self.thread.start()

    def end(self) -> None:
        """Have it end; does not wait."""
        self._ending.set()

    def join(self, timeout: float) -> None:
        """Wait for its end, at most so many seconds."""
        if self.thread.ident is not None:
            self.thread.join(timeout)

    def _run(self) -> None:
        tried = condensed = pruned = 0.0
        while not self._ending.wait(_PERIOD - time.time() % _PERIOD):
            self._waiting.extend(self._points())
            now = time.monotonic()
            if self._failure is not None and now - tried < _RETRY:
                continue
            tried = now
            if self._keep() and now - condensed > _CONDENSE:
                condensed = now
                self._guarded(self._condense)
                if now - pruned > _PRUNE:
                    pruned = now
                    self._guarded(self._prune)
        self._keep()
        if self.memory is not None:
            self.memory.close()

    def _keep(self) -> bool:
        """Everything that waits into the catalogue; whether that went well."""
        memory, points = self.open(), list(self._waiting)
        if memory is None or not self._guarded(lambda: memory.add(points) if points else memory.look()):
            return False
        for _ in points:
            self._waiting.popleft()
        self.read()
        while self._told:
            write = self._told[0]
            if not self._guarded(lambda write=write: write(memory)) and self._away:
                return False
            self._told.popleft()
        return True

    def _condense(self) -> None:
        if self.memory is not None:
            self.memory.condense(time.time())

    def _prune(self) -> None:
        if self.memory is not None:
            self.memory.chronicle.prune()

    def _guarded(self, step: Callable[[], object]) -> bool:
        self._asked = time.monotonic()
        try:
            step()
        except Exception as error:  # noqa: BLE001 - a fault of ours must not end the history in silence
            known = isinstance(error, BenchError)
            self._failure = str(error) if known else f"{type(error).__name__}: {error}"
            self._away = isinstance(error, UnavailableError)  # else it is no use to try the same again
            return False
        finally:
            self._asked = None
        self._failure = None
        return True
