"""Stretches: the equation of motion over stretches of the shaft's way, so that nothing is differentiated.

    J alpha + B omega_m + T_C sign(omega_m) + tau_L = tau_e        tau_e = 3/2 n_p (psi_f + (L_d - L_q) i_d) i_q

Integrated twice, over M rows of T, the acceleration is a difference of three angles, exactly, whatever the speed does
in between; speed, sign and torque are weighted by the same triangle of 2 M rows:

    alpha = (theta_m[k+M] - 2 theta_m[k] + theta_m[k-M]) / (M T)^2

Two moving means over M rows more smooth all of them alike, which changes no equation. A stretch is then weighted by a
cubic B-spline of 4 M rows, a modulating function (M. Shinbrot, "On the analysis of linear and nonlinear systems",
Trans. ASME 79, 1957; H. A. Preisig, D. W. T. Rippin, "Theory and application of the modulating function method",
Computers and Chemical Engineering 17(1), 1993, doi 10.1016/0098-1354(93)80001-4). Stretches begin M rows apart.

Within a row the torque is not constant: to second order its triangle's mean is that of the rows' means less
(tau[k+M] - 2 tau[k] + tau[k-M])/(12 M^2), by the torque at the rows' ends (Euler and Maclaurin's formula). Left out,
steps of current read J 0.4 % low over the shortest stretches.

**What noise does.** An angle's rounding enters alpha by 1/(M T)^2, and falls with M^-5 in energy: it is what a stretch
must be long for. Current noise is in the torque, on the other side of the equation, where it biases nothing.

**Where the speed is about zero** friction is no sign: it sticks, breaks away (Stribeck), or changes over smoothly. The
slowest speed of a stretch is told, for such stretches to be left out.

No stretch goes across a gap. Rows may be means over many control periods: their currents are means, and angles exact.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from estimator.arrays import Array, Bools
from estimator.samples import Samples, turned_angle

STEPS: Final = 4  # of M rows, in a stretch
ORDERS: Final = (1, 2)
"""Of the shaft's angle, whose cosines and sines are kept; and six times the electrical one, of torque ripple."""


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Consecutive rows without a gap, each T long, from t0 (s) on."""

    values: Array  # (12, n), their means: omega, i_q, i_d i_q, i_d, i_d^2 - i_q^2, angles, square, as in `Stretches`
    at: Array  # (2, n + 1): i_q (A) and i_d i_q (A^2) at the rows' ends
    T: float
    t0: float

    @property
    def omega(self) -> Array:
        """rad/s, mechanical."""
        return self.values[0]


@dataclass(frozen=True, slots=True, eq=False)
class Stretches:
    """Means over stretches, columns of equal length n."""

    alpha: Array  # rad/s2
    omega: Array  # rad/s, mechanical, as all here
    sign: Array  # of the speed, 1
    i_q: Array  # A
    i_d_i_q: Array  # A^2
    i_d: Array  # A
    i_d2_i_q2: Array  # A^2, i_d^2 - i_q^2
    angles: Array  # (6, n), 1: cosine and sine of the shaft's angle, of twice that, of six times the electrical one
    square: Array  # (rad/s)^2, of the speed with its sign
    time: Array  # s
    slowest: Array  # rad/s, least speed within a stretch

    def __len__(self) -> int:
        return len(self.alpha)

    def where(self, kept: Bools) -> "Stretches":
        """Some of them."""
        return Stretches(*(getattr(self, name)[..., kept] for name in Stretches.__slots__))


def rows_of(run: Samples, n_p: int) -> Rows:
    """The n - 1 complete rows of a run of n samples."""
    if run.i_d_mean is None or run.i_q_mean is None:
        i_d, i_q = (0.5 * (i[:-1] + i[1:]) for i in (run.i_d, run.i_q))
    else:
        i_d, i_q = run.i_d_mean[:-1], run.i_q_mean[:-1]
    turned = _turned(run) / n_p
    theta = run.theta_e[0] / n_p + np.cumsum(turned) - 0.5 * turned
    omega = turned / run.T
    square = omega * np.abs(omega)
    angles = [of(order * theta) for order in (*ORDERS, 6 * n_p) for of in (np.cos, np.sin)]
    values = np.stack((omega, i_q, i_d * i_q, i_d, i_d * i_d - i_q * i_q, *angles, square))
    return Rows(values, np.stack((run.i_q, run.i_d * run.i_q)), run.T, run.t0)


def _turned(run: Samples) -> Array:
    """Angle turned in each row, rad electrical; the speed of a row of several periods is that of the row alone."""
    if run.periods == 1:
        return turned_angle(run.theta_e, run.omega_e, run.T)
    expected = run.T * run.omega_e[:-1]
    off = np.diff(run.theta_e) - expected
    return expected + off - math.tau * np.floor(off / math.tau + 0.5)


def stretches_of(runs: Sequence[Rows], M: int) -> Stretches | None:
    """Stretches of 4 M rows, M rows apart; None where there are none."""
    found = [_stretches(rows, M) for rows in runs if rows.values.shape[1] > STEPS * M]
    if not found:
        return None
    return Stretches(*(np.concatenate([getattr(f, name) for f in found], axis=-1) for name in Stretches.__slots__))


def _stretches(rows: Rows, M: int) -> Stretches:
    omega = rows.omega
    slow = _centred(omega, M)
    over = mean_over(omega, M)
    alpha = (over[M:] - over[:-M]) / (M * rows.T)
    weighed = mean_over(mean_over(mean_over(np.vstack((rows.values, np.sign(slow))), M), 2), M)
    bend = rows.at[:, 2 * M :] - 2.0 * rows.at[:, M:-M] + rows.at[:, : -2 * M]
    weighed[1:3] -= bend / (12.0 * M * M)
    slowest = _slowest(slow, M)
    n = len(slowest)
    means = mean_over(mean_over(np.vstack((alpha, weighed)), M), M)[:, ::M][:, :n]
    time = rows.t0 + rows.T * M * (np.arange(n, dtype=np.float64) + 0.5 * STEPS)
    alpha, omega, i_q, i_d_i_q, i_d, i_d2_i_q2, *angles, square, sign = means
    return Stretches(alpha, omega, sign, i_q, i_d_i_q, i_d, i_d2_i_q2, np.array(angles), square, time, slowest)


def mean_over(x: Array, M: int) -> Array:
    """Means over M consecutive values, along the last axis."""
    total = np.cumsum(x, axis=-1)
    total = np.concatenate((np.zeros((*x.shape[:-1], 1)), total), axis=-1)
    return (total[..., M:] - total[..., :-M]) / M


def _centred(x: Array, M: int) -> Array:
    """Means over the M values around each; at the ends those next to it."""
    before = M // 2
    return mean_over(np.pad(x, (before, M - 1 - before), mode="edge"), M)


def _slowest(omega: Array, M: int) -> Array:
    """Least speed within each stretch, zero where the shaft turns round in it."""
    low, high = (_over_stretches(extreme, omega, M) for extreme in (np.minimum, np.maximum))
    return np.where((low < 0.0) & (high > 0.0), 0.0, np.minimum(np.abs(low), np.abs(high)))


def _over_stretches(extreme: np.ufunc, x: Array, M: int) -> Array:
    """The extreme over each stretch of 4 M values, which begin M apart."""
    of_steps = extreme.reduceat(x, np.arange(0, len(x), M))[: len(x) // M]
    n = len(of_steps) - STEPS + 1
    found = of_steps[:n]
    for k in range(1, STEPS):
        found = extreme(found, of_steps[k : k + n])
    return found


def gain_of_noise(M: int, T: float) -> float:
    """Variance of alpha (1/s4) for errors of all angles, independent of each other, of 1 rad^2."""
    spike = np.zeros(6 * M + 3)
    spike[3 * M + 1] = 1.0
    alpha = (spike[2 * M :] - 2.0 * spike[M:-M] + spike[: -2 * M]) / (M * T) ** 2
    return float(np.sum(mean_over(mean_over(alpha, M), M) ** 2))


def noise_of_angle(runs: Sequence[Rows]) -> float:
    """Variance (rad^2, mechanical) of independent errors of the angle: of its fourth differences, over 70.

    A shaft's own movement has next to none of those from row to row, an encoder's rounding has.
    """
    fourth = [np.diff(rows.omega * rows.T, 3) for rows in runs]
    count = sum(map(len, fourth))
    return sum(float(np.sum(x * x)) for x in fourth) / (70.0 * count) if count else 0.0
