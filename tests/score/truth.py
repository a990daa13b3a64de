"""What a recording conceals, told as a diagnosis tells it: effects by name, sizes by the parameters of its findings."""

import cmath
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from emulator.bounds import Points
from emulator.conceal.dead_time_compensation import COMPENSATED
from emulator.conceal.populations import FAMILIES, KINDS, STRANGERS
from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.thermal import Temperatures, Thermal, flux_factor, resistance_factor
from emulator.scenario.scenarios import Scenario, parse

EFFECT: Final[Mapping[str, str]] = {
    "dead_time": "inverter_voltage_error",
    "drops": "inverter_voltage_error",
    "saturation_d": "d_axis_saturation",
    "saturation_q": "q_axis_saturation",
    "cross_saturation": "cross_saturation",
    "iron_loss": "iron_loss",
    "winding_heat": "winding_resistance_drift",
    "magnet_heat": "magnet_flux_drift",
    "demagnetisation": "magnet_flux_step",
    "flux_harmonics": "flux_harmonics",
    "inductance_harmonics": "inductance_harmonics",
    "skin": "ac_resistance",
    "imbalance": "phase_resistance_imbalance",
    "turn_short": "interturn_short",
    "current_offset": "current_sensor_offset",
    "current_gain": "current_sensor_gain",
    "current_skew": "current_sampling_skew",
    "angle_offset": "angle_offset",
    "eccentric_once": "encoder_eccentricity",
    "eccentric_twice": "encoder_eccentricity",
    "voltage_early": "voltage_delay",
    "voltage_late": "voltage_delay",
    "dc_link_gain": "dc_link_gain",
    "currents_averaged": "current_averaging",
    "currents_filtered": "current_filter",
    "angle_late": "angle_latency",
    "angle_tracked": "angle_tracking",
    "angle_signals": "angle_sensor_error",
    "leg_voltages": "leg_voltage_offset",
    "winding_warmed": "winding_temperature",
    "magnets_warmed": "magnet_temperature",
    "over_compensated": "dead_time_compensation",
    "under_compensated": "dead_time_compensation",
    "current_hum": "current_sensor_hum",
    "mains_voltage": "mains_voltage",
    "signal_harmonics": "angle_sensor_error",
    "hall_displaced": "hall_displacement",
}
"""Name that a diagnosis gives to a class."""

BESIDE: Final = dict.fromkeys(COMPENSATED, "inverter_voltage_error")
"""Effect that a class has as well."""

UNCHAINED: Final = tuple(name for name in EFFECT if not any(name in family for family in FAMILIES.values()))
"""Classes of populations whose drives have no measuring chain, make up for nothing, and are warmed by themselves."""


@dataclass(frozen=True, slots=True)
class Size:
    """A parameter of an effect as it is."""

    value: float
    whole: float  # of which a tenth is allowed to be wrong: the largest of parameters that belong together
    unit: str


Sizes = dict[str, Size]


@dataclass(frozen=True, slots=True)
class Truth:
    """What a diagnosis should find."""

    classes: tuple[str, ...]
    subjects: tuple[str, ...]  # of these, what is concealed on purpose; the others are a measuring chain drawn besides
    kind: str  # none, one, two, three, stranger
    effects: Mapping[str, Mapping[str, Size]]  # by effect and parameter
    machine: Mapping[str, float]  # R_s, L_d, L_q, psi_f at the start and at no current, SI
    stranger: str | None
    scenario: Scenario
    length: float  # s


