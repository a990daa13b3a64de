"""Outside warmth: winding or magnets follow a temperature that no loss of the recording makes, as classes of their own.

A motor beside another one, a cooling circuit that is switched, a drive at work for longer than a recording lasts.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from emulator.bounds import Points
from emulator.conceal.chance import Chance
from emulator.conceal.population import Population, Sections, Setting

_POINTS: Final = 33

Course = Callable[[float], float]
"""Share of the most, over the share of the recording; none at its start."""


def rise(time_constant: float) -> Course:
    """Towards a temperature that stays; the time constant as a share of the recording."""
    whole = 1.0 - math.exp(-1.0 / time_constant)
    return lambda x: (1.0 - math.exp(-x / time_constant)) / whole


def rise_and_fall(peak: float, falls: float) -> Course:
    """Up to its most at `peak`, and by a share of that down again."""
    power = math.log(0.5) / math.log(peak)

    def course(x: float) -> float:
        up = math.sin(math.pi * x**power) ** 2
        return up if x < peak else 1.0 - falls * (1.0 - up)

    return course


def late(begins: float, ends: float) -> Course:
    """From one time to another, smoothly."""

    def course(x: float) -> float:
        part = min(max((x - begins) / (ends - begins), 0.0), 1.0)
        return part * part * (3.0 - 2.0 * part)

    return course


def ramp(x: float) -> float:
    """Evenly all the time."""
    return x


def points_of(course: Course, most: float, length: float) -> Points:
    """Points of time (s) and share."""
    shares = [n / (_POINTS - 1) for n in range(_POINTS)]
    return tuple((x * length, most * course(x)) for x in shares)


def _drawn(chance: Chance, forms: Sequence[str]) -> Course:
    form = chance.one_of(forms)
    if form == "rise":
        return rise(chance.log_uniform(0.2, 1.0))
    if form == "rise and fall":
        return rise_and_fall(chance.uniform(0.35, 0.65), chance.uniform(0.4, 1.0))
    return late(chance.uniform(0.1, 0.4), chance.uniform(0.7, 0.95)) if form == "late" else ramp


def _winding(x: float, on: Setting, chance: Chance) -> Sections:
    course = _drawn(chance, ("rise", "ramp", "late", "rise and fall", "rise and fall"))
    return {"warming": {"winding": points_of(course, x, on.length)}}


def _magnets(x: float, on: Setting, chance: Chance) -> Sections:
    # Those that warm up once and evenly do so by the equation of heat that comes through a housing
    course = _drawn(chance, ("late", "rise and fall", "rise and fall"))
    return {"warming": {"magnets": points_of(course, -x, on.length)}}


OUTSIDE: Final[Mapping[str, Population]] = {
    "winding_warmed": Population(
        "most that R_s rises by", "1", 0.04, 0.4, "10 to 100 K of copper; up, or up and down again", _winding
    ),
    "magnets_warmed": Population(
        "most of psi_f that is lost", "1", 0.006, 0.06, "5 to 55 K of NdFeB; down late, or down and up again", _magnets
    ),
}
"""By the names of the classes."""
