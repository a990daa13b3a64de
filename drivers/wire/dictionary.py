"""Every signal of the drive, once: CANopen address, type, unit, scale, access, range.

The EDS, the PDO layouts, the Modbus registers and the UART's numbers are derived from this table. What is new goes to
its end: a drive of an earlier layout has the same signals as far as it goes, see `signals_of`. A *row* of the
stream covers `stream_periods` control periods and follows the recording convention: `theta_e i_d i_q` are sampled at
its start (`row_tick`), `u_d u_q` and the mean quantities are means over the row, each period taken in the rotor frame
at that period's middle.

Currents, voltages and speed travel as 16-bit counts of a full scale that the drive tells (`i_full`, `u_full`,
`omega_full`), so that one layout serves motors from 50 W to 50 kW. The count -32768 says that a quantity is not known:
the voltage of a bridge that is off.
"""

import math
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Literal

from drivers.wire.memory import MemoryState

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
    `minimum` and `maximum` (SI) bound what may be written; None leaves that side to the type. A `command` is written to
    make something happen, and is no parameter.
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
    command: bool = False

    @property
    def is_parameter(self) -> bool:
        """A value that the drive keeps and that its user sets."""
        return self.access == "rw" and not self.command

    @property
    def is_set_point(self) -> bool:
        """What the motor is to do: zero unless somebody holds the control lease (`drivers.wire.lease`)."""
        return self.name in AT_REST

    @property
    def is_guarded(self) -> bool:
        """Only the holder of the control lease writes it while there is one."""
        return self.access == "rw" and self.index in _GUARDED

    @property
    def table(self) -> str:
        """The table that it is an entry of, the sub-index tells which; empty for all others."""
        return _TABLE_AT.get(self.index, "")

    def __str__(self) -> str:
        return f"0x{self.index:04X}:{self.subindex} ({self.name})"


_F = WireType.F32
_PER_FULL = 1.0 / 32768.0  # 16-bit signed counts a full scale
NOT_KNOWN = -0x8000  # count of a quantity in full scales that the drive does not know


def _stream(subindex: int, name: str, unit: str, full_scale: str, summary: str) -> Signal:
    return Signal(name, 0x2100, subindex, WireType.I16, unit, "ro", summary, _PER_FULL, full_scale)


def _setting(
    index: int, subindex: int, name: str, unit: str, minimum: float | None, maximum: float | None, summary: str
) -> Signal:
    return Signal(name, index, subindex, _F, unit, "rw", summary, minimum=minimum, maximum=maximum)


STORE_WORD = int.from_bytes(b"save", "little")  # CiA 301, object 0x1010
RESTORE_WORD = int.from_bytes(b"load", "little")  # CiA 301, object 0x1011
RESET_WORD = int.from_bytes(b"rset", "little")


def _command(
    index: int, subindex: int, name: str, type_: WireType, minimum: float, maximum: float, summary: str
) -> Signal:
    return Signal(name, index, subindex, type_, "1", "rw", summary, minimum=minimum, maximum=maximum, command=True)


def _whole(index: int, subindex: int, name: str, minimum: int, maximum: int, summary: str) -> Signal:
    """A setting that is a whole number."""
    type_ = WireType.I16 if minimum < 0 else WireType.U16 if maximum <= 0xFFFF else WireType.U32
    return Signal(name, index, subindex, type_, "1", "rw", summary, minimum=minimum, maximum=maximum)


def _recorder(subindex: int, name: str, minimum: int, maximum: int, summary: str) -> Signal:
    return _whole(0x2400, subindex, name, minimum, maximum, summary)


def _limit(subindex: int, name: str, unit: str, summary: str) -> Signal:
    """What is fixed in the drive and switches its bridge off."""
    return Signal(name, 0x2310, subindex, _F, unit, "const", summary)


CHANNELS = ("none", "theta_e", "i_d", "i_q", "omega_e", "u_d", "u_q", "u_dc", "i_a", "i_b", "i_c")
"""What the recorder can record, by number; scaled like the stream, phase currents like i_d."""

CAPTURE_CHANNELS = 8  # at most
CAPTURE_SAMPLES = 65536  # at most, of all channels

