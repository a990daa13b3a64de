"""A CAN interface of this process, `falling`, that can go down as a kernel's does, and what it then raises."""

import errno
import os
from typing import Any

import can
from can.interfaces.virtual import VirtualBus

troubles: dict[str, int] = {}
"""Error number of each channel in trouble: ENETDOWN, it is down; ENODEV, it is gone; ENOBUFS, it takes no frame."""

# As an entry point of a package would
can.interfaces.BACKENDS["falling"] = ("tests.drivers.canopen.falling_bus", "FallingBus")
can.util.VALID_INTERFACES |= {"falling"}  # pyright: ignore[reportPrivateImportUsage]


class FallingBus(VirtualBus):
    """One client of a channel."""

    def __init__(self, channel: Any = None, **options: Any) -> None:
        if troubles.get(channel) == errno.ENODEV:
            raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
        super().__init__(channel, **options)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self._check("Failed to transmit", errno.ENETDOWN, errno.ENODEV, errno.ENOBUFS)
        super().send(msg, timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        self._check("Error receiving", errno.ENETDOWN, errno.ENODEV)
        return super()._recv_internal(timeout)

    def _check(self, what: str, *numbers: int) -> None:
        number = troubles.get(str(self.channel_id))
        if number in numbers:
            raise can.CanOperationError(f"{what}: [Errno {number}] {os.strerror(number)}", number)
