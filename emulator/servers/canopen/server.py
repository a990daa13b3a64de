"""A CANopen node over the virtual drive: SDO server, NMT, heartbeats, emergencies, TPDOs with rows and with SYNC.

The only emulator file that knows canopen and python-can. What arrives from the bus is served in the bus's reader
thread; values written wait in the virtual drive for its next tick. Time comes in as the drive's.
"""

import contextlib
import errno
import heapq
import logging
import queue
import socket
import struct
import threading
from collections.abc import Iterable
from types import TracebackType
from typing import Any, Self

import can
import canopen
import numpy as np
from can.util import cast_from_string
from canopen.network import MessageListener

from drivers.wire import canopen_od as od
from drivers.wire.can_url import CanUrl
from drivers.wire.cia402 import error_register
from emulator.drive.virtual_drive import StreamRows, VirtualDrive
from emulator.errors import BusError
from emulator.servers.canopen.objects import NodeObjects
from emulator.servers.canopen.sdo_server import SdoAbortError, SdoServer
from emulator.servers.canopen.tpdo import payload, payloads
from emulator.servers.faults import Faults
from emulator.servers.socketcand import Frame, SocketcandServer

logging.getLogger("canopen").setLevel(logging.CRITICAL)

_STATES = {
    od.NMT_START: od.STATE_OPERATIONAL,
    od.NMT_STOP: od.STATE_STOPPED,
    od.NMT_PRE_OPERATIONAL: od.STATE_PRE_OPERATIONAL,
}


_REMOVED = (errno.ENODEV, errno.ENXIO)  # there is no such interface any more
_DOWN = 0.05  # s, between two looks at an interface that is down
_NO_FRAME = 0.1  # s, after which a reader that was woken for a frame that is not there goes on