STREAM_ROW = ("theta_e", "i_d", "i_q", "omega_e", "u_d", "u_q", "u_dc", "i_d_mean", "i_q_mean")
"""A row of the stream after its tick, where it travels in one piece."""

SET_POINTS = ("i_d_ref", "i_q_ref", "i_d_step", "i_q_step", "speed_ref", "speed_step")
"""What the motor is asked for."""
FORCED = ("angle_source", "forced_angle")
"""The angle that its control takes in place of the encoder's, for a motor whose encoder is not known yet."""
AT_REST = (*SET_POINTS, *FORCED)
"""What is zero while nobody controls the drive, and after its bridge went off, whatever switched it off."""

TABLE_SIZE = 64  # entries of each table
TABLE_SIDE = 8  # of a table over two quantities: 8 x 8, row by row
TABLES = {
    "psi_d_table": (0x2600, "Vs", "d-axis flux linkage: i_d by rows, from table_i_d_min; i_q by columns, from 0"),
    "psi_q_table": (0x2610, "Vs", "q-axis flux linkage on the same grid; odd in i_q"),
    "angle_table": (0x2620, "rad", "what the encoder reads too much, mechanical, over a turn that it reads"),
    "inverter_table": (0x2630, "V", "voltage that a leg loses, from phase current 0 to inverter_table_current; odd"),
}
"""Tables that a drive keeps: object, unit, meaning. An entry each is a signal, sub-index 1 to `TABLE_SIZE`."""
_TABLE_AT = {index: name for name, (index, _, _) in TABLES.items()}

_GUARDED = frozenset({
    0x2200, 0x2210, 0x2220, 0x2230, 0x2240, 0x2250, 0x2300, 0x2310, 0x2510, 0x6040, 0x1010, 0x1011,
    *(index for index, _, _ in TABLES.values()),
})
"""Objects that act on the motor; the stream's and the recorder's do not."""

LEASE_TIMES = (0.05, 10.0)  # s, shortest and longest that a control lease may last without being renewed

