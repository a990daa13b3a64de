"""The node's object dictionary: what each object holds, and what may be written to it (CiA 301). Knows no bus.

Besides the signals: how the node communicates. That is stored and restored with the parameters (0x1010, 0x1011), and
comes back with every reset. What cannot be is refused with the standard's abort code.
"""

import copy
import struct
from collections.abc import Callable
from dataclasses import dataclass

from drivers.wire import canopen_od as od
from drivers.wire.canopen_od import Abort
from drivers.wire.cia402 import error_register
from drivers.wire.codec import FULL_SCALES, FullScales, decode, encode_held
from drivers.wire.dictionary import CAPTURE_DATA, CONTROL, Signal, signal_at
from emulator.drive.control_lease import Denial, DeniedError
from emulator.drive.virtual_drive import VirtualDrive
from emulator.servers.canopen.sdo_server import SdoAbortError
from emulator.servers.canopen.tpdo import Tpdo

_STORE, _RESTORE = (od.OD_STORE, 1), (od.OD_RESTORE, 1)


@dataclass(slots=True)
class Communication:
    """How the node communicates."""

    tpdos: list[Tpdo]
    heartbeat_ms: int = od.HEARTBEAT_MS
    bench: int = 0  # object 0x1016:1: node << 16 | ms; the heartbeats of that node tell that the bench is there

    @property
    def bench_node(self) -> int | None:
        """The node whose heartbeats feed the drive's watchdog; None for nobody's."""
        return (self.bench >> 16 & 0x7F or None) if self.bench & 0xFFFF else None


