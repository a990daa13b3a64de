"""Dead times that the firmware makes up for by too much or too little, as classes of their own.

Most firmware goes by the sign of its samples; some by a linear zone around zero, or by the commanded current.
"""

from collections.abc import Mapping
from typing import Final

from emulator.conceal.chance import Chance
from emulator.conceal.population import Population, Sections, Setting
from emulator.plant.physics.compensation import BY_COMMAND, BY_SAMPLE, BY_TURNED

_WHY: Final = "a dead time of the data sheet, gates and switches that are slower or faster"


def _compensated(dead_time: float, share: float, on: Setting, chance: Chance) -> Sections:
    by = chance.one_of((BY_TURNED, BY_TURNED, BY_TURNED, BY_SAMPLE, BY_COMMAND))
    zone = chance.happens(0.3)
    width = chance.log_uniform(0.005, 0.05) * on.machine.i_rated
    return {
        "inverter": {"dead_time": dead_time},
        "compensation": {"time": share * dead_time, "width": width if zone else 0.0, "by": by},
    }


def _over(x: float, on: Setting, chance: Chance) -> Sections:
    return _compensated(x * on.T_s, chance.uniform(1.4, 2.2), on, chance)


def _under(x: float, on: Setting, chance: Chance) -> Sections:
    return _compensated(x * on.T_s, chance.uniform(0.3, 0.7), on, chance)


COMPENSATED: Final[Mapping[str, Population]] = {
    "over_compensated": Population(
        "dead_time over T_s, made up for by 1.4 to 2.2 times as much", "1", 0.004, 0.02, _WHY, _over,
    ),
    "under_compensated": Population(
        "dead_time over T_s, made up for by 0.3 to 0.7 times as much", "1", 0.004, 0.02, _WHY, _under,
    ),
}  # fmt: skip
"""By the names of the classes."""
