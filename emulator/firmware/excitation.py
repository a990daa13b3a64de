"""Excitation: sequences around the current references, so that the recorded rows tell the parameters.

* levels: each axis steps on its own between equally spaced levels, never to the level it is at, and holds each for
  one, two or three times the shortest hold; pseudo-random
* prbs: each axis jumps between its two ends as a maximum-length shift register says (ITU-T O.150, 511 bits), the q axis
  half a sequence behind the d axis, so that the two are as good as uncorrelated
* multisine: d has the odd and q the even harmonics of a base frequency, so that each line of the spectrum belongs to
  one axis; phases by Schroeder, "Synthesis of low-peak-factor signals and binary sequences with low autocorrelation",
  1970, doi 10.1109/TIT.1970.1054411
* staircase: d climbs from level to level and down again, and holds each; q steps as under levels

Knows nothing of currents: all are fractions from -1 to 1.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from emulator.kernel import kernel
from emulator.noise import uniform

KINDS: Final = ("none", "levels", "prbs", "multisine", "staircase")  # by number
LEVELS_KIND, PRBS, MULTISINE, STAIRCASE = 1, 2, 3, 4
LEVELS = 5
LONGEST_HOLD = 3
MOST_SINES = 16  # an axis
FASTEST_SINE: Final = 0.25  # of the control's frequency
PRBS_LENGTH = 511  # bits, of the register x^9 + x^5 + 1
_AXIS_D, _AXIS_Q = 11, 12  # sources of random numbers


class Axis(NamedTuple):
    """Where one axis' excitation is."""

    level: int  # from 0
    left: int  # periods until the next step
    drawn: int  # steps drawn since the start; under prbs the shift register


class Excited(NamedTuple):
    """Where the excitation is."""

    kind: int  # that it is under way with; another begins anew
    d: Axis
    q: Axis


AXIS_AT_REST = Axis(LEVELS // 2, 0, 0)
AT_REST = Excited(0, AXIS_AT_REST, AXIS_AT_REST)


@kernel
def stepped(axis: Axis, hold: int, seed: int, source: int) -> Axis:
    """The axis one control period later; `hold` is the shortest hold in periods."""
    if axis.left > 1:
        return Axis(axis.level, axis.left - 1, axis.drawn)
    other = 1 + int(uniform(seed, source, 2 * axis.drawn) * (LEVELS - 1))
    times = 1 + int(uniform(seed, source, 2 * axis.drawn + 1) * LONGEST_HOLD)
    return Axis((axis.level + other) % LEVELS, times * hold, axis.drawn + 1)


@kernel
def shifted(register: int) -> int:
    """The shift register one bit later: x^9 + x^5 + 1."""
    return (register << 1 | (register >> 8 ^ register >> 4) & 1) & PRBS_LENGTH


@kernel
def jumped(axis: Axis, hold: int, seed: int, ahead: int) -> Axis:
    """The axis of two levels one control period later. It starts `ahead` bits of the sequence after another."""
    if axis.left > 1:
        return Axis(axis.level, axis.left - 1, axis.drawn)
    register = axis.drawn
    if register == 0:
        register = 1 + int(uniform(seed, _AXIS_D, 0) * PRBS_LENGTH)
        for _ in range(ahead):
            register = shifted(register)
    register = shifted(register)
    return Axis(register & 1, hold, register)


@kernel
def climbed(axis: Axis, hold: int, levels: int) -> Axis:
    """The axis of so many levels one control period later: up from the lowest, and down again."""
    if axis.left > 1:
        return Axis(axis.level, axis.left - 1, axis.drawn)
    place = axis.drawn % (2 * levels - 2)
    return Axis(min(place, 2 * levels - 2 - place), hold, axis.drawn + 1)


@kernel
def fraction(axis: Axis, levels: int = LEVELS) -> float:
    """The axis' level, of so many, as a fraction from -1 to 1."""
    return 2.0 * min(axis.level, levels - 1) / (levels - 1) - 1.0


def _peaks() -> NDArray[np.float64]:
    """Highest value of the sum of 1 to `MOST_SINES` sines of amplitude 1, odd and even harmonics."""
    points = 16384
    peaks = np.empty((2, MOST_SINES))
    for first in (1, 2):
        for count in range(1, MOST_SINES + 1):
            n = np.arange(1, count + 1)
            spectrum = np.zeros(points // 2 + 1, np.complex128)
            spectrum[first + 2 * (n - 1)] = 0.5 * points * np.exp(-1j * np.pi * n**2 / count)
            peaks[first - 1, count - 1] = np.abs(np.fft.irfft(spectrum)).max()
    return peaks


_PEAKS = _peaks()


@kernel
def multisine(first: int, count: int, frequency: float, t: float) -> float:
    """Sum at time t (s) of `count` sines of one amplitude, every other harmonic of `frequency` (Hz) from `first` on.

    `first`: 1 or 2. Its peaks are 1.
    """
    angle, total = 2.0 * math.pi * frequency * t, 0.0
    for n in range(1, count + 1):
        total += math.cos((first + 2 * (n - 1)) * angle - math.pi * n**2 / count)
    return total / _PEAKS[first - 1, count - 1]


def highest_sine(frequency: float, count: float) -> float:
    """Highest frequency (Hz) of a multisine of `count` sines an axis."""
    return 2 * count * frequency


@kernel
def excited(
    before: Excited, kind: int, hold: int, level_hold: int, levels: int, sines: int, frequency: float, seed: int,
    t: float,
) -> tuple[Excited, float, float]:
    """The excitation one control period later, at time t (s), and the fractions of d and q.

    `hold`: the shortest hold in periods, `level_hold` that of a stair; `levels`: stairs; `sines`: an axis.
    """
    d, q = before.d, before.q
    if kind != before.kind:
        d, q = AXIS_AT_REST, AXIS_AT_REST
    if kind == LEVELS_KIND:
        d, q = stepped(d, hold, seed, _AXIS_D), stepped(q, hold, seed, _AXIS_Q)
        return Excited(kind, d, q), fraction(d), fraction(q)
    if kind == PRBS:
        d, q = jumped(d, hold, seed, PRBS_LENGTH // 2), jumped(q, hold, seed, 0)
        return Excited(kind, d, q), fraction(d, 2), fraction(q, 2)
    if kind == MULTISINE:
        return Excited(kind, d, q), multisine(1, sines, frequency, t), multisine(2, sines, frequency, t)
    if kind == STAIRCASE:
        d, q = climbed(d, level_hold, levels), stepped(q, hold, seed, _AXIS_Q)
        return Excited(kind, d, q), fraction(d, levels), fraction(q)
    return Excited(kind, d, q), 0.0, 0.0
