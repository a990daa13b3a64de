"""The switched bridge: one control period of machine and shaft under the edges of three legs.

A triangular carrier starts each period at its peak, where all legs are low, and has its trough in the middle; a
leg is high while its duty is above the carrier. That makes six edges, symmetric about the middle, and seven
stretches of constant voltage: 000, two active vectors, 111, the same two backwards, 000. Periods begin in the
middle of the zero vector 000, where the current is sampled: the ripple passes through its mean there.

The legs are ideal. What an edge really does is told by two functions, which is where less ideal legs come in:
`moments`, where in a period a voltage may change, and `legs`, what the three legs hold in between.
"""

import math
from typing import NamedTuple

from emulator.frames import clarke
from emulator.kernel import kernel
from emulator.machine import Machine
from emulator.mechanics import Shaft
from emulator.modulation import Duties
from emulator.plant import PlantState, advanced

Moments = tuple[float, float, float, float, float, float, float, float]


class Bridge(NamedTuple):
    """What the inverter is."""

    switched: bool  # edges; else the mean voltage over the whole period
    timer_counts: int  # of the modulator's timer, per control period; 0: ideal


@kernel
def moments(duties: Duties) -> Moments:
    """Start, three rising edges, three falling edges and end of a period, in their order, as fractions of it."""
    a, b, c = duties
    high, low = max(a, b, c), min(a, b, c)
    middle = max(min(a, b), min(max(a, b), c))
    return (
        0.0,
        0.5 - 0.5 * high, 0.5 - 0.5 * middle, 0.5 - 0.5 * low,
        0.5 + 0.5 * low, 0.5 + 0.5 * middle, 0.5 + 0.5 * high,
        1.0,
    )  # fmt: skip


@kernel
def legs(duties: Duties, moment: float) -> tuple[float, float, float]:
    """Voltages of the three legs against the negative rail, as fractions of u_dc, at a moment between edges."""
    carrier = abs(1.0 - 2.0 * moment)
    return (
        1.0 if duties.a > carrier else 0.0,
        1.0 if duties.b > carrier else 0.0,
        1.0 if duties.c > carrier else 0.0,
    )


@kernel
def switched(
    machine: Machine, shaft: Shaft, duties: Duties, u_dc: float, t: float, T: float, sub_steps: int, state: PlantState
) -> PlantState:
    """The state one control period T (s) after t. No integration step is longer than T / sub_steps."""
    edge = moments(duties)
    for n in range(len(edge) - 1):
        begin, end = edge[n], edge[n + 1]
        if end > begin:
            s_a, s_b, s_c = legs(duties, 0.5 * (begin + end))
            u = u_dc * clarke(s_a, s_b, s_c)
            steps = math.ceil((end - begin) * sub_steps - 1e-9)  # a whole number of them, but for rounding
            state = advanced(machine, shaft, u, t + begin * T, (end - begin) * T, max(steps, 1), state)
    return state
