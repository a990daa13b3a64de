"""The virtual drive's end of a serial line: on a pseudo-terminal, or on a TCP port, each client with a line of its own.

One thread serves all lines; none ever waits for a client: rows that a line does not take are dropped and counted, and
the ticks of those that follow tell the gap. Time comes in as the drive's ticks.
"""

import contextlib
import heapq
import math
import os
import selectors
import socket
import struct
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

import numpy as np

from drivers.wire import canopen_od as od
from drivers.wire import uart_frame as uf
from drivers.wire.codec import FULL_SCALES, FullScales, decode, encode_held, si_to_counts
from drivers.wire.dictionary import STREAM_ROW, Signal, signal_named
from drivers.wire.uart_frame import Frame, Kind
from drivers.wire.uart_url import UartUrl
from emulator.drive.control_lease import Denial, DeniedError
from emulator.drive.virtual_drive import StreamRows, VirtualDrive
from emulator.errors import BusError
from emulator.servers.faults import Faults
from emulator.servers.terminal import Terminal, at_another_speed

_BITS_A_BYTE: Final = 10  # start, 8 data, stop
_CHUNK: Final = 4096  # bytes that are put together for one write
_BACKLOG: Final = (1024, 65536)  # bytes of rows that a line may be behind: 0.2 s, within these
_ROWS: Final = uf.ROWS_PER_FRAME
_REPLIES: Final = 256  # that a line may be behind

_TEMPERATURES: Final = (signal_named("temp_winding"), signal_named("temp_magnet"))


class _RefusedError(Exception):
    """A request is refused: the signal's number and a code."""

    def __init__(self, code: int, number: int = uf.NO_SIGNAL) -> None:
        super().__init__(code, number)
        self.code, self.number = code, number


