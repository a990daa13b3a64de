"""One unit on a Modbus line, to its client. The only client file that knows pymodbus.

Requests are one at a time, in the order in which threads come. The library times out by itself and is never
interrupted. After a time-out a late answer may still be under way: a TCP connection is made anew, a serial line is read
until it is silent, and whatever comes later is told by its function, by its size, and, in the window, by the request's
number and by where it begins: every value is read through the window. What is only read is asked again when no answer
comes; what is written, never. A line that hears itself, as RS-485 adapters may, is heard past its echo.

Knows nothing of signals.
"""

import contextlib
import logging
import random
import socket
import struct
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, Final, TypeVar, cast

import serial
from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.exceptions import ConnectionException, ModbusException, ModbusIOException
from pymodbus.pdu import ModbusPDU
from pymodbus.pdu.register_message import ReadWriteMultipleRegistersResponse

from drivers import serial_port
from drivers.errors import ConnectError, DriveError, FrameError, LostError, NoReplyError, RefusedError, held
from drivers.modbus.turns import Turns
from drivers.wire.modbus_map import (
    EXCEPTIONS,
    READ,
    READ_WRITE,
    REGISTERS,
    REQUEST,
    REQUEST_FORMAT,
    ROWS,
    WINDOW,
    WINDOW_LENGTH,
    WRITE,
    Window,
    name_of,
    registers,
)
from drivers.wire.modbus_url import ModbusUrl, SerialPlace, TcpPlace

REPLY_TIMEOUT: Final = 0.3  # s for one answer, besides its time on the line
READ_ATTEMPTS: Final = 3
_LINE_TIMEOUT: Final = 2.0  # s to connect, or for a request to be sent
_PATIENT: Final = 0.7  # s for an answer that has not come in time, to tell that it comes at all
_MBAP: Final = 6  # bytes before those that a TCP frame's head counts
_QUIET: Final = 0.05  # s without a byte: nothing more is under way
_DRAIN: Final = 1.0  # s, at most, until a line is silent
_LONGEST: Final = 280  # bytes of a request and its answer
_BITS: Final = 11  # of a character on the line
_SHOWN: Final = 24  # bytes of an answer in a message

T = TypeVar("T")

logging.getLogger("pymodbus").setLevel(logging.CRITICAL)  # it logs what arrives here as exceptions


