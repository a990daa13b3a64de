"""One node on a CAN bus, to its client. The only client file that knows canopen and python-can.

SDO transfers are one at a time, under a lock; reads are repeated when no answer comes, and writes, where they may be,
after reading back. That one node alone answers is watched all the time. Knows nothing of signals. What is subscribed
runs in the bus library's reader thread.
"""

import contextlib
import errno
import importlib
import logging
import random
import select
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Mapping, Sequence
from typing import Any, cast

import can
import canopen
from can.interfaces import BACKENDS
from can.util import cast_from_string
from canopen.network import MessageListener
from canopen.sdo.client import SdoClient

from drivers.canopen.answers import Answers
from drivers.canopen.socketcand import Frame, Frames, acknowledge, connected, send_command
from drivers.errors import ConnectError, DriveError, FrameError, LostError, NoReplyError, RefusedError
from drivers.settled import settle
from drivers.wire import canopen_od as od
from drivers.wire.can_url import CanUrl

SDO_TIMEOUT = 0.3  # s, for one answer
READ_ATTEMPTS = 3
SPOILT_ATTEMPTS = 20  # for what others on the bus have spoilt: that is told at once
HEARTBEAT = 0.02  # s, between the bench's own heartbeats; a drive's watchdog has to be slower
EXPEDITED = 4  # bytes; longer downloads go by blocks
_BACKLOG = 4 << 20  # bytes of frames that may wait in the kernel for a reader that is held up; it may grant less
_ALONE_READS = 8  # by which it shows that two nodes answer
_STRAGGLERS = 0.05  # s, for the other node's answers
_OTHERS = 0.3  # s after a request of another client in which it may be in a transfer
_BLOCK = 2.0  # s, that a block of 127 frames takes at most, on a slow bus
_PASS = 1.5  # s, for which another client's blocks are let pass: longer than 32 kB take at 500 kbit/s
_PASS_IN_CONTROL = 0.3  # s, the same of who controls the node
_CONTROL = 2.0  # s, that control lasts from the latest record on
_PASSING = 0.005  # s between two looks at whether it is over, and by which one gives way
_SHOWN_OTHERS = 3  # objects in a message
_NO_FRAME = 0.1  # s, after which a reader that was woken for a frame that is not there goes on
_GONE = (errno.ENETDOWN, errno.ENODEV, errno.ENXIO)  # what an interface that is down, or no more, answers
_SHOWN = 200  # characters of the library's words in a message
_BUS_ERRORS = (can.CanError, OSError, RuntimeError, AttributeError)  # the last two: closed meanwhile

# What an SDO answer is (CiA 301, 7.2.4.3): the upper three bits of its first byte
_SEGMENT, _SEGMENT_TAKEN, _UPLOADED, _DOWNLOADED, _ABORTED, _BLOCK_DOWNLOAD, _BLOCK_UPLOAD = 0, 1, 2, 3, 4, 5, 6
_DOWNLOAD, _UPLOAD, _UPLOAD_BLOCK, _DOWNLOAD_BLOCK = 1, 2, 5, 6  # and what a request is
_SPOILT = (od.Abort.TOGGLE, od.Abort.SEQUENCE, od.Abort.CRC)  # said of frames lost, late or twice: nothing is refused

# canopen logs what arrives here as exceptions
logging.getLogger("canopen").setLevel(logging.CRITICAL)


