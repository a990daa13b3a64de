"""Acquisition: one pump thread per drive. Connects, streams, counts, reconnects; hands every block on.

Knows nothing of estimators or HTTP. Its state is one immutable value that readers take as it is.
"""

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from enum import StrEnum

from drivers.block import Block
from drivers.connect import connect
from drivers.drive import Drive, Identity
from drivers.errors import DriveError, LostError, ResetError

RETRY = (0.25, 4.0)  # s, first and longest wait before connecting again
_CLOCK_DOUBT = 1.0  # s by which a drive's clock and ours may disagree over an outage and be the same clock still
_RATE_SPAN = 2.0  # s, over which the stream's rate is measured


class LinkState(StrEnum):
    """Where the link to a drive stands."""

    CONNECTING = "connecting"  # never had it yet
    STREAMING = "streaming"
    LOST = "lost"  # had it; trying to get it back


@dataclass(frozen=True, slots=True)
class Failure:
    """What went wrong last, and when."""

    sentence: str
    time: datetime


@dataclass(frozen=True, slots=True)
class Link:
    """A drive's link and stream at one moment."""

    state: LinkState
    since: datetime
    reconnects: int = 0
    last_error: Failure | None = None
    identity: Identity | None = None
    row_time: float | None = None  # s between rows
    rows: int = 0
    gaps: int = 0
    rows_lost: int = 0
    received: float | None = None  # s, monotonic, when the latest block came
    t_drive: float | None = None  # s, drive's clock at the end of the latest row
    arrivals: tuple[tuple[float, int], ...] = ()  # (s monotonic, rows so far) within the last _RATE_SPAN

    @property
    def rate(self) -> float:
        """Rows per second over the last seconds; 0 when none come."""
        now = time.monotonic()
        recent = [arrival for arrival in self.arrivals if now - arrival[0] < _RATE_SPAN]
        if len(recent) < 2 or recent[-1][0] == recent[0][0]:
            return 0.0
        return (recent[-1][1] - recent[0][1]) / (recent[-1][0] - recent[0][0])

    @property
    def age(self) -> float | None:
        """Seconds since the latest block; None before the first."""
        return None if self.received is None else time.monotonic() - self.received


class Acquisition:
    """The pump of one drive; runs from `start` to `end`."""

    def __init__(self, name: str, url: str, on_block: Callable[[Block], None]) -> None:
        self._name = name
        self._url = url
        self._on_block = on_block
        self._stop = threading.Event()
        self._drive: Drive | None = None
        self._drive_lock = threading.Lock()
        self._next_tick: int | None = None  # None: the drive's clock has begun anew
        self._arrivals: deque[tuple[float, int]] = deque()
        self._thread = threading.Thread(target=self._run, name=f"pump {name}", daemon=True)
        self.link = Link(LinkState.CONNECTING, _now())

    @property
    def thread(self) -> threading.Thread:
        """The pump's thread, for the health page."""
        return self._thread

    def drive(self) -> Drive:
        """The drive, connected, for whoever asks it for more than its stream. Raises LostError while it is not."""
        with self._drive_lock:
            drive = self._drive
        if drive is None:
            error = self.link.last_error
            raise LostError(f"there is no link to drive {self._name}" + (f": {error.sentence}" if error else ""))
        return drive

    def start(self) -> None:
        """Begin; returns at once, whether or not the drive is there."""
        self._thread.start()

    def end(self) -> None:
        """Close the link and let the thread come to its end; it may be held up in connecting for some seconds."""
        self._stop.set()
        with self._drive_lock:
            drive = self._drive
        if drive is not None:
            drive.close()

    def join(self, timeout: float) -> None:
        """Wait for the thread's end, at most so many seconds."""
        if self._thread.ident is not None:
            self._thread.join(timeout)

    def _run(self) -> None:
        wait = RETRY[0]
        while not self._stop.is_set():
            try:
                with connect(self._url) as drive:
                    self.link = replace(self.link, identity=drive.identity)
                    with self._drive_lock:
                        self._drive = drive
                    for block in drive.stream() if not self._stop.is_set() else ():
                        self._take(block, drive.identity)
                        wait = RETRY[0]
            except ResetError as error:
                self._next_tick = None
                self._failed(str(error))
            except DriveError as error:
                self._failed(str(error))
            except Exception as error:  # noqa: BLE001 - a fault of ours must not end a drive's pump in silence
                self._failed(f"the bench failed on this drive: {type(error).__name__}: {error}")
            finally:
                with self._drive_lock:
                    self._drive = None
            self._stop.wait(wait)
            wait = min(2.0 * wait, RETRY[1])

    def _failed(self, sentence: str) -> None:
        link = self.link
        lost = link.state is not LinkState.CONNECTING
        self.link = replace(
            link,
            state=LinkState.LOST if lost else LinkState.CONNECTING,
            since=link.since if link.state is not LinkState.STREAMING else _now(),
            last_error=Failure(sentence, _now()),
        )

    def _take(self, block: Block, identity: Identity) -> None:
        link, now = self.link, time.monotonic()
        gaps, lost = int(block.lost_before > 0), block.lost_before
        if link.state is not LinkState.STREAMING:
            if link.received is not None:  # rows between two sessions
                gaps, lost = 1, self._missed(block, now - link.received)
            again = link.state is LinkState.LOST
            link = replace(link, state=LinkState.STREAMING, since=_now(), reconnects=link.reconnects + again)
            self._arrivals.clear()
        self._next_tick = int(block.tick[-1]) + block.periods
        rows = link.rows + len(block)
        self._arrivals.append((now, rows))
        while now - self._arrivals[0][0] > _RATE_SPAN:
            self._arrivals.popleft()
        self.link = replace(
            link, identity=identity, row_time=block.periods * block.T_s, rows=rows, gaps=link.gaps + gaps,
            rows_lost=link.rows_lost + lost, received=now, t_drive=self._next_tick * block.T_s,
            arrivals=tuple(self._arrivals),
        )
        self._on_block(block)

    def _missed(self, block: Block, outage: float) -> int:
        """Rows that the drive made in an outage of so many s, where it did not begin anew."""
        missed = 0 if self._next_tick is None else int(block.tick[0]) - self._next_tick
        went_on = abs(missed * block.T_s - outage) < _CLOCK_DOUBT  # it may have been reset without saying so
        return max(0, math.ceil(missed / block.periods)) if went_on else 0


def _now() -> datetime:
    return datetime.now(UTC)