class NodeObjects:
    """All objects of one node over a virtual drive."""

    def __init__(self, drive: VirtualDrive, node_id: int) -> None:
        self.full: FullScales = {name: drive.read(name) for name in FULL_SCALES}
        self.errors: list[int] = []  # error codes, the latest first
        self._drive = drive
        self._id = node_id
        self._stored = self._delivered()
        self.communication = self._delivered()

    def reset(self) -> None:
        """Communicate as stored."""
        self.communication = copy.deepcopy(self._stored)

    def note_error(self, code: int) -> None:
        """Keep an error in the history."""
        self.errors = [code, *self.errors][: od.ERROR_HISTORY]

    def identity(self) -> list[bytes]:
        """Who the drive is."""
        return [b"\4", *map(_u32, (od.VENDOR_ID, od.PRODUCT_CODE, od.REVISION, self._drive.serial))]

    def get_data(self, index: int, subindex: int) -> bytes:
        """Bytes of an object. Raises SdoAbortError."""
        if (index, subindex) == CONTROL and self._drive.has_lease:
            raise SdoAbortError(Abort.WRITE_ONLY)
        data = self._held(index, subindex)
        if data is None:
            known = self._signal(index, 0) is not None or self._held(index, 0) is not None
            raise SdoAbortError(Abort.NO_SUBINDEX if known else Abort.NO_OBJECT)
        return data

    def set_data(self, index: int, subindex: int, data: bytes) -> None:
        """Write an object. Raises SdoAbortError."""
        signal = self._signal(index, subindex)
        if signal is not None:
            self._set_signal(signal, data)
            return
        if (index, subindex) == CONTROL and self._drive.has_lease:
            self._control(data)
            return
        settings, tpdo = self.communication, self._tpdo(index)
        if (index, subindex) == (od.OD_HEARTBEAT, 0):
            settings.heartbeat_ms = _number(data, 2)
        elif (index, subindex) == (od.OD_HEARTBEAT_CONSUMER, 1):
            settings.bench = _number(data, 4)
        elif (index, subindex) == (od.OD_ERROR_HISTORY, 0):
            self._clear_errors(_number(data, 1))
        else:
            self.get_data(index, subindex)  # aborts when there is no such object
            if tpdo is None:
                raise SdoAbortError(Abort.READ_ONLY)
            write = tpdo.set_parameter if index < od.OD_TPDO_MAPPING else tpdo.set_mapping
            write(subindex, data)

    def _delivered(self) -> Communication:
        return Communication([Tpdo.default(number, self._id) for number in range(len(od.TPDO_LAYOUT))])

    def _held(self, index: int, subindex: int) -> bytes | None:
        """Bytes of an object, or None where there is none."""
        signal = self._signal(index, subindex)
        if (index, subindex) in (_STORE, _RESTORE):
            return struct.pack("<I", od.STORES_ON_COMMAND)
        if signal is not None:
            return encode_held(signal, self._drive.read(signal.name), self.full)
        if (index, subindex) == CAPTURE_DATA:
            return self._drive.captured(int(self._drive.read("capture_offset")), od.UPLOAD_SAMPLES)
        fields = self._fields(index)
        return fields[subindex] if subindex < len(fields) else None

    def _fields(self, index: int) -> list[bytes]:
        """The sub-indices of an object; sub-index 0 alone where the others are signals."""
        tpdo = self._tpdo(index)
        if tpdo is not None:
            return tpdo.parameters if index < od.OD_TPDO_MAPPING else tpdo.mapping
        if index in _OBJECTS:
            return _OBJECTS[index](self)
        subindices = [k for k in range(1, 255) if self._signal(index, k) or (index, k) == CAPTURE_DATA]
        return [bytes(subindices[-1:])] if subindices else []

    def _signal(self, index: int, subindex: int) -> Signal | None:
        """The drive's signal at an address, or None."""
        signal = signal_at(index, subindex)
        return signal if signal and signal.name in self._drive.names else None

    def _tpdo(self, index: int) -> Tpdo | None:
        """The TPDO that an object is about."""
        number, kind = index & 0xFF, index & 0xFF00
        known = kind in (od.OD_TPDO, od.OD_TPDO_MAPPING) and number < len(self.communication.tpdos)
        return self.communication.tpdos[number] if known else None

    def _set_signal(self, signal: Signal, data: bytes) -> None:
        if signal.access != "rw":
            raise SdoAbortError(Abort.READ_ONLY)
        if 8 * len(data) != signal.type.bits:
            raise SdoAbortError(Abort.LENGTH)
        address = (signal.index, signal.subindex)
        try:
            value = decode(signal, data, self.full)
            if signal.name == "stream_periods" and value * self._drive.T_s * od.BUS_FRAMES < od.ROW_TPDOS:
                raise SdoAbortError(Abort.VALUE_RANGE)  # more frames than a bus of 1 Mbit/s carries
            self._drive.request(signal.name, value)
        except DeniedError as denied:
            raise SdoAbortError(_abort(denied)) from None
        except ValueError:
            wrong_word = address in (_STORE, _RESTORE)
            raise SdoAbortError(Abort.NOT_STORED if wrong_word else Abort.VALUE_RANGE) from None
        if address == _STORE:
            self._stored = copy.deepcopy(self.communication)
        elif address == _RESTORE:
            self._stored = self._delivered()

    def _control(self, data: bytes) -> None:
        try:
            self._drive.control(data)
        except DeniedError as denied:
            raise SdoAbortError(_abort(denied)) from None
        except ValueError:
            raise SdoAbortError(Abort.VALUE_RANGE) from None

    def _clear_errors(self, value: int) -> None:
        if value != 0:
            raise SdoAbortError(Abort.VALUE_RANGE)
        self.errors = []

    def error_register_now(self) -> bytes:
        """Object 0x1001."""
        return bytes([error_register(int(self._drive.read("error_code")))])

    def error_history(self) -> list[bytes]:
        """Object 0x1003; an error that has not been is no data."""
        return [bytes([len(self.errors)]), *map(_u32, self.errors), *[b""] * (od.ERROR_HISTORY - len(self.errors))]

    @property
    def emergency_cob_id(self) -> int:
        """Object 0x1014."""
        return od.emergency_cob_id(self._id)


def _abort(denied: DeniedError) -> Abort:
    return Abort.READ_ONLY if denied.denial is Denial.HOLDERS_ALONE else Abort.DEVICE_STATE


def _u32(value: int) -> bytes:
    return struct.pack("<I", value)


def _number(data: bytes, size: int) -> int:
    if len(data) != size:
        raise SdoAbortError(Abort.LENGTH)
    return int.from_bytes(data, "little")


_OBJECTS: dict[int, Callable[[NodeObjects], list[bytes]]] = {
    od.OD_DEVICE_TYPE: lambda _: [_u32(od.DEVICE_TYPE)],
    od.OD_ERROR_REGISTER: lambda node: [node.error_register_now()],
    od.OD_ERROR_HISTORY: lambda node: node.error_history(),
    od.OD_SYNC_COB_ID: lambda _: [_u32(od.SYNC_COB_ID)],
    od.OD_DEVICE_NAME: lambda _: [od.DEVICE_NAME.encode("ascii")],
    od.OD_EMERGENCY_COB_ID: lambda node: [_u32(node.emergency_cob_id)],
    od.OD_HEARTBEAT_CONSUMER: lambda node: [b"\1", _u32(node.communication.bench)],
    od.OD_HEARTBEAT: lambda node: [struct.pack("<H", node.communication.heartbeat_ms)],
    od.OD_IDENTITY: lambda node: node.identity(),
}
"""Objects that are no signals and no TPDOs: their sub-indices."""
