"""What a drive can make up for: each effect's sizes as the signals that undo it, or a sentence.

    i_k = gain_k (reading_k - offset_k)                      read as (1 + x_k) i_k, or as i_k + x_k
    theta_m = s (reading - table) + angle_offset / n_p       s = -1 where the encoder counts against the phases' order
    u_set,k = u_k + lost(i_k)                      lost = dead_time / T_s u_dc + drop beyond a width of current; a table

A recording holds what the drive took for current, angle and voltage: an effect is what the drive's parameters of that
time left, and goes on top of them. Flux linkages are the machine's own, and take the place of those before. Effects
are told by `estimator.physics`, signals by `drivers.wire.dictionary`. Knows nothing of files.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from bench.parameters.made import Size, items, number
from drivers.wire.dictionary import TABLE_SIDE, TABLE_SIZE
from estimator.machine import PARAMETERS, PLAUSIBLE, Machine
from estimator.physics.saturation import SATURATIONS, curve_of, flux_of

BY_TIMES, BY_TABLE = 1.0, 2.0  # inverter_correction
TURN: Final = math.tau
_NO_DEAD_TIME: Final = "how much of the inverter's voltage error is dead time is not told: inverter_drop takes it all"
_OF_TABLES: Final = "the control period and the dc link's voltage"
_RIPPLE: Final = 0.02  # of the rated current: what a period's ripple and a delay make of a crossing's width
_SOFT: Final = 0.2  # of all that is lost, from which the softness of drops is worth a table
_KNEES: Final = 8.0  # to the end of such a table: 99 % of a drop
_LEAST_SPAN: Final = 0.1  # of the largest current: the least range of a table along either axis
_NEAR: Final = 8  # places of a flux map, through which a plane goes on
_DROPS: Final = ("L_d_drop", "L_q_drop", "cross_drop", "L_d_drop")
_RATED: Final = (1e-3, 1e5)  # A, of any motor
_MOST_DROP: Final = 0.9  # of an inductance

Array = NDArray[np.float64]
Sizes = Mapping[str, Size]


@dataclass(frozen=True, slots=True)
class Recorded:
    """A diagnosed recording: what the drive had then, and what was found."""

    drive: Mapping[str, float]  # its parameters, SI, by signal; those that are missing had no effect
    machine: Mapping[str, float]  # R_s, L_d, L_q, psi_f after the effects, n_p, i_rated, as far as they are known
    found: Mapping[str, Sizes]  # by effect: what is told of it
    currents: Mapping[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])  # A, seen
    T_s: float | None = None  # s
    u_dc: float | None = None  # V
    flux_map: Mapping[str, Any] = field(default_factory=dict[str, Any])  # as a diagnosis tells it
    electrical_turn: int | None = None  # of the mechanical one, as the encoder reads it, in which the recording began

    def was(self, name: str, otherwise: float = 0.0) -> float:
        """A parameter of the drive."""
        return self.drive.get(name, otherwise)

    def of(self, effect: str, *names: str) -> list[Size]:
        """Sizes of an effect. Raises UntoldError where one is not told."""
        told = self.found.get(effect, {})
        if missing := [name for name in names if name not in told]:
            raise UntoldError(f"{', '.join(missing)} {'is' if len(missing) == 1 else 'are'} not told")
        return [told[name] for name in names]

    @property
    def i_rated(self) -> float:
        """A; the largest that was seen where it is not known."""
        seen = [abs(end) for ends in self.currents.values() for end in ends]
        return self.machine.get("i_rated") or max(seen, default=0.0)


@dataclass(frozen=True, slots=True)
class Compensation:
    """Signals that undo effects."""

    effects: tuple[str, ...]
    values: Mapping[str, Size]  # SI
    note: str = ""
    doubt: str = ""  # what else it may have been, a clause
    partly: str = ""  # what of it is not taken over, a sentence


class UntoldError(Exception):
    """What a compensation would need and is not there, a clause."""


def inverter(recorded: Recorded) -> Compensation:
    """Dead time and drop on top of those that the drive made up for; a table where drops are soft.

    Of a compensation that is told beside the dead time, what it lacks or is too much.
    """
    name, other = "inverter_voltage_error", "dead_time_compensation"
    told, T_s, u_dc = recorded.found.get(name, {}), recorded.T_s, recorded.u_dc
    drop = told.get("u_drop") or told.get("voltage") or Size(0.0)
    dead_time, added = told.get("dead_time", Size(0.0)), recorded.found.get(other, {}).get("time", Size(0.0))
    if dead_time.value > 0.0 and T_s is not None and u_dc is not None:  # it is added for both alike
        share = added.value / (dead_time.value + drop.value * T_s / u_dc)
        added = Size(share * dead_time.value, added.std)
        drop = _less(drop, Size(share * drop.value, 0.0))
    dead_time = _less(dead_time, added)
    if name in recorded.found and "dead_time" not in told and "voltage" not in told:
        recorded.of(name, "dead_time")
    width = max(told.get("zero_crossing_width", Size(0.0)).value, _RIPPLE * recorded.i_rated)
    knee, mode = told.get("knee", Size(0.0)).value, recorded.was("inverter_correction")
    names = tuple(each for each in (name, other) if each in recorded.found)
    lost = drop.value if T_s is None or u_dc is None else drop.value + dead_time.value / T_s * u_dc
    partly = "" if "dead_time" in told or name not in recorded.found else _NO_DEAD_TIME
    if mode == BY_TABLE or (knee > width and drop.value > _SOFT * lost):
        if T_s is not None and u_dc is not None:
            return Compensation(names, _inverter_table(recorded, dead_time.value / T_s * u_dc, drop.value, width, knee))
        if mode == BY_TABLE:
            raise UntoldError(f"the drive has a table of lost voltage, and another one needs {_OF_TABLES}")
        partly = f"the drop is taken for one of no softness: a table of it needs {_OF_TABLES}"
    if mode == BY_TIMES:
        dead_time = Size(dead_time.value + recorded.was("dead_time"), dead_time.std)
        drop = Size(drop.value + recorded.was("inverter_drop"), drop.std)
        width = max(width, recorded.was("inverter_width"))
    if dead_time.value < 0.0:
        raise UntoldError("the drive adds more than its legs lose, by what is none of its parameters")
    values = {"inverter_correction": Size(BY_TIMES), "dead_time": dead_time, "inverter_width": Size(width)}
    note = "a crossing's width is that of the current's ripple, by a rule"
    return Compensation(names, {**values, "inverter_drop": drop}, note, partly=partly)


def _less(one: Size, other: Size) -> Size:
    """Of what is told; a size of zero without an error is of nothing."""
    stds = [each.std for each in (one, other) if each.value or each.std is not None]
    known = None if not stds or None in stds else math.hypot(*(std or 0.0 for std in stds))
    return Size(one.value - other.value, known)


def _inverter_table(recorded: Recorded, step: float, drop: float, width: float, knee: float) -> dict[str, Size]:
    """A step (V) over a width (A) and a drop (V) softened below a knee (A), and what the drive had of either."""
    mode, before = recorded.was("inverter_correction"), recorded.was("inverter_table_current")
    end = max(width, _KNEES * knee, before if mode == BY_TABLE else recorded.was("inverter_width"))
    i = np.linspace(0.0, end, TABLE_SIZE)
    u = step * np.minimum(1.0, i / width) if width > 0.0 else step * (i > 0.0)
    u = u + drop * i / np.sqrt(i**2 + max(knee, 1e-9) ** 2)
    if mode == BY_TABLE and before > 0.0:
        u = u + np.interp(i, np.linspace(0.0, before, TABLE_SIZE), _table(recorded.drive, "inverter_table"))
    elif mode == BY_TIMES and recorded.T_s and recorded.u_dc is not None:
        had = recorded.was("dead_time") / recorded.T_s * recorded.u_dc + recorded.was("inverter_drop")
        u = u + had * np.minimum(1.0, i / max(recorded.was("inverter_width"), 1e-9))
    values = {"inverter_correction": Size(BY_TABLE), "inverter_table_current": Size(end)}
    return values | _entries("inverter_table", u)


def current_gains(recorded: Recorded) -> Compensation:
    """Each channel's gain, divided by what it reads too much."""
    name = "current_sensor_gain"
    values = dict[str, Size]()
    for phase, told in zip(_channels(recorded), recorded.of(name, "gain_a", "gain_b", "gain_c"), strict=True):
        if told.value <= 0.0:
            raise UntoldError(f"a gain of {told.value:g} is none")
        gain = recorded.was(f"i_{phase}_gain", 1.0) / told.value
        values[f"i_{phase}_gain"] = Size(gain, None if told.std is None else gain / told.value * told.std)
    return Compensation((name,), values, "a gain common to all three is not told, and left as it was")