class ModbusLine:
    """A unit as its client sees it, from construction to `close`. Raises ConnectError when there is no such line."""

    def __init__(self, url: ModbusUrl) -> None:
        self.unit = str(url)
        self.closed = threading.Event()  # set from the first `close` on
        self._url = url
        self._turns = Turns()
        self._number = random.getrandbits(16)  # of the latest request in the window; those of clients before are others
        self._sent = b""  # the latest request
        self._received = b""  # since then
        self._gone = False  # there is no line any more
        try:
            self._client: _TcpClient | _SerialClient = self._opened()
        except _NoLineError as error:
            raise ConnectError(f"nothing serves Modbus {_at(url)}: {error}") from None

    @property
    def timeout(self) -> float:
        """Time in s within which an answer is expected."""
        return _timeout(self._url)

    @property
    def patience(self) -> float:
        """Time in s within which an answer that is read comes, or never."""
        return READ_ATTEMPTS * _timeout(self._url)

    def answers_after(self, address: int, count: int) -> float | None:
        """Time in s after which a unit that did not answer in time does; None where it does not either.

        The line is of no use after it.
        """
        with self._turns, contextlib.suppress(_NoLineError, DriveError):
            self._client.close()
            self._client, begun = self._opened(_PATIENT), time.monotonic()
            self._execute(READ, name_of(address, count), lambda: self._client.read_holding_registers(
                address, count=count, device_id=self._url.unit
            ))
            return time.monotonic() - begun
        return None

    def read(self, address: int, count: int) -> list[int]:
        """Holding registers, by function code 3."""
        with self._turns:
            return self._repeated(lambda: self._registers(
                READ, count, self._execute(
                    READ, name_of(address, count),
                    lambda: self._client.read_holding_registers(address, count=count, device_id=self._url.unit),
                )
            ))

    def window(self, kind: int, first: int, length: int, what: str) -> Window:
        """What the drive's window shows of `kind` from `first` on, in `length` registers besides its head."""
        with self._turns:
            return self._window(kind, first, length, what)

    def write(self, address: int, words: Sequence[int]) -> list[int]:
        """Write registers, by function code 16; what the window shows of them right after it."""
        what = name_of(address)
        with self._turns:
            self._check()
            try:
                self._written(address, words, what)
            except (NoReplyError, FrameError):
                self._clear()
                raise
            return registers(self._window(REGISTERS, address, len(words), what).data)

    def write_repeated(self, address: int, words: Sequence[int]) -> None:
        """Write registers that may be written twice: again when no answer comes."""
        what = name_of(address)
        with self._turns:
            self._repeated(lambda: self._written(address, words, what))

    def close(self) -> None:
        """Leave the line, when the request under way has ended."""
        self.closed.set()
        with self._turns:
            self._client.close()

    def _window(self, kind: int, first: int, length: int, what: str) -> Window:
        self._number = (self._number + 1) & 0xFFFF
        request = registers(struct.pack(REQUEST_FORMAT, self._number, kind, first))
        return self._repeated(lambda: self._echoed(request, length + WINDOW_LENGTH, what))

    def _echoed(self, request: list[int], count: int, what: str) -> Window:
        """One request of the window. Raises FrameError for the answer to another."""
        answer = self._execute(READ_WRITE, what, lambda: self._client.readwrite_registers(
            read_address=WINDOW, read_count=count, write_address=REQUEST, values=request, device_id=self._url.unit,
        ))
        words = self._registers(READ_WRITE, count, answer)
        window = Window.of(words)
        if words[:2] != request[:2]:
            raise FrameError(f"{self.unit} answered request {words[0]}, expected {request[0]}, for {what}")
        if words[2:4] != request[2:4] and window.kind != ROWS:  # rows that are gone are followed by those there are
            expected = request[2] << 16 | request[3]
            raise FrameError(f"{self.unit} answered from {window.first} on, expected {expected}, for {what}")
        return window

    def _written(self, address: int, words: Sequence[int], what: str) -> None:
        answer = self._execute(
            WRITE, what, lambda: self._client.write_registers(address, list(words), device_id=self._url.unit)
        )
        if (answer.function_code, answer.address, answer.count) != (WRITE, address, len(words)):
            raise FrameError(f"{self.unit} answered a write to {what} with {_bytes(self._received)}")

    def _registers(self, function: int, count: int, answer: ModbusPDU) -> list[int]:
        if answer.function_code != function or len(answer.registers) != count:
            raise FrameError(
                f"{self.unit} answered with {_bytes(self._received)}, "
                f"expected {count} registers by function {function}"
            )
        return list(answer.registers)

    def _repeated(self, attempt: Callable[[], T]) -> T:
        """Make a request again until it is answered."""
        failure: DriveError | None = None
        for _ in range(READ_ATTEMPTS):
            self._check()
            try:
                return attempt()
            except (NoReplyError, FrameError) as error:
                failure = error
                self._clear()
        assert failure is not None
        raise failure

    def _execute(self, function: int, what: str, call: Callable[[], ModbusPDU]) -> ModbusPDU:
        """One transaction; the library's errors as ours, in a sentence."""
        self._received = b""
        try:
            answer = call()
        except (ConnectionException, OSError):
            self._gone = True
            self._client.close()
            raise LostError(f"{self.unit} is gone: the line has ended") from None
        except (ModbusException, ValueError, LookupError, struct.error):  # the last three: answers that cannot be
            if expected := self._other_number():
                raise FrameError(
                    f"{self.unit} answered with transaction number {self._received[:2].hex()}, expected {expected}: "
                    "a gateway that does not return it?"
                ) from None
            if self._received:
                came = _bytes(self._received)
                raise FrameError(f"{self.unit} answered for {what} with what is no Modbus: {came}") from None
            raise NoReplyError(f"{self.unit} did not answer for {what} within {_timeout(self._url):g} s") from None
        if answer.isError():
            code = cast(Any, answer).exception_code
            if answer.function_code != function | 0x80:
                raise FrameError(f"{self.unit} refused function {answer.function_code & 0x7F}, expected {function}")
            text = EXCEPTIONS.get(code, "unknown")
            raise RefusedError(f"{self.unit} answered Modbus exception {code} ({text}) for {what}", code)
        return answer

    def _other_number(self) -> str:
        """The number that a sound answer over TCP should have had where it has another, in hexadecimal."""
        frame = self._received
        sound = isinstance(self._url.place, TcpPlace) and len(frame) > _MBAP and frame[6] == self._url.unit
        if not sound or frame[2:4] != b"\0\0" or int.from_bytes(frame[4:6], "big") != len(frame) - _MBAP:
            return ""
        return self._sent[:2].hex() if frame[:2] != self._sent[:2] else ""

    def _check(self) -> None:
        """Raise LostError when there is no line any more."""
        if self.closed.is_set():
            raise LostError(f"the line to {self.unit} is closed: it no longer takes frames")
        if self._gone:
            raise LostError(f"{self.unit} is gone: the line has ended")

    def _clear(self) -> None:
        """Have nothing under way on the line: no answer, and no part of one."""
        if self.closed.is_set():
            return
        try:
            if isinstance(self._client, _SerialClient):
                self._client.drain()
            else:
                self._client.close()
                self._client = self._opened()
        except (_NoLineError, OSError) as error:
            self._gone = True
            self._client.close()
            raise LostError(f"{self.unit} is gone: {error}") from None

    def _opened(self, timeout: float = 0.0) -> "_TcpClient | _SerialClient":
        place, timeout = self._url.place, timeout or _timeout(self._url)
        try:
            if isinstance(place, TcpPlace):
                return _TcpClient(place, timeout, self._trace)
            return _SerialClient(place, timeout, self._trace)
        except (OSError, ValueError) as error:  # ValueError: pyserial, of a URL that it does not know
            raise _NoLineError(held(error) or _first_line(error)) from None

    def _trace(self, sending: bool, data: bytes) -> bytes:
        """Told by the library of all that it sends and receives."""
        if sending:
            self._sent = data
        self._received = b"" if sending else data
        return data


