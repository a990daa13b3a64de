"""Sensing errors: gains, offsets and sampling times of the current channels, the encoder's angle, the dc link's gain.

    i_k,measured(t) = gain_k i_k(t + skew_k) + offset_k
    theta_m,measured = theta_m + offset + once sin(theta_m + once_phase) + twice sin(2 theta_m + twice_phase)
    u_dc,measured = gain u_dc + offset

D.-W. Chung, S.-K. Sul, "Analysis and compensation of current measurement error in vector-controlled AC motor drives",
IEEE Trans. Industry Applications, 1998. An offset shows at the electrical frequency in the
rotor frame, unequal gains at twice it; a common gain scales every impedance. An encoder off its centre shows once a
mechanical turn, a bent ring twice; an angle offset turns d into q. A drive that reads its dc link high gives less
voltage than it records.
"""

import math
from typing import Annotated, NamedTuple

from emulator.bounds import Bound
from emulator.kernel import kernel

_GAIN = Bound(low=0.5, high=2.0)
_OFFSET = Bound("A")
_SKEW = Bound("s", low=0.0, high=1e-5)
_ANGLE = Bound("rad", low=-0.6, high=0.6)


class CurrentSensing(NamedTuple):
    """Sizes of the current channels' errors."""

    gain_a: Annotated[float, _GAIN] = 1.0
    gain_b: Annotated[float, _GAIN] = 1.0
    gain_c: Annotated[float, _GAIN] = 1.0
    offset_a: Annotated[float, _OFFSET] = 0.0
    offset_b: Annotated[float, _OFFSET] = 0.0
    offset_c: Annotated[float, _OFFSET] = 0.0
    skew_a: Annotated[float, _SKEW] = 0.0
    skew_b: Annotated[float, _SKEW] = 0.0
    skew_c: Annotated[float, _SKEW] = 0.0


class AngleSensing(NamedTuple):
    """Sizes of the encoder's errors, mechanical angles."""

    offset: Annotated[float, _ANGLE] = 0.0
    once: Annotated[float, _ANGLE] = 0.0
    once_phase: Annotated[float, Bound("rad", low=-7.0, high=7.0)] = 0.0
    twice: Annotated[float, _ANGLE] = 0.0
    twice_phase: Annotated[float, Bound("rad", low=-7.0, high=7.0)] = 0.0


class VoltageSensing(NamedTuple):
    """Sizes of the dc link's reading."""

    gain: Annotated[float, _GAIN] = 1.0
    offset: Annotated[float, Bound("V", low=-100.0, high=100.0)] = 0.0


@kernel
def longest_skew(sensing: CurrentSensing) -> float:
    """Of the three channels (s)."""
    return max(sensing.skew_a, sensing.skew_b, sensing.skew_c)


@kernel
def read_angle(sensing: AngleSensing, theta_m: float) -> float:
    """What the encoder makes of an angle (rad)."""
    offset, once, once_phase, twice, twice_phase = sensing
    return theta_m + offset + once * math.sin(theta_m + once_phase) + twice * math.sin(2.0 * theta_m + twice_phase)


@kernel
def read_voltage(sensing: VoltageSensing, u_dc: float) -> float:
    """What the drive makes of its dc-link voltage (V)."""
    return sensing.gain * u_dc + sensing.offset
