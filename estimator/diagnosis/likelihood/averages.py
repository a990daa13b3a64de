"""Mean voltages: what a mismatch is in V, averaged over a few periods where single ones hold mostly noise.

The noise of a period's voltage is a difference of flux errors, so that of a mean over m periods falls with m, not with
its root. Knows nothing of effects.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array, Vector
from estimator.diagnosis.likelihood.noise import filter_of
from estimator.physics.rows import Rows

PERIODS: Final = 10  # that a mean is taken over where nothing else is said
_TURN: Final = 1.0  # rad that the rotor may turn meanwhile


@dataclass(frozen=True, slots=True, eq=False)
class Means:
    """A voltage averaged over blocks of consecutive periods of one run."""

    v: Vector  # V, in the rotor frame of each block's middle
    at: NDArray[np.intp]  # sample in the middle of each block
    periods: int


def voltage_of(rows: Rows, z: Vector) -> Vector:
    """The voltage (V of each period, rotor frame) that the whitening filter made a flux error (Vs) of."""
    M, gain = filter_of(rows, rows.machine)
    d, q = np.concatenate(([0.0], z.real[:-1])), np.concatenate(([0.0], z.imag[:-1]))
    kept = M[:, 0, 0] * d + M[:, 0, 1] * q + 1j * (M[:, 1, 0] * d + M[:, 1, 1] * q)
    return np.divide(z - kept, gain, out=np.zeros_like(z), where=rows.joined)


def energy_of(v: Vector) -> float:
    """Sum of squares."""
    return float(np.sum(v.real**2 + v.imag**2))


def parts(z: Vector) -> Array:
    """Real parts before imaginary ones."""
    return np.concatenate((z.real, z.imag))


def whole(x: Array) -> Vector:
    """The inverse of `parts`."""
    n = len(x) // 2
    return x[:n] + 1j * x[n:]


def sizes_in(columns: Array, z: Vector) -> Array:
    """Of columns (m, 2 n; see `parts`), by which they explain most of z."""
    return np.array(np.linalg.lstsq(columns @ columns.T, columns @ parts(z), rcond=None)[0], np.float64)


def without_columns(columns: Array, z: Vector, flux: Vector | None = None) -> Vector:
    """z less what columns (m, 2 n; see `parts`) explain of it, fitted alone or together with a flux error."""
    both = columns if flux is None else np.concatenate((columns, parts(flux)[None, :]))
    return z - whole(sizes_in(both, z)[: len(columns)] @ columns)


def usual_periods(rows: Rows) -> int:
    """About ten, less at a speed at which the rotor turns far in ten."""
    D = float(np.quantile(np.abs(rows.D), 0.9)) if len(rows) else 0.0
    return max(1, min(PERIODS, len(rows), int(_TURN / D) if D > 0.0 else PERIODS))


def means(rows: Rows, v: Vector, periods: int) -> Means:
    """Means of v (V of each period, rotor frame) over blocks of periods; blocks with a gap are left out."""
    m = periods
    blocks = len(rows) // m
    n = blocks * m
    if m == 1:
        whole = rows.joined
        return Means(v[whole], np.flatnonzero(whole), 1)
    whole = rows.joined[:n].reshape(blocks, m).all(axis=1)
    at = np.arange(m // 2, n, m)
    v_s = (v[:n] * rows.middle[:n]).reshape(blocks, m).mean(axis=1)
    middle = rows.rotor[at] if m % 2 == 0 else rows.middle[at]
    return Means((v_s * middle.conj())[whole], at[whole], m)


def noise_of_means(rows: Rows, noise: tuple[float, float], periods: int) -> tuple[float, float]:
    """Standard deviation (V) on d and q of the mean that white flux errors (Vs) leave."""
    share = float(np.sqrt(2.0)) / (periods * rows.T_s)
    return noise[0] * share, noise[1] * share
