"""Excitation: pseudo-random steps of the current references, so that the recorded rows tell the parameters.

Each axis steps on its own between equally spaced levels, never to the level it is at, and holds each for one,
two or three times the shortest hold. Knows nothing of currents: levels are fractions from -1 to 1.
"""

from typing import NamedTuple

from emulator.kernel import kernel
from emulator.noise import uniform

LEVELS = 5
LONGEST_HOLD = 3


class Axis(NamedTuple):
    """Where one axis' excitation is."""

    level: int  # 0 to LEVELS - 1
    left: int  # periods until the next step
    drawn: int  # steps drawn since the start


AXIS_AT_REST = Axis(LEVELS // 2, 0, 0)


@kernel
def stepped(axis: Axis, hold: int, seed: int, source: int) -> Axis:
    """The axis one control period later; `hold` is the shortest hold in periods."""
    if axis.left > 1:
        return Axis(axis.level, axis.left - 1, axis.drawn)
    other = 1 + int(uniform(seed, source, 2 * axis.drawn) * (LEVELS - 1))
    times = 1 + int(uniform(seed, source, 2 * axis.drawn + 1) * LONGEST_HOLD)
    return Axis((axis.level + other) % LEVELS, times * hold, axis.drawn + 1)


@kernel
def fraction(axis: Axis) -> float:
    """The axis' level as a fraction from -1 to 1."""
    return 2.0 * axis.level / (LEVELS - 1) - 1.0