class UartServer:
    """A drive on a serial line. `paced`: no quicker than the baud rate, by the drive's time.

    `faults` may be changed at any time.
    """

    def __init__(
        self, drive: VirtualDrive, place: UartUrl, faults: Faults | None = None, paced: bool = False
    ) -> None:
        self.faults = faults or Faults()
        self._drive = drive
        self._place = place
        self._paced = paced
        self._full: FullScales = {name: drive.read(name) for name in FULL_SCALES}
        self._tick = drive.tick  # at the end of the latest run
        self._error_code = 0
        self._lengths = [(0, drive.row_periods)]  # rows that begin from a tick on cover so many periods
        self._lock = threading.Lock()  # guards the lines
        self._lines: dict[int, _Line] = {}
        self._handlers: dict[int, Callable[[_Line, Frame], bytes | None]] = {  # None: the answer is under way
            Kind.IDENTIFY: self._identify, Kind.READ: self._read, Kind.WRITE: self._write, Kind.START: self._start,
            Kind.STOP: self._stop, Kind.UPLOAD: self._upload, Kind.PING: lambda _line, _frame: b"",
        }
        if drive.has_lease:
            self._handlers[Kind.CONTROL] = self._control
        self._closing = False
        with contextlib.ExitStack() as resources:
            self._selector = resources.enter_context(selectors.DefaultSelector())
            ring, self._ring = (resources.enter_context(end) for end in socket.socketpair())
            ring.setblocking(False)
            self._ring.setblocking(False)
            self._selector.register(ring, selectors.EVENT_READ, partial(_drain, ring))
            if place.device:
                self._open_terminal(resources)
            else:
                self._open_port(resources)
            self._resources = resources.pop_all()
        self._thread = threading.Thread(target=self._serve, name=f"uart {place.line}", daemon=True)
        self._thread.start()

    @property
    def rows_dropped(self) -> int:
        """Rows that a line did not take."""
        with self._lock:
            return sum(line.rows_dropped for line in self._lines.values())

    def publish(self, rows: StreamRows) -> None:
        """Send what has become due: rows to who streams, events to all."""
        tick, was, code = self._drive.tick, self._tick, int(self._drive.read("error_code"))
        events = [uf.EVENT.pack(uf.EVENT_RESET, 0)] if tick < was else []
        if code and code != self._error_code:
            events.append(uf.EVENT.pack(uf.EVENT_FAULT, code))
        self._error_code, self._tick = code, tick
        self._note_length(was, tick)
        last_row = int(rows.row_tick[-1]) if len(rows) else -1
        time = (tick - was if tick >= was else tick) * self._drive.T_s
        with self._lock:
            for line in self._lines.values():
                line.pass_time(time)
                line.events(events)
                if line.begins is not None:
                    line.begins = 0 if tick < was else line.begins
                    line.rows(self._payloads(rows, line.begins))
                elif line.stream is not None:  # what was written before it counts from the next run on
                    line.begins = tick
                with contextlib.suppress(OSError):  # who has left, the server's thread meets as well
                    line.send()
            more = any(line.wants_to_send for line in self._lines.values())
        ends = [start for start, _ in self._lengths[1:]] + [math.inf]
        self._lengths = [length for length, end in zip(self._lengths, ends, strict=True) if end > last_row]
        if more:
            self._wake()

    def close(self) -> None:
        """Leave all lines."""
        if self._closing:
            return
        self._closing = True
        self._wake()
        self._thread.join()
        for line in list(self._lines.values()):
            self._drop(line)
        self._resources.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # Lines

    def _open_terminal(self, resources: contextlib.ExitStack) -> None:
        terminal = Terminal(Path(self._place.device))
        resources.callback(terminal.close)
        self._add(terminal.near, lambda: terminal.at(self._place.baudrate))

    def _open_port(self, resources: contextlib.ExitStack) -> None:
        place = self._place
        if place.protocol != "socket":
            raise BusError(f"a serial line over TCP is served as uart://socket://, not {place.protocol}://")
        try:
            listener = resources.enter_context(socket.create_server((place.host, place.port)))
        except (OSError, UnicodeError) as error:
            reason, *_ = str(getattr(error, "strerror", None) or error).split(" (while attempting")
            raise BusError(f"cannot serve a serial line at {place.host}:{place.port}: {reason}") from None
        listener.setblocking(False)
        self._selector.register(listener, selectors.EVENT_READ, partial(self._accept, listener))

    def _accept(self, listener: socket.socket, _events: int) -> None:
        with contextlib.suppress(OSError):  # it has left again
            connection, _ = listener.accept()
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._add(connection.detach(), lambda: True)

    def _add(self, descriptor: int, same_speed: Callable[[], bool]) -> None:
        os.set_blocking(descriptor, False)
        line = _Line(descriptor, self._place.baudrate, self._paced, self._passed, same_speed)
        with self._lock:
            self._lines[descriptor] = line
        self._selector.register(descriptor, selectors.EVENT_READ, partial(self._attend, line))

    def _passed(self, data: bytes) -> list[tuple[float, bytes]]:
        """What becomes of bytes that go into a line: when it comes out, in s from now, and what."""
        now = self._drive.elapsed
        return [(out.at - now, out.data) for out in self.faults.passed(data, now)]

    def _drop(self, line: "_Line") -> None:
        with self._lock:
            del self._lines[line.descriptor]
        self._selector.unregister(line.descriptor)
        os.close(line.descriptor)

    # Service, in the server's thread

    def _serve(self) -> None:
        while not self._closing:
            for key, events in self._selector.select():
                key.data(events)
            with self._lock:
                wanted = {line: line.wants_to_send for line in self._lines.values()}
            for line, sends in wanted.items():
                key = self._selector.get_key(line.descriptor)
                events = selectors.EVENT_READ | (selectors.EVENT_WRITE if sends else 0)
                if key.events != events:
                    self._selector.modify(line.descriptor, events, key.data)

    def _wake(self) -> None:
        with contextlib.suppress(OSError):  # full: it wakes up anyway; or closed
            self._ring.send(b"\0")

    def _attend(self, line: "_Line", events: int) -> None:
        try:
            if events & selectors.EVENT_READ:
                for frame in line.received():
                    self._answer(line, frame)
            with self._lock:
                line.send()
        except OSError:
            self._drop(line)

    def _answer(self, line: "_Line", frame: Frame) -> None:
        try:
            handler = self._handlers.get(frame.kind)
            if handler is None:
                raise _RefusedError(uf.NO_SUCH_REQUEST)
            self._drive.hear()
            payload = handler(line, frame)
            if payload is None:
                return
            answer = Frame(frame.kind | uf.REPLY, frame.sequence, payload)
        except _RefusedError as refused:
            answer = Frame(Kind.REFUSAL, frame.sequence, uf.REFUSAL.pack(refused.number, refused.code))
        with self._lock:
            line.reply(answer)

    def _identify(self, _line: "_Line", _frame: Frame) -> bytes:
        drive = self._drive
        numbers = uf.IDENTITY.pack(od.VENDOR_ID, od.PRODUCT_CODE, od.REVISION, drive.serial, drive.layout_id)
        return numbers + od.DEVICE_NAME.encode("ascii")

    def _read(self, _line: "_Line", frame: Frame) -> bytes:
        (number,) = _fields(uf.NUMBER, frame.payload)
        signal = self._signal(number)
        return frame.payload + encode_held(signal, self._drive.read(signal.name), self._full)

    def _write(self, _line: "_Line", frame: Frame) -> bytes:
        about, data = frame.payload[: uf.NUMBER.size], frame.payload[uf.NUMBER.size :]
        (number,) = _fields(uf.NUMBER, about)
        signal = self._signal(number)
        if signal.access != "rw":
            raise _RefusedError(uf.READ_ONLY, number)
        if 8 * len(data) != signal.type.bits:
            raise _RefusedError(uf.WRONG_LENGTH, number)
        try:
            self._drive.request(signal.name, decode(signal, data, self._full))
        except DeniedError as denied:
            holders = denied.denial is Denial.HOLDERS_ALONE
            raise _RefusedError(uf.READ_ONLY if holders else uf.DEVICE_STATE, number) from None
        except ValueError:
            raise _RefusedError(uf.WRONG_VALUE, number) from None
        return about

    def _control(self, _line: "_Line", frame: Frame) -> bytes:
        try:
            self._drive.control(frame.payload)
        except DeniedError:
            raise _RefusedError(uf.DEVICE_STATE) from None
        except ValueError:
            raise _RefusedError(uf.WRONG_VALUE) from None
        return b""

    def _start(self, line: "_Line", frame: Frame) -> bytes:
        _fields(struct.Struct(""), frame.payload)
        with self._lock:
            line.begin_stream(frame.sequence)
            return uf.STARTED.pack(int(self._drive.read("tick")), int(self._drive.read("stream_periods")))

    def _stop(self, line: "_Line", _frame: Frame) -> bytes:
        with self._lock:
            line.begin_stream(None)
        return b""

    def _upload(self, line: "_Line", frame: Frame) -> bytes | None:
        offset, count = _fields(uf.SPAN, frame.payload)
        number, channels = int(self._drive.read("capture_number")), len(self._drive.captured(0, 1)) // 2
        data = self._drive.captured(offset, count)
        with self._lock:
            line.begin_upload(_pieces(frame.sequence, number, offset, data, channels))
        return None

    def _signal(self, number: int) -> Signal:
        signal = uf.signal_numbered(number)
        if signal is None or signal.name not in self._drive.names:
            raise _RefusedError(uf.NO_SUCH_OBJECT, number)
        if self.faults.refuses(signal.index, self._drive.elapsed):
            raise _RefusedError(uf.GENERAL, number)
        return signal

    # The stream

    def _note_length(self, was: int, tick: int) -> None:
        """What was written counts from the run's first period on; rows under way then keep their length."""
        periods = self._drive.row_periods
        if tick < was:
            self._lengths = [(0, periods)]
        elif periods != self._lengths[-1][1]:
            self._lengths.append((was, periods))

    def _payloads(self, rows: StreamRows, begins: int) -> list[bytes]:
        """Frames' payloads of the rows that begin from a tick on; each of rows that follow each other."""
        ticks = rows.row_tick
        first = int(np.searchsorted(ticks, begins)) if len(ticks) and ticks[-1] >= begins else len(ticks)
        ticks = ticks[first:]
        if not len(ticks):
            return []
        counts = si_to_counts([getattr(rows, name)[first:] for name in STREAM_ROW], STREAM_ROW, self._full)
        starts, lengths = (np.array(column) for column in zip(*self._lengths, strict=True))
        length = lengths[np.searchsorted(starts, ticks, side="right") - 1]
        breaks = (1 + np.flatnonzero((np.diff(ticks) != length[:-1]) | (np.diff(length) != 0))).tolist()
        temperatures = _counts(self._drive.read(signal.name) / signal.scale for signal in _TEMPERATURES)
        return [
            uf.packed_rows(uf.Rows(int(ticks[k]), int(length[k]), temperatures, counts[k : min(end, k + _ROWS)]))
            for begin, end in zip([0, *breaks], [*breaks, len(ticks)], strict=True)
            for k in range(begin, end, _ROWS)
        ]