class CanopenNode:
    """One node on a bus. `publish` is called after every run of the virtual drive; `close` leaves the bus.

    `faults` may be changed at any time.
    """

    def __init__(self, drive: VirtualDrive, url: CanUrl, faults: Faults | None = None) -> None:
        self._drive = drive
        self._id = url.node_id
        self.faults = faults or Faults()
        self._delayed: list[tuple[float, int, Frame]] = []  # s when it goes out, its turn, frame
        self._turn = 0
        self._lock = threading.RLock()  # guards what follows, between the bus's reader thread and the drive's
        self._objects = NodeObjects(drive, self._id)
        self._sdo = SdoServer(self)
        self._state = od.STATE_BOOT_UP
        self._resets = drive.resets
        self._heartbeat = (0, 0.0)  # ms between two, s when the latest was due
        self._rows_sent = 0
        self._begins: int | None = None  # tick at which the first row to be sent begins at the earliest
        self._error = 0  # error code that the bus has been told
        self._off = False  # the bus
        self._failure: Exception | None = None  # that a frame met: the kernel tells one thread, the reader or a sender
        self._bus = _open(url)
        self._network = canopen.Network(self._bus)
        self._network.NOTIFIER_CYCLE = 0.02  # s, for which `close` waits
        self._closed = threading.Event()
        self._network.listeners[:] = [_Listener(self._network, self._closed)]
        self._network.connect()
        self._network.subscribe(od.sdo_request_cob_id(self._id), self._on_sdo)
        self._network.subscribe(od.NMT_COB_ID, self._on_nmt)
        self._network.subscribe(od.SYNC_COB_ID, self._on_sync)
        for node in range(1, 128):
            self._network.subscribe(od.heartbeat_cob_id(node), self._on_heartbeat)
        self._boot()

    @property
    def bus(self) -> can.BusABC:
        """The bus the node is on."""
        return self._bus

    def publish(self, rows: StreamRows) -> None:
        """Send what has become due: rows' TPDOs when operational, emergencies, the heartbeat. Raises BusError."""
        self._check()
        now = self._drive.elapsed
        with self._lock:
            if self._drive.resets != self._resets:
                self._resets = self._drive.resets
                self._objects.errors.clear()
                self._boot()
            frames = [(od.sdo_response_cob_id(self._id), answer) for answer in self._sdo.expire(now)]
            frames += self._recovery(now) + self._emergency()
            if self._state == od.STATE_OPERATIONAL:
                frames += self._row_frames(rows)
            if self._heartbeat_due(now):
                frames.append((od.heartbeat_cob_id(self._id), bytes([self._state])))
            self._send(frames)  # before the reader's thread changes the state that they were made in

    def close(self) -> None:
        """Leave the bus."""
        self._closed.set()
        with contextlib.suppress(Exception):  # it raises again what ended its reader thread
            self._network.disconnect()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def get_data(self, index: int, subindex: int) -> bytes:
        """Bytes of an object, for the SDO server."""
        self._check_refused(index)
        return self._objects.get_data(index, subindex)

    def set_data(self, index: int, subindex: int, data: bytes) -> None:
        """Write an object, for the SDO server."""
        self._check_refused(index)
        self._objects.set_data(index, subindex, data)

    def _check_refused(self, index: int) -> None:
        if self.faults.refuses(index, self._drive.elapsed):
            raise SdoAbortError(od.Abort.GENERAL)

    def _check(self) -> None:
        """Raise BusError when the bus is gone. An interface that is down may come up again: a drive waits for it."""
        notifier = self._network.notifier
        error = self._failure or (notifier.exception if notifier is not None else None)
        if error is not None and not _passing(error):
            raise BusError(f"the CAN bus {self._bus.channel_info} is gone: {_first_line(error)}")

    def _heartbeat_due(self, now: float) -> bool:
        """Whether a heartbeat goes out at time `now` (s). What it is late by does not delay those to come."""
        (before, latest), period = self._heartbeat, self._objects.communication.heartbeat_ms
        if period != before:
            latest = now
        passed = int((now - latest) / (period * 1e-3) + 1e-6) if period else 0
        self._heartbeat = (period, latest + passed * period * 1e-3)
        return passed > 0 and self._state != od.STATE_BOOT_UP

    def _row_frames(self, rows: StreamRows) -> list[Frame]:
        if self._begins is None:  # in rows that were under way at the start, what was written before may not count yet
            self._begins = self._drive.tick
        first = int(np.searchsorted(rows.row_tick, self._begins))
        if first == len(rows):
            return []
        slow = {k for k in range(first, len(rows)) if (self._rows_sent + k - first) % od.SLOW_ROWS == 0}
        self._rows_sent += len(rows) - first
        sent = [
            (number, tpdo.cob_id & 0x7FF, payloads(tpdo, rows, self._objects.full, self._drive.read))
            for number, tpdo in enumerate(self._objects.communication.tpdos)
            if tpdo.valid and tpdo.on_event and (slow or number < od.ROW_TPDOS)
        ]
        frames: list[Frame] = []
        for k in range(first, len(rows)):
            frames += [(cob_id, data[k]) for number, cob_id, data in sent if number < od.ROW_TPDOS or k in slow]
        return frames

    def _recovery(self, now: float) -> list[Frame]:
        """What has to be told when the node is back on a bus that it had to leave."""
        was, self._off = self._off, self.faults.bus_off(now)
        if not was or self._off:
            return []
        if self._state == od.STATE_OPERATIONAL:
            self._state = od.STATE_PRE_OPERATIONAL  # CiA 301: what object 0x1029 is by default
        codes = (od.RECOVERED_FROM_BUS_OFF, self._error)  # told, and over
        return [(od.emergency_cob_id(self._id), struct.pack("<HB5x", code, error_register(code))) for code in codes]

    def _emergency(self) -> list[Frame]:
        """What has to be told of errors that have come or gone."""
        code = int(self._drive.read("error_code"))
        if code == self._error:
            return []
        self._error = code
        if code:
            self._objects.note_error(code)
        if self._state == od.STATE_STOPPED:
            return []
        return [(od.emergency_cob_id(self._id), struct.pack("<HB5x", code, error_register(code)))]

    def _on_sdo(self, _cob_id: int, data: bytearray, _time: float) -> None:
        now = self._drive.elapsed
        for request in self.faults.passed(bytes(data), now):
            if not request.intact or not self._line_open or self._state in (od.STATE_STOPPED, od.STATE_BOOT_UP):
                continue  # CiA 301, 7.3.2.2: a stopped node is deaf but for NMT
            self._drive.hear()
            with self._lock:
                answers = self._sdo.request(request.data, now)
                self._send([(od.sdo_response_cob_id(self._id), answer) for answer in answers])

    def _on_heartbeat(self, cob_id: int, data: bytearray, _time: float) -> None:
        own = self._objects.communication.bench_node
        if own is not None and cob_id == od.heartbeat_cob_id(own) and len(data) == 1 and self._line_open:
            self._drive.hear()

    def _on_sync(self, _cob_id: int, data: bytearray, _time: float) -> None:
        if self._state != od.STATE_OPERATIONAL or len(data) > 1 or not self._line_open:
            return
        with self._lock:
            due = [tpdo for tpdo in self._objects.communication.tpdos if tpdo.due()]
            values = self._drive.values({signal.name for tpdo in due for signal in tpdo.signals})
            self._send([(tpdo.cob_id & 0x7FF, payload(tpdo, values, self._objects.full)) for tpdo in due])

    def _on_nmt(self, _cob_id: int, data: bytearray, _time: float) -> None:
        if len(data) != 2 or data[1] not in (0, self._id) or self._state == od.STATE_BOOT_UP or not self._line_open:
            return
        with self._lock:
            if data[0] in _STATES:
                self._state, self._begins = _STATES[data[0]], None
            elif data[0] == od.NMT_RESET_COMMUNICATION:
                self._boot()
            elif data[0] == od.NMT_RESET_NODE:
                self._state = od.STATE_BOOT_UP
                self._drive.reset()  # which `publish` notices

    def _boot(self) -> None:
        """Begin to communicate, as stored."""
        self._objects.reset()
        self._sdo = SdoServer(self)
        self._send([(od.heartbeat_cob_id(self._id), bytes([od.STATE_BOOT_UP]))])
        self._state = od.STATE_PRE_OPERATIONAL
        self._heartbeat = (self._objects.communication.heartbeat_ms, self._drive.elapsed)
        self._rows_sent = 0

    @property
    def _line_open(self) -> bool:
        """No fault closes the line, or keeps the node off it."""
        now = self._drive.elapsed
        return not self.faults.closed(now) and not self.faults.bus_off(now)

    def _send(self, frames: list[Frame]) -> None:
        """Put frames on the bus, through the faults of its line, and those that were delayed till now."""
        frames = self._spoilt(frames)
        if isinstance(self._bus, _SocketcandBus):
            self._bus.send_all(frames)
            return
        for cob_id, data in frames:
            try:
                self._network.send_message(cob_id, data)
            except (can.CanError, OSError) as error:  # a bus that takes no frame loses it
                if getattr(error, "error_code", None) in _REMOVED:
                    self._failure = error

    def _spoilt(self, frames: list[Frame]) -> list[Frame]:
        """What the line lets through now. A frame that is not intact is lost: every CAN controller checks its sum."""
        if self.faults.none:
            return frames
        now = self._drive.elapsed
        if self.faults.bus_off(now):
            return []
        with self._lock:
            for cob_id, data in frames:
                for out in self.faults.passed(data, now):
                    if out.intact:
                        self._turn += 1
                        heapq.heappush(self._delayed, (out.at, self._turn, (cob_id, out.data)))
            due: list[Frame] = []
            while self._delayed and self._delayed[0][0] <= now:
                due.append(heapq.heappop(self._delayed)[2])
        return due