def truth_of(answer: Mapping[str, Any]) -> Truth:
    """Of an answer. Where the machine warms up, the recording is run again for its temperatures at the end."""
    scenario = parse(answer["scenario"], f"recording {answer['recording']}")
    classes, periods = tuple(answer["classes"]), int(answer["periods"])
    effects: dict[str, Sizes] = {}
    for name in classes:
        if name in EFFECT:
            for effect in (EFFECT[name], *([BESIDE[name]] if name in BESIDE else [])):
                effects.setdefault(effect, {}).update(_SIZES[effect](scenario, periods))
    motor, imbalance = scenario.motor, scenario.effects.imbalance
    machine = {
        "R_s": motor.R_s * (1.0 + sum(imbalance) / 3.0), "L_d": motor.L_d, "L_q": motor.L_q, "psi_f": motor.psi_f,
    }  # fmt: skip
    stranger = next((name for name in classes if name in STRANGERS), None)
    kind = "stranger" if stranger else answer["kind"] if answer["kind"] in KINDS else "one"
    subjects = classes[: 1 if stranger else KINDS.index(kind)]
    return Truth(classes, subjects, kind, effects, machine, stranger, scenario, periods * scenario.drive.T_s)


def _together(values: Mapping[str, float], unit: str) -> Sizes:
    """Parameters of one kind."""
    whole = max(map(abs, values.values()))
    return {name: Size(value, whole, unit) for name, value in values.items()}


def _inverter(scenario: Scenario, _periods: int) -> Sizes:
    # What of the two is not there is measured by what the other loses
    inverter, drive = scenario.effects.inverter, scenario.drive
    drop = 0.5 * (inverter.u_transistor + inverter.u_diode)
    per_time = drive.u_dc / drive.T_s
    lost = inverter.dead_time * per_time + drop
    return {
        "dead_time": Size(inverter.dead_time, inverter.dead_time or lost / per_time, "s"),
        "u_drop": Size(drop, drop or lost, "V"),
    }


def _iron(scenario: Scenario, _periods: int) -> Sizes:
    return _together({"R_c": scenario.effects.iron_loss.R_c}, "ohm")


def _saturation(name: str) -> Callable[[Scenario, int], Sizes]:
    return lambda scenario, _periods: _together({name: getattr(scenario.effects.saturation, name)}, "1")


def _at_end(scenario: Scenario, periods: int) -> tuple[float, float]:
    """Temperatures of winding and magnets (degC)."""
    drive = VirtualDrive(scenario)
    drive.record(periods)
    return drive.truth.temp_winding, drive.truth.temp_magnet


def _winding(scenario: Scenario, periods: int) -> Sizes:
    thermal, started = scenario.effects.thermal, scenario.run.temperature
    ended, _ = _at_end(scenario, periods)
    return _together({"rise": _resistance(thermal, ended) / _resistance(thermal, started) - 1.0}, "1")


def _resistance(thermal: Thermal, temperature: float) -> float:
    return resistance_factor(thermal, Temperatures(temperature, temperature, temperature))


def _magnet(scenario: Scenario, periods: int) -> Sizes:
    thermal, started = scenario.effects.thermal, scenario.run.temperature
    _, ended = _at_end(scenario, periods)
    return _together({"change": _flux(thermal, ended) / _flux(thermal, started) - 1.0}, "1")


def _flux(thermal: Thermal, temperature: float) -> float:
    return flux_factor(thermal, Temperatures(temperature, temperature, temperature))


def _step(scenario: Scenario, _periods: int) -> Sizes:
    step = scenario.effects.demagnetisation
    middle = step.time + 0.5 * step.duration
    return {"change": Size(-step.share, step.share, "1"), "time": Size(middle, middle, "s")}


def _flux_harmonics(scenario: Scenario, _periods: int) -> Sizes:
    harmonics = scenario.effects.harmonics
    return _together({name: getattr(harmonics, name) for name in ("d_6", "q_6", "d_12", "q_12")}, "1")


def _inductance_harmonics(scenario: Scenario, _periods: int) -> Sizes:
    return _together({"inverse_6": scenario.effects.harmonics.inductance}, "1")


def _skin(scenario: Scenario, _periods: int) -> Sizes:
    # The rung is halfway up at its frequency
    skin = scenario.effects.skin
    return {"rise": Size(2.0 * skin.rise, 2.0 * skin.rise, "1"), "corner": Size(skin.frequency, skin.frequency, "Hz")}


