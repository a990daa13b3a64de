"""The window's plain least-squares estimate at every row of a run: what a plot over time or a comparison needs.

The same sums as in `window_ls`, arranged for one pass over rows that are all there: each window is the rest of the
chunk it begins in, whole chunks, and the beginning of the chunk it ends in. Sums only ever add. Neither standard errors
nor small terms nor noise; for these, ask `window_ls.estimate` where it matters.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array
from estimator.kernel import kernel
from estimator.machine import PARAMETERS
from estimator.online.flux_balance import Balance

_CHUNK = 1024  # rows
_SUMS = 14  # upper triangle of A'A (4 x 4), then A'b
_SINGULAR = 1e-12  # of a pivot against its diagonal


def track(
    balance: Balance, length: int, estimated: Sequence[str] = PARAMETERS, held: Mapping[str, float] | None = None
) -> Array:
    """Estimates (n, 4) in the order of PARAMETERS, row k from the `length` balances that end with row k.

    NaN while the window is not full and where it cannot be solved. Parameters not in `estimated` stand at their
    `held` values (SI).
    """
    if length < 4:
        raise ValueError(f"a window to track has at least 4 rows, got {length}")
    held = held or {}
    free = np.array([name in estimated for name in PARAMETERS])
    values = np.array([0.0 if name in estimated else held[name] for name in PARAMETERS])
    out = np.full((len(balance), 4), np.nan)
    chunk = min(_CHUNK, length // 2)
    _track(np.ascontiguousarray(balance), length, chunk, free, values, out)
    return out


@kernel
def _track(z: Array, length: int, chunk: int, free: NDArray[np.bool_], held: Array, out: Array) -> None:
    n = len(z)
    sums = np.zeros((n // chunk + 1, _SUMS))  # of whole chunks
    suffix = np.zeros((chunk + 1, _SUMS))  # of the rest of the window's first chunk, from each of its rows on
    middle = np.zeros(_SUMS)
    prefix = np.zeros(_SUMS)
    total = np.zeros(_SUMS)
    for k in range(n):
        _add(z[k], prefix)
        first = k - length + 1
        if first >= 0:
            if first % chunk == 0 or first == 0:
                begin = first
                suffix[chunk] = 0.0
                for row in range(chunk - 1, -1, -1):
                    suffix[row] = suffix[row + 1]
                    _add(z[begin + row], suffix[row])
                _middle(sums, first // chunk + 1, k // chunk, middle)
            elif k % chunk == 0:
                _middle(sums, first // chunk + 1, k // chunk, middle)
            rest = suffix[first % chunk]
            for e in range(_SUMS):
                total[e] = rest[e] + middle[e] + prefix[e]
            _solve(total, free, held, out[k])
        if (k + 1) % chunk == 0:
            sums[k // chunk] = prefix
            prefix[:] = 0.0


@kernel
def _middle(sums: Array, first: int, end: int, middle: Array) -> None:
    middle[:] = 0.0
    for c in range(first, end):
        middle += sums[c]


@kernel
def _add(row: Array, s: Array) -> None:
    """Add a balance's two equations: u_d = R_s i_d + L_d x_d - L_q y_q, u_q = R_s i_q + L_d y_d + L_q x_q + psi_f s."""
    i_d, i_q, x_d, x_q, y_d, y_q = row[0], row[1], row[2], row[3], row[4], -row[5]
    w, u_d, u_q = row[6], row[8], row[9]
    s[0] += i_d * i_d + i_q * i_q
    s[1] += i_d * x_d + i_q * y_d
    s[2] += i_d * y_q + i_q * x_q
    s[3] += i_q * w
    s[4] += x_d * x_d + y_d * y_d
    s[5] += x_d * y_q + y_d * x_q
    s[6] += y_d * w
    s[7] += y_q * y_q + x_q * x_q
    s[8] += x_q * w
    s[9] += w * w
    s[10] += i_d * u_d + i_q * u_q
    s[11] += x_d * u_d + y_d * u_q
    s[12] += y_q * u_d + x_q * u_q
    s[13] += w * u_q


@kernel
def _solve(s: Array, free: NDArray[np.bool_], held: Array, beta: Array) -> None:
    """Solve A'A beta = A'b by L D L'; a held parameter's equation is replaced by its value."""
    a, b, c, d, e, f, g, h, i, j = s[0], s[1], s[2], s[3], s[4], s[5], s[6], s[7], s[8], s[9]
    p, q, r, t = s[10], s[11], s[12], s[13]
    if not free[0]:
        q, r, t = q - b * held[0], r - c * held[0], t - d * held[0]
        a, b, c, d, p = 1.0, 0.0, 0.0, 0.0, held[0]
    if not free[1]:
        p, r, t = p - b * held[1], r - f * held[1], t - g * held[1]
        e, b, f, g, q = 1.0, 0.0, 0.0, 0.0, held[1]
    if not free[2]:
        p, q, t = p - c * held[2], q - f * held[2], t - i * held[2]
        h, c, f, i, r = 1.0, 0.0, 0.0, 0.0, held[2]
    if not free[3]:
        p, q, r = p - d * held[3], q - g * held[3], r - i * held[3]
        j, d, g, i, t = 1.0, 0.0, 0.0, 0.0, held[3]
    # Pivots D_k and their reciprocals; L below the diagonal
    if not a > 0.0:
        return
    r0 = 1.0 / a
    l10, l20, l30 = b * r0, c * r0, d * r0
    d1 = e - l10 * b
    if not d1 > _SINGULAR * e:
        return
    r1 = 1.0 / d1
    m21, m31 = f - l20 * b, g - l30 * b
    l21, l31 = m21 * r1, m31 * r1
    d2 = h - l20 * c - l21 * m21
    if not d2 > _SINGULAR * h:
        return
    r2 = 1.0 / d2
    m32 = i - l30 * c - l31 * m21
    l32 = m32 * r2
    d3 = j - l30 * d - l31 * m31 - l32 * m32
    if not d3 > _SINGULAR * j:
        return
    y1 = q - l10 * p
    y2 = r - l20 * p - l21 * y1
    y3 = t - l30 * p - l31 * y1 - l32 * y2
    x3 = y3 / d3
    x2 = y2 * r2 - l32 * x3
    x1 = y1 * r1 - l21 * x2 - l31 * x3
    beta[0] = p * r0 - l10 * x1 - l20 * x2 - l30 * x3
    beta[1], beta[2], beta[3] = x1, x2, x3
