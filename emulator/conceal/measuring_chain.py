"""Measuring chains: what lies between motor and recording in a drive, as classes of their own and drawn for every run.

Whoever builds a drive decides on these; a user of it knows few of them.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from emulator.conceal.chance import Chance
from emulator.conceal.population import Population, Sections, Setting

_OF_ANGLE: Final = ("angle_late", "angle_tracked", "angle_signals")
_DEGREE: Final = math.pi / 180.0


class MeasuringChain(NamedTuple):
    """Of one drive."""

    current_sensors: int
    classes: tuple[str, ...]  # of CHAIN

    def beside(self, own: Sequence[str]) -> tuple[str, ...]:
        """Its classes beside a recording's own; Hall sensors are another way of the angle."""
        others = (*own, *(_OF_ANGLE if "hall_displaced" in own else ()))
        return tuple(name for name in self.classes if name not in others)


def drawn_chain(chance: Chance) -> MeasuringChain:
    """Two sensors in most drives; every other one reads currents and angle as they are at an instant."""
    sensors = chance.one_of((2, 2, 3))
    current = chance.one_of(("", "", "currents_averaged", "currents_filtered"))
    angle = chance.one_of(("", "", "", "angle_late", "angle_late", "angle_tracked", "angle_signals"))
    return MeasuringChain(sensors, tuple(name for name in (current, angle) if name))


def _averaged(x: float, _on: Setting, chance: Chance) -> Sections:
    if chance.happens(0.3):
        return {"current_filter": {"samples": round(x) + 1}}
    return {"current_filter": {"periods": round(x)}}


def _filtered(x: float, on: Setting, _chance: Chance) -> Sections:
    return {"current_filter": {"tau": x * on.T_s}}


def _late(x: float, on: Setting, _chance: Chance) -> Sections:
    return {"angle_signal": {"latency": x * on.T_s}}


def _tracked(x: float, on: Setting, chance: Chance) -> Sections:
    return {"angle_signal": {"bandwidth": x / on.T_s, "damping": chance.uniform(0.6, 1.0)}}


def _signals(x: float, _on: Setting, chance: Chance) -> Sections:
    direction = chance.angle()
    return {"angle_signal": {"gain": 2.0 * x * math.cos(direction), "quadrature": 2.0 * x * math.sin(direction)}}


def stray_along(direction: float, amplitude: float, frequency: float) -> Sections:
    """A voltage (V) of a frequency (Hz) along a direction (rad) of the stationary frame."""
    along = {"along_alpha": math.cos(direction), "along_beta": math.sin(direction)}
    return {"stray": {"amplitude": amplitude, "frequency": frequency, **along}}


def _leg_voltages(x: float, on: Setting, chance: Chance) -> Sections:
    return stray_along(chance.angle(), x * on.u_dc, 0.0)


CHAIN: Final[Mapping[str, Population]] = {
    "currents_averaged": Population(
        "periods of a mean, or samples but one", "1", 1.0, 3.0, "sigma-delta converters, firmware's means", _averaged,
    ),
    "currents_filtered": Population(
        "time constant over T_s", "1", 0.2, 1.5, "an RC against the pulses to a filter in firmware", _filtered,
    ),
    "angle_late": Population(
        "latency over T_s", "1", 0.2, 2.0, "a resolver's converter, an encoder on a bus", _late,
    ),
    "angle_tracked": Population(
        "bandwidth of a loop of second order times T_s", "1", 0.003, 0.02, "30 to 200 Hz at 10 kHz", _tracked,
    ),
    "angle_signals": Population(
        "electrical angle, twice an electrical turn", "rad", 0.5 * _DEGREE, 4.0 * _DEGREE,
        "unequal signals, out of quadrature, of a sensor of one period a pole pair", _signals,
    ),
    "leg_voltages": Population(
        "constant voltage over u_dc", "1", 0.0005, 0.005, "unequal delays of the legs' gates", _leg_voltages,
    ),
}  # fmt: skip
"""By the names of the classes."""
