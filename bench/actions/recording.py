"""One recording of a drive's stream, from its trigger to a Parquet on disk. Knows nothing of HTTP.

The pump hands blocks over and never waits; a thread of the recording's own puts them on disk four times a second. What
ends a recording by itself - a limit, a full disk, rows of another length - is said, in the recording too.
"""

import contextlib
import shutil
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime, timedelta
from enum import StrEnum
from importlib import metadata
from pathlib import Path
from typing import Any, Final

import numpy as np

from bench.actions.capture_request import EDGES, Level
from bench.actions.drive_jobs import BenchDrive, id_at, parameters_of
from bench.actions.recording_request import RecordingRequest
from bench.errors import BenchError, ConflictError
from bench.live.acquisition import Link
from bench.recordings.capture_file import device_of
from bench.store.annotations import Mark
from bench.store.closing import closed
from bench.store.rows import COLUMNS, Rows, joined, steps_of
from bench.store.segments import Event, FoundSegments, Heading, Segments
from bench.store.timeline import Gap, Timeline
from drivers.block import Block
from drivers.drive import Identity
from drivers.errors import DriveError

_PERIOD: Final = 0.25  # s between two looks
_PARAMETERS: Final = 2.0  # s that a recording which has ended waits for the drive's settings
_BEHIND: Final = 200_000  # rows that wait for the disk at most: some minutes
_ROOM_PERIOD: Final = 5.0  # s between two looks at a disk that is too full to close a recording
_AT_ONCE: Final = 300_000  # rows, of which a recording is closed even as the service ends


class State(StrEnum):
    """Where a recording stands; the last three are ends."""

    ARMED = "armed"
    RECORDING = "recording"
    CLOSING = "closing"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"

    @property
    def ended(self) -> bool:
        """Nothing more will come of it."""
        return self in (State.DONE, State.FAILED, State.CANCELLED)


@dataclass(frozen=True, slots=True)
class Status:
    """A recording at one moment."""

    id: str
    drive: str
    request: RecordingRequest
    asked: datetime
    whom: str = ""
    state: State = State.ARMED
    rows: int = 0
    seconds: float = 0.0  # from the first row's start to the last one's end
    bytes: int = 0  # on disk
    gaps: int = 0
    rows_lost: int = 0  # that the drive made in these, as far as it is known
    reason: str = ""  # why it ended, or what it waits for
    file: Path | None = None  # the recording, when it is closed
    continues: str = ""  # id of the one that it goes on with
    marks: tuple[Mark, ...] = ()


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What a recording is told of besides the stream, by a drive's name."""

    state: Callable[[str], str]  # of the drive, in words
    window: Callable[[str], dict[str, Any]]  # of the estimation
    # Hears a drive's own settings, by its name, and what they were read for; does not wait
    parameters: Callable[[str, str, Identity, Mapping[str, float | None]], None]


