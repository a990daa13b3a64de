"""Control of a drive by one holder: taking its lease, set points, start, renewal, stop. The same over every transport.

Nothing here renews by itself: whoever holds control renews it where it acts, so that a bench that hangs loses it. A
drive of the layout without a control lease has a watchdog instead, which is set here; nobody else is kept from writing
to it. Knows nothing of buses.
"""

import getpass
import math
import os
import secrets
import socket
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import TracebackType
from typing import Final, Self

from drivers import operation
from drivers.drive import Drive
from drivers.errors import DriveError, NoReplyError, RefusedError
from drivers.wire.canopen_od import Abort
from drivers.wire.cia402 import Command, State
from drivers.wire.codec import encode
from drivers.wire.dictionary import SET_POINTS, signal_named
from drivers.wire.lease import HOLDER, Action, Bridge, End, Record, holder_name
from drivers.wire.modbus_map import ILLEGAL_VALUE

SECONDS: Final = 2.0  # that a lease lasts from its latest renewal; a drive whose `watchdog_time` is shorter: that
_RENEWED: Final = 0.1  # of that time, after which `keep` renews
_RANGE: Final = (Abort.VALUE_RANGE, 0x06090031, 0x06090032, ILLEGAL_VALUE)  # reasons: out of range, too high, too low
_HOLDERS: Final = tuple(f"lease_holder_{k}" for k in range(1, 5))


class HeldError(RefusedError):
    """Control is another's, or no longer this holder's."""


def own_name() -> str:
    """A holder's name that tells this process from others, as far as 16 characters do."""
    try:
        user = getpass.getuser()
    except (OSError, KeyError):
        user = "bench"
    process = f":{os.getpid()}"
    return f"{user[:4]}@{socket.gethostname()[:5]}"[: HOLDER - len(process)] + process


@dataclass(frozen=True, slots=True)
class Held:
    """Who controls a drive, as it says itself."""

    holder: str  # "local" for a master inside it
    left: float | None  # s, until it ends unless renewed; None for local control

    @property
    def words(self) -> str:
        """That this holder controls the drive, a clause."""
        if self.left is None:
            return "a master inside the drive controls the drive; stop it there first"
        return f"{self.holder!r} controls the drive for {self.left:.1f} s more, unless renewed"


def held(drive: Drive) -> Held | None:
    """Who controls the drive; None for nobody, or where it has no lease. Raises DriveError."""
    if not drive.identity.has_lease:
        return None
    if drive.read("lease_left") == 0.0:
        return None
    holder = holder_name([int(drive.read(name)) for name in _HOLDERS])
    left = drive.read("lease_left")  # after the name, whose parts may have changed while they were read
    return None if left == 0.0 else Held(holder, None if left < 0.0 else left)