def current_offsets(recorded: Recorded) -> Compensation:
    """Each channel's offset, as its reading has it."""
    name = "current_sensor_offset"
    values = dict[str, Size]()
    for phase, told in zip(_channels(recorded), recorded.of(name, "offset_a", "offset_b", "offset_c"), strict=True):
        gain = recorded.was(f"i_{phase}_gain", 1.0)
        offset = recorded.was(f"i_{phase}_offset") + told.value / gain
        values[f"i_{phase}_offset"] = Size(offset, None if told.std is None else told.std / gain)
    return Compensation((name,), values, "an offset common to all three is not told, and left as it was")


def _channels(recorded: Recorded) -> str:
    """Channels by the phases that are recorded."""
    return "acb" if recorded.was("phases_swapped") else "abc"


def angle_offset(recorded: Recorded) -> Compensation:
    """Taken off the angle that is read."""
    (told,) = recorded.of("angle_offset", "offset")
    offset = math.remainder(recorded.was("angle_offset") - told.value, TURN)
    return Compensation(("angle_offset",), {"angle_offset": Size(offset, told.std)})


def encoder(recorded: Recorded) -> Compensation:
    """The encoder's error by its readings, on top of the table that the drive had."""
    name = "encoder_eccentricity"
    sizes = recorded.of(name, "once", "once_phase", "twice", "twice_phase")
    n_p = recorded.machine.get("n_p") or recorded.was("n_p")
    if not n_p:
        raise UntoldError("the pole pairs are not known")
    once, once_phase, twice, twice_phase = (size.value for size in sizes)
    there = [order for order, size in ((1, sizes[0]), (2, sizes[2])) if _is_told(size)]
    begun = recorded.electrical_turn
    if begun is None and all(order % n_p == 0.0 for order in there):  # it is the same in all of them
        once, twice, begun = once * (1 in there), twice * (2 in there), 0
    if begun is None:
        raise UntoldError(
            f"a recording of {n_p:g} pole pairs does not say which of {n_p:g} electrical turns it began in: the "
            "encoder's reading at its first row does"
        )
    had = _table(recorded.drive, "angle_table") if recorded.was("angle_correction") else np.zeros(TABLE_SIZE)
    reading = np.arange(TABLE_SIZE) * TURN / TABLE_SIZE
    way = -1.0 if recorded.was("angle_reversed") else 1.0
    taken = way * (reading - had) + recorded.was("angle_offset") / n_p - begun * TURN / n_p
    off = np.zeros(TABLE_SIZE)  # rad, electrical
    for _ in range(20):
        free = taken - off / n_p  # of this effect; an offset beside it is in its phases
        off = once * np.sin(free + once_phase) + twice * np.sin(2.0 * free + twice_phase)
    return Compensation((name,), {"angle_correction": Size(1.0), **_entries("angle_table", had + way * off / n_p)})


