"""A drive on a serial line: framed requests and replies, multiplexed with the stream. The only client file that knows
pyserial.

A reader thread takes bytes off the line and hands frames out: replies to who waits for their sequence number, those of
the stream into a queue. Requests may come from any thread, several at once. What comes late is dropped. The thread that
iterates `stream` tells the drive's watchdog that the bench is there: it is the one that acts.
"""

import contextlib
import os
import queue
import random
import re
import select
import socket
import struct
import threading
import time
from collections import deque
from collections.abc import Generator, Iterator
from types import TracebackType
from typing import Any, Final, Self, cast

import serial

from drivers import serial_port
from drivers.block import Block
from drivers.drive import Identity
from drivers.errors import ConnectError, DriveError, FrameError, LostError, NoReplyError, RefusedError, ResetError, held
from drivers.rows import TELLABLE, Carried, Counts, RowBlocks, note
from drivers.settled import REPEATABLE, settle
from drivers.wire import uart_frame as uf
from drivers.wire.codec import FULL_SCALES, FullScales, count_size, decode, encode
from drivers.wire.dictionary import layout_text, signal_named, signals_of
from drivers.wire.lease import Record, packed
from drivers.wire.uart_frame import Frame, Kind
from drivers.wire.uart_url import UartUrl

REPLY_TIMEOUT: Final = 0.3  # s
ATTEMPTS: Final = 3  # for what may be asked twice
WRITE_TIMEOUT: Final = 1.0  # s, after which a line that takes nothing counts as lost
SILENCE: Final = 1.0  # s without a row after which a drive counts as lost
POLL: Final = 0.005  # s, how often the stream looks for new frames at most
LOOK: Final = 0.02  # s, how often it looks at all else at least
PING: Final = 0.05  # s without a request after which a stream tells the drive that the bench is there
_NEW_CLOCK: Final = (4, 0.1)  # frames that follow each other, and s that they last, that tell of an unheard reset
_TICKS: Final = 1 << 32
_READER_POLL: Final = 0.02  # s, for which `close` waits
_UNANSWERED: Final = 0  # sequence number of requests whose answer nobody waits for

_TEMPERATURE: Final = count_size(signal_named("temp_winding"), {})  # degC, size of a count

Answers = queue.SimpleQueue[Frame | None]
"""Frames that answer one request; None: the line is gone."""


