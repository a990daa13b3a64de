"""One node on a CAN bus, to its client. The only client file that knows canopen and python-can.

SDO transfers are one at a time, under a lock; reads are repeated when no answer comes, writes never. Knows nothing of
signals. What is subscribed runs in the bus library's reader thread.
"""

import contextlib
import errno
import logging
import socket
import threading
import time
from collections.abc import Callable, Generator
from typing import Any, cast

import can
import canopen
from can.util import cast_from_string
from canopen.network import MessageListener
from canopen.sdo.client import SdoClient

from drivers.errors import ConnectError, FrameError, LostError, NoReplyError, RefusedError
from drivers.socketcand import check_served
from drivers.wire import canopen_od as od
from drivers.wire.can_url import CanUrl

SDO_TIMEOUT = 0.3  # s, for one answer
READ_ATTEMPTS = 3
HEARTBEAT = 0.02  # s, between the bench's own heartbeats; a drive's watchdog has to be slower
EXPEDITED = 4  # bytes; longer downloads go by blocks
_BACKLOG = 4 << 20  # bytes of frames that may wait in the kernel for a reader that is held up; it may grant less
_NO_FRAME = 0.1  # s, after which a reader that was woken for a frame that is not there goes on
_GONE = (errno.ENETDOWN, errno.ENODEV, errno.ENXIO)  # what an interface that is down, or no more, answers
_SHOWN = 200  # characters of the library's words in a message
_BUS_ERRORS = (can.CanError, OSError, RuntimeError, AttributeError)  # the last two: closed meanwhile

# What an SDO answer is (CiA 301, 7.2.4.3): the upper three bits of its first byte
_SEGMENT, _UPLOADED, _DOWNLOADED, _ABORTED, _BLOCK_DOWNLOAD, _BLOCK_UPLOAD = 0, 2, 3, 4, 5, 6
_SPOILT = (od.Abort.TOGGLE, od.Abort.SEQUENCE, od.Abort.CRC)  # said of frames lost, late or twice: nothing is refused

# python-can's socketcand client logs a line per partial frame; canopen logs what arrives here as exceptions.
logging.getLogger("can.interfaces.socketcand").setLevel(logging.CRITICAL)
logging.getLogger("canopen").setLevel(logging.CRITICAL)


class CanopenBus:
    """A node as its client sees it, from construction to `close`. Raises ConnectError when there is no such bus."""

    def __init__(self, url: CanUrl) -> None:
        self._url = url
        self._sdo_lock = threading.Lock()
        self._asked = (_UPLOADED, b"")  # kind and address of the answer that is waited for
        self._segments = False  # whether segments of it follow
        self._block = False  # whether a block transfer is under way, in which an answer may begin with anything
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

    def read(self, index: int, subindex: int, what: str) -> bytes:
        """Bytes of an object, called `what` in messages."""
        return self._repeated(lambda: self._uploaded(index, subindex, what))

    def read_block(self, index: int, subindex: int, what: str) -> bytes:
        """The same by blocks, with a checksum: for what is long."""
        return self._repeated(lambda: self._block_uploaded(index, subindex, what))

    def write(self, index: int, subindex: int, what: str, data: bytes) -> None:
        """Set an object, called `what` in messages; returns when the node has taken it."""
        if len(data) > EXPEDITED:
            self._block_download(index, subindex, what, data)
            return
        with self._transfer(_DOWNLOADED, index, subindex, what):
            self._sdo.download(index, subindex, data)

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
        for _ in range(READ_ATTEMPTS - 1):
            try:
                return read()
            except (NoReplyError, FrameError):
                if self._closed.is_set():
                    raise
        return read()

    def _uploaded(self, index: int, subindex: int, what: str) -> bytes:
        with self._transfer(_UPLOADED, index, subindex, what):
            return bytes(self._sdo.upload(index, subindex))

    def _block_uploaded(self, index: int, subindex: int, what: str) -> bytes:
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

    def _on_answer(self, cob_id: int, data: bytearray, time: float) -> None:
        """Every client on a bus hears the answers to all: the library gets those to this one's request alone."""
        if len(data) != 8:
            return
        kind, (asked, address) = data[0] >> 5, self._asked
        if self._block:
            mine = True
        elif kind == _SEGMENT:
            mine = self._segments
        else:
            mine = kind in (asked, _ABORTED) and bytes(data[1:4]) == address
            self._segments = mine and kind == _UPLOADED and not data[0] & 2  # 2: the answer is all of it
            self._block = mine and kind in (_BLOCK_UPLOAD, _BLOCK_DOWNLOAD)
        if mine:
            self._forward(cob_id, data, time)

    @contextlib.contextmanager
    def _transfer(self, kind: int, index: int, subindex: int, what: str) -> Generator[None]:
        """The one transfer under way; the library's errors as ours, in a sentence."""
        where = f"0x{index:04X}:{subindex} ({what})"
        with self._sdo_lock:
            self._segments = self._block = False
            self._asked = (kind, od.sdo_address(index, subindex))
            try:
                yield
            except canopen.SdoAbortedError as error:
                code = error.code
                if code == od.Abort.TIME_OUT:
                    raise NoReplyError(f"{self.node} waited too long for the rest of {where}") from None
                if code in _SPOILT or (code == od.Abort.COMMAND and kind == _BLOCK_UPLOAD):
                    raise FrameError(f"{self.node} gave up {where} with SDO abort 0x{code:08X}: {error}") from None
                raise RefusedError(f"{self.node} answered SDO abort 0x{code:08X} to {where}: {error}", code) from None
            except canopen.SdoCommunicationError as error:
                self._abort(kind, index, subindex)
                if "CRC" in str(error):
                    raise FrameError(f"{self.node} sent {where} with a checksum that is not right") from None
                raise NoReplyError(f"{self.node} did not answer for {where} within {SDO_TIMEOUT} s") from None
            except _BUS_ERRORS as error:
                raise LostError(f"{self._url.bus} no longer takes frames: {_first_line(error)}") from None
            finally:
                self._asked, self._block = (kind, b""), False

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


def _open(url: CanUrl, closed: threading.Event) -> canopen.Network:
    options: dict[str, Any] = {key: cast_from_string(text) for key, text in url.options.items()}
    if url.host is not None:
        check_served(url.host, url.port or 0, url.channel)
        options |= {"host": url.host, "port": url.port, "tcp_tune": True}
    network = canopen.Network()
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