def _is_told(size: Size) -> bool:
    """It stands out of its error."""
    return size.value != 0.0 and (size.std is None or abs(size.value) > 2.0 * size.std)


def electrical_turn(reading: float, theta_e: float, drive: Mapping[str, float]) -> int:
    """In which electrical turn a rotor is, from what its encoder reads (rad, mechanical) and the drive makes of that.

    `theta_e`: rad, electrical, as the drive records it at that time; `drive`: its parameters, n_p among them.
    """
    n_p, had = int(drive["n_p"]), np.zeros(TABLE_SIZE)
    if drive.get("angle_correction"):
        had = _table(drive, "angle_table")
    places = np.append(np.arange(TABLE_SIZE), TABLE_SIZE) * TURN / TABLE_SIZE
    corrected = reading - float(np.interp(reading % TURN, places, np.append(had, had[0])))
    theta = (-corrected if drive.get("angle_reversed") else corrected) * n_p + drive.get("angle_offset", 0.0)
    return round((theta - theta_e) / TURN) % n_p


def angle_latency(recorded: Recorded) -> Compensation:
    """On top of the age of the angle that the drive makes up for."""
    (told,) = recorded.of("angle_latency", "latency")
    age = Size(recorded.was("angle_latency") + told.value, told.std)
    return Compensation(("angle_latency",), {"angle_latency": age})


