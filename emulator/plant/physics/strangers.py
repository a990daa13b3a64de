"""Strangers: disturbances that no library of drive physics holds.

*Stray voltage*, coupled in between bridge and motor, along one direction of the stationary frame:

    u_s = amplitude cos(2 pi frequency t) (along_alpha + j along_beta)

*Telegraph*: a voltage offset in the stationary frame that is there or not, by chance, for times of mean `dwell`:

    u_t = amplitude s(t) exp(j direction)        s in {0, 1}

*Resonance*: a series branch of R, L and C per phase at the motor's terminals, as a filter or a long cable makes:

    L di/dt = u - R i - v        C dv/dt = i        the bridge carries i beside the motor's current

They show where they like, which is their point.
"""

import math
from typing import Annotated, NamedTuple

from emulator.bounds import Bound
from emulator.frames import turned
from emulator.kernel import kernel
from emulator.noise import uniform

_TELEGRAPH = 31  # source of noise


class Stray(NamedTuple):
    """Sizes of a stray voltage."""

    amplitude: Annotated[float, Bound("V", low=0.0)] = 0.0
    frequency: Annotated[float, Bound("Hz", low=0.0, high=5000.0)] = 90.0
    along_alpha: Annotated[float, Bound(low=-1.0, high=1.0)] = 1.0  # direction in the stationary frame
    along_beta: Annotated[float, Bound(low=-1.0, high=1.0)] = 0.0


class Telegraph(NamedTuple):
    """Sizes of a telegraph offset."""

    amplitude: Annotated[float, Bound("V", low=0.0)] = 0.0
    dwell: Annotated[float, Bound("s", above=0.0)] = 0.05
    direction: Annotated[float, Bound("rad", low=-7.0, high=7.0)] = 0.0


class Resonance(NamedTuple):
    """Sizes of a branch at the terminals; none where C is zero."""

    C: Annotated[float, Bound("F", low=0.0)] = 0.0
    L: Annotated[float, Bound("H", above=0.0)] = 1e-3
    R: Annotated[float, Bound("ohm", low=0.0)] = 0.5


@kernel
def stray_voltage(stray: Stray, t: float) -> complex:
    """u_s (V, stationary) at a time (s)."""
    u = stray.amplitude * math.cos(2.0 * math.pi * stray.frequency * t)
    return complex(u * stray.along_alpha, u * stray.along_beta)


@kernel
def telegraph_voltage(telegraph: Telegraph, there: bool) -> complex:
    """u_t (V, stationary)."""
    return telegraph.amplitude * turned(telegraph.direction) if there else 0j


@kernel
def keyed(telegraph: Telegraph, there: bool, T_s: float, seed: int, tick: int) -> bool:
    """Whether the offset is there one control period T_s (s) later."""
    return not there if uniform(seed, _TELEGRAPH, tick) < T_s / telegraph.dwell else there


def stored_energy(resonance: Resonance, i: complex, v: complex) -> float:
    """Energy (J) in coil and capacitor."""
    return 0.75 * (resonance.L * abs(i) ** 2 + resonance.C * abs(v) ** 2)