class UartDrive:
    """Client of the drive on a serial line. Opens it, checks that such a drive answers, and reads its identity."""

    def __init__(self, url: UartUrl) -> None:
        self._url = url
        self._full: FullScales = {}
        self._decoder = uf.Decoder()
        self._bytes = 0  # that have come
        self._sequence = random.getrandbits(16)  # replies to a client before this one are none of its own
        self._send_lock = threading.Lock()
        self._sent = time.monotonic()
        self._waiting: dict[int, Answers] = {}
        self._frames: deque[tuple[float, bytes]] = deque()  # s, monotonic, when it came; payload
        self._came = threading.Event()  # a frame of the stream, or what ends it
        self._looked = 0.0  # s, monotonic, when the stream looked for them
        self._heard = 0.0  # s, monotonic, when the latest row came
        self._rows: RowBlocks | None = None
        self._counts = Counts()
        self._carried: Carried | None = None
        self._told = ""
        self._anew = _Anew()
        self._stream_sequence = -1
        self._streaming = False
        self._stream_lock = threading.Lock()  # start, stop and assembly of the stream
        self._rebooted = threading.Event()
        self._fault_code = 0
        self._failure = ""  # why the line is gone
        self._closed = threading.Event()
        self._deaf = threading.Event()  # ends the reader
        self._close_lock = threading.Lock()
        self._port = _open(url)
        self._selectable = _selectable(url)
        self._reader = threading.Thread(target=self._listen, name=f"uart {url.line}", daemon=True)
        self._reader.start()
        try:
            self.identity = self._identify()
        except BaseException as error:
            self.close()
            if isinstance(error, DriveError):
                raise ConnectError(str(error)) from None
            raise

    @property
    def counts(self) -> Counts:
        """Rows and gaps of the latest stream."""
        return self._counts

    @property
    def note(self) -> str:
        """What the client has changed of the stream by itself; empty: nothing."""
        return self._told

    @property
    def seen(self) -> uf.Seen:
        """Frames that came over the line, and what was none."""
        return self._decoder.seen

    @property
    def fault_code(self) -> int:
        """CiA 402 error code of the latest fault that the drive told by itself; 0: none."""
        return self._fault_code

    def read(self, name: str) -> float:
        """Value of a signal, SI."""
        signal = signal_named(name)
        number = uf.NUMBER.pack(uf.number_of(signal))
        answer = self._exchange(Kind.READ, number, str(signal))
        if answer[: len(number)] != number:
            raise FrameError(f"the drive at {self._url} answered for another signal than {signal}")
        try:
            return decode(signal, answer[len(number) :], self._full)
        except ValueError as error:
            raise FrameError(f"the drive at {self._url}: {error}") from None

    def write(self, name: str, value: float) -> None:
        """Set a signal, SI. A change of `stream_periods` counts in a running stream from its first row on.

        A parameter is read back, and set again where it was not taken, when no answer comes; a command never.
        """
        signal = signal_named(name)
        if signal.access != "rw":
            raise RefusedError(f"{signal} is {signal.access}, it cannot be written", uf.READ_ONLY)
        try:
            data = encode(signal, value, self._full)
        except ValueError as error:
            raise RefusedError(str(error), uf.WRONG_VALUE) from None
        number = uf.NUMBER.pack(uf.number_of(signal))

        def write() -> None:
            self._exchange(Kind.WRITE, number + data, str(signal), attempts=1)

        if signal.is_parameter or name in REPEATABLE:
            settle(write, lambda: self._exchange(Kind.READ, number, str(signal)) == number + data)
        else:
            write()

    def control(self, record: Record) -> None:
        """Have a control record taken, whole or not at all."""
        self._exchange(Kind.CONTROL, packed(record), "a control record")

    def parameters(self) -> dict[str, float]:
        """Every parameter with its value, SI."""
        return {signal.name: self.read(signal.name) for signal in self.identity.signals if signal.is_parameter}

    def stream(self) -> Iterator[Block]:
        """Start the stream and yield blocks as they come; it stops when the iterator is closed.

        Raises LostError when it falls silent, the line is gone or the drive resets.
        """
        try:
            with self._stream_lock:
                self._rebooted.clear()
                self._start()
            yield from self._blocks()
        except DriveError:
            if not self._closed.is_set():
                raise
        finally:
            self._stop()

    def captured(self, offset: int, count: int) -> Iterator[bytes]:
        """The recorder's samples from `offset` on, `count` of them, piece by piece. What is lost is asked for again.

        Raises RefusedError when the drive has another recording meanwhile.
        """
        upload = _Upload(offset, count)
        in_vain = 0
        try:
            while not upload.complete:
                if in_vain == ATTEMPTS:
                    raise NoReplyError(self._no_reply("the recording"))
                in_vain += 1
                with self._asked(Kind.UPLOAD, upload.missing) as answers:
                    for piece in self._pieces(answers, upload):
                        in_vain = 0
                        yield piece
        finally:
            if not upload.complete:
                with contextlib.suppress(DriveError):
                    self._send(Frame(Kind.UPLOAD, _UNANSWERED, _Upload(0, 0).missing))

    def close(self) -> None:
        """Stop the stream and close the line."""
        self._closed.set()
        self._came.set()
        self._stop()
        self._deaf.set()
        with self._close_lock:
            self._reader.join()
            self._fail(f"{self._url} is closed")
            serial_port.close(self._port)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # Requests

    def _identify(self) -> Identity:
        try:
            answer = self._exchange(Kind.IDENTIFY, b"", "its identity")
        except NoReplyError:
            raise ConnectError(self._nobody()) from None
        if len(answer) < uf.IDENTITY.size:
            raise FrameError(f"the drive at {self._url} answered {len(answer)} bytes for its identity")
        vendor, product, revision, serial_number, layout = uf.IDENTITY.unpack_from(answer)
        name = answer[uf.IDENTITY.size :].decode("ascii", "replace")
        if not signals_of(layout):
            raise ConnectError(
                f"the drive at {self._url} ({name!r}) has another signal layout: "
                f"expected {layout_text()}, got 0x{layout:08X}"
            )
        full = self._full = {key: self.read(key) for key in FULL_SCALES}
        return Identity(name, vendor, product, revision, serial_number, layout, self.read("T_s"), **full)

    def _nobody(self) -> str:
        seen, waited = self.seen, ATTEMPTS * REPLY_TIMEOUT
        if seen.frames:
            return f"{seen.frames} frames came from {self._url} within {waited:g} s, but none is a drive's identity"
        if self._bytes:
            return (
                f"no drive answered at {self._url}: {self._bytes} bytes came within {waited:g} s, "
                "but no frame; it is another device, or its baud rate is another"
            )
        return f"no drive answered at {self._url} within {waited:g} s: nothing came"

    def _exchange(self, kind: Kind, payload: bytes, what: str, attempts: int = ATTEMPTS) -> bytes:
        """Payload of the answer to a request about `what`; repeated where it may be."""
        for _ in range(attempts):
            with self._asked(kind, payload) as answers, contextlib.suppress(queue.Empty):
                return self._checked(answers.get(timeout=REPLY_TIMEOUT), kind, what)
        raise NoReplyError(self._no_reply(what))

    @contextlib.contextmanager
    def _asked(self, kind: Kind, payload: bytes) -> Generator[Answers]:
        """A request on its way, and where its answers arrive; those that come after this are dropped."""
        answers: Answers = queue.SimpleQueue()
        with self._send_lock:
            sequence = self._sequence = self._sequence % 0xFFFF + 1
            self._waiting[sequence] = answers
        if kind is Kind.START:
            self._stream_sequence = sequence
        try:
            self._send(Frame(kind, sequence, payload))
            yield answers
        finally:
            self._waiting.pop(sequence, None)

    def _send(self, frame: Frame) -> None:
        with self._send_lock:
            if self._failure:
                raise LostError(self._failure)
            self._sent = time.monotonic()
            try:
                self._port.write(uf.packed(frame))
            except OSError as error:
                raise LostError(f"{self._url} takes nothing any more: {_reason(error)}") from None

    def _checked(self, answer: Frame | None, kind: Kind, what: str) -> bytes:
        if answer is None:
            raise LostError(self._failure)
        if answer.kind == Kind.REFUSAL and len(answer.payload) == uf.REFUSAL.size:
            _, code = uf.REFUSAL.unpack(answer.payload)
            reason = uf.REFUSAL_TEXTS.get(code, "no reason known")
            raise RefusedError(f"the drive at {self._url} refused {what} with 0x{code:08X}: {reason}", code)
        if answer.kind != kind | uf.REPLY:
            raise FrameError(f"the drive at {self._url} answered a frame of kind 0x{answer.kind:02X} for {what}")
        return answer.payload

    def _no_reply(self, what: str) -> str:
        return f"the drive at {self._url} did not answer for {what} within {REPLY_TIMEOUT} s"

    def _pieces(self, answers: Answers, upload: "_Upload") -> Iterator[bytes]:
        """Pieces that follow each other, until one is missing or all are there."""
        while not upload.complete:
            if self._failure:
                raise LostError(self._failure)
            try:
                answer = answers.get(timeout=REPLY_TIMEOUT)
            except queue.Empty:
                return
            piece = upload.taken(self._checked(answer, Kind.UPLOAD, "the recording"))
            if piece is None:
                return
            if piece:
                yield piece

    # The stream

    def _start(self) -> None:
        self._frames.clear()
        answer = self._exchange(Kind.START, b"", "the stream")
        try:
            tick, periods = uf.STARTED.unpack(answer)
        except struct.error:
            raise FrameError(f"the drive at {self._url} answered {len(answer)} bytes for the stream") from None
        self._counts, self._anew = Counts(), _Anew()
        self._rows = self._row_blocks(periods, tick)
        self._streaming, self._heard = True, time.monotonic()

    def _row_blocks(self, periods: int, tick: int) -> RowBlocks:
        """What joins rows of this length from a tick on; counts go on."""
        rows = RowBlocks(self.identity.T_s, periods, self._full, tick, self._rows.end if self._rows else None)
        rows.counts = self._counts
        self._carried = Carried(periods * self.identity.T_s, self._counts)
        return rows

    def _stop(self) -> None:
        with self._stream_lock:
            if not self._streaming:
                return
            self._streaming, self._stream_sequence = False, -1
            self._frames.clear()
            with contextlib.suppress(DriveError):
                self._exchange(Kind.STOP, b"", "the stream's end", attempts=1)

    def _blocks(self) -> Iterator[Block]:
        """Blocks as they come, until the drive is closed."""
        while self._waited():
            blocks = self._drain()
            yield from blocks
            self._lengthen()
            if self._rebooted.is_set():
                raise ResetError(f"the drive at {self._url} has reset")
            if self._failure:
                raise LostError(self._failure)
            if time.monotonic() - self._sent > PING:
                self._send(Frame(Kind.PING, _UNANSWERED))
            silent = time.monotonic() - self._heard
            if not blocks and silent > self._patience():  # after blocks, more may have come while they were dealt with
                raise LostError(
                    f"the drive at {self._url} fell silent: no row for {silent:.1f} s, "
                    f"expected one every {self._row_time() * 1e3:g} ms"
                )

    def _waited(self) -> bool:
        """Wait for what comes, and until it is time for another look; whether the drive is still open."""
        self._came.wait(LOOK)
        if (early := self._looked + POLL - time.monotonic()) > 0.0:
            self._closed.wait(early)
        self._came.clear()
        self._looked = time.monotonic()
        return not self._closed.is_set()

    def _drain(self) -> list[Block]:
        with self._stream_lock:
            rows, blocks = self._rows, list[Block]()
            if rows is None:
                return blocks
            while self._frames:
                came, payload = self._frames.popleft()
                try:
                    part = uf.unpacked_rows(payload)
                except ValueError:
                    self._counts.frames_foreign += 1
                    continue
                behind = self._counts.rows > 0 and rows.end is not None and _difference(part.tick, rows.end) < 0
                if self._anew.seen(part, behind, came):
                    self._rebooted.set()
                    break
                if behind:
                    self._counts.frames_late += 1
                    continue
                if part.periods != rows.periods or (rows.counts.rows and rows.ahead(part.tick) % rows.periods):
                    blocks += rows.take()
                    rows = self._rows = self._row_blocks(part.periods, part.tick)
                rows.temperatures = (part.temperatures[0] * _TEMPERATURE, part.temperatures[1] * _TEMPERATURE)
                rows.run(part.tick, part.counts)
                self._heard = came
            return blocks + rows.take()

    def _lengthen(self) -> None:
        """Ask for longer rows where the drive drops many: the line does not carry them."""
        rows, carried = self._rows, self._carried
        if rows is None or carried is None:
            return
        periods = carried.periods(self._counts, rows.periods)
        if periods == rows.periods:
            return
        with contextlib.suppress(RefusedError, NoReplyError):  # then it goes on as it is, and tells what is lost
            self.write("stream_periods", float(periods))
            self._told = note(periods, rows.periods, periods * self.identity.T_s)

    def _row_time(self) -> float:
        return self.identity.T_s * (self._rows.periods if self._rows else 1)

    def _patience(self) -> float:
        """Silence in s after which the drive counts as lost."""
        return max(min(SILENCE, TELLABLE * self.identity.T_s), 3.0 * self._row_time())

    # The line, in the reader's thread

    def _listen(self) -> None:
        try:
            while not self._deaf.is_set():
                data = self._received()
                self._bytes += len(data)
                for frame in self._decoder.feed(data):
                    self._hand_out(frame)
        except Exception as error:  # noqa: BLE001 - whatever ended the library's port
            self._fail(f"{self._url} is gone: {_reason(error)}")

    def _received(self) -> bytes:
        """What has come, waited for a little."""
        if self._selectable:
            ready, _, _ = select.select([self._port], [], [], _READER_POLL)
            return self._there() if ready else b""
        first: bytes = self._port.read(1)
        return first + self._port.read(self._port.in_waiting) if first else b""

    def _there(self) -> bytes:
        """What has come, at once; a line that has gone the library tells in its own words."""
        if os.name == "posix":
            with contextlib.suppress(OSError):
                if data := os.read(self._port.fileno(), 65536):
                    return data
        return self._port.read(65536)

    def _hand_out(self, frame: Frame) -> None:
        if frame.kind == Kind.STREAM:
            if frame.sequence == self._stream_sequence:
                self._frames.append((time.monotonic(), frame.payload))
                self._came.set()
        elif frame.kind == Kind.EVENT:
            self._note(frame.payload)
        elif waiting := self._waiting.get(frame.sequence):
            waiting.put(frame)

    def _note(self, event: bytes) -> None:
        if len(event) == uf.EVENT.size:
            what, code = uf.EVENT.unpack(event)
            if what == uf.EVENT_RESET:
                self._rebooted.set()
                self._came.set()
            elif what == uf.EVENT_FAULT:
                self._fault_code = code

    def _fail(self, why: str) -> None:
        """The line is gone: whoever waits for an answer is told."""
        with self._send_lock:
            self._failure = self._failure or why
            waiting = list(self._waiting.values())
        self._came.set()
        for answers in waiting:
            answers.put(None)


