"""The inverter's reach: what voltage it can give, averaged over a control period. Knows nothing of the motor.

What pulse-width modulation holds over a period is a vector in the stationary frame; the rotor turns under it.
How it is made of edges is told in `modulation` and `bridge`.
"""

import math

from emulator.kernel import kernel

_LINEAR = 1.0 / math.sqrt(3.0)  # of u_dc: the circle within the hexagon, where linear modulation ends
_CORNER = 2.0 / 3.0  # of u_dc: the hexagon's corners


@kernel
def longest(u_dc: float) -> float:
    """Length (V, peak) of the longest vector of any angle: u_dc / sqrt(3)."""
    return _LINEAR * u_dc


@kernel
def corner(u_dc: float) -> float:
    """Length (V, peak) of the longest vector of all, at six angles: 2/3 u_dc."""
    return _CORNER * u_dc


@kernel
def shortened(u: complex, most: float) -> complex:
    """The voltage vector (V), where it is longer than `most` only so long; its angle stays."""
    length = abs(u)
    return u if length <= most else u * (most / length)


@kernel
def limited(u: complex, u_dc: float) -> complex:
    """The voltage vector (V), shortened to the linear range where it is too long."""
    return shortened(u, _LINEAR * u_dc)
