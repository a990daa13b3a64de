"""A drive's signals, read and written by name while it streams. Knows nothing of HTTP and leases.

All values of a write are judged before the first goes over the wire. Where the drive then refuses one, the sentence
says which were written before it.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from typing import Any, Final

from bench.errors import LimitError, shown
from drivers.drive import Drive
from drivers.errors import DriveError
from drivers.wire.codec import check_range
from drivers.wire.dictionary import LEASE_TIMES, SIGNALS, TABLES, Signal, WireType

_BY_NAME: Final = {signal.name: signal for signal in SIGNALS}
_SCALARS: Final = sum(not signal.table for signal in SIGNALS)
_NAMES: Final = (*(signal.name for signal in SIGNALS if not signal.table), *TABLES)
_RECORDER: Final = 0x2400  # index of the recorder's signals, which captures write
_WRITABLE: Final = {  # with the least that the bench lets through
    signal.name: replace(signal, minimum=LEASE_TIMES[0]) if signal.name == "watchdog_time" else signal
    for signal in SIGNALS if signal.access == "rw" and signal.index != _RECORDER
}  # fmt: skip
_TAKEN: Final = tuple(name for name, signal in _WRITABLE.items() if not signal.table)
_EXAMPLES: Final[Mapping[str, float]] = {  # SI, of a servo motor of 6 A
    "stream_periods": 10, "n_p": 4, "control_R_s": 0.97, "control_L_d": 4.2e-3, "control_L_q": 6.2e-3,
    "control_psi_f": 0.12, "bandwidth": 1250.0, "field_weakening": 0, "i_d_weakening": 3.0, "weakening_voltage": 0.95,
    "i_d_ref": -1.0, "i_q_ref": 2.0, "i_d_step": 1.0, "i_q_step": 1.0, "step_time": 0.02, "watchdog_time": 2.0,
    "speed_control": 0, "speed_ref": 500.0, "speed_ramp": 1000.0, "speed_step": 50.0, "speed_hold": 1.0,
    "excitation_kind": 1, "sine_frequency": 10.0, "sine_count": 8, "i_d_levels": 11, "level_time": 0.5,
    "speed_error_trip": 100.0, "speed_error_time": 0.5, "control_word": 0x0F, "overspeed_trip": 1500.0, "own_gains": 0,
    "k_p_d": 5.3, "k_i_d": 1200.0, "k_p_q": 7.8, "k_i_q": 1200.0, "decoupling": 1, "k_p_speed": 0.02, "k_i_speed": 0.3,
    "speed_filter": 1e-3, "current_limit": 9.0, "i_a_gain": 1.0, "i_b_gain": 1.0, "i_c_gain": 1.0, "i_a_offset": 0.01,
    "i_b_offset": 0.0, "i_c_offset": 0.0, "u_dc_gain": 1.0, "angle_offset": 0.02, "angle_latency": 5e-5,
    "angle_reversed": 0, "phases_swapped": 0, "angle_correction": 0, "inverter_correction": 1, "dead_time": 2e-6,
    "inverter_width": 0.1, "inverter_drop": 0.8, "inverter_table_current": 9.0, "saturation_correction": 0,
    "table_i_d_min": -9.0, "table_i_d_max": 9.0, "table_i_q_max": 9.0,
}  # fmt: skip


TABLE_ENTRY: Final = f"^({'|'.join(TABLES)})_([1-9]|[1-5][0-9]|6[0-4])$"


@dataclass(frozen=True, slots=True)
class Reading:
    """A signal and what the drive said of it."""

    signal: Signal
    value: float  # SI


def read(drive: Drive, names: Iterable[str] = ()) -> list[Reading]:
    """Signals by name, a table by its own; all but the tables where none is named. Raises LimitError, DriveError."""
    wanted = [signal for name in names for signal in _table(name) or [_known(name)]]
    wanted = wanted or [signal for signal in drive.identity.signals if not signal.table]
    return [Reading(signal, drive.read(signal.name)) for signal in wanted]


def checked(values: Mapping[str, Any], among: Sequence[str] = _TAKEN) -> dict[str, float]:
    """Values (SI) that may be written, by name. Raises LimitError for the first that may not.

    `among`: the names that are told instead of one that is none.
    """
    if not values:
        raise LimitError('expected values by the names of signals, such as {"i_q_ref": 2.0}, got none')
    return {name: _checked(_known(name, among), value, among) for name, value in values.items()}


def is_writable(signal: Signal) -> bool:
    """Whether `checked` takes values of it; the recorder's are written by captures alone."""
    return signal.name in _WRITABLE


