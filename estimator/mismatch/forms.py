"""Forms of what has no name: a line, a voltage that comes and goes, a resonance, a step.

Each is fitted to a flux error with white noise and says how much of it it explains. Knows nothing of effects.
"""

import cmath
import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.flux_balance import TURN
from estimator.kernel import kernel
from estimator.mismatch.averages import Array, energy_of, means, voltage_of
from estimator.mismatch.model import filter_pole, whitened
from estimator.mismatch.spectra import Line, welch
from estimator.physics.rows import Rows, Vector

_LENGTHS: Final = (10, 30, 100, 300)  # periods of a mean
_DWELL: Final = 5.0  # means between two changes, on average
_CHANGE: Final = 3.0  # log-odds, times the logarithm of the means' number: what a change must bring
_TAPS: Final = 96  # periods that a resonance rings
_ABOVE: Final = 0.03  # of the sampling rate: where resonances are looked for
_LINES: Final = 512  # frequencies up to half the sampling rate
_PROMINENT: Final = 2.0
_IN_PHASE: Final = 0.7  # of a branch's admittance, where it is largest: it takes power
_SURE: Final = 5.2  # standard errors of a resonance's peak


@dataclass(frozen=True, slots=True, eq=False)
class TwoLevels:
    """A voltage that has one of two values."""

    frame: str  # "stationary" or "rotor", in which it is fixed
    low: complex  # V, the one nearer to zero
    high: complex
    starts: Array  # s, at which it comes
    lengths: Array  # s, for which it stays
    share: float  # of the time that it is there
    changes: Array  # s
    flux: Vector  # Vs, rotor frame: what it makes of the flux error
    gain: float  # energy of the flux error (Vs^2, summed) that it explains

    @property
    def step(self) -> complex:
        """V."""
        return self.high - self.low

    @property
    def direction(self) -> float:
        """Of the voltage that comes to the machine, rad: what is left of the recorded voltage is its opposite."""
        return cmath.phase(-self.step)


@dataclass(frozen=True, slots=True)
class Resonance:
    """A current beside the machine's that follows the voltage's changes."""

    frequency: float  # Hz, of the largest admittance
    admittance: float  # A/V there
    sure: float  # standard errors that the peak stands above nothing
    gain: float  # as the others'


@dataclass(frozen=True, slots=True)
class Drift:
    """A voltage fixed in the rotor frame that grows with time."""

    change: complex  # V, of the residual from begin to end
    gain: float  # as the others'

    @property
    def direction(self) -> float:
        """Of the voltage that comes to the machine, rad: what is left of the recorded voltage is its opposite."""
        return cmath.phase(-self.change)


Form = Line | TwoLevels | Resonance | Drift


def two_levels(rows: Rows, z: Vector, frame: str) -> TwoLevels | None:
    """The best voltage of two values along one direction of a frame."""
    v = voltage_of(rows, z)
    found = [_levels(rows, z, v, frame, m) for m in _LENGTHS if len(rows) >= 8 * m]
    return max((f for f in found if f is not None), key=lambda f: f.gain, default=None)