class _Anew:
    """Tells a clock that has begun anew, unheard, from frames that are late or come twice."""

    def __init__(self) -> None:
        self._frames = 0  # that follow each other, behind what has come
        self._next = 0  # tick at which the next would begin
        self._since = 0.0  # s, monotonic

    def seen(self, part: uf.Rows, behind: bool, came: float) -> bool:
        """Whether the clock has, by the next frame: `behind` a row that has come, at a time in s."""
        follows = self._frames > 0 and part.tick == self._next
        if not behind and not (follows and self._frames >= _NEW_CLOCK[0]):
            self._frames = 0
            return False
        if not follows:
            self._frames, self._since = 0, came
        self._frames += 1
        self._next = (part.tick + len(part.counts) * part.periods) % _TICKS
        return not behind or (self._frames >= _NEW_CLOCK[0] and came - self._since >= _NEW_CLOCK[1])


class _Upload:
    """Which samples of a recording have come."""

    def __init__(self, offset: int, count: int) -> None:
        self.next, self.end = offset, offset + count  # samples
        self.complete = False
        self._number: int | None = None

    @property
    def missing(self) -> bytes:
        """The request for what has not come yet."""
        return uf.SPAN.pack(self.next, self.end - self.next)

    def taken(self, payload: bytes) -> bytes | None:
        """Samples of a piece that follows those before; None when it does not follow."""
        if len(payload) < uf.PIECE.size:
            raise FrameError(f"expected a piece of a recording, got {len(payload)} bytes")
        number, first, channels = uf.PIECE.unpack_from(payload)
        if self._number not in (None, number):
            raise RefusedError(f"the drive has recording {number} by now, and no longer {self._number}", 0)
        if first != self.next:
            return None
        data = payload[uf.PIECE.size :]
        if data and (not channels or len(data) % (2 * channels)):
            raise FrameError(f"expected whole samples of {channels} channels, got {len(data)} bytes")
        self._number, self.complete = number, not data
        self.next += len(data) // (2 * channels) if data else 0
        return data


