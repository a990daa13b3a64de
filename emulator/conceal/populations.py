"""Populations: the classes of concealed recordings, and from which range the size of each is drawn.

A class's size is drawn evenly in its logarithm from `low` to `high`, a number without or with a unit that means alike
much in every motor; `sizes` makes of it the keys of a scenario's `[effects]`. What else an effect needs - a phase, a
direction, a frequency - is drawn beside it. The upper ends are what bad drives have; at the lower ends the flux balance
of the true machine is about as large as without the effect, or a few times that.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Final

from emulator.conceal.angle_sensors import ANGLE_SENSORS
from emulator.conceal.chance import Chance
from emulator.conceal.dead_time_compensation import COMPENSATED
from emulator.conceal.mains_hum import HUMMING
from emulator.conceal.measuring_chain import CHAIN, stray_along
from emulator.conceal.outside_warmth import OUTSIDE
from emulator.conceal.population import Population, Sections, Setting
from emulator.plant.machine import Machine
from emulator.plant.physics.saturation import Saturation, saturation_curve
from emulator.plant.physics.thermal import REFERENCE

KINDS: Final = ("none", "one", "two", "three", "stranger")
"""What may be asked for besides a class by name; `one` to `three` are drawn from the effects."""


_DEGREE: Final = math.pi / 180.0
_LARGEST_DROP: Final = 0.45
_THIRD: Final = 2.0 * math.pi / 3.0


def _dead_time(x: float, on: Setting, _chance: Chance) -> Sections:
    return {"inverter": {"dead_time": x * on.T_s}}


def _drops(x: float, on: Setting, chance: Chance) -> Sections:
    u = x * on.u_dc
    return {"inverter": {"u_transistor": u, "u_diode": u * chance.uniform(0.6, 1.4)}}


def _saturation_d(x: float, on: Setting, _chance: Chance) -> Sections:
    return {"saturation": {"L_d_drop": x * _most(on.machine, "L_d_drop")}}


def _saturation_q(x: float, on: Setting, _chance: Chance) -> Sections:
    return {"saturation": {"L_q_drop": x * _most(on.machine, "L_q_drop")}}


def _cross_saturation(x: float, on: Setting, _chance: Chance) -> Sections:
    return {"saturation": {"cross_drop": x * _most(on.machine, "cross_drop")}}


def _iron_loss(x: float, on: Setting, chance: Chance) -> Sections:
    R_c = on.back_emf / (x * on.machine.i_rated)
    return {
        "iron_loss": {
            "R_c": R_c, "omega_h": on.omega_e * chance.uniform(0.0, 1.0), "lag": chance.log_uniform(5e-5, 2e-4)
        }
    }  # fmt: skip


def _winding_heat(x: float, on: Setting, chance: Chance) -> Sections:
    C_w = on.P_copper * on.length / x
    R_wh = on.length * chance.log_uniform(0.5, 5.0) / C_w
    return {
        "thermal": {
            "C_w": C_w, "C_h": 20.0 * C_w, "C_m": 10.0 * C_w, "R_wh": R_wh, "R_mh": 100.0 * R_wh, "R_ha": R_wh,
        }
    }  # fmt: skip


def _magnet_heat(x: float, on: Setting, chance: Chance) -> Sections:
    # Surroundings that are x warmer heat housing and magnets; the winding is cooled and keeps its resistance
    C_w = on.P_copper * on.length
    R_wh = 1e3 * on.length / C_w
    C_h = 100.0 * C_w
    C_m = 0.01 * C_h
    return {
        "thermal": {
            "C_w": C_w, "C_h": C_h, "C_m": C_m, "R_wh": R_wh, "alpha": 0.0, "ambient": REFERENCE + x,
            "R_ha": max(0.02 * on.length, 200.0 * on.T_s) / C_h, "R_mh": on.length * chance.uniform(0.2, 1.0) / C_m,
        }
    }  # fmt: skip


def _demagnetisation(x: float, on: Setting, chance: Chance) -> Sections:
    return {"demagnetisation": {"share": x, "time": on.length * chance.uniform(0.25, 0.75)}}


def _flux_harmonics(x: float, _on: Setting, chance: Chance) -> Sections:
    # All of x: the root of the squares of the four
    parts = [chance.uniform(-1.0, 1.0) * weight for weight in (1.0, 1.0, 0.5, 0.5)]
    whole = math.hypot(*parts)
    return {
        "harmonics": {
            name: x * part / whole for name, part in zip(("d_6", "q_6", "d_12", "q_12"), parts, strict=True)
        }
    }


def _inductance_harmonics(x: float, _on: Setting, chance: Chance) -> Sections:
    return {"harmonics": {"inductance": chance.sign() * x}}


def _skin(x: float, _on: Setting, chance: Chance) -> Sections:
    return {"skin": {"rise": x, "frequency": chance.log_uniform(100.0, 1000.0)}}


def _imbalance(x: float, _on: Setting, chance: Chance) -> Sections:
    return {"imbalance": {chance.one_of("abc"): x}}


def _turn_short(x: float, on: Setting, chance: Chance) -> Sections:
    # A share mu of the turns, whose loop adds 2/3 mu^2 back-EMF / (R_t + mu R_s) to the phase's current
    R_s, i, u = on.machine.R_s, x * on.machine.i_rated, 2.0 / 3.0 * on.back_emf
    mu = max(chance.log_uniform(0.02, 0.1), 1.1 * R_s * i / u)
    return {"turn_short": {"share": mu, "R_t": mu**2 * u / i - mu * R_s, "phase": chance.one_of((0, 1, 2))}}


def _around(x: float, chance: Chance) -> tuple[float, float, float]:
    """What a vector of length x and any direction is on the three phases; their sum is zero."""
    direction = chance.angle()
    a, b, c = (x * math.cos(direction - n * _THIRD) for n in range(3))
    return a, b, c


def _current_offset(x: float, on: Setting, chance: Chance) -> Sections:
    a, b, c = _around(x * on.machine.i_rated, chance)
    return {"current_sensing": {"offset_a": a, "offset_b": b, "offset_c": c}}


def _current_gain(x: float, on: Setting, chance: Chance) -> Sections:
    a, b, c = _around(x, chance)
    if on.current_sensors == 2:
        a, b, c = math.copysign(x, a), -math.copysign(x, a), 0.0
    return {"current_sensing": {"gain_a": 1.0 + a, "gain_b": 1.0 + b, "gain_c": 1.0 + c}}


def _current_skew(x: float, on: Setting, chance: Chance) -> Sections:
    phase = chance.one_of("abc")
    return {"current_sensing": {f"skew_{phase if on.current_sensors == 3 else phase.replace('c', 'a')}": x}}


def _angle_offset(x: float, on: Setting, chance: Chance) -> Sections:
    return {"angle_sensing": {"offset": chance.sign() * x / on.machine.n_p}}


def _eccentric_once(x: float, on: Setting, chance: Chance) -> Sections:
    return {"angle_sensing": {"once": x / on.machine.n_p, "once_phase": chance.angle()}}


def _eccentric_twice(x: float, on: Setting, chance: Chance) -> Sections:
    return {"angle_sensing": {"twice": x / on.machine.n_p, "twice_phase": chance.angle()}}


def _voltage_early(_x: float, _on: Setting, _chance: Chance) -> Sections:
    return {"timing": {"shift": 1}}


def _voltage_late(_x: float, _on: Setting, _chance: Chance) -> Sections:
    return {"timing": {"shift": -1}}


def _dc_link_gain(x: float, _on: Setting, chance: Chance) -> Sections:
    return {"voltage_sensing": {"gain": 1.0 + chance.sign() * x}}


def _stray_voltage(x: float, on: Setting, chance: Chance) -> Sections:
    return stray_along(chance.angle(), x * on.u_dc, chance.log_uniform(10.0, 1000.0))


def _telegraph(x: float, on: Setting, chance: Chance) -> Sections:
    return {
        "telegraph": {
            "amplitude": x * on.u_dc, "dwell": on.length * chance.log_uniform(0.005, 0.1), "direction": chance.angle()
        }
    }  # fmt: skip


def _resonance(x: float, on: Setting, chance: Chance) -> Sections:
    # Above the rotor's frequencies, below half the sampling's
    L = on.machine.L_q / x
    omega = 2.0 * math.pi * chance.log_uniform(0.08, 0.25) / on.T_s
    return {"resonance": {"L": L, "C": 1.0 / (omega**2 * L), "R": omega * L / chance.log_uniform(3.0, 15.0)}}


EFFECTS: Final[Mapping[str, Population]] = {
    "dead_time": Population(
        "dead_time over T_s", "1", 0.004, 0.03,
        "0.2 us of small MOSFETs at 20 kHz to 3 us of IGBTs at 10 kHz", _dead_time,
    ),
    "drops": Population(
        "u_transistor over u_dc, the diode's 0.6 to 1.4 of it", "1", 0.002, 0.01,
        "0.5 to 3 V of IGBTs at 300 V, 50 to 250 mV of MOSFETs at 24 V", _drops,
    ),
    "saturation_d": Population(
        "L_d_drop over the most that the machine can have, 0.45 at most", "1", 0.15, 0.9,
        "magnets alone must not saturate the axis beyond what an energy allows", _saturation_d,
    ),
    "saturation_q": Population(
        "L_q_drop over 0.45", "1", 0.15, 0.9, "7 to 40 % at rated current, as published flux maps have", _saturation_q,
    ),
    "cross_saturation": Population(
        "cross_drop over the most that the machine can have, 0.45 at most", "1", 0.15, 0.9,
        "as for the d axis", _cross_saturation,
    ),
    "iron_loss": Population(
        "loss current over i_rated, at rated speed", "1", 0.01, 0.08,
        "iron takes 1 to 8 % of rated power in such machines; hysteresis as much as eddy currents at up to rated speed",
        _iron_loss,
    ),
    "winding_heat": Population(
        "rise of the winding over the recording at rated current, nothing leaving it", "K", 40.0, 200.0,
        "R_s drifts by 1 to 45 % within the recording, by how much current there is", _winding_heat,
    ),
    "magnet_heat": Population(
        "surroundings above the magnets at the start", "K", 8.0, 56.0,
        "psi_f drifts down by 0.6 to 6 % within the recording; 80 degC is the warmest ambient", _magnet_heat,
    ),
    "demagnetisation": Population(
        "share of psi_f lost", "1", 0.01, 0.15, "a hot overload, to a machine that still runs", _demagnetisation,
    ),
    "flux_harmonics": Population(
        "root of the squares of the 6th and 12th harmonics over psi_f", "1", 0.004, 0.05,
        "0.4 % of skewed servo motors to 5 % of concentrated windings", _flux_harmonics,
    ),
    "inductance_harmonics": Population(
        "harmonic of 1/L over 1/L_q", "1", 0.02, 0.15, "slotting", _inductance_harmonics,
    ),
    "skin": Population(
        "rise of R_s at 100 to 1000 Hz", "1", 0.1, 1.5, "stranded wire to hairpins", _skin,
    ),
    "imbalance": Population(
        "excess of one phase's resistance over R_s", "1", 0.05, 0.5, "a warm joint to a bad contact", _imbalance,
    ),
    "turn_short": Population(
        "current that the loop adds over i_rated, at rated speed, by 2 to 10 % of a phase's turns", "1", 0.01, 0.15,
        "a beginning short to one that trips soon", _turn_short,
    ),
    "current_offset": Population(
        "offset of the current vector over i_rated", "1", 0.003, 0.04, "zero drift of Hall sensors and amplifiers",
        _current_offset,
    ),
    "current_gain": Population(
        "difference of the channels' gains from their mean", "1", 0.006, 0.06, "shunts and amplifiers of 0.6 to 6 %",
        _current_gain,
    ),
    "current_skew": Population(
        "time by which one channel is sampled late", "s", 1.5e-6, 1e-5, "converters that take channels in turn",
        _current_skew,
    ),
    "angle_offset": Population(
        "electrical angle", "rad", 0.5 * _DEGREE, 8.0 * _DEGREE, "a careful to a careless commissioning", _angle_offset,
    ),
    "eccentric_once": Population(
        "electrical angle, once per turn", "rad", 0.5 * _DEGREE, 6.0 * _DEGREE, "an encoder off its centre",
        _eccentric_once,
    ),
    "eccentric_twice": Population(
        "electrical angle, twice per turn", "rad", 0.5 * _DEGREE, 6.0 * _DEGREE, "a bent ring, a resolver's amplitudes",
        _eccentric_twice,
    ),
    "voltage_early": Population(
        "control periods", "1", 1.0, 1.0, "the register of the next period is read", _voltage_early,
    ),
    "voltage_late": Population(
        "control periods", "1", 1.0, 1.0, "the register of the last period is read", _voltage_late,
    ),
    "dc_link_gain": Population(
        "error of the dc link's reading", "1", 0.01, 0.1,
        "dividers of 1 to 10 %; below the motor's tolerance it cannot be told from another motor", _dc_link_gain,
    ),
}  # fmt: skip
"""Physics that a library of effects may know, by the names of the classes."""

STRANGERS: Final[Mapping[str, Population]] = {
    "stray_voltage": Population(
        "amplitude over u_dc, 10 to 1000 Hz", "1", 0.004, 0.04, "as much as an inverter loses", _stray_voltage
    ),
    "telegraph": Population(
        "amplitude over u_dc, mean dwell 0.5 to 10 % of the recording", "1", 0.004, 0.04,
        "as much as an inverter loses", _telegraph,
    ),
    "resonance": Population(
        "L_q over the branch's L, resonance at 0.08 to 0.25 of the sampling rate", "1", 0.05, 0.5,
        "the branch carries 5 to 50 % of the motor's ripple", _resonance,
    ),
}  # fmt: skip
"""Disturbances that are in nobody's library."""

