"""Sine voltages on one axis of a standing motor as harmonics: what was told, what was measured, how well.

A tone is a stretch at one frequency. Legs' duties and the dc link make the voltage. Of three measured phase currents
whose sum is not zero the reading is Clarke's, which gives each sensor an equal part in it. Knows nothing of models.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, cast

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array, Vector

ORDERS: Final = 7  # harmonics of a waveform
LEGS: Final = np.exp(2j * math.pi / 3.0 * np.arange(3))  # directions of the phases
_POINTS: Final = 128  # of a waveform
_VISIBLE: Final = 0.45  # of the sampling rate
_FEWEST_PERIODS: Final = 1.9
_FEWEST_ROWS: Final = 5  # of a period
_ON_AXIS: Final = 0.03  # of a voltage may stand across its axis
_PART_OF_SUM: Final = math.sqrt(2.0) / 3.0  # that is the error along an axis, where three sensors are equally wrong
_FOURIER: Final = np.exp(2j * math.pi * np.outer(np.arange(ORDERS + 1), np.arange(_POINTS)) / _POINTS)


@dataclass(frozen=True, slots=True, eq=False)
class Tone:
    """A stretch at one frequency."""

    frequency: float  # Hz
    T_s: float  # s, between rows
    t: Array  # s
    duties: Array  # (rows, 3): shares of the dc link that the legs are told; a part common to all does not count
    u_dc: Array  # V
    i: Array  # (rows, 3): phase currents, A


@dataclass(frozen=True, slots=True, eq=False)
class Tones:
    """A sweep as harmonics: complex amplitudes, orders 0 to ORDERS in the last axis."""

    rows: tuple[Tone, ...]
    frequency: Array  # (tones,) Hz
    T_s: float  # s, the shortest sampling period: stands for the control's
    angle: float  # rad, of the voltage's axis from that of phase a
    duty: Vector  # (tones, orders) along it
    u_dc: Vector  # V
    i: Vector  # A, along it; without a mean, which a voltage without one does not drive
    across: Vector  # (tones,) A, fundamental across it
    total: Vector  # A, sum of the three currents as measured
    visible: NDArray[np.bool_]  # (tones, orders): below half the sampling rate
    noise: Array  # (tones,) A: standard error of the fundamental, by its scatter from period to period

    @property
    def omega(self) -> Array:
        """rad/s."""
        return 2.0 * math.pi * self.frequency

    @property
    def largest(self) -> float:
        """The largest amplitude of current, A."""
        return float(np.max(np.abs(self.i[:, 1])))

    @property
    def doubt(self) -> Array:
        """How wrong each harmonic of current is, as the sum of the currents says, A."""
        return _PART_OF_SUM * np.abs(self.total)

    def blaming(self, phase: int) -> "Tones":
        """These tones, were all of the sum that phase's sensor's error."""
        only = np.arange(3) == phase
        return tones_of([replace(tone, i=tone.i - only * tone.i.sum(axis=1, keepdims=True)) for tone in self.rows])


def tones_of(stretches: Sequence[Tone]) -> Tones:
    """Stretches as harmonics, by frequency. Raises ValueError where they are no sweep of one axis."""
    stretches = sorted(stretches, key=lambda tone: tone.frequency)
    for tone in stretches:
        _check(tone)
    angle = _voltage_axis(stretches)
    toward = 2.0 / 3.0 * np.cos(angle - np.angle(LEGS))
    sideways = 2.0 / 3.0 * np.cos(angle + 0.5 * math.pi - np.angle(LEGS))
    i = np.stack([harmonics(tone, tone.i @ toward) for tone in stretches])
    i[:, 0] = 0.0
    return Tones(
        rows=tuple(stretches),
        frequency=np.array([tone.frequency for tone in stretches]),
        T_s=min(tone.T_s for tone in stretches),
        angle=angle,
        duty=np.stack([harmonics(tone, tone.duties @ toward) for tone in stretches]),
        u_dc=np.stack([harmonics(tone, tone.u_dc) for tone in stretches]),
        i=i,
        across=np.array([harmonics(tone, tone.i @ sideways)[1] for tone in stretches]),
        total=np.stack([harmonics(tone, tone.i.sum(axis=1)) for tone in stretches]),
        visible=np.array([[k <= _orders_of(tone) for k in range(ORDERS + 1)] for tone in stretches]),
        noise=np.array([_scatter_of_tone(tone, tone.i @ toward) for tone in stretches]),
    )


def waveform(amplitudes: Vector) -> Array:
    """A period of what has these harmonics."""
    return (amplitudes @ _FOURIER).real


def amplitudes(wave: Array) -> Vector:
    """Harmonics of a period."""
    found = cast(Vector, 2.0 / _POINTS * (wave @ _FOURIER.conj().T))
    found[..., 0] *= 0.5
    return found


def harmonics(tone: Tone, y: Array) -> Vector:
    """Harmonics that fit a column best, as far as the sampling shows them."""
    orders = np.arange(1, _orders_of(tone) + 1)
    phase = 2.0 * math.pi * tone.frequency * np.outer(tone.t, orders)
    terms = np.column_stack([np.ones(len(y)), np.cos(phase), np.sin(phase)])
    c = np.linalg.lstsq(terms, y, rcond=None)[0]
    found = np.zeros(ORDERS + 1, np.complex128)
    found[0] = c[0]
    found[orders] = c[orders] - 1j * c[len(orders) + orders]
    return found


def _orders_of(tone: Tone) -> int:
    return min(ORDERS, int(_VISIBLE / (tone.T_s * tone.frequency)))


def _check(tone: Tone) -> None:
    f = f"at {tone.frequency:g} Hz"
    periods, rows = len(tone.t) * tone.T_s * tone.frequency, 1.0 / (tone.T_s * tone.frequency)
    if periods < _FEWEST_PERIODS:
        raise ValueError(f"expected at least two periods of every frequency, got {periods:.2g} {f}")
    if rows < _FEWEST_ROWS:
        raise ValueError(f"expected at least {_FEWEST_ROWS} rows a period, got {rows:.2g} {f}")
    if not np.ptp(tone.duties) > 0.0 or not np.ptp(tone.i) > 0.0:
        raise ValueError(f"expected a voltage and a current that alternate, got constant ones {f}")


def _voltage_axis(stretches: Sequence[Tone]) -> float:
    """Angle of the axis that the voltage is on, rad."""
    vectors = [tone.duties @ LEGS for tone in stretches]
    centred = np.concatenate([z - z.mean() for z in vectors])
    angle = 0.5 * float(np.angle(np.sum(centred**2)))
    beside = centred * np.exp(-1j * angle)
    if np.linalg.norm(beside.imag) > _ON_AXIS * np.linalg.norm(beside.real):
        raise ValueError("expected voltages along one axis, got vectors that turn")
    return angle


def _scatter_of_tone(tone: Tone, y: Array) -> float:
    """Standard error of a fundamental by its scatter from period to period."""
    rows = 1.0 / (tone.T_s * tone.frequency)
    periods = int(len(y) / rows)
    phase = 2.0 * math.pi * tone.frequency * tone.t
    found: list[complex] = []
    for k in range(periods):
        at = slice(round(k * rows), round((k + 1) * rows))
        terms = np.column_stack([np.ones(len(y[at])), np.cos(phase[at]), np.sin(phase[at])])
        c = np.linalg.lstsq(terms, y[at], rcond=None)[0]
        found.append(complex(c[1], -c[2]))
    return float(np.std(found, ddof=1)) / math.sqrt(periods) if periods > 1 else 0.0
