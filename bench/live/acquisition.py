"""Acquisition: one pump thread per drive. Connects, streams, counts, reconnects; hands every block on.

Knows nothing of estimators or HTTP. Its state is one immutable value that readers take as it is.
"""

import contextlib
import math
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from enum import StrEnum

from bench.live.drive_clock import DriveClock, ticks_between
from drivers.block import Block
from drivers.connect import connect
from drivers.drive import Drive, Identity
from drivers.errors import DriveError, LostError, ResetError

RETRY = (0.25, 4.0)  # s, first and longest wait before connecting again
_CLOCK_DOUBT = 1.0  # s by which a drive's clock and ours may disagree over an outage and be the same clock still
_LAG_DOUBT = 0.25  # s that rows seem to be late by, for which the drive is asked for its tick
_LAG_ASKED = 1.0  # s between two such questions
_LAG_MOST = (1.0, 2.0)  # s by which a stream may be late, and for how long: then it is begun anew
_RATE_SPAN = 2.0  # s, over which the stream's rate is measured,
_RATE_STEP = 0.05  # s, by arrivals so far apart


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
    frames_late: int = 0  # that came twice, or too late
    frames_foreign: int = 0  # under the stream's name, but not of it
    clock_resets: int = 0  # times the drive's clock began anew: what it made just before is not known
    note: str = ""  # what the bench has changed of the stream by itself
    made: float | None = None  # s, monotonic, when the latest row ended in the drive
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
        """Seconds since the end of the latest row, by the drive's tick; None before the first."""
        return None if self.made is None else max(0.0, time.monotonic() - self.made)


