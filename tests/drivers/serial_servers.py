"""A serial line of this machine behind a TCP port, as device servers have it: RFC 2217 by pyserial, or bare bytes."""

import contextlib
import os
import select
import socket
import threading
from collections.abc import Generator
from typing import Any, cast

import serial
from serial.rfc2217 import PortManager

from tests.conftest import free_port


class _Sent:
    """The connection as pyserial's port manager writes to it."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection

    def write(self, data: bytes) -> None:
        self._connection.sendall(data)


class _Pty(serial.Serial):
    """A pseudo-terminal: a serial line without modem lines, which a port manager would set."""

    def _update_rts_state(self) -> None: ...

    def _update_dtr_state(self) -> None: ...

    def _update_break_state(self) -> None: ...

    @property
    def cts(self) -> bool:
        return True

    @property
    def dsr(self) -> bool:
        return True

    @property
    def cd(self) -> bool:
        return True

    @property
    def ri(self) -> bool:
        return False


@contextlib.contextmanager
def device_server(device: str, baudrate: int, rfc2217: bool) -> Generator[int]:
    """Serve a device, at this baud rate until an RFC 2217 client sets another, to one client after the other."""
    port, end = free_port(), threading.Event()
    with socket.create_server(("127.0.0.1", port)) as listener:
        listener.settimeout(0.05)

        def serve() -> None:
            while not end.is_set():
                with contextlib.suppress(OSError):
                    connection, _ = listener.accept()
                    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    with connection, _Pty(device, baudrate, timeout=0) as line:
                        _pass(connection, line, rfc2217, end)

        thread = threading.Thread(target=serve, name="device server")
        thread.start()
        try:
            yield port
        finally:
            end.set()
            thread.join()


def _pass(connection: socket.socket, line: Any, rfc2217: bool, end: threading.Event) -> None:
    """Bytes both ways, until the client leaves or the line ends."""
    manager = cast(Any, PortManager)(line, _Sent(connection)) if rfc2217 else None
    while not end.is_set():
        ready, _, _ = select.select([connection, line.fd], [], [], 0.05)
        if connection in ready:
            data = connection.recv(1 << 16)
            if not data:
                return
            line.write(b"".join(manager.filter(data)) if manager else data)
        if line.fd in ready:
            data = os.read(line.fd, 1 << 16)
            connection.sendall(b"".join(manager.escape(data)) if manager else data)