def late_angle_column(recorded: Recorded) -> Compensation:
    """A column of angles that is late by rows: the age of the angle that is read."""
    name = "convention_error"
    if "theta_shift" not in recorded.found[name]:
        raise UntoldError("columns are in another convention than the one expected, which is a matter of the recording")
    (late,) = recorded.of(name, "theta_shift")
    if recorded.T_s is None:
        raise UntoldError("the control period is not known")
    age = recorded.was("angle_latency") + late.value * recorded.T_s
    return Compensation(
        (name,), {"angle_latency": Size(age)}, doubt="it may be the recording alone that has the angle late"
    )


def saturation(recorded: Recorded) -> Compensation:
    """Tables of flux linkage: a free map's where there is one, else those of the curve that the effects share."""
    there = tuple(name for name in (*SATURATIONS, FLUX_MAP) if name in recorded.found)
    if recorded.flux_map:
        return _of_map(recorded, there)
    if any(name not in recorded.machine for name in (*PARAMETERS, "i_rated")):
        raise UntoldError("drops of inductance are at the rated current, and that or the machine is not told")
    (R_s, L_d, L_q, psi_f), i_rated = (recorded.machine[name] for name in PARAMETERS), recorded.machine["i_rated"]
    bounds = PLAUSIBLE | {"i_rated": _RATED}
    if not all(low <= recorded.machine[name] <= high for name, (low, high) in bounds.items()):
        raise UntoldError("the machine is told as no motor is")
    machine = Machine(R_s, L_d, L_q, psi_f, int(recorded.machine.get("n_p", 1)), i_rated)
    drops = [
        recorded.of(name, drop)[0].value if name in recorded.found else 0.0
        for name, drop in zip(SATURATIONS, _DROPS, strict=True)
    ]
    if not all(0.0 <= drop <= _MOST_DROP for drop in drops):
        raise UntoldError(f"expected drops of 0 to {_MOST_DROP:g}, got {', '.join(f'{drop:g}' for drop in drops)}")
    low, high, q_most, note = _range_of(recorded)
    i_d, i_q = np.linspace(low, high, TABLE_SIDE), np.linspace(0.0, q_most, TABLE_SIDE)
    d, q, cross, symmetric = drops
    psi = flux_of(curve_of(machine, i_rated, (d, q, cross), symmetric), machine, np.add.outer(i_d, 1j * i_q).ravel())
    return Compensation(there, _saturation_values(low, high, q_most, psi.real, psi.imag), note)


def _range_of(recorded: Recorded) -> tuple[float, float, float, str]:
    """Currents of the tables: i_d from and to, i_q to, A, and a sentence; zero is among them."""
    if not {"i_d", "i_q"} <= set(recorded.currents):
        rated = recorded.i_rated
        return -rated, rated, rated, "up to the rated current: it is not told which currents were recorded"
    (d_low, d_high), (q_low, q_high) = recorded.currents["i_d"], recorded.currents["i_q"]
    q_most = max(abs(q_low), abs(q_high))
    least = _LEAST_SPAN * max(abs(d_low), abs(d_high), q_most)
    low, high = min(d_low, -0.5 * least), max(d_high, 0.5 * least)
    said = f"recorded were i_d from {d_low:.3g} to {d_high:.3g} A, i_q from {q_low:.3g} to {q_high:.3g} A"
    return low, high, max(q_most, least), f"{said}; beyond, the tables go on straight"


