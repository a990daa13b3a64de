"""A drive under control for as long as something is done with it: however that ends, it is off then, and as before.

Where no link is left for that, the control lease runs out, and what was noted on disk before is undone later.
"""

import contextlib
import math
import threading
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import contextmanager
from typing import Final

from bench.actions.safety.limits import RPM, Limits, Overload
from bench.actions.safety.unfinished import Origin, freed, take
from bench.errors import BenchError, ConflictError
from drivers import capture, operation
from drivers.drive import Drive
from drivers.errors import DriveError, FaultError, NoReplyError, RefusedError
from drivers.lease import HeldError, Lease
from drivers.wire.cia402 import State

_NO_TORQUE: Final = 2.0  # of `safe_torque_off`


class CancelledError(BenchError):
    """It was asked to end."""


@contextmanager
def under_control(drive: Drive, lease: Lease, origin: Origin, settings: Iterable[str]) -> Generator[None]:
    """Control of the drive; afterwards it is without current and its bridge off, these settings as they were.

    What a bench before has left is undone first. Raises as `unfinished.freed` and `take`; ConflictError where
    settings change meanwhile, FaultError where no torque is allowed, DriveError where it could not be told to stop.
    """
    freed(drive, origin.folder)
    if drive.identity.has_lease and drive.read("safe_torque_off") == _NO_TORQUE:
        raise FaultError("safe torque off is active: the drive cannot be switched on", 0)
    before = {name: drive.read(name) for name in settings}
    noted = take(drive, lease, origin, before)
    try:
        lease.stop(drive)
        changed = sorted(name for name, value in before.items() if drive.read(name) != value)
        if changed:  # by who had control until now: these are not to be kept
            before = {}
            raise ConflictError(f"another client has just changed {', '.join(changed)}: ask again")
        yield
    finally:
        with contextlib.suppress(DriveError):  # a recorder that waits on does no harm
            capture.stop(drive)
        try:
            _ended(drive, lease, before)
            noted.undone()
        finally:
            noted.close()


class Guard:
    """Looks after a drive that is on: renews its lease, and tells where it went off, turns too fast, or takes too much.

    `most_speed` (rad/s, electrical) may be changed.
    """

    def __init__(
        self, drive: Drive, lease: Lease, limits: Limits, what: str, cancelled: threading.Event,
        most_speed: float = math.inf,
    ) -> None:  # fmt: skip
        """`what` is done with it, as in "the drive went off during what"."""
        self._drive, self._lease, self._what, self._cancelled = drive, lease, what, cancelled
        self.most_speed = most_speed
        self._overload = Overload(limits)
        self._n_p = drive.read("n_p")

    def check(self, *, loaded: bool = True) -> None:
        """To be called all the time. `loaded`: its own loops may ask for currents. Raises FaultError, DriveError."""
        self._lease.keep(self._drive)
        omega_e, now = self._drive.read("omega_e"), operation.state(self._drive)
        if abs(omega_e) > self.most_speed:
            rpm, most = (omega / (self._n_p * RPM) for omega in (omega_e, self.most_speed))
            raise FaultError(f"the shaft turned at {rpm:.5g} rpm, expected at most {most:.5g}: the drive is stopped", 0)
        if now is State.OPERATION_ENABLED:
            if loaded and (too_much := self._overload.told(self._drive)):
                raise FaultError(f"the drive's speed control asked for {too_much}", 0)
            return
        found = operation.fault(self._drive)
        code, text = (found.code, f"{found.text} (0x{found.code:04X})") if found else (0, f"it is in state {now}")
        raise FaultError(f"the drive went off during {self._what}: {text}", code)

    def check_cancelled(self) -> None:
        """Raise CancelledError where it is to end."""
        if self._cancelled.is_set():
            raise CancelledError(f"{self._what} was cancelled; the drive is stopped")

    def pause(self, seconds: float) -> None:
        """Wait. Raises CancelledError."""
        self._cancelled.wait(seconds)
        self.check_cancelled()


def _ended(drive: Drive, lease: Lease, before: Mapping[str, float]) -> None:
    """Off, restored, given up; where control is another's by now, nothing is written. Raises DriveError."""
    acts: dict[str, Callable[[Drive], object]] = {
        "stop": lease.stop, "restore": lambda drive: _restored(drive, lease, before), "release": lease.release
    }
    try:
        failed = {name: error for name, act in acts.items() if (error := _twice(act, drive)) is not None}
    except HeldError:  # the lease has ended, and with it the bridge has gone off
        try:
            for name, value in before.items():
                drive.write(name, value)
        except RefusedError as error:  # another has control
            raise NoReplyError(
                f"another has control, and the drive's settings could not be restored ({error}): the next start does it"
            ) from error
        return
    if "stop" in failed and "release" in failed:  # either switches it off
        raise NoReplyError(
            f"the drive could not be told to stop ({failed['stop']}); it goes off by itself when nothing is heard of "
            f"the bench for {lease.seconds:g} s: see that it has"
        ) from failed["stop"]
    if "restore" in failed:
        raise NoReplyError(
            f"the drive is stopped, its settings could not be restored ({failed['restore']}): the next start does it"
        ) from failed["restore"]


def _restored(drive: Drive, lease: Lease, before: Mapping[str, float]) -> None:
    """All settings as before; one that is refused keeps none of the others from it. Raises DriveError."""
    try:
        lease.write(drive, before)
    except HeldError:
        raise
    except RefusedError:
        refused: RefusedError | None = None
        for name, value in before.items():
            try:
                lease.write(drive, {name: value})
            except HeldError:
                raise
            except RefusedError as error:
                refused = error
        if refused is not None:
            raise refused from None


def _twice(act: Callable[[Drive], object], drive: Drive) -> DriveError | None:
    """Do it, once more where that fails; why the second failed as well. Raises HeldError."""
    for again in (True, False):
        try:
            act(drive)
        except HeldError:
            raise
        except DriveError as error:
            if not again:
                return error
        else:
            break
    return None
