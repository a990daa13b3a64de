"""The rows of the regression: the machine's flux balance over whole control periods, exact for any speed.

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
10 kHz, and 16 times that at 320 Hz, and an inductance of time constant 10 T_s 0.08 % high.

Derived here. The period-exact discretisation of the flux linkage is textbook matter: L. Harnefors, Control of
Variable-Speed Drives, Vaesteras, 2002. Knows nothing of windows or of least squares.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.samples import Samples

COLUMNS: Final = ("i_d", "i_q", "x_d", "x_q", "y_d", "y_q", "s", "h", "u_d", "u_q")
"""Columns of a balance array: A, A, A/s, A/s, A rad/s, A rad/s, rad/s, rad^2, V, V."""

Balance = NDArray[np.float64]
"""Shape (n, 10), columns as in `COLUMNS`; row k is the balance from sample k to sample k + 1."""


def angle_turned(samples: Samples) -> NDArray[np.float64]:
    """Angle turned in each control period of the n - 1 complete rows in rad; the speed settles whole turns."""
    by_speed = 0.5 * (samples.omega_e[:-1] + samples.omega_e[1:]) if samples.periods == 1 else samples.omega_e[:-1]
    by_speed = by_speed * samples.T
    off = np.diff(samples.theta_e) - by_speed
    turn = 2.0 * math.pi
    return (by_speed + off - turn * np.round(off / turn)) / samples.periods


def flux_balance(samples: Samples, m: int = 1) -> Balance:
    """Balances of the samples' n - 1 complete rows, each the mean over m consecutive ones; shape ((n-1)//m, 10)."""
    T_s, T = samples.T_s, samples.T
    i_d, i_q = samples.i_d, samples.i_q
    if samples.i_d_mean is not None and samples.i_q_mean is not None:
        i_d_trapezoid, i_q_trapezoid = samples.i_d_mean[:-1], samples.i_q_mean[:-1]
    elif samples.periods == 1:
        i_d_trapezoid, i_q_trapezoid = 0.5 * (i_d[:-1] + i_d[1:]), 0.5 * (i_q[:-1] + i_q[1:])
    else:
        raise ValueError(f"rows of {samples.periods} control periods need i_d_mean and i_q_mean")
    D = angle_turned(samples)
    c = np.cos(0.5 * D)
    s = (2.0 / T_s) * np.sin(0.5 * D)
    di_d, di_q = np.diff(i_d), np.diff(i_q)
    arc, drift = 1.0 - D**2 / 8.0, D / (4.0 * samples.periods)
    columns = (
        arc * i_d_trapezoid - drift * di_q, arc * i_q_trapezoid + drift * di_d,
        c * di_d / T, c * di_q / T, s * i_d_trapezoid, s * i_q_trapezoid, s, D**2 / 12.0,
        samples.u_d[:-1], samples.u_q[:-1],
    )
    balance = np.stack(columns, axis=1)
    return balance if m == 1 else mean_of(balance, m)


def mean_of(balance: Balance, m: int) -> Balance:
    """Means over m consecutive balances; what is left over at the end is dropped. Shape (n//m, 10)."""
    n = len(balance) // m
    return balance[: n * m].reshape(n, m, len(COLUMNS)).mean(axis=1)
