"""Modbus lines for tests: where they can be, what befalls them, and their far end as bare bytes."""

import contextlib
import os
import select
import socket
import tempfile
import termios
import time
import tty
import uuid
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path

from drivers.wire.modbus_url import SerialPlace, TcpPlace, parse_modbus_url
from emulator.servers.faults import Passed
from tests.conftest import free_port

_ANSWER = 1.0  # s within which a server has answered


def tcp_url(unit: int = 1) -> str:
    """A unit at a free TCP port."""
    return f"modbus+tcp://127.0.0.1:{free_port()}/{unit}"


def pty_url(unit: int = 1, baudrate: int = 1_000_000) -> str:
    """A unit on a serial line at a path of its own."""
    return f"modbus+rtu://{tempfile.gettempdir()}/pmsm-bench-{uuid.uuid4().hex}?baudrate={baudrate}/{unit}"


def socket_url(unit: int = 1) -> str:
    """A unit on a serial line behind a free TCP port."""
    return f"modbus+rtu://socket://127.0.0.1:{free_port()}/{unit}"


URLS: dict[str, Callable[[], str]] = {"tcp": tcp_url, "pty": pty_url}
ALL_URLS = URLS | {"socket": socket_url}


@dataclass
class Disturbed:
    """What befalls a line: `left` pieces of bytes after `skip` are delayed by the drive's clock, doubled, changed."""

    left: int
    delay: float = 0.0  # s
    copies: int = 1
    refused: int = 0  # index of signals that are refused
    change: Callable[[bytes], bytes] = bytes
    skip: int = 0

    def passed(self, frame: bytes, t: float) -> list[Passed]:
        if self.skip or not self.left:
            self.skip = max(0, self.skip - 1)
            return [Passed(t, frame, True)]
        self.left -= 1
        return [Passed(t + self.delay, self.change(frame), True)] * self.copies

    def refuses(self, index: int, t: float) -> bool:
        del t
        return index == self.refused


class Line:
    """The far end of a line, as bytes."""

    def __init__(self, url: str) -> None:
        place = parse_modbus_url(url).place
        self._socket: socket.socket | None = None
        if isinstance(place, TcpPlace) or "://" in place.device:
            port = place.port if isinstance(place, TcpPlace) else int(place.device.rpartition(":")[2])
            self._socket = socket.create_connection(("127.0.0.1", port))
            self._file = self._socket.fileno()
        else:
            assert isinstance(place, SerialPlace)
            self._file = os.open(place.device, os.O_RDWR | os.O_NOCTTY)
            tty.setraw(self._file)
            _set_speed(self._file, place.baudrate)

    def send(self, data: bytes) -> None:
        os.write(self._file, data)

    def receive(self, size: int, patience: float = _ANSWER) -> bytes:
        """So many bytes, or what has come in time."""
        data, deadline = b"", time.monotonic() + patience
        while len(data) < size and (left := deadline - time.monotonic()) > 0.0:
            if select.select([self._file], [], [], left)[0]:
                try:
                    piece = os.read(self._file, size - len(data))
                except ConnectionError:
                    break
                if not piece:
                    break
                data += piece
        return data

    def ask(self, request: str, answer: str) -> None:
        """Send a request; the answer is as it should be. Both in hexadecimal."""
        expected = bytes.fromhex(answer)
        self.send(bytes.fromhex(request))
        assert self.receive(len(expected)).hex(" ") == expected.hex(" ")

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
        else:
            os.close(self._file)


@contextlib.contextmanager
def line_to(url: str) -> Generator[Line]:
    """The far end of a line."""
    with contextlib.closing(Line(url)) as line:
        yield line


def _set_speed(line: int, baudrate: int) -> None:
    settings = termios.tcgetattr(line)
    settings[4:6] = [getattr(termios, f"B{baudrate}")] * 2
    termios.tcsetattr(line, termios.TCSANOW, settings)


def path_of(url: str) -> Path:
    """Where a serial line's pty is."""
    place = parse_modbus_url(url).place
    assert isinstance(place, SerialPlace)
    return Path(place.device)
