"""Forms of what has no name: a line, a voltage that comes and goes, a resonance, a step.

Each is fitted to a flux error with white noise and says how much of it it explains. Knows nothing of effects.
"""

import cmath
import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array, Vector
from estimator.diagnosis.likelihood.averages import energy_of, means, parts, voltage_of
from estimator.diagnosis.likelihood.noise import filter_of, whitened
from estimator.diagnosis.unnamed.branch import Branch
from estimator.diagnosis.where.spectra import Line
from estimator.kernel import kernel
from estimator.physics.rows import Rows

_MEAN_LENGTHS: Final = (10, 30, 100, 300)  # periods of a mean
_DWELL: Final = 5.0  # means between two changes, on average
_CHANGE: Final = 3.0  # log-odds, times the logarithm of the means' number: what a change must bring


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
class Drift:
    """A voltage fixed in the rotor frame that grows with time."""

    change: complex  # V, of the residual from begin to end
    gain: float  # as the others'

    @property
    def direction(self) -> float:
        """Of the voltage that comes to the machine, rad: what is left of the recorded voltage is its opposite."""
        return cmath.phase(-self.change)


Form = Line | TwoLevels | Branch | Drift


def two_levels(rows: Rows, z: Vector, frame: str) -> TwoLevels | None:
    """The best voltage of two values along one direction of a frame."""
    v = voltage_of(rows, z)
    found = [_levels_in(rows, z, v, frame, m) for m in _MEAN_LENGTHS if len(rows) >= 8 * m]
    return max((f for f in found if f is not None), key=lambda f: f.gain, default=None)


def _levels_in(rows: Rows, z: Vector, v: Vector, frame: str, m: int) -> TwoLevels | None:
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
    flux = whitened(model * rows.joined, filter_of(rows, rows.machine))
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


def drift(rows: Rows, z: Vector) -> Drift | None:
    """The voltage fixed in the rotor frame that grows with time and explains most, beside one that does not."""
    if len(rows) < 2:
        return None
    late = (rows.t[:-1] - rows.t[0]) / (rows.t[-1] - rows.t[0]) - 0.5
    by = filter_of(rows, rows.machine)
    columns = [whitened(v * rows.joined, by) for v in (1.0 + 0j * late, 1j + 0j * late, late + 0j, 1j * late)]
    X = np.array([parts(column) for column in columns])
    gram, to = X @ X.T, X @ parts(z)
    size, *_ = np.linalg.lstsq(gram, to, rcond=None)
    steady, *_ = np.linalg.lstsq(gram[:2, :2], to[:2], rcond=None)
    return Drift(complex(size[2], size[3]), float(size @ to - steady @ to[:2]))
