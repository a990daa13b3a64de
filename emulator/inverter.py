"""The inverter's reach: what voltage it can give, averaged over a control period. Knows nothing of the motor.

What pulse-width modulation holds over a period is a vector in the stationary frame; the rotor turns under it.
How it is made of edges is told in `modulation` and `bridge`.
"""

import math

from emulator.kernel import kernel

_LINEAR = 1.0 / math.sqrt(3.0)  # of u_dc: the circle within the hexagon, where linear modulation ends


@kernel
def longest(u_dc: float) -> float:
    """Length (V, peak) of the longest vector of any angle: u_dc / sqrt(3)."""
    return _LINEAR * u_dc


@kernel
def limited(u: complex, u_dc: float) -> complex:
    """The voltage vector (V), shortened to the linear range where it is too long; its angle stays."""
    length = abs(u)
    most = _LINEAR * u_dc
    return u if length <= most else u * (most / length)
