"""A drive on a CAN bus: SDO for values, TPDOs for the stream. The only client file that knows canopen and python-can.

The bus library's reader thread only puts frames into a queue; the thread that iterates `stream` assembles them.
SDO transfers are one at a time, under a lock; reads are repeated when no answer comes, writes never.
"""

import contextlib
import logging
import socket
import threading
import time
from collections import deque
from collections.abc import Generator, Iterator
from types import TracebackType
from typing import Any, Self

import can
import canopen

from drivers.assembler import Assembler, Counts
from drivers.block import Block
from drivers.drive import Identity
from drivers.errors import ConnectError, DriveError, LostError, NoReplyError, RefusedError
from drivers.wire import canopen_od as od
from drivers.wire.can_url import CanUrl
from drivers.wire.codec import decode, encode
from drivers.wire.dictionary import SIGNALS, Signal, layout_id, signal_named

SDO_TIMEOUT = 0.3  # s, for one answer
READ_ATTEMPTS = 3
SILENCE = 1.0  # s without a row after which a drive counts as lost
POLL = 0.01  # s, how often the stream looks for new frames
_CONNECT_TIMEOUT = 2.0  # s, for a TCP port

# python-can's socketcand client logs a line per partial frame; canopen logs what arrives here as exceptions.
logging.getLogger("can.interfaces.socketcand").setLevel(logging.CRITICAL)
logging.getLogger("canopen").setLevel(logging.CRITICAL)


