"""Angles of sensors with one period a pole pair, as classes of their own: harmonics of their signals, Hall edges.

Linear Hall sensors see a magnet's field, which is no sine; digital ones switch where they were glued or soldered.
"""

import math
from collections.abc import Mapping
from typing import Final

from emulator.conceal.chance import Chance
from emulator.conceal.population import Population, Sections, Setting
from emulator.plant.physics.hall import BY_SECTOR, BY_TURN

_DEGREE: Final = math.pi / 180.0
_THIRD: Final = 2.0 * math.pi / 3.0


def _harmonics(x: float, _on: Setting, chance: Chance) -> Sections:
    # A second harmonic h of both signals is h/sqrt(2) of order 3, and of order 1; a third one h is h of order 4
    third = x * chance.uniform(0.2, 1.0) if chance.happens(0.5) else 0.0
    return {
        "angle_signal": {
            "second": math.sqrt(2.0) * x, "second_phase": chance.angle(), "third": third, "third_phase": chance.angle()
        }
    }  # fmt: skip


def _displaced(x: float, _on: Setting, chance: Chance) -> Sections:
    # One is x off, the others within; all three by as much would be an offset of the angle
    way = chance.angle()
    a, b, c = (math.cos(way + n * _THIRD) for n in range(3))
    largest = max(map(abs, (a, b, c))) / x
    names = ("displaced_a", "displaced_b", "displaced_c")
    displaced = {name: value / largest for name, value in zip(names, (a, b, c), strict=True)}
    rate, place = chance.one_of((BY_TURN, BY_SECTOR)), chance.one_of((0.0, 30.0 * _DEGREE))
    return {"hall": {"rate": rate, "place": place, **displaced}}


ANGLE_SENSORS: Final[Mapping[str, Population]] = {
    "signal_harmonics": Population(
        "electrical angle, three times an electrical turn", "rad", 0.5 * _DEGREE, 4.0 * _DEGREE,
        "linear Hall sensors beside a magnet's edge or a ring of few poles", _harmonics,
    ),
    "hall_displaced": Population(
        "electrical angle that the sensor which is most displaced is off", "rad", 1.0 * _DEGREE, 6.0 * _DEGREE,
        "0.2 mm on a ring of 25 mm with 7 pole pairs is 6 degrees", _displaced,
    ),
}  # fmt: skip
"""By the names of the classes."""
