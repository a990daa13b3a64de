"""The drive's end of a link, which may go and come back: where it ends, it is opened again until it is there."""

import sys
from collections.abc import Callable
from types import TracebackType
from typing import Final, Protocol, Self

from drivers.wire.can_url import parse_can_url
from drivers.wire.modbus_url import parse_modbus_url
from drivers.wire.uart_url import parse_uart_url
from emulator.drive.virtual_drive import StreamRows, VirtualDrive
from emulator.errors import BusError
from emulator.input_file import one_line
from emulator.servers.canopen.server import CanopenNode
from emulator.servers.faults import Faults
from emulator.servers.modbus.server import ModbusServer
from emulator.servers.uart import UartServer

SCHEMES: Final = ("canopen", "modbus+tcp", "modbus+rtu", "uart")
RETRY: Final = 0.5  # s of the drive's time between attempts to open a link again


class Server(Protocol):
    """Serves a link from construction to `close`."""

    def publish(self, rows: StreamRows) -> None:
        """Send what has become due. Called after every run of the virtual drive. Raises BusError."""
        ...

    def close(self) -> None: ...


class Link:
    """The link at a URL, from construction to `close`. Raises ValueError, BusError where it cannot be at first.

    `faults` may be changed at any time.
    """

    def __init__(
        self, url: str, drive: VirtualDrive, faults: Faults, up_to_now: Callable[[], None] = lambda: None
    ) -> None:
        """`up_to_now` has the drive come up to now, for who asks for the newest rows."""
        self._url = url
        self._up_to_now = up_to_now
        self._drive = drive
        self.faults = faults
        self._trouble = ""  # that has been told
        self._again = 0.0  # s by the drive's clock, when to try again
        self._server: Server | None = server_at(url, drive, faults, up_to_now)

    def publish(self, rows: StreamRows) -> None:
        """Send what has become due; where the link has gone, see whether it is back."""
        now = self._drive.elapsed
        if self.faults.unplugged(now):
            self.close()
            return
        if self._server is None and now < self._again:
            return
        try:
            if self._server is None:
                self._server = server_at(self._url, self._drive, self.faults, self._up_to_now)
            self._server.publish(rows)
        except BusError as error:
            self.close()
            self._again = now + RETRY
            self._tell(str(error))
        else:
            if now >= self._again + RETRY:  # one that is opened, and gone again at once, is not back
                self._tell("")

    def close(self) -> None:
        """Leave the link."""
        server, self._server = self._server, None
        if server is not None:
            server.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _tell(self, trouble: str) -> None:
        """Say what is wrong with the link, once, and when it is over."""
        if trouble != self._trouble:
            said = trouble or f"{self._url} is served again"
            print(f"pmsm-bench emulate: {one_line(said)}", file=sys.stderr, flush=True)
            self._trouble = trouble


def server_at(
    url: str, drive: VirtualDrive, faults: Faults, up_to_now: Callable[[], None] = lambda: None
) -> Server:
    """The drive's end of the link that a URL names; `up_to_now` as of `Link`. Raises ValueError, BusError."""
    scheme = url.partition("://")[0]
    if scheme == "uart":
        return UartServer(drive, parse_uart_url(url), faults)
    if scheme in ("modbus+tcp", "modbus+rtu"):
        return ModbusServer(drive, parse_modbus_url(url), faults, up_to_now=up_to_now)
    if scheme == "canopen":
        return CanopenNode(drive, parse_can_url(url), faults)
    raise ValueError(f"expected a URL that starts with {' or '.join(f'{s}://' for s in SCHEMES)}, got {url!r}")
