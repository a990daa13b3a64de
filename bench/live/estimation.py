"""Estimation: one worker thread for all drives, fed by a bounded queue, read by swapped snapshots.

It sleeps from one estimate to the next, and takes in then what has come: to wake up for every block would cost more
than all that is done with it. When it cannot keep up it drops blocks and counts them; what it drops is a gap to the
estimator, never a false neighbour. Knows nothing of links or HTTP.
"""

import contextlib
import math
import queue
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import ParamSpec

import numpy as np
from numpy.typing import NDArray

from bench.errors import LimitError, UnavailableError
from bench.live import mechanics, method, watch
from bench.live.drive_clock import ticks_between
from bench.live.mechanics import Shaft, Shafts
from bench.live.method import Running
from bench.live.watch import Mismatch, Watch
from bench.live.window import Window
from bench.machine_file import Nominal
from drivers.block import Block, one_of
from estimator.diagnosis import watch as detect
from estimator.online.estimate import WindowEstimate
from estimator.samples import Resolution, Samples

P = ParamSpec("P")

QUEUE = 1024  # blocks; four drives bring 800 a second, and a busy machine holds the worker up
REFRESH = 0.1  # s between two estimates of one drive
REFRESH_CHOSEN = 0.2  # s, the same where the data choose the window, which takes more work
TOGETHER = 0.05  # s by which an estimate comes early, for drives to be estimated at once
CROWDED = QUEUE // 8  # blocks, from which on they are taken in at once
WATCH = 1.0  # s between two windows in which a mismatch is looked for
PAUSE = 1.0  # s, or the time that the window covers where that is longer: rows of before are too old to go on from
_VALUES = ("theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q", "i_d_mean", "i_q_mean")  # of a row, all needed
_CHANGE_TIMEOUT = 5.0  # s, for the worker to take up new settings


@dataclass(frozen=True, slots=True)
class Stale:
    """Estimates that rest on old rows only."""

    since: datetime  # of the newest row that they rest on
    why: str  # no newer one is used, a sentence


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The latest estimates of one drive, with all that says how far to trust them.

    A row is used where each of its values is a number: where the bridge is off, its voltage is none.
    """

    window: Window
    result: WindowEstimate
    mismatch: Mismatch = field(default_factory=Mismatch)
    shaft: Shaft = field(default_factory=Shaft)
    received: float | None = None  # s, monotonic, when the newest row used was made
    t_drive: float | None = None  # s, drive's clock at the end of the newest row used
    rows_dropped: int = 0  # because the worker was behind
    lacking: tuple[str, ...] = ()  # what is no number in the newest row, where that is not used
    stale: Stale | None = None  # known to whoever knows the link

    @property
    def age(self) -> float | None:
        """Age of the newest row used, in s; None before the first."""
        return None if self.received is None else max(0.0, time.monotonic() - self.received)


@dataclass(slots=True)
class _Drive:
    """One drive's estimator; touched by the worker alone, but for `snapshot` and `rows_dropped`."""

    running: Running
    snapshot: Snapshot
    machine: Nominal
    watch: Watch = field(default_factory=Watch)
    shafts: Shafts = field(default_factory=Shafts)
    next_tick: int | None = None
    row: tuple[int, float] | None = None  # periods and T_s of the rows taken in
    received: float | None = None
    t_drive: float | None = None
    rows_dropped: int = 0
    estimated_at: float = field(default=0.0)
    watched_at: float = field(default=0.0)
    lacking: tuple[str, ...] = ()
    behind: bool = False  # the snapshot is behind the estimator

    @property
    def due(self) -> float:
        """When the next estimate may be made, in s, monotonic."""
        return self.estimated_at + (REFRESH_CHOSEN if self.running.window.chosen_by_data else REFRESH)


