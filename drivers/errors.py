"""What can go wrong between bench and drive.

    DriveError
      ConnectError   no such bus, port, node
      LostError      it was there: heartbeat missed, port gone
        ResetError   it has reset
      NoReplyError   no answer in time
      RefusedError   the drive said no (SDO abort, Modbus exception)
        GoneError    it has what was asked for no longer
      FrameError     bytes that cannot be
      FaultError     the drive is in fault (carries the error code)
"""

import errno


class DriveError(Exception):
    """Any failure between bench and drive; its text is a sentence for the user."""


class ConnectError(DriveError):
    """No such bus, port or node, or not the drive that was expected."""


class LostError(DriveError):
    """The drive was there and is gone."""


class ResetError(LostError):
    """The drive has reset: its tick counts anew."""


class NoReplyError(DriveError):
    """No answer in time."""


class RefusedError(DriveError):
    """The drive said no. `code` is its reason (SDO abort code, Modbus exception)."""

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code


class GoneError(RefusedError):
    """The drive no longer has what was asked for."""

    def __init__(self, message: str) -> None:
        super().__init__(message, 0)


class FrameError(DriveError):
    """Bytes that cannot be."""


class FaultError(DriveError):
    """The drive is in fault. `code` is its error code."""

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code


def held(error: BaseException) -> str | None:
    """The sentence for a serial line that was not to be opened since another program has it; None for other reasons."""
    busy = getattr(error, "errno", None) in (errno.EAGAIN, errno.EBUSY)  # locked; had for one program alone
    return "another program holds it" if busy else None
