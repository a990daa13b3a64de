"""Modbus's view of the dictionary: the register map. Derived, never written a second time.

Standard: MODBUS Application Protocol Specification V1.1b3. Addresses count from 0 (tools that count from 1 add one).
Holding and input registers are the same registers: function codes 3 and 4 read them, 6 and 16 write what is "rw", 23
does both. A 16-bit value is one register. A 32-bit value, whole or float (IEEE 754), is two, **the high word first**.
One request writes one signal, whole. Stream signals are counts of their full scale, as everywhere.

    0x0000  head       who the drive is: layout_id first
    0x0100  request    what is wanted in the window: number, kind, first (32 bits)
    0x0200  window     the answer: number, kind, first, count, and what was wanted
    0x0300  control    a control record (`drivers.wire.lease`), written whole by function code 16, two bytes a register
    0x1000  signals    area + 16 (index & 0xFFF) + 2 subindex

So a signal keeps its address when others are added at the end of its record. The register after a 16-bit signal is
spare and reads 0.

The window is asked by function code 23, which writes the request and reads the answer in one transaction. The answer
begins with the request: an answer to another one, however late, is told by that. The same request may be repeated.

* REGISTERS, first: an address; what stands there, `count` registers.
* ROWS, first: a row's running number since the drive's reset. The answer's `first` is the first row that there still is
  from there on, followed by `count` rows of equal length that join: see `ROWS_HEAD`, then rows of `STREAM_ROW`.
* SAMPLES, first: a sample of the recording, then `count` of them: see `SAMPLES_HEAD`, then all channels of each.

Pure: numbers and bytes.
"""

import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from drivers.wire.canopen_od import DEVICE_NAME, PRODUCT_CODE, REVISION, VENDOR_ID
from drivers.wire.dictionary import SIGNALS, STREAM_ROW, Signal, WireType, signal_named

READ: Final = 3
READ_INPUT: Final = 4
WRITE_ONE: Final = 6
WRITE: Final = 16
READ_WRITE: Final = 23

ILLEGAL_FUNCTION: Final = 1
ILLEGAL_ADDRESS: Final = 2
ILLEGAL_VALUE: Final = 3
DEVICE_FAILURE: Final = 4
DEVICE_BUSY: Final = 6
EXCEPTIONS: Final = {
    ILLEGAL_FUNCTION: "illegal function", ILLEGAL_ADDRESS: "illegal data address", ILLEGAL_VALUE: "illegal data value",
    DEVICE_FAILURE: "device failure", 5: "acknowledge", DEVICE_BUSY: "device busy", 8: "memory parity error",
    10: "gateway path unavailable", 11: "gateway target failed to respond",
}

MOST_READ: Final = 125  # registers in one answer
MOST_WRITTEN: Final = 123  # by function code 16
MOST_WRITTEN_23: Final = 121  # by function code 23

_NAME_LENGTH: Final = 32  # characters, two in a register
HEAD: Final = 0x0000
HEAD_FORMAT: Final = f">IIIII{_NAME_LENGTH}s"  # layout_id, vendor, product, revision, serial, device name
HEAD_LENGTH: Final = struct.calcsize(HEAD_FORMAT) // 2

REQUEST: Final = 0x0100
REQUEST_FORMAT: Final = ">HHI"
REQUEST_LENGTH: Final = 4
WINDOW: Final = 0x0200
WINDOW_FORMAT: Final = ">HHIH"
WINDOW_LENGTH: Final = 5

CONTROL: Final = 0x0300

REGISTERS: Final = 1
ROWS: Final = 2
SAMPLES: Final = 3

ROWS_HEAD: Final = ">IIHhh"
"""Rows made since reset, tick of the first row here, control periods per row, winding's and magnets' temperature."""
SAMPLES_HEAD: Final = ">HH"
"""Number of the recording, channels in a sample."""

