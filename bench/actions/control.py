"""Control of the drives for operators: start, stop, reset, set points, and what state each drive is in.

One thread a drive looks at its state and, where this service controls it, renews its control lease: a service that
ends or hangs renews nothing. Control ends where the bridge goes off, whatever switched it off. Stop is anybody's at any
time, and waits for nobody. Knows nothing of HTTP.
"""

import contextlib
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Final

from bench.actions.drive_jobs import Link
from bench.actions.safety.lease import Leases, Part
from bench.actions.safety.limits import JUDGED, TRIP, Limits, Overload
from bench.actions.safety.unfinished import Noted, Origin, freed, take
from bench.errors import BenchError, ConflictError, LimitError, UnavailableError
from bench.store.write_log import to_standard_error
from drivers import lease as control
from drivers import operation
from drivers.drive import Drive
from drivers.errors import DriveError, RefusedError
from drivers.lease import SECONDS, Held, HeldError, Lease
from drivers.operation import Fault
from drivers.wire.cia402 import Command, State, command_of
from drivers.wire.dictionary import SET_POINTS, signal_named

_PERIOD: Final = 0.1  # s between two looks at a drive's state
_WHO: Final = 5  # such looks between two at who controls it
_HELD: Final = 30.0  # s that the bench's own lease is taken for, anew with every look
_STOPPING: Final = 5.0  # s that a stop goes on trying while there is no link
_OUT_OF_REACH: Final = (
    "nothing has come to the drive for longer than it waits for its bench: it should have gone off, which is seen when "
    "the link is back"
)
_UNTOLD: Final = "it could not be told to stop: its bridge goes off when its control lease runs out"
_SAFE_TORQUE_OFF: Final = {1: "torque allowed", 2: "torque off"}


@dataclass(frozen=True, slots=True)
class DriveState:
    """What a drive says of itself."""

    state: State
    fault: Fault | None
    held: Held | None  # who controls it, where it has a lease
    has_lease: bool
    safe_torque_off: str | None  # in words; None where it has no such input, or does not tell
    at: datetime  # when it said so


@dataclass(frozen=True, slots=True)
class Controlled:
    """What this service controls."""

    lease: Lease
    noted: Noted
    holder: str  # in the bench's own lease
    whom: str
    before: Mapping[str, float]  # what it has changed of the settings, as it was
    overload: Overload


