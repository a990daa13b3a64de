"""The TPDOs of the node: when each is sent, under which identifier, and what it carries, as CiA 301 has them set.

To change a mapping: TPDO not valid (0x18xx:1, bit 31), no entries (0x1Axx:0), the entries, their number, valid again.
What cannot be is refused with the standard's abort code. Knows nothing of buses.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from drivers.wire import canopen_od as od
from drivers.wire.canopen_od import Abort
from drivers.wire.codec import FullScales, encode_held, si_to_counts
from drivers.wire.dictionary import Signal, signal_at
from emulator.drive.virtual_drive import StreamRows
from emulator.servers.canopen.sdo_server import SdoAbortError

_EXTENDED: Final = 1 << 29  # bit of a COB-ID: a 29-bit identifier
_RESTRICTED: Final = (  # identifiers that no PDO may have (CiA 301, table 40)
    (0x000, 0x080), (0x101, 0x180), (0x581, 0x5FF), (0x601, 0x67F), (0x6E0, 0x6FF), (0x701, 0x7FF),
)
_MEASURED: Final = frozenset(  # with each row
    signal.name for layout in od.TPDO_LAYOUT[: od.ROW_TPDOS] for signal in layout if signal.name != "row_tick"
)


@dataclass(slots=True)
class Tpdo:
    """One TPDO; `configure` changes it in place."""

    cob_id: int  # with the bit `NOT_VALID`
    transmission: int
    entries: list[int]  # all eight, index << 16 | sub-index << 8 | bits
    count: int  # of the entries that it carries
    syncs: int = 0  # SYNCs since it was sent last

    @classmethod
    def default(cls, number: int, node_id: int) -> "Tpdo":
        """TPDO `number` (0 to 3) as delivered."""
        mapping = od.tpdo_mapping(number)
        entries = [*mapping, *[0] * (od.MAPPING_ENTRIES - len(mapping))]
        return cls(od.tpdo_cob_id(number, node_id), od.ON_EVENT, entries, len(mapping))

    @property
    def valid(self) -> bool:
        """It is sent."""
        return not self.cob_id & od.NOT_VALID and self.count > 0

    @property
    def on_event(self) -> bool:
        """It goes with rows of the stream, not with SYNCs."""
        return self.transmission >= od.ON_EVENT

    @property
    def signals(self) -> list[Signal]:
        """What it carries, in its order."""
        return [_mappable(entry) for entry in self.entries[: self.count]]

    def due(self) -> bool:
        """Count a SYNC; whether it is to be sent with this one."""
        self.syncs += 1
        if self.on_event or self.syncs < self.transmission:
            return False
        self.syncs = 0
        return self.valid

    @property
    def parameters(self) -> list[bytes]:
        """Object 0x18xx, by sub-indices."""
        return [b"\2", struct.pack("<I", self.cob_id), bytes([self.transmission])]

    @property
    def mapping(self) -> list[bytes]:
        """Object 0x1Axx, by sub-indices."""
        return [bytes([self.count]), *(struct.pack("<I", entry) for entry in self.entries)]

    def set_parameter(self, subindex: int, data: bytes) -> None:
        """Write object 0x18xx. Raises SdoAbortError."""
        value = _number(data, {1: 4, 2: 1}.get(subindex))
        if subindex == 1:
            self._set_cob_id(value)
        elif od.transmission_known(value):
            self.transmission, self.syncs = value, 0
        else:
            raise SdoAbortError(Abort.VALUE_RANGE)

    def set_mapping(self, subindex: int, data: bytes) -> None:
        """Write object 0x1Axx. Raises SdoAbortError."""
        value = _number(data, 1 if subindex == 0 else 4 if subindex <= od.MAPPING_ENTRIES else None)
        if not self.cob_id & od.NOT_VALID or (subindex and self.count):
            raise SdoAbortError(Abort.DEVICE_STATE)
        if subindex:
            _mappable(value)
            self.entries[subindex - 1] = value
            return
        if value > od.MAPPING_ENTRIES:
            raise SdoAbortError(Abort.VALUE_RANGE)
        if sum(_mappable(entry).type.bits for entry in self.entries[:value]) > 64:
            raise SdoAbortError(Abort.PDO_LENGTH)
        self.count = value

    def _set_cob_id(self, value: int) -> None:
        identifier = value & 0x7FF
        if value & _EXTENDED or value & 0x1FFF_F800 or any(low <= identifier <= high for low, high in _RESTRICTED):
            raise SdoAbortError(Abort.VALUE_RANGE)
        staying_valid = not (self.cob_id | value) & od.NOT_VALID
        if staying_valid and value & 0x7FF != self.cob_id & 0x7FF:
            raise SdoAbortError(Abort.DEVICE_STATE)
        self.cob_id, self.syncs = value, 0


def payloads(tpdo: Tpdo, rows: StreamRows, full: FullScales, read: Callable[[str], float]) -> list[bytes]:
    """What a TPDO carries with each row; what is no column of the rows is as the drive reads it now."""
    signals = tpdo.signals
    packed = np.empty(len(rows), [(f"{k}", s.type.struct_format) for k, s in enumerate(signals)])
    measured = [signal.name for signal in signals if signal.name in _MEASURED]
    counts = iter(si_to_counts([getattr(rows, name) for name in measured], measured, full).T if measured else ())
    for k, signal in enumerate(signals):
        column = next(counts) if signal.name in _MEASURED else _column(signal, rows, full, read)
        packed[f"{k}"] = column.view(packed.dtype[k])
    data, size = packed.tobytes(), packed.dtype.itemsize
    return [data[k : k + size] for k in range(0, len(data), size)]


def payload(tpdo: Tpdo, values: dict[str, float], full: FullScales) -> bytes:
    """What a TPDO carries at one moment."""
    return b"".join(encode_held(signal, values[signal.name], full) for signal in tpdo.signals)


def _column(
    signal: Signal, rows: StreamRows, full: FullScales, read: Callable[[str], float]
) -> "NDArray[np.uint16 | np.int16 | np.uint32]":
    if signal.name == "row_tick":
        return (rows.row_tick & 0xFFFF).astype("<u2")
    one = np.frombuffer(encode_held(signal, read(signal.name), full), signal.type.struct_format)
    return np.repeat(one, len(rows))


def _mappable(entry: int) -> Signal:
    """The signal of a mapping entry. Raises SdoAbortError."""
    signal = signal_at(entry >> 16, entry >> 8 & 0xFF)
    if signal is None or not od.mappable(signal) or signal.type.bits != entry & 0xFF:
        raise SdoAbortError(Abort.NOT_MAPPABLE)
    return signal


def _number(data: bytes, size: int | None) -> int:
    """The number that is written, of so many bytes; None where nothing can be written."""
    if size is None:
        raise SdoAbortError(Abort.READ_ONLY)
    if len(data) != size:
        raise SdoAbortError(Abort.LENGTH)
    return int.from_bytes(data, "little")
