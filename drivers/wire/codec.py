"""Bytes of one signal to SI and back; pure, knows nothing of buses."""

import math
import struct
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from drivers.wire.dictionary import CHANNELS, NOT_KNOWN, Signal, WireType, signal_named

FULL_SCALES: Final = ("i_full", "u_full", "omega_full")
"""What the drive tells of the size of its counts."""

FullScales = Mapping[str, float]
"""Values of `FULL_SCALES` as read from the drive."""

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
    """SI value of the bytes, NaN where the drive does not know it.

    Raises ValueError when their number is wrong or the value is no number.
    """
    if len(data) * 8 != signal.type.bits:
        raise ValueError(f"{signal} has {signal.type.bits // 8} bytes, got {len(data)}")
    (raw,) = struct.unpack(signal.type.struct_format, data)
    if signal.full_scale and raw == NOT_KNOWN:
        return math.nan
    value = (_shortest(raw) if signal.type is WireType.F32 else raw) * count_size(signal, full)
    if not math.isfinite(value):
        raise ValueError(f"{signal} is {value}, expected a finite number")
    return value


def encode(signal: Signal, value: float, full: FullScales) -> bytes:
    """Bytes of an SI value; measured quantities clip at the type's ends, as a converter does.

    Raises ValueError when a value to be written is outside the signal's or the type's range.
    """
    if signal.full_scale and math.isnan(value):
        return struct.pack(signal.type.struct_format, NOT_KNOWN)
    if not math.isfinite(value):
        raise ValueError(f"{signal} takes a finite number, got {value}")
    if signal.access == "rw":
        check_range(signal, value)
    if signal.type is WireType.F32:
        return _float32(signal, value)
    low, high = _INTEGER_RANGE[signal.type]
    if signal.full_scale:
        low = NOT_KNOWN + 1
    counts = value / count_size(signal, full)
    if signal.access == "rw" and not low - 0.5 <= counts <= high + 0.5:
        raise ValueError(f"{signal} takes {low} to {high}, got {counts:g}")
    return struct.pack(signal.type.struct_format, round(min(max(counts, low), high)))


def encode_held(signal: Signal, value: float, full: FullScales) -> bytes:
    """Bytes of a value that the drive itself holds: never refused, wrapped where a counter has run over."""
    if signal.type is WireType.F32:
        return struct.pack(signal.type.struct_format, value)
    if signal.scale == 1.0 and signal.full_scale is None and signal.type in (WireType.U16, WireType.U32):
        return struct.pack(signal.type.struct_format, int(value) % (1 << signal.type.bits))
    return encode(signal, value, full)


def counts_to_si(counts: NDArray[np.integer[Any]], names: Sequence[str], full: FullScales) -> NDArray[np.float64]:
    """Counts (n, len(names)) of stream signals or channels to SI, one row a name: shape (len(names), n)."""
    sizes, angles, low, _ = _columns(tuple(names), tuple(full.items()))
    values = counts.T.astype(np.float64, order="C")
    not_known = values < low
    for k in angles:
        values[k] %= 65536.0
    values *= sizes
    if not_known.any():
        values[not_known] = np.nan
    return values


def si_to_counts(columns: Sequence[NDArray[np.float64]], names: Sequence[str], full: FullScales) -> NDArray[np.int16]:
    """Columns in SI to counts (n, len(names)), as a drive sends them; an angle's unsigned count as its 16 bits."""
    sizes, _, low, high = _columns(tuple(names), tuple(full.items()))
    whole = np.clip(np.rint(np.array(columns) / sizes), low, high)
    whole[np.isnan(whole)] = NOT_KNOWN
    return np.ascontiguousarray(whole.T.astype(np.int64).astype(np.uint16).view(np.int16))


@lru_cache(maxsize=64)
def _columns(
    names: tuple[str, ...], full: tuple[tuple[str, float], ...]
) -> tuple[NDArray[np.float64], tuple[int, ...], NDArray[np.float64], NDArray[np.float64]]:
    """Of each name (len(names), 1): SI value of a count, least and largest count; and which are unsigned angles."""
    signals, scales = [channel_signal(name) for name in names], dict(full)
    sizes = np.array([[count_size(signal, scales)] for signal in signals])
    angles = tuple(k for k, signal in enumerate(signals) if not signal.full_scale)
    low, high = np.full(sizes.shape, NOT_KNOWN + 1.0), np.full(sizes.shape, float(0x7FFF))
    low[list(angles)], high[list(angles)] = -np.inf, np.inf
    return sizes, angles, low, high


def channel_signal(name: str) -> Signal:
    """The stream signal that a channel of the recorder is scaled like."""
    return signal_named("i_d" if name in ("i_a", "i_b", "i_c") else name)


def channel_number(name: str) -> int:
    """Number of a channel of the recorder. Raises ValueError, in a sentence."""
    if name not in CHANNELS[1:]:
        raise ValueError(f"expected a channel out of {', '.join(CHANNELS[1:])}, got {name!r}")
    return CHANNELS.index(name)


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
    if not math.isfinite(value):
        raise ValueError(f"{signal} takes a finite number, got {value}")
    low, high = signal.minimum, signal.maximum
    if low is not None and value < low:
        raise ValueError(f"{signal} takes at least {_told(signal, low)}, got {_number(signal, value)}")
    if high is not None and value > high:
        raise ValueError(f"{signal} takes at most {_told(signal, high)}, got {_number(signal, value)}")
    if signal.type is WireType.F32:
        _float32(signal, value)


def _float32(signal: Signal, value: float) -> bytes:
    """Its bytes. Raises ValueError where it is larger than they can be."""
    try:
        return struct.pack("<f", value)
    except OverflowError:
        raise ValueError(f"{signal} takes a 32-bit float, up to 3.4028e+38 in size, got {value}") from None


def _told(signal: Signal, value: float) -> str:
    """A value with its unit, where it has one."""
    return _number(signal, value) + ("" if signal.unit == "1" else f" {signal.unit}")


def _number(signal: Signal, value: float) -> str:
    """A whole number as one where the signal takes no others."""
    whole = signal.type is not WireType.F32 and math.isfinite(value) and value == int(value)
    return f"{int(value) if whole else value}"
