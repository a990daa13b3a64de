"""What a window can tell: which parameters, and which only in combination.

A direction in parameter space is told when the regressors move along it by clearly more than their own noise does.
Current noise sits inside the regressors (errors in variables), so a column of pure noise looks like
excitation to the normal matrix: the test is the ratio of the two, direction by direction.
Knows nothing of streams; works on one window's normal matrix.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]

NOISE_SHARE = 0.1  # a direction owing more of its regressor energy than this to noise is not told
ROUND_OFF = 1e-10  # relative energy below which a direction is arithmetic, not excitation
INVOLVED = 0.05  # share of the largest contribution from which a parameter counts as part of a combination


@dataclass(frozen=True, slots=True, eq=False)
class Excitation:
    """Excitation of p parameters by one window."""

    told: NDArray[np.bool_]  # shape (p,)
    combinations: tuple[tuple[int, ...], ...]  # groups of parameters that cannot be told apart; one = not at all
    inverse: Matrix  # shape (p, p), inverse of G - N over the directions that are told
    condition: float | None  # of the column-scaled regressor matrix; None where a column is zero


def excitation(G: Matrix, N: Matrix) -> Excitation:
    """Judge a normal matrix G = A'A (p, p) against the part N (p, p, diagonal) that noise contributes to it."""
    p = len(G)
    norm = np.sqrt(np.diag(G))
    lively = np.flatnonzero(norm > 0.0)
    told = np.zeros(p, dtype=np.bool_)
    inverse = np.zeros((p, p))
    combinations: list[tuple[int, ...]] = [(int(j),) for j in np.flatnonzero(norm == 0.0)]
    condition: float | None = None
    if len(lively):
        scale = 1.0 / norm[lively]
        C = G[np.ix_(lively, lively)] * np.outer(scale, scale)
        noise = np.diag(N)[lively] * scale**2 / NOISE_SHARE + ROUND_OFF
        eigenvalue, direction = np.linalg.eigh(C)
        if len(lively) == p and eigenvalue[0] > 0.0:
            condition = float(np.sqrt(eigenvalue[-1] / eigenvalue[0]))
        # Generalised eigenvalues of (C, noise): energy of a direction over what noise would feign.
        whitening = 1.0 / np.sqrt(noise)
        strength, direction = np.linalg.eigh(C * np.outer(whitening, whitening))
        direction = whitening[:, None] * direction  # columns v with v' C v = strength, v' noise v = 1
        strong = strength > 1.0
        V = direction[:, strong]
        clean = C - np.diag(np.diag(N)[lively] * scale**2)
        inverse[np.ix_(lively, lively)] = V @ np.linalg.inv(V.T @ clean @ V) @ V.T * np.outer(scale, scale)
        told[lively] = True
        for v in direction[:, ~strong].T:
            members = lively[np.abs(v) > INVOLVED * np.max(np.abs(v))]
            told[members] = False
            combinations.append(tuple(int(j) for j in members))
    return Excitation(told, tuple(combinations), inverse, condition)
