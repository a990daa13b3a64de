"""A Modbus server over the virtual drive: TCP, RTU on a pty of its own, RTU over TCP.

Reads and writes lines in threads of its own; values written wait in the virtual drive for its next tick. A request to
another unit, or to all (unit 0), is passed over in silence. Knows nothing of what registers and frames hold.
"""

import contextlib
import os
import select
import socket
import threading
from collections.abc import Callable, Generator
from pathlib import Path
from types import TracebackType
from typing import Final, Protocol, Self
from urllib.parse import urlsplit

from drivers.wire.modbus_url import ModbusUrl, SerialPlace, TcpPlace
from emulator.drive.virtual_drive import StreamRows, VirtualDrive
from emulator.errors import BusError
from emulator.servers.faults import Faults, Passed
from emulator.servers.modbus.frames import Framing, Request, RtuFraming, TcpFraming
from emulator.servers.modbus.registers import Registers, asks_for_rows
from emulator.servers.terminal import Terminal, at_another_speed

_SILENCE: Final = 0.01  # s without a byte that ends a frame; 3.5 characters are 0.3 ms at 115200 bit/s
_SEND_TIMEOUT: Final = 1.0  # s after which a client that takes nothing is dropped
_PAUSE: Final = 0.1  # s, where nobody can be let in
_BITS_A_BYTE: Final = 11  # start, 8 data, parity or a second stop, stop
_RTU_FRAME: Final = 3  # bytes of a request besides its function and data
_TICK: Final = 1e-3  # s, how often the drive's clock is looked at


class Disturbance(Protocol):
    """What befalls a line; `emulator.servers.faults.Faults` is one. Times in s since power-on, by the drive's clock."""

    def passed(self, frame: bytes, t: float) -> list[Passed]:
        """What becomes of bytes that go into the line at time t."""
        ...

    def refuses(self, index: int, t: float) -> bool:
        """Accesses to signals of this CANopen index are refused at time t."""
        ...


class ModbusServer:
    """One unit on a line, served from construction to `close`. `faults` may be changed at any time.

    `paced`: on a serial line, an answer takes the time of its bytes and the request's, by the drive's clock.
    """

    def __init__(
        self, drive: VirtualDrive, url: ModbusUrl, faults: Disturbance | None = None, paced: bool = False,
        up_to_now: Callable[[], None] = lambda: None,
    ) -> None:
        """`up_to_now` has the drive come up to now: rows that are asked for are the newest."""
        paced_by = url.place.baudrate if paced and isinstance(url.place, SerialPlace) else 0
        self._byte_time = _BITS_A_BYTE / paced_by if paced_by else 0.0  # s
        self.faults: Disturbance = faults or Faults()
        self._drive = drive
        self._unit = url.unit
        self._up_to_now = up_to_now
        self._registers = Registers(drive, lambda index: self.faults.refuses(index, drive.elapsed))
        self._closing = threading.Event()
        self._lock = threading.Lock()  # guards what follows
        self._ends: dict[_End, threading.Thread] = {}
        self._listener: _Listener | None = None
        place = url.place
        if isinstance(place, SerialPlace) and "://" not in place.device:
            self._begin(_Pty(place), RtuFraming())
        else:
            framing = TcpFraming if isinstance(place, TcpPlace) else RtuFraming
            self._listener = _Listener(
                place if isinstance(place, TcpPlace) else _tcp_place(place), lambda end: self._begin(end, framing())
            )

    def publish(self, rows: StreamRows) -> None:
        """Keep the rows for whoever asks."""
        self._registers.publish(rows)

    def close(self) -> None:
        """Leave the line."""
        self._closing.set()
        if self._listener is not None:
            self._listener.close()
        with self._lock:
            ends = dict(self._ends)
        for end in ends:
            end.leave()
        for thread in ends.values():
            thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _begin(self, end: "_End", framing: Framing) -> None:
        thread = threading.Thread(target=self._serve, args=(end, framing), name="modbus line", daemon=True)
        with self._lock:
            self._ends[end] = thread
            thread.start()

    def _serve(self, end: "_End", framing: Framing) -> None:
        """One line to its end; bytes that cannot be Modbus end it, too, where the line tells frames by their header."""
        quiet = True
        with contextlib.closing(end), contextlib.suppress(ValueError):
            while not self._closing.is_set() and (data := end.receive(None if quiet else _SILENCE)) is not None:
                quiet = not data
                requests = [] if data else framing.silence()
                for part in self._through(end, data):
                    requests += framing.received(part)
                for request in requests:
                    self._take(end, framing, request)
        with self._lock:
            del self._ends[end]

    def _take(self, end: "_End", framing: Framing, request: Request) -> None:
        if request.unit != self._unit:
            return
        self._drive.hear()
        if asks_for_rows(request.pdu):
            self._up_to_now()
        answer = framing.answer(request, self._registers.answer(request.pdu))
        self._wait(self._drive.elapsed + self._byte_time * (len(request.pdu) + _RTU_FRAME + len(answer)))
        for part in self._through(end, answer):
            end.send(part)

    def _wait(self, moment: float) -> None:
        """Return at this time, in s by the drive's clock."""
        while self._drive.elapsed < moment and not self._closing.wait(_TICK):
            pass

    def _through(self, end: "_End", data: bytes) -> Generator[bytes]:
        """What comes of bytes on their way through the line; what is late holds up all after it."""
        for out in self.faults.passed(data, self._drive.elapsed) if data else []:
            self._wait(out.at)
            if out.intact or not end.checked:
                yield out.data


