"""One capture, from a drive's recorder to a recording on disk. Knows nothing of services, HTTP or how a link is kept.

It waits out a lost link and goes on where it stood. What the drive no longer has is said; what had been uploaded of it
is kept as a partial recording. One that ends with the process goes on from its part file, which it has from the moment
it is asked for: see `capture_file`.
"""

import contextlib
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Final, TypeVar

from bench.actions.capture_request import COMMAND, Level, Request
from bench.actions.drive_jobs import Link, id_at
from bench.errors import BenchError, ConflictError, UnavailableError
from bench.files import check_room
from bench.live.drive_clock import ticks_between
from bench.recordings.capture_file import CapturePart, Heading, write_recording
from bench.recordings.recording import off_remark
from drivers import capture, operation
from drivers.capture import ARMED, DONE, TRIGGERED, Upload
from drivers.drive import Drive
from drivers.errors import DriveError, GoneError, NoReplyError, RefusedError

T = TypeVar("T")

LINK_PATIENCE: Final = 120.0  # s that a lost link is waited for
_POLL: Final = 0.1  # s between two looks at the recorder, which a slow line shares with the stream
_RETRY: Final = 0.2  # s
_REFUSALS: Final = 5  # in a row, after which a drive means it
_STOPPED: Final = "another client has stopped the recorder before the recording was complete"
_STANDSTILL: Final = 10.0  # s without another sample after which a recording is given up


class State(StrEnum):
    """Where a capture stands; the last three are ends."""

    ARMED = "armed"
    TRIGGERED = "triggered"  # recording
    UPLOADING = "uploading"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"

    @property
    def ended(self) -> bool:
        """Nothing more will come of it."""
        return self in (State.DONE, State.FAILED, State.CANCELLED)


@dataclass(frozen=True, slots=True)
class Status:
    """A capture at one moment."""

    id: str
    drive: str
    request: Request
    asked: datetime
    state: State = State.ARMED
    samples: int = 0  # recorded so far, then uploaded so far
    reason: str = ""  # why it failed, or what it waits for
    file: Path | None = None  # the recording, as far as there is one
    remark: str = ""  # what it will lack, or lacks: a sentence

    @property
    def progress(self) -> float:
        """Share of the samples that are recorded, then uploaded."""
        return self.samples / self.request.length


class _LeftError(Exception):
    """The capture is not to go on."""


