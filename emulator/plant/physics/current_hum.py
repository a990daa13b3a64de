"""Hum of the mains on the current channels: a loop between a sensor's ground and the drive's, a supply's ripple.

    i_k,measured = i_k + amplitude_k cos(2 pi frequency t + phase)

It is added to what a channel reads before it is converted; with two channels the third phase is what the others leave.
A rectified supply hums at twice the mains' frequency. It goes on with the bridge off. A current control answers it, so
that the motor has a current of that frequency, which the channels then hardly show.
"""

import math
from typing import Annotated, NamedTuple

from emulator.bounds import Bound
from emulator.kernel import kernel


class CurrentHum(NamedTuple):
    """Sizes of the hum."""

    a: Annotated[float, Bound("A")] = 0.0
    b: Annotated[float, Bound("A")] = 0.0
    c: Annotated[float, Bound("A")] = 0.0
    frequency: Annotated[float, Bound("Hz", low=0.0, high=1000.0)] = 50.0
    phase: Annotated[float, Bound("rad", low=-7.0, high=7.0)] = 0.0


@kernel
def humming(hum: CurrentHum, t: float) -> float:
    """Share of each channel's amplitude at a time (s)."""
    return math.cos(2.0 * math.pi * hum.frequency * t + hum.phase)