class Estimation:
    """The worker; runs from `start` to `stop`."""

    def __init__(self, windows: Mapping[str, Window], machines: Mapping[str, Nominal] | None = None) -> None:
        """Settings by drive, and what is known of their machines."""
        known = machines or {}
        self._drives = {name: _new_drive(window, known.get(name, Nominal({}))) for name, window in windows.items()}
        self._queue: queue.Queue[tuple[str, Block, float] | Callable[[], None]] = queue.Queue(QUEUE)
        self._stop = threading.Event()
        self._wanted = threading.Event()  # the worker, before an estimate is due
        self.thread = threading.Thread(target=self._run, name="estimation", daemon=True)
        self._failing: dict[tuple[str, str], str] = {}  # by drive and step

    def start(self) -> None:
        """Compile the kernels, then begin."""
        method.warm_up()
        detect.warm_up()
        self.thread.start()

    def stop(self) -> None:
        """End the worker and wait for it."""
        self._stop.set()
        self._wanted.set()
        if self.thread.ident is not None:
            self.thread.join(timeout=10.0)

    def put(self, name: str, block: Block, made: float | None = None) -> None:
        """Hand over a block whose last row ended at a time in s, monotonic (None: now); never waits."""
        try:
            self._queue.put_nowait((name, block, time.monotonic() if made is None else made))
        except queue.Full:
            self._drives[name].rows_dropped += len(block)
        if self._queue.qsize() > CROWDED:
            self._wanted.set()

    def snapshot(self, name: str) -> Snapshot:
        """The latest estimates of a drive."""
        return self._drives[name].snapshot

    def change_window(self, name: str, change: Mapping[str, object]) -> Window:
        """Replace settings of a drive's window; the samples held stay. Raises LimitError, UnavailableError."""
        answer: Future[Window] = Future()

        def apply() -> None:
            if not answer.set_running_or_notify_cancel():
                return
            try:
                answer.set_result(self._changed(self._drives[name], change))
            except Exception as error:  # noqa: BLE001 - raised again where the answer is awaited
                answer.set_exception(error)

        if not self.thread.is_alive():
            raise UnavailableError("the estimation does not run, the window stays as it is")
        try:
            self._queue.put(apply, timeout=_CHANGE_TIMEOUT)
            self._wanted.set()
            return answer.result(_CHANGE_TIMEOUT)
        except (queue.Full, TimeoutError):
            if not answer.cancel():  # taken up at the last moment
                return answer.result()
            raise UnavailableError(
                f"the estimation is behind: expected to change the window within {_CHANGE_TIMEOUT:g} s, "
                "it stays as it is"
            ) from None

    def _changed(self, drive: _Drive, change: Mapping[str, object]) -> Window:
        before = drive.running
        window = before.window.changed(change)
        try:
            drive.running = method.changed(before, window)
            self._estimate(drive)
        except BaseException as error:
            drive.running = before
            if isinstance(error, ValueError):
                raise LimitError(str(error)) from None
            raise
        return window

    def _run(self) -> None:
        while not self._stop.is_set():
            due = min((drive.due for drive in self._drives.values()), default=math.inf)
            self._wanted.wait(min(max(0.0, due - time.monotonic()), REFRESH))
            self._wanted.clear()
            now, crowded = time.monotonic(), self._queue.qsize() > CROWDED
            self._take_in()
            for name, drive in self._drives.items():
                if drive.due > now + TOGETHER:
                    continue
                drive.estimated_at = now  # be there rows or not: this was its turn
                if drive.behind and not crowded and now >= drive.watched_at + WATCH:
                    self._guarded(name, self._watch, drive)
                elif drive.behind and not crowded and now >= drive.shafts.due:
                    self._guarded(name, self._look_at_shaft, drive)
                if drive.behind:
                    self._guarded(name, self._estimate, drive)

    def _take_in(self) -> None:
        """All that waits in the queue: blocks that follow each other as one, and what is asked for in its place."""
        waiting: dict[str, list[tuple[Block, float]]] = {}
        with contextlib.suppress(queue.Empty):
            for _ in range(QUEUE):
                item = self._queue.get_nowait()
                if callable(item):
                    self._take_blocks(waiting)
                    item()
                else:
                    waiting.setdefault(item[0], []).append(item[1:])
        self._take_blocks(waiting)

    def _take_blocks(self, waiting: dict[str, list[tuple[Block, float]]]) -> None:
        """Take in blocks by drive, and leave none."""
        for name, blocks in waiting.items():
            for block, received in joined(blocks):
                self._guarded(name, self._take, self._drives[name], block, received)
        waiting.clear()

    def _guarded(self, name: str, step: Callable[P, None], *args: P.args, **kwargs: P.kwargs) -> None:
        """Take a step; a fault of ours is told by the health page and ends neither the worker nor other drives."""
        try:
            step(*args, **kwargs)
        except Exception as error:  # noqa: BLE001
            self._failing[name, step.__name__] = f"drive {name}: {type(error).__name__}: {error}"
        else:
            self._failing.pop((name, step.__name__), None)

    @property
    def failure(self) -> str | None:
        """What fails at present; None when each drive's last step went well."""
        return "; ".join(list(self._failing.values())) or None

    def _take(self, drive: _Drive, block: Block, received: float) -> None:
        row = (block.periods, block.T_s)
        samples = samples_of(block, drive.machine.theta_step)
        whole = _whole(samples)
        used = np.flatnonzero(np.logical_and.reduce(list(whole.values())))
        if drive.row != row or _too_old(drive, used, samples, block):  # other rows cannot share an estimator
            drive.running = method.start(drive.running.window)
            drive.watch, drive.shafts = watch.anew(drive.watch), mechanics.anew(drive.shafts)
            drive.row, drive.next_tick = row, None
        joined = drive.next_tick == int(block.tick[0])
        drive.next_tick = None  # should the update fail, the next block begins a new run
        method.take(drive.running, samples, joined=joined)
        watch.take(drive.watch, samples, drive.running.window)
        mechanics.take(drive.shafts, samples)
        drive.next_tick = block.end
        drive.lacking = tuple(name for name, finite in whole.items() if not finite[-1])
        if len(used):
            newest = int(used[-1])
            drive.received = received - (len(samples) - 1 - newest) * samples.T
            drive.t_drive = (int(block.tick[newest]) + block.periods) * block.T_s
        drive.behind = True

    def _estimate(self, drive: _Drive) -> None:
        drive.behind = False
        drive.snapshot = Snapshot(
            drive.running.window, method.estimate(drive.running), drive.watch.said, drive.shafts.shaft, drive.received,
            drive.t_drive, drive.rows_dropped, drive.lacking,
        )

    def _watch(self, drive: _Drive) -> None:
        drive.watched_at = time.monotonic()
        snapshot = drive.snapshot
        watch.judge(drive.watch, snapshot.window, snapshot.result.estimates, drive.machine.given, datetime.now(UTC))

    def _look_at_shaft(self, drive: _Drive) -> None:
        mechanics.judge(drive.shafts, drive.snapshot.result.estimates, drive.machine, datetime.now(UTC))