def _levels(rows: Rows, z: Vector, v: Vector, frame: str, m: int) -> TwoLevels | None:
    blocks = means(rows, v, m)
    if len(blocks.v) < 8:
        return None
    x = blocks.v * (rows.rotor[blocks.at] if frame == "stationary" else 1.0)
    spread = x - complex(float(np.median(x.real)), float(np.median(x.imag)))
    along = cmath.exp(0.5j * cmath.phase(complex(np.sum(spread**2))))
    p: Array = (x * along.conjugate()).real
    low, high = float(np.quantile(p, 0.1)), float(np.quantile(p, 0.9))
    up = p > 0.5 * (low + high)
    for _ in range(20):
        if up.all() or not up.any():
            return None
        low, high = float(p[~up].mean()), float(p[up].mean())
        up = p > 0.5 * (low + high)
    scatter = float(np.mean(np.where(up, p - high, p - low) ** 2))
    up = _likeliest((p - 0.5 * (low + high)) * ((high - low) / scatter), _CHANGE * math.log(len(p)))
    if up.all() or not up.any():
        return None
    levels = complex(x[~up].mean()), complex(x[up].mean())
    nearest = np.clip(np.searchsorted(blocks.at // m, np.arange(len(rows) // m + 1)), 0, len(up) - 1)
    model = np.where(np.repeat(up[nearest], m)[: len(rows)], levels[1], levels[0])
    if frame == "stationary":
        model = rows.stationary(model)
    flux = whitened(model * rows.joined, rows, filter_pole(rows.machine, rows.T_s))
    gain = energy_of(z) - energy_of(z - flux)
    if abs(levels[1]) < abs(levels[0]):
        up, levels = ~up, (levels[1], levels[0])
    change = np.flatnonzero(np.diff(up)) + 1
    if len(up) < _DWELL * (len(change) + 1):
        return None
    edges = np.concatenate(([0], change, [len(up)]))
    t = np.concatenate((rows.t[blocks.at] - 0.5 * m * rows.T_s, [rows.t[blocks.at[-1]] + 0.5 * m * rows.T_s]))
    there = up[edges[:-1]]
    return TwoLevels(
        frame, levels[0], levels[1], t[edges[:-1]][there], np.diff(t[edges])[there], float(np.mean(up)), t[change],
        flux, gain,
    )  # fmt: skip


@kernel
def _likeliest(odds: Array, penalty: float) -> NDArray[np.bool_]:
    """Two states by the log-odds of each step for the second one, and what a change costs (Viterbi's algorithm)."""
    n = len(odds)
    came = np.zeros((n, 2), np.bool_)  # from the other state
    low, high = 0.0, odds[0]
    for k in range(1, n):
        came[k, 0], came[k, 1] = high - penalty > low, low - penalty > high
        low, high = max(low, high - penalty), max(high, low - penalty) + odds[k]
    states = np.zeros(n, np.bool_)
    states[n - 1] = high > low
    for k in range(n - 1, 0, -1):
        states[k - 1] = states[k] != came[k, int(states[k])]
    return states


def resonance(rows: Rows, z: Vector, noise: tuple[float, float]) -> Resonance | None:
    """What of the measured current follows past changes of the voltage, as a filter at the terminals makes it.

    Only the past counts: the voltage's control follows the current's noise in its turn.
    """
    m, p = rows.machine, _TAPS
    n = len(rows)
    if n < 8 * p:
        return None
    i = (z.real / m.L_d + 1j * (z.imag / m.L_q)) * rows.rotor[1:]
    u_s = rows.u * rows.middle
    du = np.diff(u_s, prepend=u_s[:1]) * rows.joined
    size = 1 << (n + p).bit_length()
    U, to = np.fft.fft(du, size), np.fft.fft(i, size)
    auto, cross = np.fft.ifft(np.abs(U) ** 2)[:p], np.fft.ifft(to * U.conj())[:p]
    lag = np.arange(p)[:, None] - np.arange(p)[None, :]
    gram = np.where(lag >= 0, auto[np.abs(lag)], auto[np.abs(lag)].conj())
    gram[np.diag_indices(p)] += 1e-9 * auto[0].real
    inverse = np.linalg.inv(gram)
    g = inverse @ cross
    follows = np.fft.ifft(np.fft.fft(g, size) * U)[:n]
    f = np.arange(1, _LINES) / (2.0 * _LINES)
    turn = np.exp(-1j * TURN * f[:, None] * np.arange(p))
    G = turn @ g
    Y = -G * (1.0 - np.exp(-1j * TURN * f)) * np.exp(-1j * np.pi * f)  # A/V; i is half a period later than u
    colour = welch(i - follows, 2 * _LINES)  # more than white noise at what is no answer to the voltage
    variance = (noise[0] / m.L_d) ** 2 + (noise[1] / m.L_q) ** 2
    power = np.maximum(variance, np.maximum(colour[1:_LINES], colour[:_LINES:-1]))
    error = np.sqrt(power * np.sum((turn @ inverse) * turn.conj(), axis=1).real)
    sure = np.abs(G) / error
    peak = _peak(Y, np.where(f > _ABOVE, sure, 0.0))
    if not peak:
        return None
    back = follows * rows.rotor[1:].conj()
    left = z - (m.L_d * back.real + 1j * m.L_q * back.imag)
    gain = energy_of(z) - energy_of(left)
    return Resonance(float(f[peak] / rows.T_s), float(abs(Y[peak])), float(sure[peak]), gain)


def _peak(Y: Vector, sure: Array) -> int:
    """Where an admittance has its highest peak that takes power and stands above half and 1.6 times as far; or 0."""
    size, k = np.abs(Y), np.arange(1, len(Y) - 1)
    k = k[(size[k] >= size[k - 1]) & (size[k] >= size[k + 1]) & (sure[k] > _SURE)]
    around = np.maximum(size[k // 2], size[np.minimum(8 * k // 5, len(Y) - 1)])
    k = k[(size[k] > _PROMINENT * around) & (Y[k].real > _IN_PHASE * size[k])]
    return int(k[np.argmax(size[k])]) if len(k) else 0


def drift(rows: Rows, z: Vector) -> Drift | None:
    """The voltage fixed in the rotor frame that grows with time and explains most, beside one that does not."""
    if len(rows) < 2:
        return None
    late = (rows.t[:-1] - rows.t[0]) / (rows.t[-1] - rows.t[0]) - 0.5
    rho = filter_pole(rows.machine, rows.T_s)
    columns = [whitened(v * rows.joined, rows, rho) for v in (1.0 + 0j * late, 1j + 0j * late, late + 0j, 1j * late)]
    X = np.array([np.concatenate((c.real, c.imag)) for c in columns])
    y = np.concatenate((z.real, z.imag))
    gram, to = X @ X.T, X @ y
    size, *_ = np.linalg.lstsq(gram, to, rcond=None)
    steady, *_ = np.linalg.lstsq(gram[:2, :2], to[:2], rcond=None)
    return Drift(complex(size[2], size[3]), float(size @ to - steady @ to[:2]))