class CanopenBus:
    """A node as its client sees it, from construction to `close`. Raises ConnectError when there is no such bus."""

    def __init__(self, url: CanUrl) -> None:
        self._url = url
        self._sdo_lock = threading.Lock()
        self._asked = (_UPLOADED, b"")  # kind and address of the answer that is waited for
        self._segments = False  # whether segments, or answers to them, follow
        self._block = False  # whether a block transfer is under way, in which an answer may begin with anything
        self._blocks_until = 0.0  # s, monotonic, until when frames may be of a block, this client's or another's
        self._let_pass_until = 0.0  # s, monotonic, until when another client's block is let pass
        self._go_first_until = 0.0  # s, monotonic, until when no other is let pass again
        self._controlled = -_CONTROL  # s, monotonic, when the latest control record went out
        self._heard: Callable[[bytes], None] = lambda _: None
        self._answers = Answers()
        self._others: dict[bytes, float] = {}  # objects that other clients asked for, and when, s, monotonic
        self._others_asked = 0.0  # s, monotonic, when another client asked last
        self._closed = threading.Event()
        self._close_lock = threading.Lock()
        self._beaten = 0.0  # s, monotonic, when the latest heartbeat was sent
        self._failure: BaseException | None = None  # that a heartbeat met
        self._network = _open(url, self._closed)
        request, answer = od.sdo_request_cob_id(url.node_id), od.sdo_response_cob_id(url.node_id)
        self._sdo = SdoClient(request, answer, canopen.ObjectDictionary())
        self._sdo.network = self._network
        self._sdo.RESPONSE_TIMEOUT = SDO_TIMEOUT
        self._forward: Callable[[int, bytearray, float], None] = cast(Any, self._sdo).on_response
        self._network.subscribe(answer, self._on_answer)
        self._network.subscribe(request, self._on_others_request)

    @property
    def node(self) -> str:
        """The node in words, for messages."""
        return f"node {self._url.node_id} on {self._url.bus}"

    @property
    def closed(self) -> threading.Event:
        """Set from the first `close` on."""
        return self._closed

    def subscribe(self, cob_id: int, callback: Callable[[bytes], None]) -> None:
        """Have the payload of every frame with this identifier, from the reader thread."""
        self._network.subscribe(cob_id, lambda _cob_id, data, _time: callback(bytes(data)))

    def hear_stream(self, numbers: Mapping[int, int], callback: Callable[[Sequence[Frame]], None]) -> None:
        """Have frames of these identifiers, by the numbers they have here, from the reader thread: many at once."""
        if isinstance(self._network.bus, _SocketcandBus):
            self._network.bus.hear(numbers, callback)
            return
        for cob_id, number in numbers.items():
            self.subscribe(cob_id, lambda data, number=number: callback([(number, data)]))

    def hear_answers(self, callback: Callable[[bytes], None]) -> None:
        """Have every answer to an SDO request, whoever's, from the reader thread; the data of blocks is left out."""
        self._heard = callback

    def read(self, index: int, subindex: int, what: str) -> bytes:
        """Bytes of an object, called `what` in messages."""
        with self._alone():
            return self._repeated(lambda: self._uploaded(index, subindex, what))

    def read_block(self, index: int, subindex: int, what: str) -> bytes:
        """Bytes of an object by blocks, with a checksum: for what is long."""
        with self._alone():
            return self._repeated(lambda: self._block_uploaded(index, subindex, what))

    def write(self, index: int, subindex: int, what: str, data: bytes) -> None:
        """Set an object, called `what` in messages; returns when the node has taken it."""
        with self._alone():
            if len(data) > EXPEDITED:
                self._block_download(index, subindex, what, data)
                return
            with self._transfer(_DOWNLOADED, index, subindex, what):
                self._sdo.download(index, subindex, data)

    def put(self, index: int, subindex: int, what: str, data: bytes) -> None:
        """`write`, for what may be written twice: made again where no answer comes and it reads back otherwise."""
        settle(
            lambda: self.write(index, subindex, what, data), lambda: self.read(index, subindex, what) == data
        )

    def glance(self, index: int, subindex: int) -> None:
        """Ask for an object and wait for nothing: who has subscribed hears the answer.

        Does nothing while a transfer is under way, be it another client's, which it would end.
        """
        if time.monotonic() - self._others_asked < _OTHERS or not self._sdo_lock.acquire(blocking=False):
            return
        try:
            address = od.sdo_address(index, subindex)
            self._answers.asked(address)
            with contextlib.suppress(*_BUS_ERRORS):  # `check` tells of it
                self._network.send_message(
                    od.sdo_request_cob_id(self._url.node_id), bytes([_UPLOAD << 5]) + address + bytes(4)
                )
        finally:
            self._sdo_lock.release()

    def look_for_another(self) -> None:
        """Have all who answer as this node show themselves. Raises LostError where there are two, NoReplyError."""
        for _ in range(_ALONE_READS):
            self.read(od.OD_IDENTITY, 4, "identity")
        self._closed.wait(_STRAGGLERS)
        self.check_alone()

    def check_alone(self) -> None:
        """Raise LostError where two nodes answer as this one."""
        if two := self._answers.two:
            raise LostError(f"two nodes answer as {self.node}: {two}")

    def write_control(self, index: int, subindex: int, what: str, data: bytes) -> None:
        """Write a control record by segments; it may be written twice: repeated when no answer comes."""

        def download() -> bytes:
            with self._transfer(_DOWNLOADED, index, subindex, what):
                self._sdo.download(index, subindex, data, force_segment=True)
            return data

        self._controlled = time.monotonic()
        with self._alone():
            self._repeated(download)

    def beat(self, node: int) -> None:
        """Send a heartbeat as this node, operational, where one is due."""
        now = time.monotonic()
        if now - self._beaten >= HEARTBEAT:
            self._beaten = now
            try:
                self._network.send_message(od.heartbeat_cob_id(node), bytes([od.STATE_OPERATIONAL]))
            except _BUS_ERRORS as error:  # the kernel tells one thread that an interface is down: it may be this one
                if getattr(error, "error_code", None) in _GONE:
                    self._failure = error

    def command(self, nmt: int) -> None:
        """Send the node an NMT command."""
        try:
            self._network.send_message(od.NMT_COB_ID, bytes([nmt, self._url.node_id]))
        except _BUS_ERRORS as error:
            raise LostError(f"{self._url.bus} no longer takes frames: {_first_line(error)}") from None

    def check(self) -> None:
        """Raise LostError when the bus has failed."""
        try:
            if self._failure is not None:
                raise self._failure
            self._network.check()
        except Exception as error:  # noqa: BLE001 - whatever ended the library's reader thread
            raise LostError(f"{self._url.bus} is gone: {_first_line(error)}") from None

    def close(self) -> None:
        """Leave the bus."""
        self._closed.set()
        with self._close_lock, contextlib.suppress(Exception):  # it raises again what ended its reader thread
            self._network.disconnect()

    def _repeated(self, read: Callable[[], bytes]) -> bytes:
        """A read that is repeated when no answer comes, or a spoilt one."""
        unanswered, spoilt = 0, 0
        while True:
            try:
                return read()
            except (NoReplyError, FrameError) as error:
                unanswered += isinstance(error, NoReplyError)
                spoilt += 1
                if self._closed.is_set() or unanswered == READ_ATTEMPTS or spoilt == SPOILT_ATTEMPTS:
                    raise
                if time.monotonic() - self._others_asked < _OTHERS:  # who asks several things one after the other
                    self._closed.wait(random.uniform(0.0, spoilt * _PASSING))

    @contextlib.contextmanager
    def _alone(self) -> Generator[None]:
        """A transfer with one node; whatever else goes wrong with two of them is that."""
        try:
            yield
        except DriveError:
            self.check_alone()
            raise
        self.check_alone()

    def _let_pass(self) -> None:
        """Wait for the end of another client's block transfer, which a request would end; then it is one's own turn.

        Where it does not end, a third of the time at most: who controls a drive has to be heard.
        """
        begun = now = time.monotonic()
        if begun < self._go_first_until or begun - self._others_asked > _OTHERS:
            return
        most = _PASS_IN_CONTROL if begun - self._controlled < _CONTROL else _PASS
        self._closed.wait(_PASSING)  # in which another can begin
        while now < min(self._let_pass_until, begun + most):
            self._closed.wait(_PASSING)
            now = time.monotonic()
        if now >= begun + most:
            self._go_first_until = now + 2.0 * most

    def _uploaded(self, index: int, subindex: int, what: str) -> bytes:
        self._let_pass()
        with self._transfer(_UPLOADED, index, subindex, what):
            return bytes(self._sdo.upload(index, subindex))

    def _block_uploaded(self, index: int, subindex: int, what: str) -> bytes:
        self._let_pass()
        with self._transfer(_BLOCK_UPLOAD, index, subindex, what), self._sdo.open(
            index, subindex, "rb", buffering=0, block_transfer=True
        ) as stream:
            try:
                return bytes(cast(Any, stream).readall())
            except AttributeError:  # the library's own, where the end of the transfer does not come
                raise canopen.SdoCommunicationError("no end of the block transfer") from None

    def _block_download(self, index: int, subindex: int, what: str, data: bytes) -> None:
        with self._transfer(_BLOCK_DOWNLOAD, index, subindex, what), self._sdo.open(
            index, subindex, "wb", buffering=0, size=len(data), block_transfer=True
        ) as stream:
            for at in range(0, len(data), 7):
                cast(Any, stream).write(data[at : at + 7])

    def _on_answer(self, cob_id: int, data: bytearray, came: float) -> None:
        """Every client on a bus hears the answers to all: the library gets those to this one's request alone."""
        if len(data) != 8:
            return
        kind, (asked, address) = data[0] >> 5, self._asked
        if kind == _ABORTED:
            self._let_pass_until = 0.0
        if not self._block and time.monotonic() >= self._blocks_until:
            if kind in (_UPLOADED, _DOWNLOADED):  # an abort may follow an answer, where another client has cut in
                self._answers.came(bytes(data))
            self._heard(bytes(data))
        if self._block:
            mine = True
        elif kind == _ABORTED and self._segments and int.from_bytes(data[4:8], "little") == od.Abort.COMMAND:
            mine = True  # another client's request has ended the transfer
        elif kind in (_SEGMENT, _SEGMENT_TAKEN):
            mine = self._segments
        else:
            mine = kind in (asked, _ABORTED) and bytes(data[1:4]) == address
            if mine:  # an answer to another client leaves the transfer as it is
                whole = kind == _UPLOADED and data[0] & 2  # the answer is all of it
                self._segments = kind in (_UPLOADED, _DOWNLOADED) and not whole
                self._block = kind in (_BLOCK_UPLOAD, _BLOCK_DOWNLOAD)
        if mine:
            self._forward(cob_id, data, came)

    def _on_others_request(self, _cob_id: int, data: bytearray, _time: float) -> None:
        """Every client on a bus hears the requests of all others, too."""
        self._others_asked = now = time.monotonic()
        kind = data[0] >> 5 if len(data) == 8 else None
        if kind in (_UPLOAD_BLOCK, _DOWNLOAD_BLOCK):
            ended = data[0] & 3 == 1  # its last frame (CiA 301, 7.2.4.3.12 and 16)
            self._blocks_until = now + (_OTHERS if ended else _BLOCK)
            self._let_pass_until = now if ended else now + _BLOCK
        elif kind == _ABORTED:
            self._let_pass_until = now
        elif kind in (_DOWNLOAD, _UPLOAD) and now >= self._blocks_until:
            address = bytes(data[1:4])
            self._answers.asked(address)
            self._others = {a: t for a, t in self._others.items() if now - t < 1.0} | {address: now}

    def _and_others(self) -> str:
        """More to say where a transfer has failed: that another client is on the bus."""
        asked = [f"0x{int.from_bytes(a[:2], 'little'):04X}:{a[2]}" for a in self._others][:_SHOWN_OTHERS]
        if time.monotonic() - self._others_asked > 1.0 or not asked:
            return ""
        return f"; another SDO client is on the bus: it asks for {', '.join(asked)}"

    @contextlib.contextmanager
    def _transfer(self, kind: int, index: int, subindex: int, what: str) -> Generator[None]:
        """The one transfer under way; the library's errors as ours, in a sentence."""
        where = f"0x{index:04X}:{subindex} ({what})"
        with self._sdo_lock:
            self._segments = self._block = False
            self._asked, whole = (kind, od.sdo_address(index, subindex)), False
            if kind in (_UPLOADED, _DOWNLOADED):
                self._answers.asked(self._asked[1])
            try:
                yield
                whole = True
            except canopen.SdoAbortedError as error:
                code = error.code
                if code == od.Abort.TIME_OUT:
                    raise NoReplyError(f"{self.node} waited too long for the rest of {where}") from None
                in_pieces = kind == _BLOCK_UPLOAD or self._segments
                cut_off = self._block and self._and_others()  # an abort of what another has asked for, it may be
                if code in _SPOILT or (code == od.Abort.COMMAND and in_pieces) or cut_off:
                    raise FrameError(
                        f"{self.node} gave up {where} with SDO abort 0x{code:08X}: {error}{self._and_others()}"
                    ) from None
                raise RefusedError(f"{self.node} answered SDO abort 0x{code:08X} to {where}: {error}", code) from None
            except canopen.SdoCommunicationError as error:
                self._abort(kind, index, subindex)
                if "CRC" in str(error):
                    raise FrameError(f"{self.node} sent {where} with a checksum that is not right") from None
                raise NoReplyError(
                    f"{self.node} did not answer for {where} within {SDO_TIMEOUT} s{self._and_others()}"
                ) from None
            except _BUS_ERRORS as error:
                raise LostError(f"{self._url.bus} no longer takes frames: {_first_line(error)}") from None
            finally:
                if self._block and not whole:
                    self._blocks_until = time.monotonic() + _OTHERS  # in which the rest of it may come
                self._asked, self._block, self._segments = (kind, b""), False, False

    def _abort(self, kind: int, index: int, subindex: int) -> None:
        """End a block transfer that has failed, at the server too."""
        if kind in (_BLOCK_UPLOAD, _BLOCK_DOWNLOAD):
            with contextlib.suppress(*_BUS_ERRORS):
                code = int(od.Abort.TIME_OUT).to_bytes(4, "little")
                self._network.send_message(
                    od.sdo_request_cob_id(self._url.node_id), b"\x80" + od.sdo_address(index, subindex) + code
                )