MOST_REGISTERS: Final = MOST_READ - WINDOW_LENGTH
ROW_LENGTH: Final = len(STREAM_ROW)
MOST_ROWS: Final = (MOST_REGISTERS - struct.calcsize(ROWS_HEAD) // 2) // ROW_LENGTH

_AREAS: Final = {0x2: 0x1000, 0x6: 0x8000, 0x1: 0x9000}  # by the index's first digit


@dataclass(frozen=True, slots=True)
class Head:
    """Who a drive is, as its first registers tell."""

    layout_id: int
    vendor_id: int
    product_code: int
    revision: int
    serial: int
    device_name: str

    def words(self) -> list[int]:
        """As registers."""
        name = self.device_name.encode("ascii")[:_NAME_LENGTH]
        return registers(struct.pack(
            HEAD_FORMAT, self.layout_id, self.vendor_id, self.product_code, self.revision, self.serial, name
        ))

    @classmethod
    def of(cls, words: Sequence[int]) -> "Head":
        """From registers."""
        layout_id, vendor_id, product_code, revision, serial, name = struct.unpack(HEAD_FORMAT, data_of(words))
        text = name.rstrip(b"\0").decode("ascii", "replace")
        return cls(layout_id, vendor_id, product_code, revision, serial, text)


def our_head(layout_id: int, serial: int) -> Head:
    """The head of a drive of ours."""
    return Head(layout_id, VENDOR_ID, PRODUCT_CODE, REVISION, serial, DEVICE_NAME)


def address_of(signal: Signal) -> int:
    """The signal's first register."""
    return _AREAS[signal.index >> 12] + 16 * (signal.index & 0xFFF) + 2 * signal.subindex


def length_of(signal: Signal) -> int:
    """Registers of a signal: 1 or 2."""
    return -(-signal.type.bits // 16)


_BY_ADDRESS: Final = {address_of(signal): signal for signal in SIGNALS}


def signal_at_register(address: int) -> Signal | None:
    """The signal whose first register this is, or None."""
    return _BY_ADDRESS.get(address)


def name_of(address: int, count: int = 1) -> str:
    """Registers in words, for messages: `register 0x1002 (T_s)`."""
    signals = [signal.name for at, signal in _BY_ADDRESS.items() if address <= at < address + max(1, count)]
    if len(signals) == 1:
        return f"register 0x{address:04X} ({signals[0]})"
    if signals:
        return f"registers 0x{address:04X} to 0x{address + count - 1:04X} ({signals[0]} to {signals[-1]})"
    known = {HEAD: "identity", REQUEST: "request", WINDOW: "window", CONTROL: "control record"}.get(address)
    return f"register 0x{address:04X}" + (f" ({known})" if known else "")


def registers(data: bytes) -> list[int]:
    """Big-endian bytes as registers."""
    return list(struct.unpack(f">{len(data) // 2}H", data))


def data_of(words: Sequence[int]) -> bytes:
    """Registers as big-endian bytes."""
    return struct.pack(f">{len(words)}H", *words)


def words_of(signal: Signal, data: bytes) -> list[int]:
    """The registers of a value, from its little-endian bytes."""
    return registers(data[::-1].rjust(2 * length_of(signal), b"\0"))


def bytes_of(signal: Signal, words: Sequence[int]) -> bytes:
    """Little-endian bytes of a value, from its registers."""
    return data_of(words)[::-1][: signal.type.bits // 8]


def blocks(signals: Iterable[Signal]) -> list[list[Signal]]:
    """The signals by blocks that one request can read: neighbours by address, of `MOST_REGISTERS` at most."""
    found: list[list[Signal]] = []
    for signal in sorted(signals, key=address_of):
        address = address_of(signal)
        last = found[-1] if found else []
        if last and address == address_of(last[-1]) + 2 and address + 2 - address_of(last[0]) <= MOST_REGISTERS:
            last.append(signal)
        else:
            found.append([signal])
    return found


@dataclass(frozen=True, slots=True)
class Window:
    """An answer in the window, taken apart as far as all kinds are alike."""

    number: int
    kind: int
    first: int
    count: int
    data: bytes  # big-endian

    @classmethod
    def of(cls, words: Sequence[int]) -> "Window":
        """From registers, `WINDOW_LENGTH` of them at least."""
        data = data_of(words)
        size = 2 * WINDOW_LENGTH
        return cls(*struct.unpack(WINDOW_FORMAT, data[:size]), data[size:])


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows of the stream that join, each of `periods` control periods."""

    first: int  # running number of the first
    made: int  # rows made since reset
    tick: int  # at which the first began, 32 bits
    periods: int
    temperatures: tuple[float, float]  # degC, of winding and magnets
    rows: NDArray[np.int16]  # (n, len(STREAM_ROW)), counts

    @classmethod
    def of(cls, window: Window) -> "Rows":
        """From the window's answer to ROWS. Raises ValueError when it tells of rows that cannot be."""
        size = struct.calcsize(ROWS_HEAD)
        made, tick, periods, winding, magnets = struct.unpack(ROWS_HEAD, window.data[:size])
        room = (len(window.data) - size) // (2 * ROW_LENGTH)
        if window.count > room or (window.count and not periods):
            raise ValueError(f"expected {room} rows at most, of 1 period or more, got {window.count} of {periods}")
        rows = np.frombuffer(window.data, ">i2", window.count * ROW_LENGTH, size).astype(np.int16)
        scale = signal_named("temp_winding").scale
        return cls(window.first, made, tick, periods, (winding * scale, magnets * scale),
                   rows.reshape(-1, ROW_LENGTH))


@dataclass(frozen=True, slots=True)
class Samples:
    """Samples of a recording."""

    number: int  # of the recording
    channels: int
    counts: bytes  # little-endian, 16 bits each, all channels of a sample after another

    @classmethod
    def of(cls, window: Window) -> "Samples":
        """From the window's answer to SAMPLES. Raises ValueError when it tells of samples that cannot be."""
        size = struct.calcsize(SAMPLES_HEAD)
        number, channels = struct.unpack(SAMPLES_HEAD, window.data[:size])
        room = (len(window.data) - size) // 2
        if window.count * channels > room:
            raise ValueError(f"expected {room} counts at most, got {window.count} x {channels}")
        return cls(number, channels, swapped(window.data[size : size + 2 * window.count * channels]))


def swapped(data: bytes) -> bytes:
    """16-bit values of the other byte order."""
    turned = bytearray(len(data))
    turned[0::2], turned[1::2] = data[1::2], data[0::2]
    return bytes(turned)


def table() -> list[dict[str, Any]]:
    """The map, line by line: address, registers, name, type, unit, what one count is, access, summary."""
    head = [
        (0, "layout_id", "U32"), (2, "vendor_id", "U32"), (4, "product_code", "U32"), (6, "revision", "U32"),
        (8, "serial", "U32"), (10, "device_name", f"ASCII[{_NAME_LENGTH}]"),
    ]
    own = [
        *(_line(HEAD + at, 2 if kind == "U32" else _NAME_LENGTH // 2, name, kind, "const", "who the drive is")
          for at, name, kind in head),
        _line(REQUEST, REQUEST_LENGTH, "request", "U16, U16, U32", "rw",
              "number, kind (1 registers, 2 rows, 3 samples), first; by function code 23"),
        _line(WINDOW, MOST_READ, "window", "block", "ro",
              "number, kind, first (U32), count (U16), and what was wanted"),
        _line(CONTROL, MOST_WRITTEN, "control", "block", "wo", "a control record: token, lease, bridge, set points"),
    ]
    return own + [
        _line(address, length_of(signal), signal.name, signal.type.name, signal.access, signal.summary, signal.unit,
              signal.scale if signal.type is not WireType.F32 else None, signal.full_scale)
        for address, signal in sorted(_BY_ADDRESS.items())
    ]


def _line(
    address: int, length: int, name: str, kind: str, access: str, summary: str, unit: str = "1",
    scale: float | None = None, full_scale: str | None = None,
) -> dict[str, Any]:
    return {"address": address, "registers": length, "name": name, "type": kind, "unit": unit, "scale": scale,
            "full_scale": full_scale, "access": access, "summary": summary}
