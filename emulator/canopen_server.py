"""A CANopen node over the virtual drive: SDO server, NMT, heartbeat, the TPDO stream.

The only emulator file that knows canopen and python-can. What arrives from the bus is served in the bus's reader
thread; values written wait in the virtual drive for its next tick. Time comes in as the drive's ticks.
"""

import contextlib
import logging
import queue
import struct
import threading
from collections.abc import Callable, Iterable
from types import TracebackType
from typing import Any, Self, cast

import can
import canopen
import numpy as np
from canopen.network import MessageListener
from canopen.sdo.exceptions import SdoAbortedError
from canopen.sdo.server import SdoServer
from numpy.typing import NDArray

from drivers.wire import canopen_od as od
from drivers.wire.can_url import CanUrl
from drivers.wire.codec import FullScales, count_size, decode, encode
from drivers.wire.dictionary import Signal, WireType, signal_at
from emulator.socketcand import BusError, Frame, SocketcandServer
from emulator.virtual_drive import StreamRows, VirtualDrive

logging.getLogger("canopen").setLevel(logging.CRITICAL)

_SERIAL = 1
_ABORT_READ_ONLY = 0x06010002
_ABORT_NO_OBJECT = 0x06020000
_ABORT_LENGTH = 0x06070010
_ABORT_NO_SUBINDEX = 0x06090011
_ABORT_VALUE_RANGE = 0x06090030


class CanopenNode:
    """One node on a bus. `publish` is called after every run of the virtual drive; `close` leaves the bus."""

    def __init__(self, drive: VirtualDrive, url: CanUrl) -> None:
        self._drive = drive
        self._id = url.node_id
        self._full: FullScales = {name: drive.read(name) for name in ("i_full", "u_full", "omega_full")}
        self._state = od.STATE_BOOT_UP
        self._heartbeat_ms = od.HEARTBEAT_MS
        self._heartbeat_tick = 0
        self._rows_sent = 0
        self._packers = [_RowPacker(number, self._full) for number in range(od.ROW_TPDOS)]
        self._bus = _open(url)
        self._network = canopen.Network(self._bus)
        self._network.NOTIFIER_CYCLE = 0.02  # s, for which `close` waits
        self._closed = threading.Event()
        self._network.listeners[:] = [_Listener(self._network, self._closed)]
        self._network.connect()
        self._sdo = SdoServer(od.sdo_request_cob_id(self._id), od.sdo_response_cob_id(self._id), self._objects())
        self._sdo.network = self._network
        self._answer: Callable[[int, bytearray, float], None] = cast(Any, self._sdo).on_request
        self._network.subscribe(od.sdo_request_cob_id(self._id), self._on_sdo)
        self._network.subscribe(od.NMT_COB_ID, self._on_nmt)
        self._boot()

    @property
    def bus(self) -> can.BusABC:
        """The bus the node is on."""
        return self._bus

    def publish(self, rows: StreamRows) -> None:
        """Send what has become due: the rows' TPDOs when operational, the heartbeat. Raises BusError."""
        try:
            self._network.check()
        except Exception as error:  # noqa: BLE001 - whatever ended the library's reader thread
            raise BusError(f"the CAN bus {self._bus.channel_info} is gone: {_first_line(error)}") from None
        frames: list[Frame] = []
        if self._state == od.STATE_OPERATIONAL and len(rows.row_tick):
            frames += self._row_frames(rows)
        tick = self._drive.tick
        heartbeat_ticks = self._heartbeat_ms * 1e-3 / self._drive.read("T_s")
        if self._heartbeat_ms and tick - self._heartbeat_tick >= heartbeat_ticks:
            self._heartbeat_tick = tick
            frames.append((od.heartbeat_cob_id(self._id), bytes([self._state])))
        self._send(frames)

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

    def get_data(self, index: int, subindex: int, check_readable: bool = False) -> bytes:
        """Bytes of an object, for the SDO server. `check_readable` is the library's; all objects are readable."""
        del check_readable
        signal = signal_at(index, subindex)
        if signal is not None:
            return encode_any(signal, self._drive.read(signal.name), self._full)
        data = self._communication_object(index, subindex)
        if data is None:
            known = signal_at(index, 1) or self._communication_object(index, 0) is not None
            raise SdoAbortedError(_ABORT_NO_SUBINDEX if known else _ABORT_NO_OBJECT)
        return data

    def set_data(self, index: int, subindex: int, data: bytes, check_writable: bool = False) -> None:
        """Write an object, for the SDO server."""
        del check_writable
        if (index, subindex) == (od.OD_HEARTBEAT, 0):
            if len(data) != 2:
                raise SdoAbortedError(_ABORT_LENGTH)
            (self._heartbeat_ms,) = struct.unpack("<H", data)
            return
        signal = signal_at(index, subindex)
        if signal is None:
            self.get_data(index, subindex)  # aborts when there is no such object
            raise SdoAbortedError(_ABORT_READ_ONLY)
        if signal.access != "rw":
            raise SdoAbortedError(_ABORT_READ_ONLY)
        if 8 * len(data) != signal.type.bits:
            raise SdoAbortedError(_ABORT_LENGTH)
        try:
            self._drive.write(signal.name, decode(signal, bytes(data), self._full))
        except ValueError:
            raise SdoAbortedError(_ABORT_VALUE_RANGE) from None

    def _objects(self) -> Any:
        """This node in the shape the library's SDO server asks for."""
        self.object_dictionary = canopen.ObjectDictionary()
        return self

    def _communication_object(self, index: int, subindex: int) -> bytes | None:
        record: dict[int, list[bytes]] = {
            od.OD_DEVICE_TYPE: [struct.pack("<I", od.DEVICE_TYPE)],
            od.OD_ERROR_REGISTER: [b"\0"],
            od.OD_DEVICE_NAME: [od.DEVICE_NAME.encode("ascii")],
            od.OD_HEARTBEAT: [struct.pack("<H", self._heartbeat_ms)],
            od.OD_IDENTITY: [b"\4", *(struct.pack("<I", value) for value in
                                      (od.VENDOR_ID, od.PRODUCT_CODE, od.REVISION, _SERIAL))],
        }
        number = index & 0xFF
        if number < len(od.TPDO_LAYOUT):
            mapping = od.tpdo_mapping(number)
            record[od.OD_TPDO + number] = [b"\2", struct.pack("<I", od.tpdo_cob_id(number, self._id)), b"\xfe"]
            record[od.OD_TPDO_MAPPING + number] = [
                bytes([len(mapping)]), *(struct.pack("<I", entry) for entry in mapping)
            ]
        if subindex == 0 and index not in record and signal_at(index, 1):
            highest = max(k for k in range(1, 256) if signal_at(index, k))
            return bytes([highest])
        fields = record.get(index, [])
        return fields[subindex] if subindex < len(fields) else None

    def _row_frames(self, rows: StreamRows) -> list[Frame]:
        payloads = [packer.payloads(rows) for packer in self._packers]
        ids = [od.tpdo_cob_id(number, self._id) for number in range(len(od.TPDO_LAYOUT))]
        frames: list[Frame] = []
        for k in range(len(rows.row_tick)):
            frames += [(cob_id, payload[k]) for cob_id, payload in zip(ids, payloads, strict=False)]
            self._rows_sent += 1
            if self._rows_sent % od.SLOW_ROWS == 1:
                slow = od.TPDO_LAYOUT[od.ROW_TPDOS]
                tick = struct.pack("<H", int(rows.row_tick[k]) & 0xFFFF)
                values = (encode(s, self._drive.read(s.name), self._full) for s in slow[1:])
                frames.append((ids[od.ROW_TPDOS], tick + b"".join(values)))
        return frames

    def _on_sdo(self, cob_id: int, data: bytearray, time: float) -> None:
        if self._state != od.STATE_STOPPED:  # CiA 301, 7.3.2.2: a stopped node is deaf but for NMT
            self._answer(cob_id, data, time)

    def _on_nmt(self, _cob_id: int, data: bytearray, _time: float) -> None:
        if len(data) != 2 or data[1] not in (0, self._id):
            return
        states = {
            od.NMT_START: od.STATE_OPERATIONAL,
            od.NMT_STOP: od.STATE_STOPPED,
            od.NMT_PRE_OPERATIONAL: od.STATE_PRE_OPERATIONAL,
        }
        if data[0] in states:
            self._state = states[data[0]]
        elif data[0] in (od.NMT_RESET_NODE, od.NMT_RESET_COMMUNICATION):
            self._heartbeat_ms = od.HEARTBEAT_MS
            self._boot()

    def _boot(self) -> None:
        self._send([(od.heartbeat_cob_id(self._id), bytes([od.STATE_BOOT_UP]))])
        self._state = od.STATE_PRE_OPERATIONAL
        self._rows_sent = 0

    def _send(self, frames: list[Frame]) -> None:
        if isinstance(self._bus, _SocketcandBus):
            self._bus.send_all(frames)
            return
        for cob_id, payload in frames:
            with contextlib.suppress(can.CanError, OSError):  # a bus that takes no frame loses it
                self._network.send_message(cob_id, payload)


