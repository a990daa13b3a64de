"""Spectra of flux errors, in which the noise is white: lines, bands, and orders of the rotor's turning.

Knows nothing of effects.
"""

import cmath
import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from estimator.flux_balance import TURN
from estimator.mismatch.averages import Array
from estimator.mismatch.columns import filter_pole
from estimator.physics.rows import Rows, Vector

SEGMENT: Final = 256  # periods of a Welch spectrum
_ORDER_TURNS: Final = 8.0  # of the order's base, over which an order's amplitude may change
_BLOCK: Final = 64  # periods that are summed before a line's frequency is refined
_SPARSE: Final = 3.0  # longest time grid, over the periods there are


@dataclass(frozen=True, slots=True)
class Line:
    """v = forth exp(j 2 pi f t) + back exp(-j 2 pi f t), V in the frame it was looked for in, t from the first sample."""

    frequency: float  # Hz
    forth: complex
    back: complex
    gain: float  # energy of the flux error (Vs^2, summed) that it explains

    @property
    def amplitude(self) -> float:
        """Of the longer axis of its ellipse, V."""
        return abs(self.forth) + abs(self.back)

    @property
    def narrow(self) -> float:
        """The shorter axis over the longer one: 0 along a line, 1 for a circle."""
        return abs(abs(self.forth) - abs(self.back)) / max(self.amplitude, 1e-300)

    @property
    def direction(self) -> float:
        """Of the longer axis, rad, 0 to pi from the frame's real axis."""
        return (0.5 * cmath.phase(self.forth * self.back)) % math.pi if self.back else 0.0


def response(rows: Rows, f: Array | float) -> Vector | np.complex128:
    """What the whitening filter makes of a stationary voltage of frequency f (Hz): Vs per V."""
    turn = np.exp(1j * TURN * np.asarray(f) * rows.T_s)
    return rows.T_s / (turn - filter_pole(rows.machine, rows.T_s))


def on_grid(rows: Rows, z: Vector) -> Vector:
    """z with zeros in the gaps between runs, so that a line goes on; without them where they are most of the time."""
    place = np.rint((rows.t[1:] - rows.t[0]) / rows.T_s).astype(np.intp) - 1
    if place[-1] + 1 == len(z) or place[-1] + 1 > _SPARSE * len(z) or (np.diff(place) <= 0).any():
        return z
    grid = np.zeros(place[-1] + 1, np.complex128)
    grid[place] = z
    return grid


def strongest_line(rows: Rows, z: Vector, lowest: float, highest: float) -> Line | None:
    """The line of a flux error (Vs, in the frame to look in) that explains most of its energy, lowest to highest Hz."""
    x = on_grid(rows, z)
    n = len(x)
    size = 1 << max(4, (n - 1).bit_length())
    X = np.fft.fft(x, size)
    df = 1.0 / (size * rows.T_s)
    k = np.arange(max(2, math.ceil(lowest / df)), min(size // 2, math.floor(highest / df)))
    if len(k) == 0:
        return None
    coarse = float(k[np.argmax(np.abs(X[k]) ** 2 + np.abs(X[-k]) ** 2)]) * df
    forth, back = (_shifted(x, s * coarse * rows.T_s) for s in (1.0, -1.0))
    middle = (np.arange(len(forth)) + 0.5) * _BLOCK * rows.T_s

    def sums(f: float) -> tuple[complex, complex]:
        turning = np.exp(-1j * TURN * (f - coarse) * middle)
        return complex(forth @ turning), complex(back @ turning.conj())

    def power(f: float) -> float:
        a, b = sums(f)
        return abs(a) ** 2 + abs(b) ** 2

    f, width = coarse, df
    for _ in range(30):  # the golden section's poor cousin: three points, ever closer
        f = max((f - width, f, f + width), key=power)
        width *= 0.7
    a, b = sums(f)
    there = int(np.count_nonzero(x)) or 1
    up, down = (complex(response(rows, s * f)) for s in (1.0, -1.0))
    late = cmath.exp(0.5j * TURN * f * rows.T_s)  # a period's mean voltage is that of its middle
    return Line(f, a / there / up / late, b / there / down * late, (abs(a) ** 2 + abs(b) ** 2) / there)


def _shifted(x: Vector, turns: float) -> Vector:
    """Sums over blocks of x exp(-j 2 pi turns k)."""
    padded = np.concatenate((x, np.zeros(-len(x) % _BLOCK)))
    return (padded * np.exp(-1j * TURN * turns * np.arange(len(padded)))).reshape(-1, _BLOCK).sum(axis=1)


def energy_of_orders(rows: Rows, z: Vector, orders: Array, turns_per_order: float) -> tuple[Array, float]:
    """Energy (Vs^2) of z exp(-j order theta_e) that is steady for some turns, by order; and that of z in them."""
    theta = rows.theta_e[1:]
    travelled = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(theta)))))
    block = np.floor(travelled / (TURN * _ORDER_TURNS * turns_per_order)).astype(np.intp)
    starts = np.flatnonzero(np.concatenate(([True], np.diff(block) > 0)))
    counts = np.diff(np.concatenate((starts, [len(z)])))
    if len(starts) < 2:
        return np.zeros(len(orders)), 0.0
    energy = np.empty(len(orders))
    for j, order in enumerate(orders):
        sums = np.add.reduceat(z * np.exp(-1j * order * theta), starts)
        energy[j] = float(np.sum(np.abs(sums) ** 2 / counts))
    return energy, float(np.mean(counts))


def welch(z: Vector, segment: int = SEGMENT) -> Array:
    """Mean power (Vs^2) of each of `segment` frequencies, as numpy's FFT orders them; of white noise its variance."""
    n = min(segment, len(z))
    hann = np.hanning(n + 1)[:-1]
    step = n // 2
    blocks = np.lib.stride_tricks.sliding_window_view(z, n)[::step]
    return np.mean(np.abs(np.fft.fft(blocks * hann, axis=1)) ** 2, axis=0) / float(hann @ hann)


def white_level(x: Array) -> float:
    """Standard deviation of the white part of a channel, whatever lines and colours stand above it."""
    power = welch(x.astype(np.complex128))
    return math.sqrt(float(np.median(power[len(power) // 16 : len(power) // 2])))