FAMILIES: Final[Mapping[str, Mapping[str, Population]]] = {
    "chained": CHAIN, "warmed": OUTSIDE, "miscompensated": COMPENSATED, "humming": HUMMING, "misread": ANGLE_SENSORS,
}  # fmt: skip
"""Kinds that are asked for by name alone, so that all kinds stay as they were: one class of the measuring chain, of
warmth from outside, of dead times that are made up for by too much or too little, of the mains' hum, of angles by
sensors of few periods.
"""

POPULATIONS: Final[Mapping[str, Population]] = {
    **EFFECTS, **STRANGERS, **CHAIN, **OUTSIDE, **COMPENSATED, **HUMMING, **ANGLE_SENSORS,
}  # fmt: skip


def chosen(kind: str, chance: Chance) -> tuple[str, ...]:
    """The classes of a recording of a kind, or of the one class that is asked for by its name."""
    if kind in POPULATIONS:
        return (kind,)
    if kind == "stranger":
        return (chance.one_of(tuple(STRANGERS)),)
    if kind in FAMILIES:
        return (chance.one_of(tuple(FAMILIES[kind])),)
    names: tuple[str, ...] = ()
    for _ in range(KINDS.index(kind)):
        free = [name for name in EFFECTS if not any(_contradict(name, other) for other in names)]
        names = (*names, chance.one_of(free))
    return names


def merged(parts: Sequence[Sections]) -> Sections:
    """Sections of several classes as one."""
    whole: Sections = {}
    for part in parts:
        for section, keys in part.items():
            whole.setdefault(section, {}).update(keys)
    return whole


_EXCLUSIVE: Final = (("voltage_early", "voltage_late"), ("winding_heat", "magnet_heat"))


def _contradict(name: str, other: str) -> bool:
    """One effect twice, or two that set the same keys."""
    return name == other or any(name in pair and other in pair for pair in _EXCLUSIVE)


def _most(machine: Machine, key: str) -> float:
    """The largest drop of one kind that a machine can have alone, by bisection; at most `_LARGEST_DROP`."""
    if _can_have(machine, key, _LARGEST_DROP):
        return _LARGEST_DROP
    low, high = 0.0, _LARGEST_DROP
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _can_have(machine, key, middle) else (low, middle)
    return low


def _can_have(machine: Machine, key: str, drop: float) -> bool:
    sizes = Saturation(**{key: drop})
    try:
        saturation_curve(sizes, machine.L_d, machine.L_q, machine.psi_f, machine.i_rated)
    except ValueError:
        return False
    return True
