"""What hums at the mains' frequency, or at twice it behind a rectifier, as classes of their own: sensors, and leads."""

from collections.abc import Mapping
from typing import Final

from emulator.conceal.chance import Chance
from emulator.conceal.measuring_chain import stray_along
from emulator.conceal.population import Population, Sections, Setting

_OFF: Final = 1e-3  # of its frequency, by which the mains' is off at most


def _frequency(chance: Chance) -> float:
    return chance.one_of((50.0, 50.0, 50.0, 60.0, 60.0, 100.0, 120.0)) * (1.0 + chance.uniform(-_OFF, _OFF))


def _current_hum(x: float, on: Setting, chance: Chance) -> Sections:
    # One channel has the most; in a half of drives the others have some
    there, first = "abc"[: on.current_sensors], chance.one_of(range(on.current_sensors))
    others = 1.0 if chance.happens(0.5) else 0.0
    share = {k: 1.0 if n == first else others * chance.uniform(-1.0, 1.0) for n, k in enumerate(there)}
    most = x * on.machine.i_rated
    amplitudes: dict[str, float] = {k: most * each for k, each in share.items()}
    return {"current_hum": {**amplitudes, "frequency": _frequency(chance), "phase": chance.angle()}}


def _mains_voltage(x: float, on: Setting, chance: Chance) -> Sections:
    return stray_along(chance.angle(), x * on.u_dc, _frequency(chance))


HUMMING: Final[Mapping[str, Population]] = {
    "current_hum": Population(
        "most of a channel's amplitude over i_rated, 50, 60, 100 or 120 Hz", "1", 0.003, 0.03,
        "ground loops, supplies' ripple; such as a careful layout leaves to one that disturbs the torque", _current_hum,
    ),
    "mains_voltage": Population(
        "amplitude over u_dc, 50, 60, 100 or 120 Hz", "1", 0.0005, 0.01, "coupled into leads beside others",
        _mains_voltage,
    ),
}  # fmt: skip
"""By the names of the classes."""