def _imbalance(scenario: Scenario, _periods: int) -> Sizes:
    shares = scenario.effects.imbalance
    mean = sum(shares) / 3.0
    return _together(
        {f"excess_{phase}": scenario.motor.R_s * (share - mean) for phase, share in zip("abc", shares, strict=True)},
        "ohm",
    )


def _turn_short(scenario: Scenario, _periods: int) -> Sizes:
    # The loop carries i_t = mu e / (R_t + mu R_s) and adds 2/3 mu i_t to the phase's current
    short, R_s = scenario.effects.turn_short, scenario.motor.R_s
    conductance = 2.0 / 3.0 * short.share**2 / (short.R_t + short.share * R_s)
    return {"conductance": Size(conductance, conductance, "S"), "phase": Size(float(short.phase), 0.0, "1")}


def _current_offset(scenario: Scenario, _periods: int) -> Sizes:
    sensing = scenario.effects.current_sensing
    return _together({f"offset_{phase}": getattr(sensing, f"offset_{phase}") for phase in "abc"}, "A")


def _current_gain(scenario: Scenario, _periods: int) -> Sizes:
    # Of 1.02 what matters is the 2 %
    sensing = scenario.effects.current_sensing
    there = "abc"[: scenario.drive.current_sensors]
    gains = {f"gain_{phase}": float(getattr(sensing, f"gain_{phase}")) for phase in there}
    mean = sum(gains.values()) / len(there)
    whole = max(abs(gain / mean - 1.0) for gain in gains.values())
    return {name: Size(gain / mean, whole, "1") for name, gain in gains.items()}


def _skew(scenario: Scenario, _periods: int) -> Sizes:
    sensing = scenario.effects.current_sensing
    skews = {f"skew_{phase}": float(getattr(sensing, f"skew_{phase}")) for phase in "abc"}
    return _together({name: skew for name, skew in skews.items() if skew > 0.0}, "s")


def _angle_offset(scenario: Scenario, _periods: int) -> Sizes:
    # An encoder that tells whole counts reads half a count low on average
    drive, n_p = scenario.drive, scenario.motor.n_p
    low = math.pi / drive.encoder_counts if drive.encoder_counts else 0.0
    return _together({"offset": n_p * (scenario.effects.angle_sensing.offset - low)}, "rad")


def _eccentricity(scenario: Scenario, _periods: int) -> Sizes:
    sensing, n_p = scenario.effects.angle_sensing, scenario.motor.n_p
    return _together({"once": n_p * sensing.once, "twice": n_p * sensing.twice}, "rad")


def _delay(scenario: Scenario, _periods: int) -> Sizes:
    # A row that has the voltage of the period after tells it early: it acted later than recorded
    return _together({"periods": float(scenario.effects.timing.shift)}, "1")


def _dc_link_gain(scenario: Scenario, _periods: int) -> Sizes:
    gain = scenario.effects.voltage_sensing.gain
    return {"gain": Size(gain, abs(gain - 1.0), "1")}


def _averaging(scenario: Scenario, _periods: int) -> Sizes:
    mean, T_s = scenario.effects.current_filter, scenario.drive.T_s
    return _together({"lag": 0.5 * T_s * (mean.periods or mean.samples - 1)}, "s")


def _filter(scenario: Scenario, _periods: int) -> Sizes:
    return _together({"tau": scenario.effects.current_filter.tau}, "s")


def _latency(scenario: Scenario, _periods: int) -> Sizes:
    return _together({"latency": scenario.effects.angle_signal.latency}, "s")


def _tracking(scenario: Scenario, _periods: int) -> Sizes:
    return _together({"bandwidth": scenario.effects.angle_signal.bandwidth}, "Hz")


def _signals(scenario: Scenario, _periods: int) -> Sizes:
    # To the first order: half of what the signals differ by and half of what their angle does
    signal = scenario.effects.angle_signal
    second = math.sqrt(0.5) * signal.second
    sizes = {"once": second, "twice": 0.5 * math.hypot(signal.gain, signal.quadrature), "thrice": second}
    return _together({name: size for name, size in (*sizes.items(), ("fourth", signal.third)) if size > 0.0}, "rad")


