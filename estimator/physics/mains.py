"""The mains: what hums at their frequency, or at twice it behind a rectifier. In the stationary frame,

    forth exp(j 2 pi f t) + back exp(-j 2 pi f t)        t from the recording's start

Mains keep their frequency within a percent, and better. Where in that range something hums, a spectrum tells: the peak
that stands out most from what is around it. Of steady lines only; derived here.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from estimator.arrays import Array, Vector
from estimator.physics.effect import Parameter, constant, rated
from estimator.physics.rows import Rows

FREQUENCIES: Final = (50.0, 60.0, 100.0, 120.0)
_WITHIN: Final = 0.01  # of each
_AROUND: Final = 0.05  # of each, that a peak is compared with
_BIN: Final = 0.25  # of a turn of what is furthest from the frequency that is looked at: what is summed at once
_FINER: Final = 8  # frequencies of a spectrum for each that the recording's length resolves
_CLOSER: Final = 15  # times that a peak is sought ever more closely
_OF_LINE: Final = 0.3  # turns over the recording, by which a frequency commonly is off


def turning(rows: Rows, frequency: float) -> Vector:
    """exp(j 2 pi f t) at samples."""
    return rows.once(_turning, frequency)


def _turning(rows: Rows, frequency: float) -> Vector:
    return np.exp(2j * math.pi * frequency * rows.clock)


TYPICAL: Final = rated(0.01)
"""A of a hum, commonly."""
FREQUENCY: Final = Parameter(
    "frequency", "Hz", lambda rows: _OF_LINE / rows.span[1], constant((1.0 - _WITHIN) * FREQUENCIES[0]),
    constant((1.0 + _WITHIN) * FREQUENCIES[-1]), shape=True, fine=True,
)  # fmt: skip


def shapes(rows: Rows) -> tuple[tuple[float, ...], ...]:
    """The frequency at which something may hum."""
    return ((rows.hums,),)


def impedance(rows: Rows) -> float:
    """Of the machine at that frequency, ohm."""
    m = rows.machine
    return math.hypot(m.R_s, math.pi * rows.hums * (m.L_d + m.L_q))


def hum_in(v: Vector, clock: Array) -> float:
    """The frequency (Hz), near the mains' or twice theirs, at which a stationary vector hums most plainly; clock: s."""
    return max(_peak(v, clock, f) for f in FREQUENCIES)[1]


def _peak(v: Vector, clock: Array, f: float) -> tuple[float, float]:
    """How far the highest peak near a frequency (Hz) stands out from what is around it, and where it is."""
    width = _BIN / (_AROUND * f)  # s
    place = ((clock - clock[0]) / width).astype(np.intp)
    back, n = np.exp(-2j * math.pi * f * clock), int(place[-1]) + 1
    size = 1 << max(4, (_FINER * n - 1).bit_length())
    both = [np.bincount(place, x.real, n) + 1j * np.bincount(place, x.imag, n) for x in (v * back, v.conj() * back)]
    power = sum((np.abs(np.fft.fft(sums, size)) ** 2 for sums in both), start=np.zeros(size))
    by, middle = np.fft.fftfreq(size, width), width * np.arange(n)
    near, around = np.abs(by) <= _WITHIN * f, np.abs(by) <= _AROUND * f

    def power_at(beside: float) -> float:
        turn = np.exp(-2j * math.pi * beside * middle)
        return sum(abs(complex(sums @ turn)) ** 2 for sums in both)

    best = int(np.argmax(np.where(near, power, -1.0)))
    usual = float(np.median(power[around & ~near])) if bool((around & ~near).any()) else 0.0
    beside, step = float(by[best]), 0.5 / (size * width)
    for _ in range(_CLOSER):
        beside = max((beside - step, beside, beside + step), key=power_at)
        step *= 0.6
    return float(power[best]) / max(usual, 1e-300), f + beside


def of_mains(frequency: float) -> bool:
    """A frequency (Hz) is one at which something of the mains may hum."""
    return any(abs(frequency - f) <= _WITHIN * f for f in FREQUENCIES)


def phasors(sizes: Sequence[float]) -> tuple[complex, complex]:
    """`forth` and `back` of the first four sizes."""
    return complex(sizes[0], sizes[1]), complex(sizes[2], sizes[3])


PARTS: Final = ("forth_alpha", "forth_beta", "back_alpha", "back_beta")
"""Names of the four."""