def _saturation_values(low: float, high: float, q_most: float, psi_d: Array, psi_q: Array) -> dict[str, Size]:
    values = {
        "saturation_correction": Size(1.0), "table_i_d_min": Size(low), "table_i_d_max": Size(high),
        "table_i_q_max": Size(q_most),
    }  # fmt: skip
    return values | _entries("psi_d_table", psi_d) | _entries("psi_q_table", psi_q)


def _of_map(recorded: Recorded, there: tuple[str, ...]) -> Compensation:
    """Of a free flux map, linear between its currents; where it has none, on the plane through the nearest it has."""
    told = recorded.flux_map
    i_d, i_q = (_numbers(items(told, key)) for key in ("i_d", "i_q"))
    psi_d, psi_q = (_rows(items(told, key), len(i_d), len(i_q)) for key in ("psi_d", "psi_q"))
    if min(len(i_d), len(i_q)) < 2 or not (np.diff(i_d) > 0.0).all() or not (np.diff(i_q) > 0.0).all():
        raise UntoldError("the flux map is no table over rising i_d and i_q")
    known = np.isfinite(psi_d) & np.isfinite(psi_q)
    if np.count_nonzero(known) < _NEAR or i_q[-1] <= 0.0:
        raise UntoldError("the flux map holds too few flux linkages")
    ends = {"i_d": (float(i_d[0]), float(i_d[-1])), "i_q": (float(i_q[0]), float(i_q[-1]))}
    low, high, q_most, note = _range_of(replace(recorded, currents=ends | dict(recorded.currents)))
    d_at, q_at = np.linspace(low, high, TABLE_SIDE), np.linspace(0.0, q_most, TABLE_SIDE)
    d_out, q_out, far = np.empty(TABLE_SIZE), np.empty(TABLE_SIZE), 0
    for k, at in enumerate(np.add.outer(d_at, 1j * q_at).ravel()):
        d_out[k], q_out[k] = (_between(i_d, i_q, psi, at) for psi in (psi_d, psi_q))
        if not (math.isfinite(d_out[k]) and math.isfinite(q_out[k])):
            d_out[k], q_out[k] = (_beside(i_d, i_q, psi, known, at) for psi in (psi_d, psi_q))
            far += 1
    note += f"; {far} of {TABLE_SIZE} entries, where the map has none, are by those beside" if far else ""
    return Compensation(there, _saturation_values(low, high, q_most, d_out, q_out), note)


def _rows(told: Sequence[object], rows: int, columns: int) -> Array:
    found = [_numbers(cast(list[object], row)) for row in told if isinstance(row, list)]
    if len(found) != rows or any(len(row) != columns for row in found):
        raise UntoldError("the flux map is no table over i_d and i_q")
    return np.array(found)


def _between(i_d: Array, i_q: Array, psi: Array, at: complex) -> float:
    """Bilinear; no number where a corner has none."""
    k = int(np.clip(np.searchsorted(i_d, at.real, "right") - 1, 0, len(i_d) - 2))
    m = int(np.clip(np.searchsorted(i_q, at.imag, "right") - 1, 0, len(i_q) - 2))
    x, y = (at.real - i_d[k]) / (i_d[k + 1] - i_d[k]), (at.imag - i_q[m]) / (i_q[m + 1] - i_q[m])
    weights = np.outer((1.0 - x, x), (1.0 - y, y))
    corners = psi[k : k + 2, m : m + 2]
    return float(np.sum(np.where(weights == 0.0, 0.0, weights * corners)))


def _beside(i_d: Array, i_q: Array, psi: Array, known: NDArray[np.bool_], at: complex) -> float:
    """On the plane through the nearest that are known."""
    cell_d, cell_q = np.ptp(i_d) / (len(i_d) - 1), np.ptp(i_q) / (len(i_q) - 1)
    x, y = np.meshgrid((i_d - at.real) / cell_d, (i_q - at.imag) / cell_q, indexing="ij")
    x, y, values = x[known], y[known], psi[known]
    near = np.argsort(np.hypot(x, y), kind="stable")[:_NEAR]
    columns = np.column_stack((np.ones(_NEAR), x[near], y[near]))
    return float(np.linalg.lstsq(columns, values[near], rcond=None)[0][0])


