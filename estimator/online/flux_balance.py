"""The rows of the regression: the machine's flux balance over whole control periods, at any speed.

Over one control period the stator flux linkage, seen from the stationary frame, changes by the voltage-time area less
the resistive drop. Written in the rotor frame at the middle of the period, with `D` the angle turned in it,

    u = R_s i_mean + ( exp(+jD/2) psi[k+1] - exp(-jD/2) psi[k] ) / T_s

No derivative is approximated. The mean of N such balances telescopes, with T = N T_s and a speed that is steady
within the row, to

    u = R_s i_mean + cos(D/2) (psi[k+N] - psi[k]) / T + j (2/T_s) sin(D/2) psi(i_trapezoid)

so a row of N periods needs no more than means and end points. It is linear in R_s, L_d, L_q and psi_f:

    u_d = R_s (i_d - h psi_f/L_d) + L_d x_d - L_q y_q     x = cos(D/2) (i[k+N] - i[k]) / T
    u_q = R_s i_q + L_q x_q + L_d y_d + psi_f s           y = s i_trapezoid,  s = (2/T_s) sin(D/2)

but for small terms, `h = D^2/12` among them, that belong to the mean current. The inverter holds its voltage still
while the rotor turns under it, and the resistive drop bends the flux linkage, so between two samples the current
follows an arc whose mean is not that of its ends but

    i_mean = i_trapezoid (1 - D^2/8) + j D/4 (i[k+N] - i[k])/N - h psi_f/L_d + R_s T_s^2/(12 L) (x + j y)

to second order in D and T_s R_s/L (L_d = L_q in the second term; L is that of the axis). The first two are in the
rows; the others need the parameters and are left to `solve`. Left out, these terms read R_s 0.04 % low at 80 Hz and
10 kHz, and 16 times that at 320 Hz, and an inductance of time constant 10 T_s 0.08 % high. Terms of third order, which
are left out, read L_q 0.04 % low at D = 0.84 rad; intervals count them in (`fit.MODEL_TURN`).

Derived here. The period-exact discretisation of the flux linkage is textbook matter: L. Harnefors, Control of
Variable-Speed Drives, Vaesteras, 2002. Knows nothing of windows or of least squares.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.kernel import kernel
from estimator.samples import Column, Samples

TURN: Final = 2.0 * math.pi  # rad
COS_STEPS: Final = tuple(1.0 / (j * (j - 1)) for j in range(20, 0, -2))  # of the nested series
SIN_STEPS: Final = tuple(1.0 / (j * (j - 1)) for j in range(21, 1, -2))
COLUMNS: Final = ("i_d", "i_q", "x_d", "x_q", "y_d", "y_q", "s", "h", "u_d", "u_q")
"""Columns of a balance array: A, A, A/s, A/s, A rad/s, A rad/s, rad/s, rad^2, V, V."""

Balance = NDArray[np.float64]
"""Shape (n, 10), columns as in `COLUMNS`; row k is the balance from sample k to sample k + 1."""

Columns = NDArray[np.float64]


def flux_balance(samples: Samples, m: int = 1) -> Balance:
    """Balances of the samples' n - 1 complete rows, each the mean over m consecutive ones; shape ((n-1)//m, 10)."""
    n = max(0, len(samples) - 1)
    columns = np.empty((len(COLUMNS), n))
    balances_into(
        *columns_of(samples), samples.T_s, samples.periods, samples.i_d_mean is None, columns, 0, np.empty((3, n))
    )
    return columns.T if m == 1 else mean_of(columns.T, m)


def angle_turned(balance: Balance, T_s: float) -> Column:
    """Angle turned in each control period of balances in rad, shape (n,); D of the equations."""
    s = balance[:, COLUMNS.index("s")]
    return 2.0 * np.arcsin(0.5 * T_s * s)


def columns_of(samples: Samples) -> tuple[Column, Column, Column, Column, Column, Column, Column, Column]:
    """theta_e, omega_e, i_d, i_q, u_d, u_q, mean currents, as the kernels take them: of one length, in one piece.

    Where a row is one period and no means are given, the sampled currents stand in their place, not to be read.
    """
    i_d_mean, i_q_mean = samples.i_d_mean, samples.i_q_mean
    if i_d_mean is None or i_q_mean is None:
        if samples.periods != 1:
            raise ValueError(f"rows of {samples.periods} control periods need i_d_mean and i_q_mean")
        i_d_mean, i_q_mean = samples.i_d, samples.i_q
    columns = (samples.theta_e, samples.omega_e, samples.i_d, samples.i_q, samples.u_d, samples.u_q, i_d_mean, i_q_mean)
    n = len(samples.theta_e)
    for column in columns:
        if len(column) != n:
            raise ValueError(f"samples need columns of one length, got {sorted({len(column) for column in columns})}")
    theta_e, omega_e, i_d, i_q, u_d, u_q, i_d_mean, i_q_mean = map(_in_one_piece, columns)
    return theta_e, omega_e, i_d, i_q, u_d, u_q, i_d_mean, i_q_mean