class _Line:
    """A line to one client. What goes out goes frame by frame: replies and events, then rows, then a recording."""

    def __init__(
        self, descriptor: int, baudrate: int, paced: bool, passed: Callable[[bytes], list[tuple[float, bytes]]],
        same_speed: Callable[[], bool],
    ) -> None:
        """`passed`: what becomes of bytes on their way, and after how many s."""
        self.descriptor = descriptor
        self.stream: int | None = None  # sequence number of the request that started it
        self.begins: int | None = None  # tick of its first row at the earliest
        self.rows_dropped = 0
        self._bytes_a_second = baudrate / _BITS_A_BYTE
        self._backlog = min(max(round(0.2 * self._bytes_a_second), _BACKLOG[0]), _BACKLOG[1])
        self._paced = paced
        self._due = 0.0 if paced else math.inf  # bytes that the line takes by now
        self._passed = passed
        self._same_speed = same_speed
        self._decoder = uf.Decoder()
        self._replies = deque[bytes]()
        self._rows = deque[bytes]()
        self._behind = 0  # bytes of rows
        self._pieces: Iterator[bytes] = iter(())
        self._unsent = b""  # of what has begun to be sent
        self._late: list[tuple[float, int, bytes]] = []  # s when it goes out, its turn, a frame
        self._turn = 0
        self._time = 0.0  # s, that has passed

    def received(self) -> list[Frame]:
        """Frames that have come. Raises OSError when the client has left."""
        try:
            data = os.read(self.descriptor, 65536)
        except BlockingIOError:
            return []
        if not data:
            raise ConnectionResetError
        return self._decoder.feed(b"".join(part for _, part in self._passed(self._at_their_speed(data))))

    def reply(self, frame: Frame) -> None:
        if len(self._replies) < _REPLIES:
            self._replies.append(uf.packed(frame))

    def events(self, payloads: Iterable[bytes]) -> None:
        for payload in payloads:
            self.reply(Frame(Kind.EVENT, 0, payload))

    def rows(self, payloads: Iterable[bytes]) -> None:
        for payload in payloads:
            if self._behind > self._backlog:
                self.rows_dropped += (len(payload) - uf.ROWS.size) // uf.ROW_BYTES
                continue
            data = uf.packed(Frame(Kind.STREAM, self.stream or 0, payload))
            self._rows.append(data)
            self._behind += len(data)

    def begin_stream(self, sequence: int | None) -> None:
        self.stream, self.begins = sequence, None
        self._rows.clear()
        self._behind = 0

    def begin_upload(self, pieces: Iterator[bytes]) -> None:
        """Send a recording, whatever was under way of another."""
        self._pieces = pieces

    def pass_time(self, time: float) -> None:
        """The line takes more after so many s; what it could have taken while idle is gone, but for a chunk."""
        self._time += time
        if self._paced:
            idle = not (self._unsent or self._replies or self._rows)
            self._due = (min(self._due, _CHUNK) if idle else self._due) + time * self._bytes_a_second

    @property
    def wants_to_send(self) -> bool:
        self._fill()
        return bool(self._unsent) and self._due >= 1.0

    def send(self) -> None:
        """Write a chunk of what the line takes now. Raises OSError when the client has left."""
        if self.wants_to_send:
            with contextlib.suppress(BlockingIOError):
                sent = os.write(self.descriptor, self._unsent[: int(min(self._due, len(self._unsent)))])
                self._unsent = self._unsent[sent:]
                self._due -= sent

    def _fill(self) -> None:
        """Put together what is to be sent next, whole frames, where all before has been sent."""
        if self._unsent:
            return
        frames, size = list[bytes](), 0
        while self._late and self._late[0][0] <= self._time:
            frames.append(heapq.heappop(self._late)[2])
        while size < _CHUNK and (frame := self._next()):
            size += len(frame)
            for wait, part in self._passed(frame):
                if wait > 0.0:
                    self._turn += 1
                    heapq.heappush(self._late, (self._time + wait, self._turn, part))
                else:
                    frames.append(part)
        self._unsent = self._at_their_speed(b"".join(frames))

    def _next(self) -> bytes:
        if self._replies:
            return self._replies.popleft()
        if self._rows:
            frame = self._rows.popleft()
            self._behind -= len(frame)
            return frame
        return next(self._pieces, b"")

    def _at_their_speed(self, data: bytes) -> bytes:
        return data if not data or self._same_speed() else at_another_speed(data)


def _pieces(sequence: int, number: int, offset: int, data: bytes, channels: int) -> Iterator[bytes]:
    """Frames of a recording from sample `offset` on; the last is empty."""
    width = 2 * channels or 1  # bytes of a sample
    size = (uf.PAYLOAD - uf.PIECE.size) // width * width
    for k in range(0, len(data) + size, size):
        about = uf.PIECE.pack(number, offset + min(k, len(data)) // width, channels)
        yield uf.packed(Frame(Kind.UPLOAD | uf.REPLY, sequence, about + data[k : k + size]))


def _drain(ring: socket.socket, _events: int) -> None:
    with contextlib.suppress(BlockingIOError):
        ring.recv(_CHUNK)


def _fields(layout: struct.Struct, payload: bytes) -> tuple[Any, ...]:
    if len(payload) != layout.size:
        raise _RefusedError(uf.WRONG_LENGTH)
    return layout.unpack(payload)


def _counts(values: Iterable[float]) -> tuple[int, int]:
    first, second = (round(min(max(value, -0x8000), 0x7FFF)) for value in values)
    return first, second