class _Listener(MessageListener):
    """Where the bus fails, holds the library's reader thread until the drive is closed; `Network.check` tells of it."""

    def __init__(self, network: canopen.Network, closed: threading.Event) -> None:
        super().__init__(network)
        self._closed = closed

    def on_message_received(self, msg: can.Message) -> None:
        if not msg.is_extended_id:  # a 29-bit identifier is another one, whatever its number
            super().on_message_received(msg)

    def on_error(self, exc: Exception) -> None:
        del exc
        self._closed.wait()


class _SocketcandBus(can.BusABC):
    """A bus behind a socketcand server. What is heard from it directly does not pass through the library."""

    def __init__(self, host: str, port: int, channel: str) -> None:
        self._server = connected(host, port, channel)
        self._frames = Frames()
        self._waiting: deque[Frame] = deque()  # for the library
        self._numbers: Mapping[int, int] = {}
        self._heard: Callable[[Sequence[Frame]], None] = lambda _: None
        super().__init__(channel=channel)
        self.channel_info = f"socketcand on {channel}@{host}:{port}"

    def hear(self, numbers: Mapping[int, int], callback: Callable[[Sequence[Frame]], None]) -> None:
        """Have frames of these identifiers, by numbers."""
        self._heard, self._numbers = callback, numbers

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        del timeout
        self._server.sendall(send_command(msg.arbitration_id, bytes(msg.data)))

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._waiting:
            self._receive(timeout)
        if not self._waiting:
            return None, False
        cob_id, data = self._waiting.popleft()
        return can.Message(timestamp=time.time(), arbitration_id=cob_id, data=data, is_extended_id=False), False

    def _receive(self, timeout: float | None) -> None:
        """Take in what comes within so many s."""
        if not select.select([self._server], [], [], timeout)[0]:
            return
        data = self._server.recv(1 << 16)
        if not data:
            raise can.CanOperationError("its server has ended the connection")
        acknowledge(self._server)
        numbers = self._numbers
        frames = self._frames.feed(data)
        direct = [(numbers[cob_id], data) for cob_id, data in frames if cob_id in numbers]
        if direct:
            self._heard(direct)
        self._waiting.extend(frame for frame in frames if frame[0] not in numbers)

    def shutdown(self) -> None:
        super().shutdown()
        self._server.close()


