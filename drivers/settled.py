"""A write whose answer was lost: read back, and made again where it was not taken. Knows nothing of transports."""

from collections.abc import Callable
from typing import Final

from drivers.errors import FrameError, NoReplyError

ATTEMPTS: Final = 3
REPEATABLE: Final = ("capture_offset",)  # commands that may be given twice


def settle(write: Callable[[], None], taken: Callable[[], bool]) -> None:
    """Write until it is answered, or `taken`, asked after each write without an answer, says so.

    For what may be written twice. Raises NoReplyError, FrameError where neither comes.
    """
    for left in reversed(range(ATTEMPTS)):
        try:
            write()
        except (NoReplyError, FrameError):
            if taken():
                return
            if not left:
                raise
        else:
            return