def encode_any(signal: Signal, value: float, full: FullScales) -> bytes:
    """Bytes of a value the drive itself holds: never refused, wrapped where a counter has run over."""
    if signal.type is WireType.F32:
        return struct.pack("<f", value)
    if signal.type in (WireType.U16, WireType.U32) and signal.scale == 1.0:
        return struct.pack(signal.type.struct_format, int(value) % (1 << signal.type.bits))
    return encode(signal, value, full)


class _RowPacker:
    """The payloads of one TPDO for many rows at once."""

    def __init__(self, number: int, full: FullScales) -> None:
        self._signals = od.TPDO_LAYOUT[number][1:]
        self._scales = [count_size(signal, full) for signal in self._signals]
        self._dtype = np.dtype([(s.name, s.type.struct_format) for s in od.TPDO_LAYOUT[number]])

    def payloads(self, rows: StreamRows) -> list[bytes]:
        packed = np.empty(len(rows.row_tick), dtype=self._dtype)
        packed["row_tick"] = rows.row_tick & 0xFFFF
        for signal, scale in zip(self._signals, self._scales, strict=True):
            column: NDArray[np.float64] = getattr(rows, signal.name)
            counts = np.round(column / scale)
            if signal.name == "theta_e":
                packed[signal.name] = counts.astype(np.int64) & 0xFFFF
            else:
                packed[signal.name] = np.clip(counts, -0x8000, 0x7FFF)
        data = packed.tobytes()
        size = self._dtype.itemsize
        return [data[k : k + size] for k in range(0, len(data), size)]


class _Listener(MessageListener):
    """Where the bus fails, holds the library's reader thread until the node is closed; `Network.check` tells of it."""

    def __init__(self, network: canopen.Network, closed: threading.Event) -> None:
        super().__init__(network)
        self._closed = closed

    def on_error(self, exc: Exception) -> None:
        del exc
        self._closed.wait()


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
    options: dict[str, Any] = dict(url.options)
    try:
        return can.Bus(interface=url.interface, channel=url.channel, **options)
    except Exception as error:  # noqa: BLE001 - each CAN interface has its own errors for a bus that is not there
        raise BusError(f"no CAN bus {url.bus}: {_first_line(error)}") from None


def _first_line(error: BaseException) -> str:
    return (str(error) or type(error).__name__).splitlines()[0]