class Acquisition:
    """The pump of one drive; runs from `start` to `end`."""

    def __init__(
        self, name: str, url: str, on_block: Callable[[Block], None],
        on_drive: Callable[[Drive], None] = lambda _: None,
        on_event: Callable[[str, str], None] = lambda _kind, _sentence: None,
    ) -> None:
        """`on_drive` has each connection before its stream begins. It may raise DriveError.

        `on_event` hears of links lost and back (`link`) and clocks begun anew (`clock`), a sentence each.
        """
        self._on_event = on_event
        self._name = name
        self._url = url
        self._on_block, self._on_drive = on_block, on_drive
        self._stop = threading.Event()
        self._drive: Drive | None = None
        self._drive_lock = threading.Lock()
        self._next_tick: int | None = None  # None: the drive's clock has begun anew
        self._clock: DriveClock | None = None
        self._asked = 0.0  # s, monotonic, when the drive was asked for its tick
        self._lost = 0.0  # s, monotonic, when the latest stream was
        self._lagging: float | None = None  # s, monotonic, since when the stream is too late
        self._frames = (0, 0)  # late and foreign ones of the present stream
        self._arrivals: deque[tuple[float, int]] = deque()
        self.thread = threading.Thread(target=self._run, name=f"pump {name}", daemon=True)
        self.status = Link(LinkState.CONNECTING, _now())

    def drive(self) -> Drive:
        """The drive, connected, for whoever asks it for more than its stream. Raises LostError while it is not."""
        with self._drive_lock:
            drive = self._drive
        if drive is None:
            error = self.status.last_error
            raise LostError(f"there is no link to drive {self._name}" + (f": {error.sentence}" if error else ""))
        return drive

    def start(self) -> None:
        """Begin; returns at once, whether or not the drive is there."""
        self.thread.start()

    def end(self) -> None:
        """Close the link and let the thread come to its end; it may be held up in connecting for some seconds."""
        self._stop.set()
        with self._drive_lock:
            drive = self._drive
        if drive is not None:
            drive.close()

    def join(self, timeout: float) -> None:
        """Wait for the thread's end, at most so many seconds."""
        if self.thread.ident is not None:
            self.thread.join(timeout)

    def _run(self) -> None:
        wait = RETRY[0]
        while not self._stop.is_set():
            try:
                with connect(self._url) as drive:
                    self._on_drive(drive)
                    self.status = replace(self.status, identity=drive.identity)
                    with self._drive_lock:
                        self._drive = drive
                    for block in drive.stream() if not self._stop.is_set() else ():
                        self._take(block, drive)
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
        link, now = self.status, _now()
        if link.state is LinkState.STREAMING:
            link, self._lost = replace(link, state=LinkState.LOST, since=now), time.monotonic()
            if not self._stop.is_set():
                self._on_event("link", f"lost: {sentence}")
        self.status = replace(link, last_error=Failure(sentence, now))

    def _take(self, block: Block, drive: Drive) -> None:
        link, now = self.status, time.monotonic()
        gaps, lost, resets = int(block.lost_before > 0), block.lost_before, 0
        if link.state is not LinkState.STREAMING:
            if link.made is not None:  # rows between two sessions
                gaps, (lost, resets) = 1, self._missed(block, now, link.made)
            again = link.state is LinkState.LOST
            self._tell_begin(drive, link, lost, resets)
            link = replace(link, state=LinkState.STREAMING, since=_now(), reconnects=link.reconnects + again)
            self._arrivals.clear()
            self._clock, self._lagging, self._frames = None, None, (0, 0)
        self._next_tick = block.end
        rows = link.rows + len(block)
        if len(self._arrivals) > 1 and now - self._arrivals[-2][0] < _RATE_STEP:
            self._arrivals.pop()
        self._arrivals.append((now, rows))
        while now - self._arrivals[0][0] > _RATE_SPAN:
            self._arrivals.popleft()
        made, counts, (late, foreign) = self._made(block.T_s, now, drive), drive.counts, self._frames
        self._frames = (counts.frames_late, counts.frames_foreign)
        self.status = replace(
            link, identity=drive.identity, row_time=block.periods * block.T_s, rows=rows, gaps=link.gaps + gaps,
            rows_lost=link.rows_lost + lost, clock_resets=link.clock_resets + resets, note=drive.note,
            frames_late=link.frames_late + _more(late, counts.frames_late),
            frames_foreign=link.frames_foreign + _more(foreign, counts.frames_foreign),
            made=made, t_drive=self._next_tick * block.T_s, arrivals=tuple(self._arrivals),
        )
        self._on_block(block)
        self._check_lag(now, now - made)

    def _tell_begin(self, drive: Drive, before: Link, lost: int, resets: int) -> None:
        if before.state is LinkState.LOST:
            self._on_event("link", f"back after {time.monotonic() - self._lost:.3g} s, in which {lost} rows were lost")
        else:
            self._on_event("link", f"there: {drive.identity.device_name}, serial {drive.identity.serial}")
        if resets:
            self._on_event("clock", "the drive's clock has begun anew, as by a reset")

    def _made(self, T_s: float, now: float, drive: Drive) -> float:
        """When the latest row ended in the drive."""
        assert self._next_tick is not None
        first = self._clock is None
        clock = self._clock = self._clock or DriveClock(T_s, self._next_tick, now)
        made = clock.came(self._next_tick, now)
        if first or (now - made > _LAG_DOUBT and now - self._asked > _LAG_ASKED):
            self._asked = now
            with contextlib.suppress(DriveError):  # the stream tells, too, where it is gone
                tick = int(drive.read("tick"))
                made = clock.told(tick, now, time.monotonic())
        return made

    def _check_lag(self, now: float, lag: float) -> None:
        """Raise LostError where the stream lags for long."""
        self._lagging = None if lag <= _LAG_MOST[0] else self._lagging or now
        if self._lagging is not None and now - self._lagging > _LAG_MOST[1]:
            raise LostError(f"the stream lags {lag:.1f} s behind the drive: its line does not carry it; it begins anew")

    def _missed(self, block: Block, now: float, made: float) -> tuple[int, int]:
        """Rows that the drive made in an outage, as far as they are known, and whether its clock began anew in it.

        `made`: when the latest row before it ended, in s, as `now`.
        """
        tick, outage = int(block.tick[0]), now - made
        known = self._next_tick is not None and self._clock is not None
        missed = ticks_between(self._next_tick or 0, tick)
        was_up = tick * block.T_s > outage + _CLOCK_DOUBT  # since before the outage: it may not have been reset in it
        same = abs(missed * block.T_s - outage) < _CLOCK_DOUBT
        if known and missed >= 0 and (was_up or same):
            return math.ceil(missed / block.periods), 0
        return tick // block.periods, 1


def _more(before: int, now: int) -> int:
    """What a count has grown by, be it begun anew meanwhile."""
    return now - before if now >= before else now


def _now() -> datetime:
    return datetime.now(UTC)