def _hall(scenario: Scenario, _periods: int) -> Sizes:
    hall = scenario.effects.hall
    return _together({name: getattr(hall, name) for name in ("displaced_a", "displaced_b", "displaced_c")}, "rad")


def _leg_voltages(scenario: Scenario, _periods: int) -> Sizes:
    stray = scenario.effects.stray
    along = stray.amplitude * complex(stray.along_alpha, stray.along_beta)
    third = 2.0 * math.pi / 3.0
    return _together({f"offset_{x}": (along * cmath.exp(-1j * n * third)).real for n, x in enumerate("abc")}, "V")


def _warmed(part: str, most: str, unit: str) -> Callable[[Scenario, int], Sizes]:
    """`most`: the name that the largest share is told by."""

    def sizes(scenario: Scenario, periods: int) -> Sizes:
        points: Points = getattr(scenario.effects.warming, part)
        t, share = ([point[n] for point in points] for n in (0, 1))
        value = scenario.motor.R_s if part == "winding" else scenario.motor.psi_f
        largest, end = max(share, key=abs), periods * scenario.drive.T_s
        at = {"at_half": 0.5 * end, "at_end": end}
        course = {
            name: Size(value * (1.0 + float(np.interp(x, t, share))), value * abs(largest), unit)
            for name, x in at.items()
        }
        return {most: Size(largest, abs(largest), "1"), **course}

    return sizes


def _compensation(scenario: Scenario, _periods: int) -> Sizes:
    return _together({"time": scenario.effects.compensation.time}, "s")


def _hum(scenario: Scenario, _periods: int) -> Sizes:
    # Of two channels the third phase is what they leave
    hum = scenario.effects.current_hum
    c = hum.c if scenario.drive.current_sensors == 3 else -hum.a - hum.b
    amplitudes = {f"amplitude_{k}": abs(x) for k, x in zip("abc", (hum.a, hum.b, c), strict=True)}
    return {"frequency": Size(hum.frequency, hum.frequency, "Hz"), **_together(amplitudes, "A")}


def _mains_voltage(scenario: Scenario, _periods: int) -> Sizes:
    stray = scenario.effects.stray
    return {
        "frequency": Size(stray.frequency, stray.frequency, "Hz"), **_together({"amplitude": stray.amplitude}, "V"),
    }  # fmt: skip


_SIZES: Final[Mapping[str, Callable[[Scenario, int], Sizes]]] = {
    "inverter_voltage_error": _inverter,
    "d_axis_saturation": _saturation("L_d_drop"),
    "q_axis_saturation": _saturation("L_q_drop"),
    "cross_saturation": _saturation("cross_drop"),
    "iron_loss": _iron,
    "winding_resistance_drift": _winding,
    "magnet_flux_drift": _magnet,
    "magnet_flux_step": _step,
    "flux_harmonics": _flux_harmonics,
    "inductance_harmonics": _inductance_harmonics,
    "ac_resistance": _skin,
    "phase_resistance_imbalance": _imbalance,
    "interturn_short": _turn_short,
    "current_sensor_offset": _current_offset,
    "current_sensor_gain": _current_gain,
    "current_sampling_skew": _skew,
    "angle_offset": _angle_offset,
    "encoder_eccentricity": _eccentricity,
    "voltage_delay": _delay,
    "dc_link_gain": _dc_link_gain,
    "current_averaging": _averaging,
    "current_filter": _filter,
    "angle_latency": _latency,
    "angle_tracking": _tracking,
    "angle_sensor_error": _signals,
    "leg_voltage_offset": _leg_voltages,
    "winding_temperature": _warmed("winding", "rise", "ohm"),
    "magnet_temperature": _warmed("magnets", "change", "Vs"),
    "dead_time_compensation": _compensation,
    "current_sensor_hum": _hum,
    "mains_voltage": _mains_voltage,
    "hall_displacement": _hall,
}