SIGNALS: tuple[Signal, ...] = (
    # What the drive is
    Signal("layout_id", 0x2000, 1, WireType.U32, "1", "const", "checksum of this dictionary"),
    Signal("T_s", 0x2000, 2, WireType.U32, "s", "const", "control period", scale=1e-9),
    Signal("tick", 0x2000, 3, WireType.U32, "1", "ro", "control periods since reset"),
    Signal("stream_periods", 0x2000, 4, WireType.U16, "1", "rw", "control periods per stream row",
           minimum=1, maximum=1000),
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
    _whole(0x2200, 7, "field_weakening", 0, 1, "1: i_d goes negative where the voltage is short"),
    _setting(0x2200, 8, "i_d_weakening", "A", 0.0, None, "most current that field weakening takes"),
    _setting(0x2200, 9, "weakening_voltage", "1", 0.5, 1.0, "share of the inverter's voltage that it stays below"),
    # What it is asked to do
    _setting(0x2300, 1, "i_d_ref", "A", None, None, "d-axis current reference"),
    _setting(0x2300, 2, "i_q_ref", "A", None, None, "q-axis current reference"),
    _setting(0x2300, 3, "i_d_step", "A", 0.0, None, "d-axis excitation: steps within +- this"),
    _setting(0x2300, 4, "i_q_step", "A", 0.0, None, "q-axis excitation: steps within +- this"),
    _setting(0x2300, 5, "step_time", "s", 1e-3, 10.0, "shortest time between excitation steps"),
    _setting(0x2300, 6, "watchdog_time", "s", 0.0, LEASE_TIMES[1],
             "longest that a control lease lasts unless renewed; without leases: silence after which it goes off"),
    _whole(0x2300, 7, "speed_control", 0, 2, "0: i_q as commanded, 1: by speed_ref, 2: by the drive's own profile"),
    _setting(0x2300, 8, "speed_ref", "rad/s", None, None, "speed reference, electrical"),
    _setting(0x2300, 9, "speed_ramp", "rad/s2", 0.0, None, "rate at which it is approached; 0: at once"),
    _setting(0x2300, 10, "speed_step", "rad/s", 0.0, None, "excitation by speed ramps: between +- this around it"),
    _setting(0x2300, 11, "speed_hold", "s", 0.0, 100.0, "time at either end of these ramps"),
    _whole(0x2300, 12, "excitation_kind", 0, 4, "0: none, 1: random levels, 2: PRBS, 3: multisine, 4: i_d staircase"),
    _setting(0x2300, 13, "sine_frequency", "Hz", 0.1, 1e3, "base of the multisine: d odd, q even harmonics"),
    _whole(0x2300, 14, "sine_count", 1, 16, "sines an axis of the multisine"),
    _whole(0x2300, 15, "i_d_levels", 2, 101, "levels of the staircase, from -i_d_step to i_d_step"),
    _setting(0x2300, 16, "level_time", "s", 1e-3, 100.0, "time on each of these levels"),
    Signal("speed_demand", 0x2300, 17, _F, "rad/s", "ro", "where the speed reference is, electrical"),
    # What switches its bridge off
    _setting(0x2310, 1, "speed_error_trip", "rad/s", 0.0, None, "electrical speed off its reference; 0: never"),
    _setting(0x2310, 2, "speed_error_time", "s", 0.0, 10.0, "when it lasts for longer than this"),
    _limit(3, "overcurrent_trip", "A", "current vector beyond this"),
    _limit(4, "overvoltage_trip", "V", "dc link above this; 0: never"),
    _limit(5, "undervoltage_trip", "V", "dc link below this"),
    _limit(6, "temperature_trip", "degC", "winding above this"),
    # Its state (CiA 402), and its memory (CiA 301)
    _command(0x6040, 0, "control_word", WireType.U16, 0, 0xFFFF, "commands to the state machine"),
    Signal("status_word", 0x6041, 0, WireType.U16, "1", "ro", "state of its state machine"),
    Signal("error_code", 0x603F, 0, WireType.U16, "1", "ro", "what put it into fault; 0: nothing"),
    _command(0x1010, 1, "store", WireType.U32, STORE_WORD, STORE_WORD, "keep all parameters over a power cycle"),
    _command(0x1011, 1, "restore", WireType.U32, RESTORE_WORD, RESTORE_WORD, "parameters as delivered, after a reset"),
    # Its recorder
    *(_recorder(k, f"capture_channel_{k}", 0, len(CHANNELS) - 1, f"channel {k}: what it records; 0: nothing")
      for k in range(1, CAPTURE_CHANNELS + 1)),
    _recorder(9, "capture_decimation", 1, 1000, "control periods per sample"),
    _recorder(10, "capture_length", 1, CAPTURE_SAMPLES, "samples to record"),
    _recorder(11, "capture_pre", 0, CAPTURE_SAMPLES - 1, "of these, samples before the trigger"),
    _recorder(12, "trigger_channel", 0, len(CHANNELS) - 1, "what triggers; 0: a command"),
    _setting(0x2400, 13, "trigger_level", "1", None, None, "SI value that it must cross"),
    _recorder(14, "trigger_edge", -1, 1, "1: upwards, -1: downwards, 0: either way"),
    _command(0x2400, 15, "capture_command", WireType.U16, 0, 2, "0: stop, 1: arm, 2: trigger now"),
    Signal("capture_state", 0x2400, 16, WireType.U16, "1", "ro", "0: idle, 1: armed, 2: triggered, 3: done"),
    Signal("capture_count", 0x2400, 17, WireType.U32, "1", "ro", "samples recorded"),
    Signal("capture_tick", 0x2400, 18, WireType.U32, "1", "ro", "tick of the first sample"),
    Signal("capture_number", 0x2400, 19, WireType.U16, "1", "ro", "of this recording; each arming makes another"),
    _command(0x2400, 20, "capture_offset", WireType.U32, 0, CAPTURE_SAMPLES, "first sample of the next upload"),
    # What layout 0x576E360A does not have: who controls it, and what else switches its bridge off
    _setting(0x2310, 7, "overspeed_trip", "rad/s", 1.0, None, "electrical speed beyond this"),
    Signal("safe_torque_off", 0x2320, 1, WireType.U16, "1", "ro", "0: no such input, 1: torque allowed, 2: torque off"),
    *(Signal(f"lease_holder_{k}", 0x2500, k, WireType.U32, "1", "ro",
             f"who controls it, ASCII, characters {4 * k - 3} to {4 * k}; 0: nobody") for k in range(1, 5)),
    Signal("lease_left", 0x2500, 5, _F, "s", "ro", "until the control lease ends; 0: there is none, -1: local control"),
    Signal("lease_end", 0x2500, 6, WireType.U16, "1", "ro",
           "how the latest ended; 0: none has, 1: given up, 2: not renewed, 3: stopped by another client"),
    # What layout 0x8B680B3C does not have: its control loops, what they make up for, and what its memory is like
    _whole(0x2210, 1, "own_gains", 0, 1, "current control: 0: gains of the bandwidth, 1: those below"),
    _setting(0x2210, 2, "k_p_d", "V/A", 0.0, 1e4, "proportional gain, d axis"),
    _setting(0x2210, 3, "k_i_d", "V/(A s)", 0.0, 1e7, "integral gain, d axis"),
    _setting(0x2210, 4, "k_p_q", "V/A", 0.0, 1e4, "proportional gain, q axis"),
    _setting(0x2210, 5, "k_i_q", "V/(A s)", 0.0, 1e7, "integral gain, q axis"),
    _whole(0x2210, 6, "decoupling", 0, 1, "1: cross-coupling and back-EMF are fed forward"),
    _setting(0x2220, 1, "k_p_speed", "A s/rad", 0.0, 1e3, "proportional gain of the speed control, electrical speed"),
    _setting(0x2220, 2, "k_i_speed", "A/rad", 0.0, 1e5, "integral gain of the speed control"),
    _setting(0x2220, 3, "speed_filter", "s", 0.0, 1.0, "time constant of the speed that it controls by"),
    _setting(0x2220, 4, "current_limit", "A", 0.0, None, "longest current reference; the drive's own limit bounds it"),
    *(_setting(0x2230, k, f"i_{phase}_gain", "1", 0.5, 2.0, f"phase {phase}: ratio of the current to its reading")
      for k, phase in enumerate("abc", start=1)),
    *(_setting(0x2230, k, f"i_{phase}_offset", "A", None, None, f"phase {phase}: taken off its reading before that")
      for k, phase in enumerate("abc", start=4)),
    _setting(0x2230, 7, "u_dc_gain", "1", 0.5, 2.0, "ratio of the dc link's voltage to its reading"),
    _setting(0x2230, 8, "angle_offset", "rad", -3.2, 3.2, "electrical: added to the angle that is read"),
    _setting(0x2230, 9, "angle_latency", "s", -1e-3, 1e-3, "age of the angle that is read"),
    _whole(0x2230, 10, "angle_reversed", 0, 1, "1: the encoder counts against the phases' order"),
    _whole(0x2230, 11, "phases_swapped", 0, 1, "1: phases b and c are connected the other way round"),
    _whole(0x2230, 12, "angle_correction", 0, 1, "1: angle_table is taken off the angle that is read"),
    _whole(0x2240, 1, "inverter_correction", 0, 2, "of lost voltage; 0: none, 1: dead time and drop, 2: a table"),
    _setting(0x2240, 2, "dead_time", "s", 0.0, 2e-5, "for which both transistors of a leg are off"),
    _setting(0x2240, 3, "inverter_width", "A", 0.0, None, "phase current from which a leg loses all of that"),
    _setting(0x2240, 4, "inverter_drop", "V", 0.0, 10.0, "voltage across a leg's device"),
    _setting(0x2240, 5, "inverter_table_current", "A", 0.0, None, "phase current of the last entry of inverter_table"),
    _whole(0x2250, 1, "saturation_correction", 0, 1, "1: flux linkages of the tables, not of control_L_d and so on"),
    _setting(0x2250, 2, "table_i_d_min", "A", None, 0.0, "i_d of the tables' first row"),
    _setting(0x2250, 3, "table_i_d_max", "A", 0.0, None, "i_d of their last row"),
    _setting(0x2250, 4, "table_i_q_max", "A", 0.0, None, "i_q of their last column"),
    _whole(0x2300, 18, "angle_source", 0, 1, "0: the encoder's, 1: forced_angle, wherever the rotor is"),
    _setting(0x2300, 19, "forced_angle", "rad", None, None, "electrical angle that its control takes then"),
    _setting(0x2300, 20, "forced_speed", "rad/s", 0.01, 100.0, "rate at which it is approached"),
    Signal("encoder_angle", 0x2260, 1, WireType.U32, "rad", "ro", "what the encoder reads, mechanical, as it comes",
           scale=2.0 * math.pi / 2.0**32),
    Signal("memory_state", 0x2510, 1, WireType.U16, "1", "ro",
           f"parameters after the latest reset: {'; '.join(f'{state.value}: {state.words}' for state in MemoryState)}"),
    Signal("memory_count", 0x2510, 2, WireType.U32, "1", "ro", "so often have parameters been stored"),
    Signal("memory_checksum", 0x2510, 3, WireType.U32, "1", "ro", "CRC-32 of what is stored; 0: nothing"),
    _command(0x2510, 4, "reset", WireType.U32, RESET_WORD, RESET_WORD, "start anew, with the bridge off"),
    *(_setting(index, k, f"{name}_{k}", unit, None, None, meaning)
      for name, (index, unit, meaning) in TABLES.items() for k in range(1, TABLE_SIZE + 1)),
)