def _numbers(row: Sequence[object]) -> Array:
    return np.array([math.nan if (value := number(one)) is None else value for one in row])


def _entries(table: str, values: Array) -> dict[str, Size]:
    return {f"{table}_{k}": Size(float(value)) for k, value in enumerate(values, start=1)}


def _table(drive: Mapping[str, float], table: str) -> Array:
    return np.array([drive.get(f"{table}_{k}", 0.0) for k in range(1, TABLE_SIZE + 1)])


FLUX_MAP: Final = "flux_map"
"""Stands among effects for a map that no curve of few numbers is."""
TABLE: Final[Mapping[str, Callable[[Recorded], Compensation] | str]] = {
    "inverter_voltage_error": inverter,
    "dead_time_compensation": inverter,
    "d_axis_saturation": saturation,
    "symmetric_d_axis_saturation": saturation,
    "q_axis_saturation": saturation,
    "cross_saturation": saturation,
    FLUX_MAP: saturation,
    "current_sensor_gain": current_gains,
    "current_sensor_offset": current_offsets,
    "angle_offset": angle_offset,
    "encoder_eccentricity": encoder,
    "angle_latency": angle_latency,
    "convention_error": late_angle_column,
    "iron_loss": "part of the current makes heat and no torque, the more the faster it turns",
    "winding_resistance_drift": "the current control's integral takes it; control_R_s is that at the start",
    "magnet_flux_drift": "torque per ampere changes with it; control_psi_f is that at the start",
    "winding_temperature": "the current control's integral takes it; control_R_s is that at the start",
    "magnet_temperature": "torque per ampere changes with it; control_psi_f is that at the start",
    "magnet_flux_step": "torque per ampere is lower from then on; control_psi_f is that before",
    "flux_harmonics": "torque ripples at 6 and 12 times the electrical frequency",
    "inductance_harmonics": "torque ripples at 6 times the electrical frequency under current",
    "ac_resistance": "ripple and fast currents lose more; control_R_s is that of steady ones",
    "phase_resistance_imbalance": "torque ripples at twice the electrical frequency: a contact or a joint to be mended",
    "interturn_short": "it heats the winding as long as the motor turns: a motor to be taken out of service",
    "current_sampling_skew": "currents ripple at twice the electrical frequency: a matter of the sampling's timing",
    "current_sensor_hum": "torque ripples at the mains' frequency: a matter of grounds and supplies of the sensors",
    "mains_voltage": "torque ripples at the mains' frequency: a matter of the leads' way and shield",
    "voltage_delay": "it is a matter of the recording: the drive's voltages are read in other rows than they act in",
    "current_averaging": "current control answers late by half of what the mean is over: a matter of the converter",
    "current_filter": "current control answers late by its time constant: a matter of the filter",
    "angle_tracking": "the angle lags as long as the speed changes: a faster loop is set where the angle is read",
    "angle_sensor_error": "offset, amplitude, phase and harmonics of its signals are trimmed where they are read",
    "hall_displacement": "a table of six angles, one for each edge of the sensors, is set where they are read",
    "leg_voltage_offset": "torque ripples at the electrical frequency: a matter of the gate drives",
    "voltage_offset": "it is a matter of what the drive reports of its voltages",
}
"""By effect, what undoes it; or, where no compensation does, what it does instead."""


def compensations(recorded: Recorded) -> tuple[list[Compensation], list[str]]:
    """All that undo what was found, and a sentence for each effect that none does."""
    made, said, done = list[Compensation](), list[str](), set[object]()
    for effect in (*recorded.found, *((FLUX_MAP,) if recorded.flux_map else ())):
        how = TABLE.get(effect, "the bench knows of none")
        if isinstance(how, str):
            said.append(f"{effect} is absorbed by no compensation: {how}")
        elif how not in done:
            done.add(how)
            try:
                made.append(one := how(recorded))
                said += [one.partly] if one.partly else []
            except UntoldError as error:
                said.append(f"{effect} is absorbed by no compensation: {error}")
    return made, said