class _Listener(MessageListener):
    """Where the bus fails, holds the library's reader thread until the node is closed, or a bit where it may pass."""

    def __init__(self, network: canopen.Network, closed: threading.Event) -> None:
        super().__init__(network)
        self._closed = closed

    def on_message_received(self, msg: can.Message) -> None:
        if not msg.is_extended_id:  # a 29-bit identifier is another one, whatever its number
            super().on_message_received(msg)

    def on_error(self, exc: Exception) -> None:
        self._closed.wait(_DOWN if _passing(exc) else None)


class _SocketcandBus(can.BusABC):
    """The node's end of a bus that this process serves over TCP."""

    def __init__(self, server: SocketcandServer) -> None:
        super().__init__(channel=server.channel)
        self.channel_info = f"socketcand {server.channel} at port {server.port}"
        self._server = server

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        del timeout
        self._server.broadcast([(msg.arbitration_id, bytes(msg.data))])

    def send_all(self, frames: Iterable[Frame]) -> None:
        self._server.broadcast(frames)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        try:
            cob_id, payload = self._server.received.get(timeout=timeout)
        except queue.Empty:
            return None, False
        return can.Message(arbitration_id=cob_id, data=payload, is_extended_id=False), False

    def shutdown(self) -> None:
        super().shutdown()
        self._server.close()


def _open(url: CanUrl) -> can.BusABC:
    if url.host is not None:
        return _SocketcandBus(SocketcandServer(url.host, url.port or 0, url.channel))
    options: dict[str, Any] = {key: cast_from_string(text) for key, text in url.options.items()}
    try:
        bus = can.Bus(interface=url.interface, channel=url.channel, **options)
    except Exception as error:  # noqa: BLE001 - each CAN interface has its own errors for a bus that is not there
        raise BusError(f"no CAN bus {url.bus}: {_first_line(error)}") from None
    frames = getattr(bus, "socket", None)
    if isinstance(frames, socket.socket):  # of the kernel's, which tells one thread that the interface has gone down:
        frames.settimeout(_NO_FRAME)  # where that was a sender, the reader, woken too, finds nothing
    return bus


def _passing(error: BaseException) -> bool:
    """The interface is down, or the reader was woken for nothing: neither need last."""
    return isinstance(error, can.CanError) and (
        error.error_code == errno.ENETDOWN or isinstance(error.__cause__, TimeoutError)
    )


def _first_line(error: BaseException) -> str:
    return (str(error) or type(error).__name__).splitlines()[0]