class _End(Protocol):
    """The drive's end of a line; `checked` where the network drops what it has corrupted."""

    checked: bool

    def receive(self, patience: float | None) -> bytes | None:
        """What has come; nothing when nothing did within `patience` s; None when the line has ended."""
        ...

    def send(self, data: bytes) -> None: ...

    def leave(self) -> None:
        """Make `receive` tell the end, from another thread."""
        ...

    def close(self) -> None: ...


class _Client:
    """A client's TCP connection."""

    checked = True

    def __init__(self, connection: socket.socket) -> None:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket = connection

    def receive(self, patience: float | None) -> bytes | None:
        try:
            self._socket.settimeout(patience)
            return self._socket.recv(1 << 16) or None
        except TimeoutError:
            return b""
        except OSError:
            return None

    def send(self, data: bytes) -> None:
        try:
            self._socket.settimeout(_SEND_TIMEOUT)
            self._socket.sendall(data)
        except OSError:
            self.leave()

    def leave(self) -> None:
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        self._socket.close()


class _Pty:
    """A serial line that this process makes. Raises BusError where none can be."""

    checked = False

    def __init__(self, place: SerialPlace) -> None:
        self._terminal = Terminal(Path(place.device))
        self._baudrate = place.baudrate
        self._near = self._terminal.near
        self._wake = os.eventfd(0)

    def receive(self, patience: float | None) -> bytes | None:
        ready, _, _ = select.select([self._near, self._wake], [], [], patience)
        if self._wake in ready:
            return None
        return self._at_their_speed(os.read(self._near, 1 << 16)) if ready else b""

    def send(self, data: bytes) -> None:
        with contextlib.suppress(BlockingIOError):  # a line waits for nobody
            os.write(self._near, self._at_their_speed(data))

    def _at_their_speed(self, data: bytes) -> bytes:
        return data if self._terminal.at(self._baudrate) else at_another_speed(data)

    def leave(self) -> None:
        os.eventfd_write(self._wake, 1)

    def close(self) -> None:
        self._terminal.close()
        os.close(self._near)
        os.close(self._wake)


class _Listener:
    """A TCP port that hands its clients on. Raises BusError when it cannot be had."""

    def __init__(self, place: TcpPlace, begin: Callable[[_End], None]) -> None:
        try:
            self._socket = socket.create_server((place.host, place.port))
        except (OSError, UnicodeError) as error:
            reason, *_ = str(getattr(error, "strerror", None) or error).split(" (while attempting")
            raise BusError(f"cannot serve Modbus at {place}: {reason}") from None
        self._begin = begin
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._accept, name=f"modbus {place.port}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._closing.set()
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        self._thread.join()

    def _accept(self) -> None:
        while not self._closing.is_set():
            try:
                client = _Client(self._socket.accept()[0])
            except OSError:  # closed, left again, or out of file descriptors for a while
                self._closing.wait(_PAUSE)
                continue
            self._begin(client)


def _tcp_place(place: SerialPlace) -> TcpPlace:
    """Where a serial line over TCP is served. Raises ValueError, in a sentence."""
    form = f"expected the path of a serial line, or socket://HOST:PORT, to serve, got {place.device!r}"
    try:
        parts = urlsplit(place.device)
        host, port = parts.hostname, parts.port
    except ValueError:
        raise ValueError(form) from None
    if parts.scheme != "socket" or not host or not port:
        raise ValueError(form)
    return TcpPlace(host, port)
