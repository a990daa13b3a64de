"""Spectra of flux errors, in which the noise is white: lines, and orders of the rotor's turning.

Knows nothing of effects.
"""

import cmath
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array, Vector
from estimator.diagnosis.likelihood.averages import energy_of, parts, sizes_in, whole, without_columns
from estimator.diagnosis.likelihood.noise import filter_of, whitened
from estimator.diagnosis.likelihood.whitening import Whitening
from estimator.kernel import kernel
from estimator.online.flux_balance import TURN
from estimator.physics.rows import Rows

_WELCH_SEGMENT: Final = 256  # periods of a Welch spectrum
_ORDER_TURNS: Final = 8  # over which an order's amplitude is steady
_BLOCK: Final = 64  # periods that are summed before a line's frequency is refined
_SPARSE: Final = 3.0  # longest time by the clock, over the periods there are
_FAR_LESS: Final = 0.2  # of an energy: a line between two frequencies of a spectrum shows half of its own
_LINE_STEPS: Final = 8  # of Newton's, to a line beside the machine
_OWN_ENERGY: Final = 0.1  # of a line: with less beside the machine it is none, as the rotor's frequency at one speed
_SAME_LINE: Final = 1e-5  # periods of a line over the whole recording: a step that changes nothing


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """forth exp(j 2 pi f t) + back exp(-j 2 pi f t), V in the frame it was looked for in, t from the first period."""

    frequency: float  # Hz
    forth: complex
    back: complex
    flux: Vector  # Vs, rotor frame: what it makes of the flux error
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
        """Of the longer axis, rad, within a right angle of the frame's real axis."""
        return 0.5 * cmath.phase(self.forth * self.back)


def _of_lines(voltages: Iterable[Vector], by: Whitening) -> Array:
    """Flux errors of voltages (rotor frame) and of the same a right angle ahead; see `parts`."""
    return np.array([parts(whitened(turned, by)) for v in voltages for turned in (v, 1j * v)])


def _periods_by_clock(rows: Rows) -> NDArray[np.intp]:
    """Number of each period from 0, so that a line goes on over gaps; without these where they are most of the time."""
    place = np.rint((rows.t[1:] - rows.t[1]) / rows.T_s).astype(np.intp)
    if place[-1] >= _SPARSE * len(rows) or (np.diff(place) <= 0).any():
        return np.arange(len(rows))
    return place


