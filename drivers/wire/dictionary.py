"""Every signal of the drive, once: CANopen address, type, unit, scale, access, range.

The EDS and the PDO layouts are derived from this table. A *row* of the stream covers `stream_periods` control periods
and follows the recording convention: `theta_e i_d i_q` are sampled at its start (`row_tick`), `u_d u_q`
and the mean quantities are means over the row, each period taken in the rotor frame at that period's middle.

Currents, voltages and speed travel as 16-bit counts of a full scale that the drive tells (`i_full`, `u_full`,
`omega_full`), so that one layout serves motors from 50 W to 50 kW.
"""

import math
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Literal

Access = Literal["const", "ro", "rw"]


class WireType(Enum):
    """Type on the wire: struct format (little-endian), CiA 301 data type, size in bits."""

    U8 = ("<B", 0x05, 8)
    U16 = ("<H", 0x06, 16)
    U32 = ("<I", 0x07, 32)
    I16 = ("<h", 0x03, 16)
    I32 = ("<i", 0x04, 32)
    F32 = ("<f", 0x08, 32)

    @property
    def struct_format(self) -> str:
        return self.value[0]

    @property
    def canopen_type(self) -> int:
        return self.value[1]

    @property
    def bits(self) -> int:
        return self.value[2]


@dataclass(frozen=True, slots=True)
class Signal:
    """One row of the dictionary.

    `scale` is the SI value of one count; with `full_scale` it is a fraction of the named signal's value.
    `minimum` and `maximum` (SI) bound what may be written; None leaves that side to the type.
    """

    name: str
    index: int
    subindex: int
    type: WireType
    unit: str
    access: Access
    summary: str
    scale: float = 1.0
    full_scale: str | None = None
    minimum: float | None = None
    maximum: float | None = None

    def __str__(self) -> str:
        return f"0x{self.index:04X}:{self.subindex} ({self.name})"


_F = WireType.F32
_PER_FULL = 1.0 / 32768.0  # 16-bit signed counts a full scale


def _stream(subindex: int, name: str, unit: str, full_scale: str, summary: str) -> Signal:
    return Signal(name, 0x2100, subindex, WireType.I16, unit, "ro", summary, _PER_FULL, full_scale)


def _setting(
    index: int, subindex: int, name: str, unit: str, minimum: float | None, maximum: float | None, summary: str
) -> Signal:
    return Signal(name, index, subindex, _F, unit, "rw", summary, minimum=minimum, maximum=maximum)


SIGNALS: tuple[Signal, ...] = (
    # What the drive is
    Signal("layout_id", 0x2000, 1, WireType.U32, "1", "const", "checksum of this dictionary"),
    Signal("T_s", 0x2000, 2, WireType.U32, "s", "const", "control period", scale=1e-9),
    Signal("tick", 0x2000, 3, WireType.U32, "1", "ro", "control periods since reset"),
    Signal("stream_periods", 0x2000, 4, WireType.U16, "1", "rw", "control periods per stream row",
           minimum=5, maximum=1000),
    Signal("i_full", 0x2010, 1, _F, "A", "const", "full scale of currents (peak, dq)"),
    Signal("u_full", 0x2010, 2, _F, "V", "const", "full scale of voltages"),
    Signal("omega_full", 0x2010, 3, _F, "rad/s", "const", "full scale of electrical speed"),
    # What it streams
    Signal("row_tick", 0x2100, 1, WireType.U16, "1", "ro", "low 16 bits of the tick at the row's start"),
    Signal("theta_e", 0x2100, 2, WireType.U16, "rad", "ro", "electrical angle at the row's start",
           scale=2.0 * math.pi / 65536.0),
    _stream(3, "i_d", "A", "i_full", "d-axis current at the row's start"),
    _stream(4, "i_q", "A", "i_full", "q-axis current at the row's start"),
    _stream(5, "omega_e", "rad/s", "omega_full", "mean electrical speed"),
    _stream(6, "u_d", "V", "u_full", "mean d-axis voltage applied"),
    _stream(7, "u_q", "V", "u_full", "mean q-axis voltage applied"),
    _stream(8, "i_d_mean", "A", "i_full", "mean d-axis current"),
    _stream(9, "i_q_mean", "A", "i_full", "mean q-axis current"),
    _stream(10, "u_dc", "V", "u_full", "mean dc-link voltage"),
    Signal("temp_winding", 0x2100, 11, WireType.I16, "degC", "ro", "winding temperature", scale=0.01),
    Signal("temp_magnet", 0x2100, 12, WireType.I16, "degC", "ro", "magnet temperature", scale=0.01),
    # What its current control takes the machine for
    Signal("n_p", 0x2200, 1, WireType.U16, "1", "rw", "pole pairs", minimum=1, maximum=100),
    _setting(0x2200, 2, "control_R_s", "ohm", 1e-4, 1e3, "stator resistance, per phase"),
    _setting(0x2200, 3, "control_L_d", "H", 1e-6, 1.0, "d-axis inductance"),
    _setting(0x2200, 4, "control_L_q", "H", 1e-6, 1.0, "q-axis inductance"),
    _setting(0x2200, 5, "control_psi_f", "Vs", 0.0, 100.0, "magnet flux linkage, peak"),
    _setting(0x2200, 6, "bandwidth", "rad/s", 10.0, 1e4, "current-control bandwidth"),
    # What it is asked to do
    _setting(0x2300, 1, "i_d_ref", "A", None, None, "d-axis current reference"),
    _setting(0x2300, 2, "i_q_ref", "A", None, None, "q-axis current reference"),
    _setting(0x2300, 3, "i_d_step", "A", 0.0, None, "d-axis excitation: steps within +- this"),
    _setting(0x2300, 4, "i_q_step", "A", 0.0, None, "q-axis excitation: steps within +- this"),
    _setting(0x2300, 5, "step_time", "s", 1e-3, 10.0, "shortest time between excitation steps"),
)

_BY_NAME = {signal.name: signal for signal in SIGNALS}
_BY_ADDRESS = {(signal.index, signal.subindex): signal for signal in SIGNALS}


def signal_named(name: str) -> Signal:
    """The signal of this name. Raises KeyError with a sentence when the drive has none."""
    try:
        return _BY_NAME[name]
    except KeyError:
        raise KeyError(f"the drive has no signal {name!r}; it has {', '.join(sorted(_BY_NAME))}") from None


def signal_at(index: int, subindex: int) -> Signal | None:
    """The signal at this CANopen address, or None."""
    return _BY_ADDRESS.get((index, subindex))


def layout_id(signals: Iterable[Signal] = SIGNALS) -> int:
    """Checksum (CRC-32) over addresses, types and scales: two ends with the same value read the same bytes alike."""
    text = "\n".join(
        f"{s.name} {s.index:04X}:{s.subindex} {s.type.name} {s.unit} {s.scale!r} {s.full_scale}" for s in signals
    )
    return zlib.crc32(text.encode("ascii"))