def _open(url: UartUrl) -> Any:
    try:
        port = cast(Any, serial).serial_for_url(
            url.line, baudrate=url.baudrate, timeout=0.0 if _selectable(url) else _READER_POLL,
            write_timeout=None if url.protocol == "rfc2217" else WRITE_TIMEOUT, exclusive=True,  # it knows none
        )
    except (OSError, ValueError) as error:
        raise ConnectError(f"cannot open {url}: {held(error) or _reason(error)}") from None
    if url.protocol == "socket":
        with socket.socket(fileno=os.dup(port.fileno())) as same:
            same.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return port


def _selectable(url: UartUrl) -> bool:
    """Whether the port can be waited for by `select`, and then be read without waiting."""
    return url.protocol == "socket" or (bool(url.device) and os.name == "posix")


def _difference(later: int, earlier: int) -> int:
    """Of two ticks of which at least one has lost all but its low 32 bits."""
    return (later - earlier + _TICKS // 2) % _TICKS - _TICKS // 2


def _reason(error: BaseException) -> str:
    """Why, in the system's words where it has told a number."""
    text = (str(error) or type(error).__name__).splitlines()[0]
    number = getattr(error, "errno", None)
    return os.strerror(number) if isinstance(number, int) else re.sub(r"^.*\[Errno -?[0-9]+\] ", "", text)
