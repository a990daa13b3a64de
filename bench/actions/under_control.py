"""A drive under control for as long as something is done with it: however that ends, it is off then, and as before.

Where no link is left for that, the control lease runs out, and what was noted on disk before is undone later.
"""

import contextlib
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import contextmanager

from bench.actions.unfinished import Origin, take
from bench.errors import BenchError
from drivers import capture
from drivers.drive import Drive
from drivers.errors import DriveError, NoReplyError, RefusedError
from drivers.lease import HeldError, Lease


class CancelledError(BenchError):
    """It was asked to end."""


@contextmanager
def under_control(drive: Drive, lease: Lease, origin: Origin, settings: Iterable[str]) -> Generator[None]:
    """Control of the drive; afterwards it is without current and its bridge off, these settings as they were.

    Raises as `unfinished.take`; DriveError where it could not be told to stop.
    """
    before = {name: drive.read(name) for name in settings}
    noted = take(drive, lease, origin, before)
    try:
        lease.stop(drive)
        yield
    finally:
        with contextlib.suppress(DriveError):  # a recorder that waits on does no harm
            capture.stop(drive)
        try:
            _ended(drive, lease, before)
            noted.undone()
        finally:
            noted.close()


def _ended(drive: Drive, lease: Lease, before: Mapping[str, float]) -> None:
    """Off, restored, given up; where control is another's by now, nothing is written. Raises DriveError."""
    acts: dict[str, Callable[[Drive], object]] = {
        "stop": lease.stop, "restore": lambda drive: lease.write(drive, before), "release": lease.release
    }
    try:
        failed = {name: error for name, act in acts.items() if (error := _twice(act, drive)) is not None}
    except HeldError:  # the lease has ended, and with it the bridge has gone off
        with contextlib.suppress(RefusedError):  # another has control, and the settings are that one's now
            for name, value in before.items():
                drive.write(name, value)
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