def shapes() -> dict[str, Any]:
    """What `checked` takes, by name, as JSON schemas; SI. Entries of tables go by a pattern, `TABLE_ENTRY`."""
    return {name: _shape(signal) for name, signal in _WRITABLE.items() if not signal.table}


def write(drive: Drive, values: Mapping[str, float]) -> None:
    """Write `checked` values in their order. Raises DriveError."""
    written = list[str]()
    for name, value in values.items():
        try:
            drive.write(name, value)
        except DriveError as error:
            before = f"written before: {', '.join(written)}" if written else "nothing was written"
            error.args = (f"{error}; {before}", *error.args[1:])
            raise
        written.append(name)


def read_back(drive: Drive, values: Mapping[str, float]) -> list[Reading]:
    """What has been written, as the drive says it now; a command is over, and is told as it was given."""
    return [
        Reading(signal := _BY_NAME[name], drive.read(name) if signal.is_parameter else value)
        for name, value in values.items()
    ]


def values_of(drive: Drive, names: Iterable[str]) -> dict[str, float]:
    """Values of those of the signals that can be read. Raises DriveError."""
    return {name: drive.read(name) for name in names if _BY_NAME[name].is_parameter}


def _table(name: str) -> list[Signal]:
    """Entries of the table of this name; empty where it is none."""
    return [signal for signal in SIGNALS if signal.table == name] if name in TABLES else []


def _known(name: str, among: Sequence[str] = _NAMES) -> Signal:
    signal = _BY_NAME.get(name)
    if signal is None:
        alike = get_close_matches(name[:64], among, 3) or _made_of(get_close_matches(name[:64], _NAMES, 3), among)
        there = f"there is {', '.join(alike)}" if alike else f"`pmsm-bench signals DRIVE` lists all {_SCALARS}"
        raise LimitError(f"no signal {shown(name)}; {there}")
    return signal


def _made_of(names: Sequence[str], among: Sequence[str]) -> list[str]:
    """Signals whose names begin with one of these: what is written of what is read."""
    return [one for one in among if any(one.startswith(f"{name}_") for name in names)]


def _shape(signal: Signal) -> dict[str, Any]:
    kind = "number" if signal.type is WireType.F32 else "integer"
    bounds = {"minimum": signal.minimum, "maximum": signal.maximum}
    text = signal.summary if signal.unit == "1" else f"{signal.summary}, {signal.unit}"
    example = _EXAMPLES.get(signal.name, signal.minimum)  # a command has one value
    shape = {"type": kind, "description": text, "examples": [example]}
    return shape | {key: end for key, end in bounds.items() if end is not None}


def _checked(signal: Signal, value: object, among: Sequence[str]) -> float:
    if signal.access != "rw":
        instead = _made_of([signal.name], among)
        raise LimitError(f"{signal} cannot be written" + (f"; there is {', '.join(instead)}" if instead else ""))
    if signal.index == _RECORDER:
        raise LimitError(f"{signal} is the recorder's, which captures write")
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise LimitError(f"{signal} takes a number, got {shown(value)}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise LimitError(f"{signal} takes a finite number, got {shown(value)}")
    if signal.type is not WireType.F32 and number != int(number):
        raise LimitError(f"{signal} takes a whole number, got {shown(value)}")
    try:
        check_range(_WRITABLE[signal.name], number)
    except ValueError as error:
        raise LimitError(str(error)) from None
    return number
