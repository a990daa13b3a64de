"""Constant parameters over a window of rows: flux balances as columns, their whitening on each axis, least squares.

Rows may cover several control periods. Noise of the sampled currents is differenced in a balance e, and white, by axis,
in the flux error

    z[k+1] = exp(-jD/2) (a exp(-jD/2) z[k] + T e[k])

Where the d axis has no equation its part is zero throughout, and the q axis' is filtered without the turn, which mixes
them. Pure; knows nothing of effects.
"""

from typing import Final

import numpy as np

from estimator.arrays import Array, Bools, Vector, Vectors
from estimator.kernel import kernel
from estimator.machine import PLAUSIBLE

POLE: Final = 0.9  # of the whitening, before noise and parameters are known
LEAST_L: Final = PLAUSIBLE["L_d"][0]  # H
ROUND_OFF: Final = 1e-10


def balance_columns(balance: Array, *, q_only: bool = False) -> Vectors:
    """What multiplies R_s, L_d, L_q, psi_f in a row's voltage; the voltage; the small term h; place for the angle."""
    i_d, i_q, x_d, x_q, y_d, y_q, s, h, u_d, u_q = balance.T
    columns = np.stack((i_d + 1j * i_q, x_d + 1j * y_d, 1j * x_q - y_q, 1j * s, u_d + 1j * u_q, h + 0j, 0j * h))
    return on_q(columns) if q_only else columns


def on_q(x: Vectors) -> Vectors:
    """Without the part of the d axis."""
    return x - x.real


def half_turn(D: Array, *, q_only: bool = False) -> Vector:
    """By how much the filter turns: by half of D, but for an axis alone."""
    return np.exp(0.5j * (0.0 * D if q_only else D))


def of_h(beta: Array) -> float:
    R_s, L_d, _, psi_f = beta.tolist()
    return R_s * psi_f / L_d if L_d > LEAST_L else 0.0


def least_squares(columns: Vectors, y: Vector) -> Array:
    rows: Array = np.concatenate((columns.real, columns.imag), axis=1)
    norm: Array = np.sqrt(np.sum(rows**2, axis=1))
    scale: Array = np.divide(1.0, norm, out=np.zeros_like(norm), where=norm > 0.0)
    rows *= scale[:, None]
    inverse: Array = np.array(np.linalg.pinv(rows @ rows.T, ROUND_OFF, hermitian=True), np.float64)
    return inverse @ (rows @ np.concatenate((y.real, y.imag))) * scale


@kernel
def whiten_axes(v: Vectors, half: Vector, joined: Bools, T: float, a_d: float, a_q: float) -> None:
    """The filter above, over the rows of v (columns x rows) in place; it begins anew where a row is not joined."""
    for c in range(v.shape[0]):
        z = 0j
        for k in range(v.shape[1]):
            back = half[k].conjugate()
            z = back * z if joined[k] else 0j
            z = back * (complex(a_d * z.real, a_q * z.imag) + T * v[c, k])
            v[c, k] = z
