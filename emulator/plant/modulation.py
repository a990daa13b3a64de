"""Space-vector modulation: from a voltage vector to the share of the period that each leg of the bridge is high.

The three phase voltages are lifted together, by the zero-sequence voltage that puts the highest and the lowest
equally far from the rails. This is space-vector modulation with its zero time halved between 000 and 111: H. W.
van der Broeck, H.-C. Skudelny, G. V. Stanke, "Analysis and realization of a pulsewidth modulator based on voltage
space vectors", IEEE Trans. Industry Applications, 1988, doi 10.1109/28.87265.

Knows nothing of transistors: what a bridge makes of its duties is the bridge's matter.
"""

import math
from typing import NamedTuple

from emulator.frames import clarke, phases
from emulator.kernel import kernel


class Duties(NamedTuple):
    """Share of the control period that each leg is to be high, 0 to 1."""

    a: float
    b: float
    c: float


@kernel
def modulated(u: complex, u_dc: float, timer_counts: int, shortest: float = 0.0) -> Duties:
    """Duties for a stationary voltage vector (V), as the timer can set them.

    Beyond the linear range they are cut off at the rails. Pulses that would be shorter than `shortest`, as a share of
    the period, are left out, high ones and low ones.
    """
    u_a, u_b, u_c = phases(u)
    u_0 = -0.5 * (max(u_a, u_b, u_c) + min(u_a, u_b, u_c))
    return Duties(
        _set(0.5 + (u_a + u_0) / u_dc, timer_counts, shortest),
        _set(0.5 + (u_b + u_0) / u_dc, timer_counts, shortest),
        _set(0.5 + (u_c + u_0) / u_dc, timer_counts, shortest),
    )


@kernel
def _set(duty: float, timer_counts: int, shortest: float) -> float:
    """The nearest duty of a timer with so many counts a period; of any fineness where that is 0."""
    duty = min(max(duty, 0.0), 1.0)
    if duty < shortest:
        return 0.0
    if duty > 1.0 - shortest:
        return 1.0
    return math.floor(duty * timer_counts + 0.5) / timer_counts if timer_counts > 0 else duty


@kernel
def voltage_of(duties: Duties, u_dc: float) -> complex:
    """Mean stationary voltage vector (V) of the duties on ideal legs: all that a drive knows of its voltage."""
    return u_dc * clarke(duties.a, duties.b, duties.c)
