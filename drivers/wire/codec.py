"""Bytes of one signal to SI and back; pure, knows nothing of buses."""

import math
import struct
from collections.abc import Mapping

from drivers.wire.dictionary import Signal, WireType

FullScales = Mapping[str, float]
"""Values of `i_full`, `u_full`, `omega_full` as read from the drive."""

_INTEGER_RANGE: dict[WireType, tuple[int, int]] = {
    WireType.U8: (0, 0xFF),
    WireType.U16: (0, 0xFFFF),
    WireType.U32: (0, 0xFFFF_FFFF),
    WireType.I16: (-0x8000, 0x7FFF),
    WireType.I32: (-0x8000_0000, 0x7FFF_FFFF),
}


def count_size(signal: Signal, full: FullScales) -> float:
    """SI value of one count."""
    return signal.scale * (full[signal.full_scale] if signal.full_scale else 1.0)


def decode(signal: Signal, data: bytes, full: FullScales) -> float:
    """SI value of the bytes. Raises ValueError when their number is wrong or the value is no number."""
    if len(data) * 8 != signal.type.bits:
        raise ValueError(f"{signal} has {signal.type.bits // 8} bytes, got {len(data)}")
    (raw,) = struct.unpack(signal.type.struct_format, data)
    value = (_shortest(raw) if signal.type is WireType.F32 else raw) * count_size(signal, full)
    if not math.isfinite(value):
        raise ValueError(f"{signal} is {value}, expected a finite number")
    return value


def encode(signal: Signal, value: float, full: FullScales) -> bytes:
    """Bytes of an SI value; measured quantities clip at the type's ends, as a converter does.

    Raises ValueError when a value to be written is outside the signal's or the type's range.
    """
    if not math.isfinite(value):
        raise ValueError(f"{signal} takes a finite number, got {value}")
    if signal.access == "rw":
        check_range(signal, value)
    if signal.type is WireType.F32:
        try:
            return struct.pack("<f", value)
        except OverflowError:
            raise ValueError(f"{signal} takes a 32-bit float, got {value}") from None
    low, high = _INTEGER_RANGE[signal.type]
    counts = value / count_size(signal, full)
    if signal.access == "rw" and not low - 0.5 <= counts <= high + 0.5:
        raise ValueError(f"{signal} takes {low} to {high}, got {counts:g}")
    return struct.pack(signal.type.struct_format, round(min(max(counts, low), high)))


def _shortest(value: float) -> float:
    """The shortest decimal that is the same 32-bit float: 0.9664 comes back as 0.9664."""
    if not math.isfinite(value):
        return value
    for digits in (6, 7, 8):
        short = float(f"{value:.{digits}g}")
        if struct.pack("<f", short) == struct.pack("<f", value):
            return short
    return value


def check_range(signal: Signal, value: float) -> None:
    """Raise ValueError, in a sentence, when the value may not be written to the signal."""
    low, high = signal.minimum, signal.maximum
    if low is not None and value < low:
        raise ValueError(f"{signal} takes at least {low} {signal.unit}, got {value}")
    if high is not None and value > high:
        raise ValueError(f"{signal} takes at most {high} {signal.unit}, got {value}")
