"""One node on a CAN bus, to its client. The only client file that knows canopen and python-can.

SDO transfers are one at a time, under a lock; reads are repeated when no answer comes, writes never. Knows nothing of
signals. What is subscribed runs in the bus library's reader thread.
"""

import contextlib
import logging
import threading
from collections.abc import Callable, Generator
from typing import Any, cast

import can
import canopen
from canopen.network import MessageListener

from drivers.errors import ConnectError, LostError, NoReplyError, RefusedError
from drivers.socketcand import check_served
from drivers.wire import canopen_od as od
from drivers.wire.can_url import CanUrl

SDO_TIMEOUT = 0.3  # s, for one answer
READ_ATTEMPTS = 3
_BUS_ERRORS = (can.CanError, OSError, RuntimeError, AttributeError)  # the last two: closed meanwhile

# What an SDO answer is (CiA 301, 7.2.4.3): the upper three bits of its first byte
_SEGMENT, _UPLOADED, _DOWNLOADED, _ABORTED = 0, 2, 3, 4

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
        self._closed = threading.Event()
        self._close_lock = threading.Lock()
        self._network = _open(url, self._closed)
        self._sdo = self._network.add_node(url.node_id, canopen.ObjectDictionary()).sdo
        self._sdo.RESPONSE_TIMEOUT = SDO_TIMEOUT
        self._forward: Callable[[int, bytearray, float], None] = cast(Any, self._sdo).on_response
        self._network.unsubscribe(od.sdo_response_cob_id(url.node_id))
        self._network.subscribe(od.sdo_response_cob_id(url.node_id), self._on_answer)

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
        for attempt in range(READ_ATTEMPTS):
            try:
                with self._transfer(_UPLOADED, index, subindex, what):
                    return bytes(self._sdo.upload(index, subindex))
            except NoReplyError:
                if attempt == READ_ATTEMPTS - 1 or self._closed.is_set():
                    raise
        raise AssertionError

    def write(self, index: int, subindex: int, what: str, data: bytes) -> None:
        """Set an object, called `what` in messages; returns when the node has taken it."""
        with self._transfer(_DOWNLOADED, index, subindex, what):
            self._sdo.download(index, subindex, data)

    def command(self, nmt: int) -> None:
        """Send the node an NMT command."""
        try:
            self._network.send_message(od.NMT_COB_ID, bytes([nmt, self._url.node_id]))
        except _BUS_ERRORS as error:
            raise LostError(f"{self._url.bus} no longer takes frames: {_first_line(error)}") from None

    def check(self) -> None:
        """Raise LostError when the bus has failed."""
        try:
            self._network.check()
        except Exception as error:  # noqa: BLE001 - whatever ended the library's reader thread
            raise LostError(f"{self._url.bus} is gone: {_first_line(error)}") from None

    def close(self) -> None:
        """Leave the bus."""
        self._closed.set()
        with self._close_lock, contextlib.suppress(Exception):  # it raises again what ended its reader thread
            self._network.disconnect()

    def _on_answer(self, cob_id: int, data: bytearray, time: float) -> None:
        """Every client on a bus hears the answers to all: the library gets those to this one's request alone."""
        if len(data) != 8:
            return
        kind, (asked, address) = data[0] >> 5, self._asked
        if kind == _SEGMENT:
            mine = self._segments
        else:
            mine = kind in (asked, _ABORTED) and bytes(data[1:4]) == address
            self._segments = mine and kind == _UPLOADED and not data[0] & 2  # 2: the answer is all of it
        if mine:
            self._forward(cob_id, data, time)

    @contextlib.contextmanager
    def _transfer(self, kind: int, index: int, subindex: int, what: str) -> Generator[None]:
        """The one transfer under way; the library's errors as ours, in a sentence."""
        where = f"0x{index:04X}:{subindex} ({what})"
        with self._sdo_lock:
            self._segments = False
            self._asked = (kind, od.sdo_address(index, subindex))
            try:
                yield
            except canopen.SdoAbortedError as error:
                code = error.code
                raise RefusedError(f"{self.node} answered SDO abort 0x{code:08X} to {where}: {error}", code) from None
            except canopen.SdoCommunicationError:
                raise NoReplyError(f"{self.node} did not answer for {where} within {SDO_TIMEOUT} s") from None
            except _BUS_ERRORS as error:
                raise LostError(f"{self._url.bus} no longer takes frames: {_first_line(error)}") from None
            finally:
                self._asked = (kind, b"")


class _Listener(MessageListener):
    """Where the bus fails, holds the library's reader thread until the drive is closed; `Network.check` tells of it."""

    def __init__(self, network: canopen.Network, closed: threading.Event) -> None:
        super().__init__(network)
        self._closed = closed

    def on_error(self, exc: Exception) -> None:
        del exc
        self._closed.wait()


def _open(url: CanUrl, closed: threading.Event) -> canopen.Network:
    options: dict[str, Any] = dict(url.options)
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
    return network


def _first_line(error: BaseException) -> str:
    return (str(error) or type(error).__name__).splitlines()[0]
