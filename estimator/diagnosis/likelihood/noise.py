"""Noise: what a model leaves of a recording's voltage as flux errors, in which noise is white, and how large that is.

Knows nothing of how a model is found.
"""

import math
from typing import Final

import numpy as np

from estimator.arrays import Array, Vector
from estimator.diagnosis.likelihood.whitening import Axes, Whitening, whiten, whitening_of
from estimator.machine import Machine
from estimator.physics.flux_map import Bend
from estimator.physics.rows import Rows
from estimator.twin.model import Model

Noise = tuple[float, float, float]
"""White noise of the whitened residual: Vs on d, Vs on q, A of the three phase currents' mean."""
_TRIMMED: Final = 3  # times, that what is beyond 4 standard deviations is left out of noise
_VARIANCE_WITHIN: Final = 0.99887  # of a normal variance, within these
_COLOURED: Final = 1.05  # times the variance between neighbours: more is no white noise
_BEYOND_NOISE: Final = (6, 8, 11, 15)  # periods, that no noise of sensors and their filters lasts
_EVEN: Final = 1.03  # times the least of variances, that they are alike within
_FORGOTTEN: Final = 0.01  # a period, of a flux error
_LEAST_NOISE: Final = 1e-6  # of rated current, that the noise of a current is taken for


def filter_poles(machine: Machine, T_s: float) -> Axes:
    """rho of the whitening on d and q.

    At most 0.99 on the axis of less inductance, so that what noise does not explain is forgotten soon. What the other
    one forgets by such a pole is noise, more by the ratio of the inductances, and turns into this axis: its pole is as
    much closer to 1.
    """
    R_s, L_d, L_q = machine.R_s, machine.L_d, machine.L_q
    least = min(L_d, L_q)
    rho_d, rho_q = (min(math.exp(-R_s * T_s / L), 1.0 - _FORGOTTEN * least / L) for L in (L_d, L_q))
    return rho_d, rho_q


def filter_of(rows: Rows, machine: Machine) -> Whitening:
    """The filter by a machine, of voltages in the rotor frame."""
    poles = filter_poles(machine, rows.T_s)
    return whitening_of(rows.half, rows.joined, (machine.L_d, machine.L_q), poles, rows.T_s)


def whitened(v: Vector, by: Whitening) -> Vector:
    """One column, whitened, Vs."""
    z = v[None, :].astype(np.complex128)
    whiten(z, by.M, by.gain, np.zeros(1, np.complex128))
    return z[0]


def flux_errors(v: Vector, rows: Rows, model: Model, machine: Machine | None = None) -> Vector:
    """What is left of a voltage (V), whitened, Vs.

    By the model's machine, or another one. Beside a flux map's bend: of its straight lines, at which noise of the
    currents is alike at every current.
    """
    z = whitened(v, filter_of(rows, machine or model.machine))
    if model.bend is None:
        return z
    (dd, dq), (qd, qq) = straightening(rows, model, model.bend)
    return dd * z.real + dq * z.imag + 1j * (qd * z.real + qq * z.imag)


def as_in(of: Machine, other: Machine, z: Vector) -> Vector:
    """Flux errors (Vs) of a machine, as its errors of the currents make them in another."""
    return z.real * (other.L_d / of.L_d) + 1j * z.imag * (other.L_q / of.L_q)


def straightening(rows: Rows, model: Model, bend: Bend) -> Array:
    """Shape (2, 2, n): what makes flux errors beside a map's bend those of its straight lines, by axes d and q."""
    m, g = model.machine, bend.stiffness(model.machine, rows.i[1:])
    return np.array([
        [m.L_d * (g.a + g.b.real), m.L_d * g.b.imag], [m.L_q * g.b.imag, m.L_q * (g.a - g.b.real)],
    ])  # fmt: skip


def noise_of(z: Vector, zero: Array | None, rows: Rows, samples: int = 1) -> Noise:
    """White noise of the whitened residual (Vs on d, Vs on q, A). A little at least: no sensor is free of it.

    `samples`: of which each current is the mean, with noise of its own.
    """
    m, least = rows.machine, _LEAST_NOISE * rows.i_rated
    zero_noise = 1.0 if zero is None else max(white_of(zero[:-1], rows, samples), least)
    d, q = (white_of(x, rows, samples) for x in (z.real, z.imag))
    return max(d, m.L_d * least), max(q, m.L_q * least), zero_noise


def white_of(x: Array, rows: Rows, samples: int = 1) -> float:
    """White noise of what has a value for each period, rms, from what changes between neighbours.

    What changes in two periods is more by as much of the noise as each further sample of a mean brings: the more that
    are in a mean, the more neighbours share. Noise that is coloured besides is alike beyond its few periods, as nothing
    is that a motor does.
    """
    once, twice = (_changed(x, rows, k) ** 2 for k in (1, 2))
    if samples > 1:
        return math.sqrt(once + (samples - 1) * max(twice - once, 0.0))
    if twice > _COLOURED * once:
        beyond = [_changed(x, rows, k) ** 2 for k in _BEYOND_NOISE]
        if max(beyond) < _EVEN * min(beyond) and min(beyond) > _COLOURED * once:
            return math.sqrt(sum(beyond) / len(beyond))
    return math.sqrt(once)


def _changed(x: Array, rows: Rows, periods: int) -> float:
    """Noise of values, rms, that changes by as much in so many periods."""
    both = np.logical_and.reduce(np.lib.stride_tricks.sliding_window_view(rows.joined, periods + 1), axis=1)
    step = (x[periods:] - x[:-periods])[both[: len(x) - periods]]
    rms = float(np.median(np.abs(step))) / 0.6744898
    for _ in range(_TRIMMED):  # closer than a median, and as little moved by what jumps
        within = step[np.abs(step) <= 4.0 * rms] if rms > 0.0 else step
        rms = float(np.sqrt(np.mean(within**2) / _VARIANCE_WITHIN)) if len(within) else 0.0
    return rms / math.sqrt(2.0)