@dataclass(slots=True)
class Lease:
    """One holder's control of one drive, which is given to each call: its link may have been made anew meanwhile."""

    holder: str = field(default_factory=own_name)
    seconds: float = SECONDS
    token: int = field(default_factory=lambda: secrets.randbits(32) or 1, repr=False)
    _renewed: float = 0.0  # s, monotonic
    _watchdog: float | None = None  # s, what it was in a drive without leases

    @property
    def lapsed(self) -> bool:
        """By our clock it has run out, were the latest renewal the last that came to the drive; never of a watchdog,
        which others may feed.
        """
        return self._watchdog is None and time.monotonic() - self._renewed > self.seconds

    def take(self, drive: Drive) -> None:
        """Become the holder. Raises HeldError where another is, DriveError."""
        if not drive.identity.has_lease:
            before = drive.read("watchdog_time")
            if not 0.0 < before <= self.seconds:
                drive.write("watchdog_time", self.seconds)
            self._watchdog, self._renewed = before, time.monotonic()
            return
        self._allowed(drive.read("watchdog_time"))
        self._send(drive, Action.TAKE)

    def keep(self, drive: Drive) -> None:
        """Renew where that is due: to be called all the time, by what acts. Raises HeldError, DriveError."""
        if time.monotonic() - self._renewed < _RENEWED * self.seconds:
            return
        if drive.identity.has_lease:
            self._send(drive, Action.RENEW)
        else:
            if not 0.0 < drive.read("watchdog_time") <= self.seconds:  # any request feeds it; somebody has set it
                drive.write("watchdog_time", self.seconds)
            self._renewed = time.monotonic()

    def write(self, drive: Drive, values: Mapping[str, float]) -> None:
        """Write signals (SI) in one piece. Raises HeldError, RefusedError, DriveError."""
        self._send(drive, Action.RENEW, values=values)
        if drive.identity.has_lease:  # no record asks for more than the drive then allows
            self._allowed(values.get("watchdog_time", self.seconds))

    def start(self, drive: Drive, values: Mapping[str, float] | None = None) -> None:
        """Write signals and switch the bridge on, in one piece. Raises HeldError, FaultError, DriveError."""
        operation.check_fault(drive)
        if not drive.identity.has_lease:
            self._send(drive, Action.RENEW, values=values or {})
            operation.enable(drive)
            return
        self._send(drive, Action.RENEW, Bridge.ON, values or {})
        operation.await_state(drive, {State.OPERATION_ENABLED})

    def stop(self, drive: Drive) -> None:
        """Switch the bridge off, set points to zero, and stay the holder. Raises HeldError, DriveError."""
        if not drive.identity.has_lease:
            operation.disable(drive)
            _still(drive)
            return
        self._send(drive, Action.RENEW, Bridge.OFF)
        operation.await_state(drive, {State.SWITCH_ON_DISABLED, State.FAULT})

    def release(self, drive: Drive) -> None:
        """Give it up: the bridge goes off, set points to zero. Without effect once it has ended. Raises DriveError."""
        if drive.identity.has_lease:
            drive.control(Record(self.token, Action.RELEASE))
            deadline = time.monotonic() + operation.PATIENCE
            while operation.state(drive) is State.OPERATION_ENABLED and held(drive) is None:
                if time.monotonic() > deadline:
                    raise NoReplyError(f"the drive is still on {operation.PATIENCE:g} s after it was given up")
            return
        operation.disable(drive)
        try:
            _still(drive)
        finally:
            if self._watchdog:  # one that never bites is not given back
                drive.write("watchdog_time", self._watchdog)

    def _allowed(self, longest: float) -> None:
        """No longer than the drive allows, in whole ms as it travels."""
        self.seconds = min(self.seconds, math.floor(longest * 1e3 + 1e-6) * 1e-3)

    def _send(
        self, drive: Drive, action: Action, bridge: Bridge = Bridge.AS_IT_IS, values: Mapping[str, float] | None = None
    ) -> None:
        full = drive.identity.full
        if not drive.identity.has_lease:
            for name, value in (values or {}).items():
                drive.write(name, value)
            self._renewed = time.monotonic()
            return
        try:
            encoded = [(s := signal_named(name), encode(s, value, full)) for name, value in (values or {}).items()]
        except ValueError as error:
            raise RefusedError(str(error), 0) from None
        begun = time.monotonic()
        try:
            drive.control(Record(self.token, action, bridge, self.seconds, self.holder, tuple(encoded)))
        except RefusedError as error:
            told = self._told(drive, action, error)
            if values:
                why = f"the drive refused ({told.code:#x}): outside its own range" if told.code in _RANGE else str(told)
                told.args = (f"{why}; nothing was written of {_words(values)}",)
            raise told from None
        self._renewed = begun

    def _told(self, drive: Drive, action: Action, error: RefusedError) -> RefusedError:
        """Why a record was refused, as far as the drive tells."""
        try:
            now, end = held(drive), End(int(drive.read("lease_end")))
        except (DriveError, ValueError):
            return error
        if now is None and action is Action.RENEW:
            return HeldError(f"control of the drive {end.words}", error.code)
        if now is not None and (action is Action.TAKE or now.holder != self.holder):
            return HeldError(now.words, error.code)
        return error


def _words(values: Mapping[str, float]) -> str:
    units = {name: unit if (unit := signal_named(name).unit) != "1" else "" for name in values}
    return ", ".join(f"{name} = {value:g} {units[name]}".rstrip() for name, value in values.items())


class Controlled:
    """A drive under control from entry to exit: for one drive by its bus, and for tests."""

    def __init__(self, drive: Drive, lease: Lease | None = None) -> None:
        self.drive, self.lease = drive, lease or Lease()

    def write(self, **values: float) -> None:
        """Write signals (SI) in one piece."""
        self.lease.write(self.drive, values)

    def start(self, **values: float) -> None:
        """Write signals and switch the bridge on."""
        self.lease.start(self.drive, values)

    def __enter__(self) -> Self:
        self.lease.take(self.drive)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.lease.release(self.drive)
        except DriveError:
            if error is None:
                raise


def stop(drive: Drive) -> None:
    """Switch the bridge off, whoever has control: they have it no longer. Raises NoReplyError, DriveError."""
    drive.write("control_word", float(Command.DISABLE_VOLTAGE.bits))
    operation.await_state(drive, {State.SWITCH_ON_DISABLED, State.FAULT})
    if not drive.identity.has_lease:
        _still(drive)
    elif held(drive) is not None:
        raise NoReplyError("the drive is off, but somebody controls it still")


def _still(drive: Drive) -> None:
    """Every set point that can be is set to zero. Raises RefusedError for one that cannot, after all others."""
    refused: RefusedError | None = None
    for name in SET_POINTS:
        try:
            drive.write(name, 0.0)
        except RefusedError as error:
            refused = refused or error
    if refused is not None:
        raise refused