def check_interface(name: str) -> None:
    """Raise ConnectError unless python-can has such an interface, and can load it. Opens nothing."""
    if name not in BACKENDS:
        raise ConnectError(f"python-can has no interface {name!r}; it has {', '.join(sorted(BACKENDS))}")
    try:
        importlib.import_module(BACKENDS[name][0])
    except Exception as error:  # noqa: BLE001 - each has its own for a vendor's library that is not there
        raise ConnectError(f"interface {name!r} of python-can cannot be loaded: {_first_line(error)}") from None


def _open(url: CanUrl, closed: threading.Event) -> canopen.Network:
    options: dict[str, Any] = {key: cast_from_string(text) for key, text in url.options.items()}
    network = canopen.Network(None if url.host is None else _SocketcandBus(url.host, url.port or 0, url.channel))
    network.NOTIFIER_CYCLE = 0.02  # s, for which `close` waits
    network.listeners[:] = [_Listener(network, closed)]
    try:
        network.connect(interface=url.interface, channel=url.channel, **options)
    except Exception as error:  # noqa: BLE001 - each CAN interface has its own errors for a bus that is not there
        raise ConnectError(f"no CAN bus {url.bus}: {_first_line(error)}") from None
    _prepare(network.bus)
    return network


def _prepare(bus: can.BusABC | None) -> None:
    """Where the bus is a socket of the kernel's: room for many frames, and a reader that never waits for ever.

    An interface that goes down wakes the reader and tells one thread; where that was a sender, nothing is to be read.
    """
    frames = getattr(bus, "socket", None)
    if isinstance(frames, socket.socket):
        frames.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BACKLOG)
        frames.settimeout(_NO_FRAME)


def _first_line(error: BaseException) -> str:
    text = (str(error) or type(error).__name__).splitlines()[0]
    text = text.partition(" Traceback")[0].rstrip()  # python-can appends one to its own sentence
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]} ..."  # and quotes all that has come