class Run:
    """A recording under way: `put` from the pump, `work` in a thread of its own, the rest from any thread."""

    def __init__(
        self, status: Status, drive: BenchDrive, folder: Path, kept_free: float, around: Surroundings,
        on_change: Callable[[Status], None],
    ) -> None:
        """`kept_free`: bytes of the disk that it leaves for others."""
        self.status = status
        self.again: str = ""  # the recording ended only since rows have changed: why
        self._drive, self._folder, self._kept_free = drive, folder, kept_free
        self._around, self._on_change = around, on_change
        self._lock = threading.Lock()  # guards what follows
        self._blocks: deque[tuple[Block, Link]] = deque()
        self._waiting = self._dropped = 0  # rows
        self._rest: list[tuple[Block, Link]] = []  # those of the other length
        self._next: Run | None = None  # which goes on with them
        self._events: list[Event] = []  # to come, without a place
        self._end = threading.Event()
        self._why = ""
        self._leaving = self._discarded = False
        # Of the thread alone
        self._asked = time.monotonic()
        self._timeline = Timeline()
        self._before: deque[Rows] = deque()  # the trigger
        self._last: float | None = None  # value that the trigger's signal had in the latest row
        self._offset = 0  # control periods from the timeline's begin to the recording's
        self._trigger = 0  # its place
        self._row: tuple[Identity, int] | None = None  # whose, of how many periods
        self._segments: Segments | None = None
        self._drive_state = ""
        self._T_s = 0.0  # s

    # --- from any thread

    def put(self, block: Block, link: Link) -> None:
        """A block has come; `link` as it is now. Does not wait."""
        with self._lock:
            if self._next is not None:
                self._next.put(block, link)
            elif self._end.is_set() and not self.again:
                return
            elif self._waiting + len(block) > _BEHIND:
                self._dropped += len(block)
            else:
                self._blocks.append((block, link))
                self._waiting += len(block)

    def hand_over(self, to: "Run") -> None:
        """Give all rows of the other length to the recording that goes on, those that have come meanwhile, too."""
        with self._lock:
            for block, link in (*self._rest, *self._blocks):
                to.put(block, link)
            self._rest, self._next = [], to
            self._blocks.clear()

    def mark(self, text: str, whom: str) -> None:
        """Mark the newest row. Raises ConflictError before there are rows."""
        if self.status.state is not State.RECORDING:
            raise ConflictError(f"recording {self.status.id} is {self.status.state}, there is nothing to mark")
        mark = Mark(self.status.seconds, text, whom, _now())
        place = round(mark.t / self._T_s) if self._T_s else 0
        self._tell_event({"place": place, "what": "mark", "text": text, "whom": whom, "at": mark.at})
        self._tell(marks=(*self.status.marks, mark))

    def stop(self, why: str) -> None:
        """Have it end, and what was recorded closed; does not wait."""
        self._why = self._why or why
        self._end.set()

    def cancel(self) -> None:
        """Have it end, and what was recorded discarded; does not wait."""
        self._discarded = True
        self.stop("discarded")

    def leave(self) -> None:
        """Have it end, since the service does: what is not closed soon, the next service closes."""
        self._leaving = True
        self.stop("the service ended")

    # --- the recording's thread

    def work(self) -> None:
        """All of it; the status tells how it went."""
        reader = threading.Thread(target=self._read_parameters, name=f"parameters {self.status.id}", daemon=True)
        reader.start()
        try:
            while not self._end.wait(_PERIOD):
                self._take()
            self._take()
            if not self._leaving and not self._discarded:  # of a short one
                reader.join(_PARAMETERS)
                self._take()
        except OSError as error:
            self.stop(f"it cannot be written: {error.strerror or error}")
        except Exception as error:  # noqa: BLE001 - a fault of ours must not leave a recording without an end
            self.stop(f"the bench failed on this recording: {type(error).__name__}: {error}")
        try:
            self._close()
        except (OSError, BenchError) as error:
            left = "what there is stays on disk, and is closed when the service starts again"
            self._tell(state=State.FAILED, reason=f"{self._why}; {getattr(error, 'strerror', '') or error}; {left}")

    def _take(self) -> None:
        """What has come since: to disk, or to what is kept before the trigger."""
        with self._lock:
            blocks, self._waiting = list(self._blocks), 0
            self._blocks.clear()
            events, self._events = self._events, []
            dropped, self._dropped = self._dropped, 0
        fresh: list[Rows] = []
        gaps: list[Gap] = []
        for k, (block, link) in enumerate(blocks):
            if self._others(block, link):
                self.stop(self.again)
                self._rest += blocks[k:]
                break
            rows, gap = self._timeline.rows(block, link)
            gaps += [] if gap is None else [gap]
            fresh.append(rows)
        if dropped:
            events.append({"what": "dropped", "rows": dropped, "why": "the disk was too slow"})
        if (state := self._around.state(self.status.drive)) != self._drive_state:
            self._drive_state = state
            events.append({"what": "drive", "state": state})
        if self.status.state is State.ARMED:
            fresh = self._triggered(fresh)
        if self._segments is None and fresh:
            self._segments = self._begun(fresh, blocks[-1][1])
        if self._segments is None:
            with self._lock:
                self._events = events + self._events
            self._wait_for_trigger()
        else:
            gaps = [gap for gap in gaps if gap.place > self._offset]
            events += [gap.event(self._offset) for gap in gaps]
            lost = dropped + sum(gap.rows for gap in gaps)
            self._write(self._segments, [rows.moved(-self._offset) for rows in fresh], events)
            self._tell(gaps=self.status.gaps + len(gaps), rows_lost=self.status.rows_lost + lost)

    def _others(self, block: Block, link: Link) -> bool:
        """These rows are of another length, or of another drive, than those before."""
        assert link.identity is not None, "rows have come"
        row = (link.identity, block.periods)
        if self._row is None:
            self._row, self._T_s = row, block.T_s
        if row == self._row or self.again:
            return bool(self.again)
        if row[0] != self._row[0]:
            self.again = f"another drive answers: {device_of(row[0])}"
        else:
            self.again = f"rows have become {row[1]} control periods long, from {self._row[1]}"
        if block.lost_before:
            self.again += f"; {block.lost_before} of the new ones are lost before the recording that goes on"
        return True

    def _triggered(self, fresh: list[Rows]) -> list[Rows]:
        """The rows from the recording's begin on; none before the trigger."""
        level = self.status.request.trigger
        if not isinstance(level, Level):
            if fresh:
                self._offset = fresh[0].place
                self._tell(state=State.RECORDING, reason="")
            return fresh
        for k, rows in enumerate(fresh):
            at = self._crossing(rows, level)
            if at is None:
                self._before.append(rows)
                continue
            trigger = rows.place + at * rows.periods
            kept = [*self._before, rows, *fresh[k + 1 :]]
            self._before.clear()
            begin = trigger - round(self.status.request.pre_trigger_s / self._T_s)
            kept = [part for one in kept if len(part := one.part(slice(_rows_before(one, begin), None)))]
            self._offset = kept[0].place
            self._trigger = trigger - self._offset
            self._tell_event({"place": self._trigger, "what": "trigger", "trigger": str(level)})
            self._tell(state=State.RECORDING, reason="")
            return kept
        self._forget()
        return []

    def _crossing(self, rows: Rows, level: Level) -> int | None:
        """The first row that the level is crossed at."""
        column = rows.columns[COLUMNS.index(level.signal)]
        values = np.concatenate(([column[0] if self._last is None else self._last], column))
        self._last = float(column[-1])
        above, edge = values >= level.level, EDGES[level.edge]
        crossed = np.flatnonzero(above[1:] != above[:-1]) if edge == 0 else np.flatnonzero(
            (above[1:] & ~above[:-1]) if edge > 0 else (~above[1:] & above[:-1])
        )
        return int(crossed[0]) if len(crossed) else None

    def _forget(self) -> None:
        """What is too long ago to be before the trigger."""
        most = round(self.status.request.pre_trigger_s / self._T_s) if self._T_s else 0
        while self._before and self._before[-1].end - self._before[0].end > most:
            self._before.popleft()

    def _wait_for_trigger(self) -> None:
        request = self.status.request
        waited = time.monotonic() - self._asked
        if request.timeout_s is not None and waited > request.timeout_s:
            self.stop(f"the trigger, {request.trigger}, has not come within {request.timeout_s:g} s")
        elif isinstance(request.trigger, Level):
            self._tell(reason=f"waiting for {request.trigger}")
        else:
            self._tell(reason="waiting for the first row")

    def _begun(self, fresh: list[Rows], link: Link) -> Segments:
        """The first segment, as it is known now what the rows are. Raises OSError."""
        assert self._row is not None, "rows have come"
        identity, periods = self._row
        since = (fresh[-1].end - fresh[0].place) * self._T_s
        since += time.monotonic() - link.made if link.made is not None else 0.0
        status = self.status
        return Segments(self._folder, Heading(
            status.id, status.drive, self._drive.url, device_of(identity), identity.layout_id,
            status.asked.isoformat(), status.whom, (datetime.now(UTC) - timedelta(seconds=since)).isoformat(),
            status.request.as_json(), self._T_s, periods, steps_of(identity.full), self._around.window(status.drive),
            asdict(self._drive.nominal), {"pmsm-bench": metadata.version("pmsm-bench")}, status.continues,
        ))  # fmt: skip

    def _write(self, segments: Segments, fresh: list[Rows], events: list[Event]) -> None:
        request, status = self.status.request, self.status
        place = round(status.seconds / self._T_s)
        most = None if request.seconds is None else self._trigger + round(request.seconds / self._T_s)
        for one in joined(fresh):
            rows = one if most is None else one.part(slice(None, _rows_before(one, most)))
            if len(rows):
                segments.rows(rows)
                place = rows.end
                status = replace(status, rows=status.rows + len(rows))
        for event in events:
            segments.event({"place": place} | event)
        self._tell(
            rows=status.rows, seconds=place * self._T_s, bytes=segments.size,
            reason="" if fresh else self.status.reason,
        )
        if most is not None and place >= most:
            self.stop(f"its {request.seconds:g} s are over")
        if request.megabytes is not None and segments.size >= request.megabytes * 1e6:
            self.stop(f"its {request.megabytes:g} MB are full")
        if (free := shutil.disk_usage(self._folder).free) < self._kept_free + segments.size:
            self.stop(f"the disk is nearly full: {free / 1e6:.4g} MB are free")

    def _close(self) -> None:
        """What was recorded becomes a Parquet. Raises OSError, BenchError."""
        if (segments := self._segments) is None:
            state = State.CANCELLED if self._discarded or self._leaving else State.FAILED
            self._tell(state=state, reason=self._why or "no row came")
            return
        with contextlib.suppress(OSError):
            segments.event({"place": round(self.status.seconds / self._T_s), "what": "ended", "why": self._why,
                            "at": _now()})  # fmt: skip
        segments.close()
        found = FoundSegments.found(self._folder, self.status.id)
        assert found is not None, "nobody else has them"
        with contextlib.closing(found):
            if self._discarded:
                found.remove()
                self._tell(state=State.CANCELLED, reason=self._why)
                return
            self._tell(state=State.CLOSING, reason=self._why)
            if self._leaving and self.status.rows > _AT_ONCE:
                self._tell(reason="the service ended; what there is is closed when it starts again")
                return
            path = self._closed(found)
        if path is None:
            self._tell(state=State.FAILED, reason=f"{self._why}: no row was recorded")
        else:
            self._tell(state=State.DONE, reason=self._why, file=path, bytes=path.stat().st_size)

    def _closed(self, found: FoundSegments) -> Path | None:
        """Waits for room on the disk while the service runs."""
        while True:
            try:
                return closed(found, self._why)
            except OSError as error:
                if self._leaving:
                    raise
                self._tell(reason=f"{self._why}; it is closed when there is room: {error.strerror or error}")
                time.sleep(_ROOM_PERIOD)

    def _read_parameters(self) -> None:
        """The drive's own settings, on whatever line, while the recording goes on."""
        with contextlib.suppress(DriveError):
            drive = self._drive.link.drive()
            values = parameters_of(drive, lambda: self._leaving or self._discarded)
            if values and not self._leaving and not self._discarded:
                self._tell_event({"what": "parameters", "values": values})
                self._around.parameters(self.status.drive, f"recording {self.status.id}", drive.identity, values)

    def _tell_event(self, event: Event) -> None:
        with self._lock:
            self._events.append(event)

    def _tell(self, **changes: object) -> None:
        with self._lock:
            status = replace(self.status, **changes)  # pyright: ignore[reportArgumentType]
            if status == self.status:
                return
            self.status = status
        self._on_change(status)


def new_status(drive: str, request: RecordingRequest, whom: str, continues: str = "") -> Status:
    """Of a recording that has just been asked for."""
    now = datetime.now(UTC)
    return Status(id_at(drive, now), drive, request, now, whom, continues=continues)


def _rows_before(rows: Rows, place: int) -> int:
    """How many of them begin before a place."""
    return min(max(-((rows.place - place) // rows.periods), 0), len(rows))


def _now() -> str:
    return datetime.now(UTC).isoformat()