class CanopenDrive:
    """CANopen client of one node. Opens the bus, checks that the node is such a drive, and reads its identity."""

    def __init__(self, url: CanUrl) -> None:
        self._url = url
        self._sdo_lock = threading.Lock()
        self._frames: deque[tuple[int, bytes]] = deque()
        self._assembler: Assembler | None = None
        self._stream_lock = threading.Lock()
        self._closed = threading.Event()
        self._rebooted = threading.Event()
        self._network = _open(url)
        try:
            self._node = self._network.add_node(url.node_id, canopen.ObjectDictionary())
            self._node.sdo.RESPONSE_TIMEOUT = SDO_TIMEOUT
            self.identity = self._identify()
            self._full = {"i_full": self.identity.i_full, "u_full": self.identity.u_full,
                          "omega_full": self.identity.omega_full}
            for number in range(len(od.TPDO_LAYOUT)):
                self._network.subscribe(od.tpdo_cob_id(number, url.node_id), self._on_tpdo)
            self._network.subscribe(od.heartbeat_cob_id(url.node_id), self._on_heartbeat)
        except BaseException:
            self.close()
            raise

    @property
    def counts(self) -> Counts:
        """Rows and gaps of the present stream."""
        return self._assembler.counts if self._assembler else Counts()

    def read(self, name: str) -> float:
        """Value of a signal, SI."""
        signal = signal_named(name)
        return self._decode(signal, self._upload(signal.index, signal.subindex, signal.name))

    def write(self, name: str, value: float) -> None:
        """Set a signal, SI. A change of `stream_periods` restarts a running stream."""
        signal = signal_named(name)
        if signal.access != "rw":
            raise RefusedError(f"{signal} is {signal.access}, it cannot be written", 0x06010002)
        try:
            data = encode(signal, value, self._full)
        except ValueError as error:
            raise RefusedError(str(error), 0x06090030) from None
        if name == "stream_periods" and self._assembler is not None:
            self._command(od.NMT_PRE_OPERATIONAL)
            self._download(signal, data)
            self._start()
        else:
            self._download(signal, data)

    def parameters(self) -> dict[str, float]:
        """Every writable signal with its value, SI."""
        return {signal.name: self.read(signal.name) for signal in SIGNALS if signal.access == "rw"}

    def stream(self) -> Iterator[Block]:
        """Start the stream and yield blocks as they come. Raises LostError when it falls silent or the node resets."""
        self._rebooted.clear()
        self._start()
        heard = time.monotonic()
        while not self._closed.wait(POLL):
            blocks = self._drain()
            if blocks:
                heard = time.monotonic()
                yield from blocks
            if self._rebooted.is_set():
                raise LostError(f"node {self._url.node_id} on {self._url.bus} has reset")
            self._check_bus()
            silent = time.monotonic() - heard
            if silent > SILENCE:
                raise LostError(
                    f"node {self._url.node_id} on {self._url.bus} fell silent: no row for {silent:.1f} s, "
                    f"expected one every {self._row_time() * 1e3:g} ms"
                )

    def close(self) -> None:
        """Stop the stream and close the bus."""
        if self._closed.is_set():
            return
        self._closed.set()
        with contextlib.suppress(DriveError):
            if self._assembler is not None:
                self._command(od.NMT_PRE_OPERATIONAL)
        with contextlib.suppress(can.CanError, OSError):
            self._network.disconnect()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _identify(self) -> Identity:
        url = self._url
        try:
            vendor, product, revision, serial = (
                int.from_bytes(self._upload(od.OD_IDENTITY, k, "identity"), "little") for k in (1, 2, 3, 4)
            )
            name = self._upload(od.OD_DEVICE_NAME, 0, "device name").decode("ascii", "replace")
        except NoReplyError:
            raise ConnectError(f"no node {url.node_id} answered on {url.bus} within {SDO_TIMEOUT} s") from None
        try:
            layout = int(self.read("layout_id"))
        except RefusedError:
            layout = -1
        if layout != layout_id():
            raise ConnectError(
                f"node {url.node_id} on {url.bus} ({name!r}) has another signal layout: expected "
                f"0x{layout_id():08X}, got " + ("none" if layout < 0 else f"0x{layout:08X}")
            )
        return Identity(
            name, vendor, product, revision, serial, layout,
            self.read("T_s"), self.read("i_full"), self.read("u_full"), self.read("omega_full"),
        )

    def _start(self) -> None:
        """Pre-operational, read where the tick stands, operational: the first row's place in time is known."""
        self._command(od.NMT_PRE_OPERATIONAL)
        periods = int(self.read("stream_periods"))
        tick = int(self.read("tick"))
        with self._stream_lock:
            self._frames.clear()
            self._assembler = Assembler(self.identity.T_s, periods, self._full, tick - 2 * periods)  # a row under way
        self._command(od.NMT_START)

    def _drain(self) -> list[Block]:
        with self._stream_lock:
            assembler = self._assembler
            if assembler is None:
                return []
            while self._frames:
                number, data = self._frames.popleft()
                assembler.frame(number, data)
            return assembler.take()

    def _row_time(self) -> float:
        return self.identity.T_s * (self._assembler.periods if self._assembler else 1)

    def _on_tpdo(self, cob_id: int, data: bytearray, _time: float) -> None:
        self._frames.append(((cob_id - self._url.node_id - 0x180) >> 8, bytes(data)))

    def _on_heartbeat(self, _cob_id: int, data: bytearray, _time: float) -> None:
        if len(data) == 1 and data[0] == od.STATE_BOOT_UP:
            self._rebooted.set()

    def _command(self, command: int) -> None:
        try:
            self._network.send_message(od.NMT_COB_ID, bytes([command, self._url.node_id]))
        except (can.CanError, OSError) as error:
            raise LostError(f"{self._url.bus} no longer takes frames: {_first_line(error)}") from None

    def _check_bus(self) -> None:
        try:
            self._network.check()
        except Exception as error:  # noqa: BLE001 - whatever ended the library's reader thread
            raise LostError(f"{self._url.bus} is gone: {_first_line(error)}") from None

    def _upload(self, index: int, subindex: int, what: str) -> bytes:
        for attempt in range(READ_ATTEMPTS):
            try:
                with self._sdo_lock, self._translated(index, subindex, what):
                    return bytes(self._node.sdo.upload(index, subindex))
            except NoReplyError:
                if attempt == READ_ATTEMPTS - 1 or self._closed.is_set():
                    raise
        raise AssertionError

    def _download(self, signal: Signal, data: bytes) -> None:
        with self._sdo_lock, self._translated(signal.index, signal.subindex, signal.name):
            self._node.sdo.download(signal.index, signal.subindex, data)

    def _decode(self, signal: Signal, data: bytes) -> float:
        try:
            return decode(signal, data, getattr(self, "_full", {}))
        except ValueError as error:
            raise ConnectError(f"node {self._url.node_id} on {self._url.bus}: {error}") from None

    @contextlib.contextmanager
    def _translated(self, index: int, subindex: int, what: str) -> Generator[None]:
        """The library's errors as ours, in a sentence."""
        where = f"node {self._url.node_id} on {self._url.bus}"
        try:
            yield
        except canopen.SdoAbortedError as error:
            raise RefusedError(
                f"{where} answered SDO abort 0x{error.code:08X} to 0x{index:04X}:{subindex} ({what}): {error}",
                error.code,
            ) from None
        except canopen.SdoCommunicationError:
            raise NoReplyError(f"{where} did not answer for 0x{index:04X}:{subindex} within {SDO_TIMEOUT} s") from None
        except (can.CanError, OSError, RuntimeError) as error:
            raise LostError(f"{self._url.bus} no longer takes frames: {_first_line(error)}") from None


def _open(url: CanUrl) -> canopen.Network:
    options: dict[str, Any] = dict(url.options)
    if url.host is not None:
        try:
            socket.create_connection((url.host, url.port or 0), _CONNECT_TIMEOUT).close()
        except OSError as error:
            reason = error.strerror or error
            raise ConnectError(f"nothing serves a CAN bus at {url.host}:{url.port}: {reason}") from None
        options |= {"host": url.host, "port": url.port, "tcp_tune": True}
    network = canopen.Network()
    network.NOTIFIER_CYCLE = 0.1
    try:
        network.connect(interface=url.interface, channel=url.channel, **options)
    except Exception as error:  # noqa: BLE001 - each CAN interface has its own errors for a bus that is not there
        raise ConnectError(f"no CAN bus {url.bus}: {_first_line(error)}") from None
    return network


def _first_line(error: BaseException) -> str:
    return (str(error) or type(error).__name__).splitlines()[0]