def joined(blocks: Sequence[tuple[Block, float]]) -> list[tuple[Block, float]]:
    """The same rows in as few blocks as can be, each with the time at which its last row ended."""
    stretches: list[list[tuple[Block, float]]] = []
    for block, received in blocks:
        if stretches and block.joins(stretches[-1][-1][0]):
            stretches[-1].append((block, received))
        else:
            stretches.append([(block, received)])
    return [(one_of([block for block, _ in stretch]), stretch[-1][1]) for stretch in stretches]


def _whole(samples: Samples) -> dict[str, NDArray[np.bool_]]:
    """Of each value, whether it is a number, in every row."""
    return {name: np.isfinite(column) for name in _VALUES if (column := getattr(samples, name)) is not None}


def _too_old(drive: _Drive, used: NDArray[np.intp], samples: Samples, block: Block) -> bool:
    """Whether the rows used so far are of a drive's clock that has begun anew since, or of long before these."""
    if drive.t_drive is None or not len(used):
        return False
    pause = block.T_s * ticks_between(round(drive.t_drive / block.T_s), int(block.tick[used[0]]))
    return pause < -0.5 * samples.T or pause > max(PAUSE, drive.running.window.samples * samples.T)


def samples_of(block: Block, theta_step: float = 0.0) -> Samples:
    """A block in the estimator's terms."""
    return Samples(
        block.theta_e, block.omega_e, block.i_d, block.i_q, block.u_d, block.u_q, block.T_s, block.periods,
        block.i_d_mean, block.i_q_mean, int(block.tick[0]) * block.T_s,
        Resolution(block.i_step, block.u_step, theta_step),
    )


def _new_drive(window: Window, machine: Nominal) -> _Drive:
    running = method.start(window)
    return _Drive(running, Snapshot(window, method.estimate(running)), machine)