def strongest_line(rows: Rows, z: Vector, frame: str, lowest: float, highest: float, least: float = 0.0) -> Line | None:
    """The line of a flux error (Vs, rotor frame) that explains most of it in a frame, lowest to highest Hz.

    None where it explains far less than `least` (Vs^2, summed), or the recording is too short. Its frequency is that
    at which the flux error holds most; its voltage, what explains most at that frequency.
    """
    place = _periods_by_clock(rows)
    n = int(place[-1]) + 1
    x = np.zeros(n, np.complex128)
    x[place] = z * rows.rotor[1:] if frame == "stationary" else z
    size = 1 << max(4, (n - 1).bit_length())
    X = np.fft.fft(x, size)
    df = 1.0 / (size * rows.T_s)
    first, end = max(2, math.ceil(lowest / df)), min(size // 2, math.floor(highest / df))
    if end <= first:
        return None
    ahead, astern = X[first:end], X[size - first : size - end : -1]
    powers = ahead.real**2 + ahead.imag**2 + astern.real**2 + astern.imag**2
    peak = int(np.argmax(powers))
    if peak > 0 and powers[peak] < _FAR_LESS * least * len(z):  # at the edge it may be slower still
        return None
    coarse = (first + peak) * df
    forth, back = _shifted(x, coarse * rows.T_s)
    middle = (_BLOCK * (np.arange(len(forth)) + 0.5) - 0.5) * rows.T_s

    def sums(f: float) -> tuple[complex, complex]:
        turning = np.exp(-1j * TURN * (f - coarse) * middle)
        return complex(forth @ turning), complex(back @ turning.conj())

    def power(f: float) -> float:
        a, b = sums(f)
        return abs(a) ** 2 + abs(b) ** 2

    f, width = coarse, df
    for _ in range(30):  # three points, ever closer
        f = max((f - width, f, f + width), key=power)
        width *= 0.7
    turning = np.exp(1j * TURN * f * rows.T_s * place)
    voltages = turning, turning.conj()
    if frame == "stationary":
        voltages = (rows.stationary(v) for v in voltages)
    columns = _of_lines(voltages, filter_of(rows, rows.machine))
    sizes = sizes_in(columns, z)
    flux = whole(sizes @ columns)
    return Line(f, complex(*sizes[:2]), complex(*sizes[2:]), flux, energy_of(z) - energy_of(z - flux))


def line_beside(rows: Rows, z: Vector, machine: Array, line: Line) -> Line | None:
    """The line (stationary frame) that explains most of a flux error beside columns of the machine, sought from one on.

    machine: (m, 2 n), real parts before imaginary ones. Fitted alone, the machine hides a part of a line. By
    Gauss-Newton of the frequency, where all else is linear. None where the machine hides nearly all of it.
    """
    back, time = rows.middle.conj(), (_periods_by_clock(rows) - 0.5 * len(rows)) * rows.T_s
    long, by = float(time[-1] - time[0]), filter_of(rows, rows.machine)
    most, f, best = energy_of(without_columns(machine, z)), line.frequency, line
    for _ in range(_LINE_STEPS):
        turning = np.exp(1j * TURN * f * time)
        forth, aft = turning * back, turning.conj() * back
        own = _of_lines((forth, aft), by)
        both = np.concatenate((machine, own))
        sizes = sizes_in(both, z)
        a, b = complex(*sizes[-4:-2]), complex(*sizes[-2:])
        flux = whole(sizes[-4:] @ own)
        gain = most - energy_of(z - whole(sizes @ both))
        if best is not line and gain <= best.gain:
            break
        begin = np.exp(1j * TURN * f * time[0])
        best = Line(f, a * begin, b / begin, flux, gain)
        faster = parts(whitened(1j * TURN * time * (a * forth - b * aft), by))
        step = float(sizes_in(np.concatenate((both, faster[None, :])), z)[-1])
        if abs(step) * long < _SAME_LINE or abs(step) * long > 1.0:
            break
        f += step
    return best if best.gain > _OWN_ENERGY * energy_of(best.flux) else None


def _shifted(x: Vector, turns: float) -> tuple[Vector, Vector]:
    """Sums over blocks of x exp(-j 2 pi turns k), and of x exp(j 2 pi turns k)."""
    padded = np.concatenate((x, np.zeros(-len(x) % _BLOCK)))
    turning = np.exp(-1j * TURN * turns * np.arange(len(padded)))
    forth, back = ((padded * by).reshape(-1, _BLOCK).sum(axis=1) for by in (turning, turning.conj()))
    return forth, back


def _turn_starts(rows: Rows, turns: float) -> NDArray[np.intp]:
    """Where stretches begin in which the rotor turns that often, electrically."""
    travelled = np.concatenate((np.zeros(1), np.cumsum(np.abs(rows.D[1:]))))
    return np.flatnonzero(np.diff(np.floor(travelled / (TURN * turns)), prepend=-1.0) > 0.0)


def energy_of_orders(rows: Rows, z: Vector, highest: int, base: int) -> Array:
    """Energy (Vs^2) of z exp(-+ j k theta_e / base) that is steady for some turns of theta_e / base, by k from 1.

    Zero where the rotor makes too few.
    """
    starts = _turn_starts(rows, _ORDER_TURNS * base)
    energy = np.zeros(highest)
    if len(starts) < 2:
        return energy
    turn = np.exp(-1j / base * rows.theta_e[1:])
    return _summed_orders(z, turn, np.append(starts, len(z)), highest)


@kernel
def _summed_orders(z: Vector, turn: Vector, edges: NDArray[np.intp], highest: int) -> Array:
    energy = np.zeros(highest)
    for s in range(len(edges) - 1):
        forth, back = np.zeros(highest, np.complex128), np.zeros(highest, np.complex128)
        for j in range(edges[s], edges[s + 1]):
            a, b = z[j], z[j]
            for k in range(highest):
                a, b = a * turn[j], b * turn[j].conjugate()
                forth[k] += a
                back[k] += b
        for k in range(highest):
            power = forth[k].real ** 2 + forth[k].imag ** 2 + back[k].real ** 2 + back[k].imag ** 2
            energy[k] += power / (edges[s + 1] - edges[s])
    return energy


def noise_of_orders(rows: Rows, variance: float, base: int) -> float:
    """What white noise (Vs^2) adds to the energy of each order."""
    return 2.0 * variance * len(_turn_starts(rows, _ORDER_TURNS * base))


def welch(z: Vector, segment: int = _WELCH_SEGMENT, *, off_mean: bool = False) -> Array:
    """Mean power (Vs^2) of each of `segment` frequencies, as numpy's FFT orders them; of white noise its variance.

    `off_mean`: of segments less their means.
    """
    n = min(segment, len(z))
    hann = np.hanning(n + 1)[:-1] if n > 1 else np.ones(1)
    blocks = np.lib.stride_tricks.sliding_window_view(z, n)[:: max(n // 2, 1)]
    if off_mean:
        blocks = blocks - blocks.mean(axis=1, keepdims=True)
    return np.mean(np.abs(np.fft.fft(blocks * hann, axis=1)) ** 2, axis=0) / float(hann @ hann)


def white_level(x: Array) -> float:
    """Standard deviation of the white part of a channel, whatever lines and colours stand above it."""
    power = welch(x.astype(np.complex128))
    return math.sqrt(float(np.median(power[len(power) // 16 : len(power) // 2])))