CAPTURE_DATA = (0x2410, 1)
"""Address of the recording: samples from `capture_offset` on, each all chosen channels as 16-bit counts."""

CONTROL = (0x2501, 0)
"""Address of the control record: set points, start and renewal of the lease in one piece, see `drivers.wire.lease`."""

_BY_NAME = {signal.name: signal for signal in SIGNALS}
_BY_ADDRESS = {(signal.index, signal.subindex): signal for signal in SIGNALS}


def signal_named(name: str) -> Signal:
    """The signal of this name. Raises KeyError with a sentence when the drive has none."""
    try:
        return _BY_NAME[name]
    except KeyError:
        entries = (f"{table}_1 to _{TABLE_SIZE}" for table in TABLES)
        there = sorted((*(signal.name for signal in SIGNALS if not signal.table), *entries))
        raise KeyError(f"the drive has no signal {name!r}; it has {', '.join(there)}") from None


def signal_at(index: int, subindex: int) -> Signal | None:
    """The signal at this CANopen address, or None."""
    return _BY_ADDRESS.get((index, subindex))


def layout_id(signals: Iterable[Signal] = SIGNALS) -> int:
    """Checksum (CRC-32) over addresses, types, scales and orders: two ends of one value read the same bytes alike."""
    text = "\n".join((
        *(f"{s.name} {s.index:04X}:{s.subindex} {s.type.name} {s.unit} {s.scale!r} {s.full_scale}" for s in signals),
        *CHANNELS, *STREAM_ROW,
    ))
    return zlib.crc32(text.encode("ascii"))


_WATCHDOG_SIGNALS, _LEASE_SIGNALS = 76, 84  # of the layouts before the control lease, and before control loops
WATCHDOG_LAYOUT = layout_id(SIGNALS[:_WATCHDOG_SIGNALS])
"""A drive without a control lease: anybody's request feeds its watchdog, and anybody may start it."""
LEASE_LAYOUT = layout_id(SIGNALS[:_LEASE_SIGNALS])
"""A drive with a control lease whose control loops and corrections are fixed, and which tells nothing of its memory."""


_LAYOUTS = {
    layout_id(): SIGNALS, LEASE_LAYOUT: SIGNALS[:_LEASE_SIGNALS], WATCHDOG_LAYOUT: SIGNALS[:_WATCHDOG_SIGNALS],
}


def signals_of(layout: int) -> tuple[Signal, ...]:
    """What a drive of this layout has; nothing where the layout is not known."""
    return _LAYOUTS.get(layout, ())


def layout_text() -> str:
    """The layouts that are known, in words."""
    *others, last = (f"0x{layout:08X}" for layout in _LAYOUTS)
    return f"{', '.join(others)} or {last}"
