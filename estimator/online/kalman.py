"""The rows of the extended Kalman filter: prediction by one of two models, correction in Joseph's form.

Letters and models as in `ekf`, which prepares the rows; knows nothing of tuning or of what the states say.
"""

import math

import numpy as np

from estimator.arrays import Array
from estimator.kernel import kernel

_CLEAR = 25.0  # a square this many times its variance is no noise


@kernel
def filtered(
    rows: Array, T_s: float, periods: int, model: int, start: Array, P_0: Array, Q: Array, R: Array, x: Array,
    P: Array, level: Array, sums: Array,
) -> None:
    """Take in rows, changing x (5,), P (5, 5) and sums (2,) in place.

    A row (13,) is a flux balance, the angle turned in a control period in rad, i_d and i_q at the end in A;
    `start` is R_s, L_d, L_q, psi_f. `level`: the mean currents that the model of inductances learns with, in A.
    `sums`: squared innovations as a voltage over the row in V^2, and restarts.
    """
    T = T_s * periods
    F, A, work, K = np.eye(5), np.eye(5), np.empty((5, 5)), np.empty((5, 2))
    for k in range(len(rows)):
        row = rows[k]
        if model == 0:
            _fluxes_moved(row, T_s, T, start, x, F)
        else:
            _inductances_moved(row, T, periods, start[3], R, x, F, level)
        _transformed(F, P, work)
        for j in range(5):
            P[j, j] += Q[j] * T

        e_d, e_q = row[11] - x[0], row[12] - x[1]
        S_dd, S_dq, S_qq = P[0, 0] + R[0], P[0, 1], P[1, 1] + R[1]
        det = S_dd * S_qq - S_dq * S_dq
        for j in range(5):
            K[j, 0] = (P[j, 0] * S_qq - P[j, 1] * S_dq) / det
            K[j, 1] = (P[j, 1] * S_dd - P[j, 0] * S_dq) / det
            x[j] += K[j, 0] * e_d + K[j, 1] * e_q
            A[j, 0], A[j, 1] = -K[j, 0], -K[j, 1]
        A[0, 0] += 1.0
        A[1, 1] += 1.0
        _transformed(A, P, work)
        for i in range(5):
            for j in range(i, 5):
                P[i, j] += R[0] * K[i, 0] * K[j, 0] + R[1] * K[i, 1] * K[j, 1]
                P[j, i] = P[i, j]

        ran_away = not (np.isfinite(x).all() and np.isfinite(P).all() and (np.diag(P) >= 0.0).all())
        if model == 1:
            ran_away = ran_away or x[3] <= 0.05 * start[1] or x[4] <= 0.05 * start[2]
        if ran_away:
            _started_anew(row, model, start, x)
            P[:] = P_0
            sums[1] += 1.0
        else:
            sums[0] += ((start[1] * e_d) ** 2 + (start[2] * e_q) ** 2) / T**2


@kernel
def _fluxes_moved(row: Array, T_s: float, T: float, start: Array, x: Array, F: Array) -> None:
    """One Euler step of the published equations, and its Jacobian."""
    u_d, u_q, omega = row[8], row[9], row[10] / T_s
    L_d, L_q = start[1], start[2]
    i_d, i_q, psi_d, psi_q, R_s = x
    x[0] += T * (u_d - R_s * i_d + omega * psi_q) / L_d
    x[1] += T * (u_q - R_s * i_q - omega * psi_d) / L_q
    F[0, 0], F[0, 3], F[0, 4] = 1.0 - T * R_s / L_d, T * omega / L_d, -T * i_d / L_d
    F[1, 1], F[1, 2], F[1, 4] = 1.0 - T * R_s / L_q, -T * omega / L_q, -T * i_q / L_q


@kernel
def _inductances_moved(
    row: Array, T: float, periods: int, psi_f: float, R: Array, x: Array, F: Array, level: Array
) -> None:
    """One row of the flux balance, and its Jacobian, in which a current that is all noise teaches nothing.

    Noise in a regressor looks like excitation: without this, a constant current would soon "tell" R_s from L_q. The
    Jacobian leaves out the small terms with b and h.
    """
    i_d, i_q, _, _, y_d, y_q, s, h, u_d, u_q, D = row[:11]
    R_s, L_d, L_q = x[2:]
    c, b = math.cos(0.5 * D), (R_s * T / periods) ** 2 / 12.0
    b_d, b_q = b / L_d, b / L_q
    g_d, g_q = T / ((L_d + b_d) * c), T / ((L_q + b_q) * c)
    di_d = g_d * (u_d - R_s * (i_d - h * psi_f / L_d) + (L_q + b_d) * y_q)
    di_q = g_q * (u_q - R_s * i_q - (L_d + b_q) * y_d - psi_f * s)
    level[0] = _level(level[0], i_d, R[0] / periods)
    level[1] = _level(level[1], i_q, R[1] / periods)
    learnt_d = _plausible_change(di_d, row[11] - x[0], 2.0 * R[0])
    learnt_q = _plausible_change(di_q, row[12] - x[1], 2.0 * R[1])
    x[0] += di_d
    x[1] += di_q
    i_d, i_q = level
    F[0, 2], F[0, 3], F[0, 4] = -g_d * i_d, -learnt_d / L_d, g_d * s * i_q
    F[1, 2], F[1, 3], F[1, 4] = -g_q * i_q, -g_q * s * i_d, -learnt_q / L_q


@kernel
def _level(before: float, now: float, variance: float) -> float:
    """A measured value, or the one before where the difference is within its noise."""
    return now if (now - before) ** 2 > _CLEAR * variance else before


@kernel
def _plausible_change(predicted: float, measured: float, variance: float) -> float:
    """A predicted change where it stands out of the noise and was not made up by wrong parameters, else 0.

    Predicted and not measured: where a measured one stands out, its noise is more likely than not in its favour.
    """
    return predicted if predicted**2 > _CLEAR * variance and 4.0 * measured**2 > _CLEAR * variance else 0.0


@kernel
def _started_anew(row: Array, model: int, start: Array, x: Array) -> None:
    """All states from the start values and the current at the row's end."""
    R_s, L_d, L_q, psi_f = start
    x[0], x[1] = row[11], row[12]
    if model == 0:
        x[2], x[3], x[4] = L_d * x[0] + psi_f, L_q * x[1], R_s
    else:
        x[2], x[3], x[4] = R_s, L_d, L_q


@kernel
def _transformed(A: Array, P: Array, work: Array) -> None:
    """P = A P A', upper triangle computed and mirrored; all (5, 5)."""
    for i in range(5):
        for j in range(5):
            work[i, j] = 0.0
            for n in range(5):
                work[i, j] += A[i, n] * P[n, j]
    for i in range(5):
        for j in range(i, 5):
            total = 0.0
            for n in range(5):
                total += work[i, n] * A[j, n]
            P[i, j] = total
            P[j, i] = total