def _in_one_piece(column: Column) -> Column:
    """The column itself, or a copy where a kernel would have to be compiled anew for its layout."""
    flags = column.flags
    fits = flags.c_contiguous and flags.writeable and column.dtype == np.float64
    return column if fits else np.array(column, dtype=np.float64)


@kernel
def balances_into(
    theta_e: Column, omega_e: Column, i_d: Column, i_q: Column, u_d: Column, u_q: Column, i_d_mean: Column,
    i_q_mean: Column, T_s: float, periods: int, by_ends: bool, out: Columns, at: int, scratch: Columns,
) -> None:
    """Write the n - 1 balances between n samples to `out` (10, ...) from place `at` on.

    `scratch` (3, n - 1 or more) is overwritten. `by_ends`: the mean current is that of a row's two ends. One short
    loop a column, each of which the compiler turns into vector instructions.
    """
    n = len(theta_e) - 1
    T = periods * T_s
    per_T, per_T_s, per_turn, share = 1.0 / T, 1.0 / T_s, 1.0 / TURN, 1.0 / periods
    D, cos, sin = scratch[0], scratch[1], scratch[2]
    by_speed = sin  # until its own values are due
    for k in range(n):
        by_speed[k] = T * (0.5 * (omega_e[k] + omega_e[k + 1]) if periods == 1 else omega_e[k])
    for k in range(n):
        off = theta_e[k + 1] - theta_e[k] - by_speed[k]
        D[k] = (by_speed[k] + (off - TURN * math.floor(off * per_turn + 0.5))) * share
    sines(D, n, cos, sin)

    end = at + n
    x_d, x_q, y_d, y_q = out[2, at:end], out[3, at:end], out[4, at:end], out[5, at:end]
    s, h = out[6, at:end], out[7, at:end]
    for k in range(n):
        s[k] = 2.0 * per_T_s * sin[k]
    for k in range(n):
        h[k] = D[k] * D[k] * (1.0 / 12.0)
    for k in range(n):
        x_d[k] = cos[k] * (i_d[k + 1] - i_d[k]) * per_T
    for k in range(n):
        x_q[k] = cos[k] * (i_q[k + 1] - i_q[k]) * per_T
    for k in range(n):
        y_d[k] = s[k] * (0.5 * (i_d[k] + i_d[k + 1]) if by_ends else i_d_mean[k])
    for k in range(n):
        y_q[k] = s[k] * (0.5 * (i_q[k] + i_q[k + 1]) if by_ends else i_q_mean[k])
    _mean_current(i_d, i_d_mean, i_q, -1.0, by_ends, periods, D, n, out[0, at:end])
    _mean_current(i_q, i_q_mean, i_d, +1.0, by_ends, periods, D, n, out[1, at:end])
    out[8, at:end] = u_d[:n]
    out[9, at:end] = u_q[:n]


@kernel
def _mean_current(
    i: Column, i_mean: Column, other: Column, sign: float, by_ends: bool, periods: int, D: Column, n: int, out: Column
) -> None:
    """The first two of the mean current's terms, of one axis."""
    quarter = sign * 0.25 / periods
    for k in range(n):
        trapezoid = 0.5 * (i[k] + i[k + 1]) if by_ends else i_mean[k]
        out[k] = (1.0 - 0.125 * D[k] * D[k]) * trapezoid + quarter * D[k] * (other[k + 1] - other[k])


@kernel
def sines(D: Column, n: int, cos: Column, sin: Column) -> None:
    """cos(D/2) and sin(D/2) by their series up to D/2 = 1.6 rad, where they are exact to round-off."""
    for k in range(n):
        x2 = 0.25 * D[k] * D[k]
        p = 1.0
        for step in COS_STEPS:
            p = 1.0 - p * x2 * step
        cos[k] = p
    for k in range(n):
        x2 = 0.25 * D[k] * D[k]
        p = 1.0
        for step in SIN_STEPS:
            p = 1.0 - p * x2 * step
        sin[k] = 0.5 * D[k] * p
    for k in range(n):
        if abs(D[k]) > 3.2:
            cos[k], sin[k] = math.cos(0.5 * D[k]), math.sin(0.5 * D[k])


def mean_of(balance: Balance, m: int) -> Balance:
    """Means over m consecutive balances; what is left over at the end is dropped. Shape (n//m, 10)."""
    n = len(balance) // m
    return balance[: n * m].reshape(n, m, len(COLUMNS)).mean(axis=1)