class Control:
    """One drive's control; runs from `start` to `end`."""

    def __init__(
        self, name: str, link: Link, leases: Leases, limits: Limits, origin: Callable[[str], Origin],
        on_event: Callable[[str, str], None] = lambda _kind, _sentence: None,
    ) -> None:
        """`origin` tells, for whom asks, where and as what to note that this drive is controlled.

        `on_event` hears of other states (`state`) and faults (`fault`), a sentence each; it does not wait.
        """
        self._on_event = on_event
        self._told: tuple[State, int] | None = None  # state and fault that it heard of last
        self._looking = threading.Lock()  # one look at a time, each from beginning to end
        self._name, self._link, self._leases, self._limits, self._origin = name, link, leases, limits, origin
        self._lock = threading.RLock()  # guards what follows, and all that is written to the drive
        self._controlled: Controlled | None = None
        self._left: Controlled | None = None  # has ended, and what it changed is to be undone
        self._stops = 0  # so often has somebody asked for Stop
        self._stopping = set[object]()  # those under way
        self._ending = threading.Event()
        self.thread = threading.Thread(target=self._watch, name=f"control {name}", daemon=True)
        self.state: DriveState | None = None  # None while there is no link
        self.said = ""  # why the latest control of it ended
        self.farewell = ""  # what became of the drive when the service ended, a clause; empty where it was not ours

    @property
    def whom(self) -> str | None:
        """Who has this service control the drive; None where it does not, or has not been heard for too long."""
        controlled = self._controlled
        return None if controlled is None or controlled.lease.lapsed else controlled.whom

    @property
    def off_words(self) -> str:
        """Why the drive drives no voltage, a clause; empty where it does, or is not to be had."""
        now = self.state
        return "" if now is None else operation.off_words(now.state, now.fault)

    def begin(self) -> None:
        """Look at the drive from now on."""
        self.thread.start()

    def end(self) -> None:
        """Give up control, also that of a start under way; the drive is off then, and nobody starts it here."""
        self._ending.set()
        self.void()
        if self._controlled is not None:
            self.farewell = _UNTOLD
        with self._lock, contextlib.suppress(DriveError):
            drive, ours = self._link.drive(), self._controlled is not None
            self._give_up(drive, how="the service ended")
            self.farewell = "stopped, its bridge is off" if ours else ""
            self._restore(drive)

    def join(self, timeout: float) -> None:
        """Wait for the thread's end, at most so many seconds."""
        if self.thread.ident is not None:
            self.thread.join(timeout)

    def start(self, values: Mapping[str, float], whom: str) -> None:
        """Take control, give set points (SI, checked) and switch the bridge on; again, only the set points are new.

        What is left out is zero. Raises LimitError, ConflictError, UnavailableError, DriveError.
        """
        stops = self._stops
        with self._lock:
            drive, fresh = self._link.drive(), self._controlled is None
            self._check_not_stopped(stops)
            if fresh:
                self._take(drive, whom)
            controlled = self._controlled
            assert controlled is not None
            try:
                given = dict.fromkeys(SET_POINTS, 0.0) | dict(values)
                self._check(drive, given)
                kept = [name for name in SET_POINTS if name not in values and not drive.read(name)]
                lowered = dict.fromkeys(controlled.before, self._limits.trip(drive.read("n_p")) or 0.0) if fresh else {}
                controlled.lease.start(drive, lowered | {k: v for k, v in given.items() if k not in kept})
                self._check_not_stopped(stops)
            except (BenchError, DriveError):
                if fresh or stops != self._stops or _off(drive):
                    with contextlib.suppress(DriveError):
                        self._give_up(drive, how="its start failed, or was stopped")
                raise
            self.said = ""
        self._look(drive, who=True)

    def void(self) -> None:
        """Have a start that is under way end: its drive is being stopped, here or under another name of it."""
        self._stops += 1

    def stop(self, whom: str) -> None:
        """Switch the bridge off, whoever controls the drive; nobody does then, nor renews. Raises DriveError."""
        self.void()
        self._stopping.add(mine := object())
        said = f"stopped by {whom}" if whom else "stopped"
        try:
            drive = self._stop_repeatedly(said)
        finally:
            self._stopping.discard(mine)
        self.said = said
        self._look(drive, who=True)

    def reset(self) -> None:
        """Leave fault, with the bridge off and controlled by nobody. Raises FaultError where its cause remains."""
        with self._lock:
            drive = self._link.drive()
            if operation.fault(drive) is None:
                raise ConflictError(f"drive {self._name} is in no fault: it is {operation.state(drive)}")
            self._give_up(drive, how="a fault was reset")
            operation.reset_fault(drive)
        self._look(drive, who=True)

    def write(self, drive: Drive, values: Mapping[str, float], write: Callable[[Mapping[str, float]], None]) -> None:
        """Write signals (SI, checked): under control by a control record, else by `write`, one by one.

        Raises LimitError, ConflictError where set points have nobody to answer for them or another does, DriveError.
        """
        command = command_of(int(values["control_word"])) if "control_word" in values else None
        off = command not in (None, Command.ENABLE_OPERATION, Command.FAULT_RESET)
        with self._lock:
            self._check(drive, values)
            if self._controlled is not None:
                self._controlled.lease.write(drive, values)
                if off:
                    said = f"control_word = {values['control_word']:g} switched it off"
                    self._give_up(drive, how=said)
                    self.said = said
                return
            holder = None if off and len(values) == 1 else control.held(drive)  # what stops is anybody's
            if holder is not None and any(signal_named(name).is_guarded for name in values):
                raise ConflictError(f"{holder.words}: who stops the drive may write to it then")
            given = [name for name in SET_POINTS if name in values] if drive.identity.has_lease else []
            if any(values[name] for name in given):
                raise ConflictError(
                    f"{given[0]} is a set point, and set points hold only while the drive is controlled: start it with "
                    f"them, as by `pmsm-bench start {self._name} {given[0]}={values[given[0]]:g}`"
                )
            if command is Command.ENABLE_OPERATION:
                raise ConflictError(f"a drive is started by who controls it then: `pmsm-bench start {self._name}`")
            write({name: value for name, value in values.items() if name not in given})

    def _stop_repeatedly(self, how: str) -> Drive:
        """Switch off, again where it does not come to the drive, for some seconds; the drive it came to."""
        deadline = time.monotonic() + _STOPPING
        while True:
            try:
                drive = self._link.drive()
                control.stop(drive)
                with self._lock:
                    if not _off(drive):  # by a start that was under way
                        control.stop(drive)
                    self._ended("", how=how)
                return drive
            except DriveError:
                if time.monotonic() > deadline or self._ending.is_set():
                    with self._lock:
                        self._ended("it was stopped, and whether that has come to the drive is not known", off=False)
                    raise
                self._ending.wait(_PERIOD)

    def _take(self, drive: Drive, whom: str) -> None:
        started = f"started from {whom}; " if whom else ""
        holder = f"the operator's control ({started}`pmsm-bench stop {self._name}` ends it)"
        self._restore(drive)
        self._leases.take(self._name, holder, _HELD, Part.CONTROL)
        lease = Lease()
        try:
            freed(drive, self._origin(holder).folder)
            before = self._trip_too_high(drive)
            noted = take(drive, lease, self._origin(holder), before)
        except BaseException:
            self._leases.release(self._name, holder)
            raise
        self._controlled = Controlled(lease, noted, holder, whom, before, Overload(self._limits))

    def _give_up(self, drive: Drive, said: str = "", how: str = "") -> None:
        if (controlled := self._controlled) is None:
            return
        try:
            controlled.lease.release(drive)
        except DriveError as error:
            self._ended(f"the drive could not be told that it is over ({error})", off=False)
            raise
        self._ended(said, how=how)

    def _ended(self, said: str, *, off: bool = True, how: str = "") -> None:
        """Control is over: nothing is renewed. Where the drive may not be `off`, the note for a later start stays.

        `how`: that it is over, where nothing is said of it.
        """
        if (controlled := self._controlled) is None:
            return
        self.said, self._controlled = said, None
        self._leases.release(self._name, controlled.holder, said or how)
        if not off:
            controlled.noted.close()
        elif not controlled.before:
            controlled.noted.undone()
        else:
            self._left = controlled
            with contextlib.suppress(DriveError):  # it is tried again with every look
                self._restore(self._link.drive())
        if said:
            to_standard_error(f"drive  {self._name}: control ended: {said}")

    def _restore(self, drive: Drive) -> None:
        """What control that is over had changed is as before, unless another has control by now. Raises DriveError."""
        if (left := self._left) is None:
            return
        for name, value in left.before.items():
            with contextlib.suppress(RefusedError):
                drive.write(name, value)
        self._left = None
        left.noted.undone()

    def _check_not_stopped(self, stops: int) -> None:
        if self._ending.is_set():
            raise UnavailableError("the service is ending")
        if stops != self._stops:
            raise ConflictError(f"drive {self._name} was stopped meanwhile: start it again where that is meant")

    def _check(self, drive: Drive, values: Mapping[str, float]) -> None:
        """Raise LimitError where set points would be too far, or a guard weaker under control."""
        if any(name in JUDGED for name in values):
            present = {name: values[name] if name in values else drive.read(name) for name in JUDGED}
            self._limits.check_set_points(present, "set points")
        if self._controlled is None:
            return
        if TRIP in values:
            self._limits.check_trip(values[TRIP], drive.read("n_p"))
        watchdog = SECONDS if drive.identity.has_lease else values.get("watchdog_time", SECONDS)
        if not 0.0 < watchdog <= SECONDS:
            raise LimitError(
                f"watchdog_time goes up to {SECONDS:g} s while the drive is controlled: nothing else stops it when its "
                f"bench is gone; got {watchdog:g}"
            )

    def _trip_too_high(self, drive: Drive) -> dict[str, float]:
        """The drive's overspeed trip, where the machine's largest speed asks for a lower one."""
        if not drive.identity.has_lease or (most := self._limits.trip(drive.read("n_p"))) is None:
            return {}
        now = drive.read(TRIP)
        return {TRIP: now} if now > most else {}

    def _watch(self) -> None:
        looks = 0
        while not self._ending.wait(_PERIOD):
            try:
                drive = self._link.drive()
                self._keep(drive)
                self._look(drive, who=looks % _WHO == 0)
                looks += 1
            except (BenchError, DriveError):
                self.state, looks = None, 0
                self._out_of_reach()
            except Exception as error:  # noqa: BLE001 - a fault of ours must not leave a drive without who looks at it
                self.state, looks = None, 0
                to_standard_error(f"drive  {self._name}: the bench failed: {type(error).__name__}: {error}")

    def _keep(self, drive: Drive) -> None:
        with self._lock:
            controlled = self._controlled
            if self._stopping:  # a stop that is under way ends control itself
                return
            if controlled is None:
                self._restore(drive)
                return
            if controlled.lease.lapsed:
                self._give_up_late(drive)
                return
            self._leases.take(self._name, controlled.holder, _HELD, Part.CONTROL)
            try:
                controlled.lease.keep(drive)
                if too_much := controlled.overload.told(drive):
                    self._give_up(drive, f"the drive's own control asked for {too_much}")
                    return
                now = operation.state(drive)
                if now is not State.OPERATION_ENABLED:
                    fault, at = operation.fault(drive), f"{datetime.now(UTC):%Y-%m-%d %H:%M:%SZ}"
                    went = "went off by itself" if fault else "was stopped by another client, or went off by itself"
                    why = f"{fault.text} (0x{fault.code:04X})" if fault else f"it is {now}"
                    if drive.identity.has_lease:
                        with contextlib.suppress(HeldError):
                            controlled.lease.release(drive)
                    self._ended(f"the drive {went} at {at}: {why}")
            except HeldError as error:
                self._ended(str(error))

    def _give_up_late(self, drive: Drive) -> None:
        """The link is back, after the lease should have run out: see to it that the drive is off. Raises DriveError."""
        on = operation.state(drive) is State.OPERATION_ENABLED
        now = "it was still on, and has been switched off" if on else "it had gone off"
        self._give_up(drive, f"nothing came to the drive for longer than it waits for its bench; {now}")

    def _out_of_reach(self) -> None:
        """Without a link a lease runs out by itself; whether it has is seen when the link is back."""
        with self._lock:
            controlled = self._controlled
            if controlled is None or not controlled.lease.lapsed or self.said == _OUT_OF_REACH:
                return
            self.said = _OUT_OF_REACH
            to_standard_error(f"drive  {self._name}: {_OUT_OF_REACH}")

    def _look(self, drive: Drive, *, who: bool) -> None:
        """See the drive's state; who controls it as well, where that is asked for or the state is another."""
        with self._looking:
            before = self.state
            now = operation.state(drive)
            fault = operation.fault(drive) if now is State.FAULT else None
            self._tell(now, fault)
            if now is State.OPERATION_ENABLED and self._controlled is None:  # by another, or by itself
                self.said = ""
            if not who and before is not None and before.state is now:
                self.state = replace(before, fault=fault, at=datetime.now(UTC))
                return
            has_lease = drive.identity.has_lease
            sto = int(drive.read("safe_torque_off")) if has_lease else 0
            self.state = DriveState(
                now, fault, control.held(drive), has_lease, _SAFE_TORQUE_OFF.get(sto), datetime.now(UTC)
            )

    def _tell(self, now: State, fault: Fault | None) -> None:
        """Of a state, or a fault, that is another than before."""
        told = now, 0 if fault is None else fault.code
        if told == self._told:
            return
        self._told = told
        if fault is None:
            self._on_event("state", str(now))
        else:
            self._on_event("fault", f"{fault.text} (0x{fault.code:04X})")


def _off(drive: Drive) -> bool:
    """Whether its bridge is off for certain. Raises nothing: a drive that does not answer is taken to be on."""
    try:
        return operation.state(drive) is not State.OPERATION_ENABLED
    except DriveError:
        return False