class Run:
    """A capture under way: `arm`, then `finish` in a thread of its own; the rest from any thread."""

    def __init__(
        self, status: Status, url: str, link: Link, path: Path, on_change: Callable[[Status], None],
        interrupted: CapturePart | None = None,
    ) -> None:
        """`path` is where the recording goes; `interrupted`, what a run before this one has left."""
        self.status = status
        self.path = path
        self._url, self._link, self._on_change = url, link, on_change
        self._leave = threading.Event()
        self._cancelled = False
        self._number = 0  # of the drive's recording
        self._armed = self._tick = 0  # by the drive's clock: when it was armed, and latest
        self._off = ""  # why the drive drove no voltage after the recording
        self._T_s = 0.0  # s
        self._upload: Upload | None = None
        self._part = interrupted
        self._progressed = time.monotonic()
        self._refusals = 0
        if interrupted is not None:
            heading = interrupted.heading
            self._number, self._T_s = heading.number, heading.T_s
            self._armed = self._tick = heading.armed
            if heading.count is not None:
                setup = status.request.setup
                self._upload = Upload(setup, heading.number, heading.tick, heading.count, interrupted.data)

    @property
    def part(self) -> Path:
        """What has been uploaded so far, unless that name was another's."""
        return self.path.with_suffix(".part")

    @property
    def most_seconds(self) -> float:
        """Time in s within which this comes to an end, or tells something new."""
        request = self.status.request
        left = request.length if self.status.state is State.ARMED else request.length - self.status.samples
        waiting = request.timeout_s if self.status.state is State.ARMED else 0.0
        return waiting + left * request.decimation * self._T_s + _STANDSTILL + LINK_PATIENCE

    def arm(self) -> None:
        """Arm the drive's recorder. Raises LimitError, DriveError; RefusedError where it has none; UnavailableError."""
        request, drive = self.status.request, self._link.drive()
        request.check_level(drive.identity.full)
        try:
            drive.read("capture_number")
        except RefusedError as error:
            raise RefusedError(f"drive {self.status.drive} has no recorder: {error}", error.code) from None
        self._T_s = drive.identity.T_s
        self._armed = self._tick = int(drive.read("tick"))
        off = operation.off(drive)
        status = self.status
        heading = Heading.of(
            status.id, status.drive, self._url, status.asked.isoformat(), request.as_json(), drive.identity
        )
        try:
            check_room(self.path.parent, request.length, len(request.signals))
            self._part = part = CapturePart.begun(self.part, heading)
        except OSError as error:
            raise UnavailableError(f"the capture cannot be kept on disk: {error.strerror or error}") from None
        try:
            self._number = capture.arm(drive, request.setup, by_command=request.trigger == COMMAND)
            part.change(replace(heading, number=self._number, armed=self._armed, off_before=off))
        except BaseException as error:
            part.remove()
            if isinstance(error, OSError):
                self._stop_recorder()
                raise UnavailableError(f"the capture cannot be kept on disk: {error.strerror or error}") from None
            raise
        if off:
            self._tell(remark=f"{off}: there is no voltage to record until it is started")

    def trigger(self) -> None:
        """Trigger now. Raises ConflictError when no trigger is awaited, DriveError."""
        if self.status.state is not State.ARMED:
            raise ConflictError(f"capture {self.status.id} awaits no trigger: it is {self.status.state}")
        capture.trigger(self._link.drive())

    def cancel(self) -> None:
        """Have `finish` stop the recorder, discard what was uploaded, and return."""
        self._cancelled = True
        self._leave.set()

    def leave(self) -> None:
        """Have `finish` return: what waits for its trigger is cancelled, what is uploading keeps its part file."""
        self._leave.set()

    def finish(self) -> None:
        """All that follows the arming; the status tells how it went."""
        try:
            if self._upload is None:
                self._await_recording()
            written = self._take_over()
            self._tell(state=State.DONE, samples=self.status.request.length, file=written)
        except _LeftError:
            self._left()
        except (DriveError, BenchError) as error:
            self._failed(str(error))
        except OSError as error:
            self._failed(f"the recording cannot be written: {error.strerror or error}", keep=True)
        except Exception as error:  # noqa: BLE001 - a fault of ours must not leave a capture without an end
            self._failed(f"the bench failed on this capture: {type(error).__name__}: {error}")
        finally:
            if self._part is not None:
                self._part.close()

    def _await_recording(self) -> None:
        request = self.status.request
        patience = request.timeout_s + request.setup.pre * request.decimation * self._T_s
        grown, count = time.monotonic(), -1
        begun: float | None = None  # the recorder has been armed for some time where a run before this one did it
        while True:
            seen = self._with_drive(self._seen)
            now = time.monotonic()
            if begun is None:
                begun = now - max(0, ticks_between(self._armed, self._tick)) * self._T_s
            if seen.state == DONE:
                self._tell(samples=seen.count)
                return
            if seen.state not in (ARMED, TRIGGERED):
                raise GoneError(_STOPPED)
            if seen.state == ARMED and now - begun > patience:
                self._stop_recorder()
                raise NoReplyError(f"{_awaited(request)} has not come within {request.timeout_s:g} s")
            if seen.count != count:
                count, grown = seen.count, now
            elif seen.state == TRIGGERED and now - grown > _STANDSTILL:
                self._stop_recorder()
                raise NoReplyError(f"the recording stands still at {count} samples for {_STANDSTILL:g} s")
            if seen.state == ARMED:
                self._tell(state=State.ARMED, reason=f"waiting for {_awaited(request).rstrip(',')}")
            else:
                self._tell(state=State.TRIGGERED, samples=count, reason="")
            self._pause(_POLL)

    def _seen(self, drive: Drive) -> capture.Seen:
        """Where the recorder stands. Raises GoneError where it has lost the recording, also by a reset of the drive."""
        before, self._tick = self._tick, int(drive.read("tick"))
        if capture.earlier(self._tick, before):
            raise GoneError(f"the drive no longer has recording {self._number}, it has been reset")
        return capture.seen(drive, self._number)

    def _found(self, drive: Drive) -> Upload:
        self._seen(drive)
        self._off = operation.off(drive)
        upload = capture.found(drive, self.status.request.setup)
        capture.check_ours(drive, upload, self._number, self._armed)
        return upload

    def _take_over(self) -> Path:
        """Upload, beside the part file, and write the recording; where it is."""
        if self._upload is None:
            self._upload = self._with_drive(self._found)
        upload = self._upload
        self._tell(state=State.UPLOADING, samples=upload.done, reason="")
        part = self._part
        assert part is not None, "it has been armed, or was found"
        if part.heading.count is None:
            part.change(replace(part.heading, tick=upload.tick, count=upload.count, off_after=self._off))
            self._tell(remark=off_remark(part.heading.off_before, self._off))

        def uploaded(done: int) -> None:
            part.keep(upload.data, done * 2 * len(upload.setup.channels))
            self._went_on()
            self._tell(samples=done, reason="")
            if self._leave.is_set():
                raise _LeftError

        self._with_drive(lambda drive: capture.upload(drive, upload, uploaded))
        if upload.count < self.status.request.length:
            raise GoneError(_STOPPED)
        written = write_recording(self.path, part.heading, upload)
        part.remove()
        return written

    def _with_drive(self, work: Callable[[Drive], T]) -> T:
        """Do something with the drive, again while its link is lost. Raises DriveError where that leads nowhere."""
        while True:
            if self._leave.is_set():
                raise _LeftError
            try:
                done = work(self._link.drive())
            except GoneError:
                raise
            except DriveError as error:
                self._refusals += isinstance(error, RefusedError)
                if self._refusals >= _REFUSALS:
                    raise
                if time.monotonic() - self._progressed > LINK_PATIENCE:
                    raise NoReplyError(f"it could not go on for {LINK_PATIENCE:g} s: {error}") from None
                self._tell(reason=f"it goes on when the link is back: {error}")
                self._pause(_RETRY)
            else:
                self._went_on()
                return done

    def _went_on(self) -> None:
        self._progressed, self._refusals = time.monotonic(), 0

    def _pause(self, seconds: float) -> None:
        if self._leave.wait(seconds):
            raise _LeftError

    def _left(self) -> None:
        if not self._cancelled and self.status.state is not State.ARMED:
            self._tell(reason="the service has ended; it goes on when the service runs again")
            return
        if self._upload is None:
            self._stop_recorder()
        self._remove_part()
        self._tell(state=State.CANCELLED, reason="" if self._cancelled else "the service has ended")

    def _failed(self, why: str, *, keep: bool = False) -> None:
        """Keep what there is, as a partial recording; `keep` the part file where there is no more."""
        upload, part = self._upload, self._part
        if upload is None or part is None or not upload.done:
            if keep and part is not None:
                why = f"{why}; it is taken up again when the service runs again, from {part.path.name}"
            else:
                self._remove_part()
            self._tell(state=State.FAILED, reason=why)
            return
        try:
            partial = write_recording(self.path.with_suffix(".partial.parquet"), part.heading, upload)
        except Exception:  # noqa: BLE001 - as in `finish`
            self._tell(state=State.FAILED, reason=f"{why}; the first {part.samples} samples are in {part.path.name}")
            return
        part.remove()
        why = f"{why}; the first {upload.done} of {self.status.request.length} samples are kept"
        self._tell(state=State.FAILED, samples=upload.done, reason=why, file=partial)

    def _remove_part(self) -> None:
        if self._part is not None:
            self._part.remove()

    def _stop_recorder(self) -> None:
        """As far as the drive can be had: a recorder that waits on does no harm."""
        with contextlib.suppress(DriveError):
            drive = self._link.drive()
            capture.seen(drive, self._number)
            capture.stop(drive)

    def _tell(self, **changes: object) -> None:
        status = replace(self.status, **changes)  # pyright: ignore[reportArgumentType]
        if status != self.status:
            self.status = status
            self._on_change(status)


def new_status(drive: str, request: Request) -> Status:
    """Of a capture that has just been asked for."""
    now = datetime.now(UTC)
    return Status(id_at(drive, now), drive, request, now)


def _awaited(request: Request) -> str:
    if isinstance(request.trigger, Level):
        return f"the trigger, {request.trigger},"
    return "the command to trigger" if request.trigger == COMMAND else "the beginning"