class _NoLineError(Exception):
    """No line, and why."""


class _Answer(ReadWriteMultipleRegistersResponse):
    """The library's answer of the window, its registers taken apart at once."""

    def decode(self, data: bytes) -> None:
        """Raises ModbusIOException where there are fewer bytes than it says."""
        size = data[0]
        if size >= len(data):
            raise ModbusIOException(f"expected {size} bytes, got {len(data) - 1}", function_code=self.function_code)
        self.registers = registers(data[1 : 1 + size // 2 * 2])


class _TcpClient(ModbusTcpClient):
    """The library's client, connected."""

    def __init__(self, place: TcpPlace, timeout: float, trace: Callable[[bool, bytes], bytes]) -> None:
        super().__init__(place.host, port=place.port, timeout=timeout, retries=0, trace_packet=trace)
        self.register(_Answer)
        self.socket = socket.create_connection((place.host, place.port), timeout=_LINE_TIMEOUT)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def connect(self) -> bool:
        """There is no other connection than the one that it began with."""
        return self.socket is not None


class _SerialClient(ModbusSerialClient):
    """The library's client on an open port. It waits for bytes, where the library would look every millisecond."""

    def __init__(self, place: SerialPlace, timeout: float, trace: Callable[[bool, bytes], bytes]) -> None:
        def heard(sending: bool, data: bytes) -> bytes:
            self._echo = data if sending else self._echo
            return trace(sending, data)

        self._echo = b""  # what a line that hears itself begins its answer with
        super().__init__(place.device, baudrate=place.baudrate, timeout=timeout, retries=0, trace_packet=heard)
        self.register(_Answer)
        self.socket: Any = serial.serial_for_url(
            place.device, baudrate=place.baudrate, parity=place.parity, stopbits=place.stopbits,
            timeout=timeout, exclusive=True,
            write_timeout=None if place.device.startswith("rfc2217://") else _LINE_TIMEOUT,  # it knows none
        )

    def connect(self) -> bool:
        return self.socket is not None

    def recv(self, size: int | None) -> bytes:
        """What has come but for an echo of the request, waiting at most the time-out for its first byte."""
        del size
        data, echo = self._some(), self._echo
        while data and len(data) < len(echo) and echo.startswith(data) and (more := self._some()):
            data += more  # no answer begins as its request does for long
        if echo and data.startswith(echo):
            data = data[len(echo) :] or self._some()
        self._echo = b""
        return data

    def _some(self) -> bytes:
        if self.socket is None:
            raise ConnectionException("closed")
        data = self.socket.read(1)
        while data and len(data) < _LONGEST and (waiting := self.socket.in_waiting):
            data += self.socket.read(waiting)
        return data

    def drain(self) -> None:
        """Read until the line is silent."""
        if self.socket is None:
            return
        deadline = time.monotonic() + _DRAIN
        timeout, self.socket.timeout = self.socket.timeout, _QUIET
        while self.socket.read(1) and time.monotonic() < deadline:
            self.socket.read(self.socket.in_waiting)
        self.socket.timeout = timeout

    def close(self) -> None:
        port, self.socket = self.socket, None
        if port is not None:
            serial_port.close(port)


def _timeout(url: ModbusUrl) -> float:
    """Time in s for one answer."""
    line = _LONGEST * _BITS / url.place.baudrate if isinstance(url.place, SerialPlace) else 0.0
    return round((url.timeout or REPLY_TIMEOUT) + line, 2)


def _at(url: ModbusUrl) -> str:
    return f"{'at' if isinstance(url.place, TcpPlace) else 'on'} {url.place}"


def _bytes(data: bytes) -> str:
    """As a sentence has them: not by the thousand."""
    more = f" ... ({len(data)} bytes)" if len(data) > _SHOWN else ""
    return data[:_SHOWN].hex(" ") + more


def _first_line(error: BaseException) -> str:
    return (getattr(error, "strerror", None) or str(error) or type(error).__name__).splitlines()[0]
