"""What a window can tell: which parameters, and which only in combination.

A direction in parameter space is told when the regressors move along it by clearly more than their own noise does.
Current noise sits inside the regressors (errors in variables), so a column of pure noise looks like
excitation to the normal matrix: the test is the ratio of the two, direction by direction.
Knows nothing of streams; works on the normal matrices of K windows at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from estimator.arrays import Array

NOISE_SHARE: Final = 0.1  # a direction owing more of its regressor energy than this to noise is not told
ARITHMETIC_ENERGY: Final = 1e-10  # relative energy below which a direction is arithmetic, not excitation
INVOLVED: Final = 0.05  # share from which two parameters count as coupled by a direction


@dataclass(frozen=True, slots=True, eq=False)
class Excitation:
    """Excitation of p parameters by each of K windows.

    Directions are counted in units of each column's own size: the voltage that a parameter contributes.
    """

    scale: Array  # (K, p), one over each column's norm; 0 for a column of zeros
    inverse: Array  # (K, p, p), of G - N over the directions that are told
    plain: Array  # (K, p, p), of G over those that are not, as far as arithmetic goes
    weak: Array  # (K, p, p), orthonormal columns that span the directions that are not told, and columns of zeros


def excitation(G: Array, N: Array) -> Excitation:
    """Judge normal matrices G = A'A (K, p, p) against what noise contributes to their diagonals, N (K, p)."""
    scale, C = _normalised(G)
    noise = N * scale**2
    # Generalised eigenvalues of (C, doubt): energy of a direction over what noise would feign.
    doubt = noise / NOISE_SHARE + ARITHMETIC_ENERGY
    whitening = 1.0 / np.sqrt(doubt)
    strength, v = np.linalg.eigh(C * whitening[:, :, None] * whitening[:, None, :])
    v = whitening[:, :, None] * v  # columns with v' C v = strength, v' doubt v = 1
    strong = strength > 1.0
    energy_1 = np.where(strength > 0.0, 1.0 / np.sqrt(np.maximum(strength, 1e-300)), 0.0)
    V = v * np.where(strong, energy_1, 0.0)[:, None, :]
    inner = np.eye(G.shape[-1]) - V.transpose(0, 2, 1) @ (noise[:, :, None] * V)
    back = scale[:, :, None] * scale[:, None, :]
    told = V @ np.linalg.inv(inner) @ V.transpose(0, 2, 1) * back
    if strong.all():
        none = np.zeros(told.shape)
        return Excitation(scale, told, none, none)
    size = np.linalg.norm(v, axis=1)  # a direction of length 1 has the energy strength / size^2
    some = ~strong & (strength > ARITHMETIC_ENERGY * size**2)
    W = v * np.where(some, energy_1, 0.0)[:, None, :]
    return Excitation(scale, told, W @ W.transpose(0, 2, 1) * back, _basis(v * ~strong[:, None, :]))


def condition(G: Array) -> Array:
    """Condition numbers of the column-scaled regressors, shape (K,); infinite where a column is zero."""
    scale, C = _normalised(G)
    eigenvalue = np.linalg.eigvalsh(C)
    least, largest = eigenvalue[:, 0], eigenvalue[:, -1]
    finite = (scale > 0.0).all(axis=1) & (least > 0.0)
    return np.sqrt(np.divide(largest, least, out=np.full_like(least, np.inf), where=finite))


def combinations(weak: Array, untold: Sequence[int]) -> list[tuple[int, ...]]:
    """Groups of untold parameters that a window cannot tell apart, from its weak directions; one alone: not at all.

    The finest groups whose sums of directions make up all that is weak: where the projector on it couples two
    parameters, they are of one group.
    """
    projector = weak @ weak.T
    share = np.sqrt(np.maximum(np.diag(projector), 0.0))
    left = list(untold)
    groups: list[tuple[int, ...]] = []
    while left:
        group = [left.pop(0)]
        for j in group:  # grows while it is walked
            coupled = [k for k in left if abs(projector[j, k]) > INVOLVED * share[j] * share[k]]
            left = [k for k in left if k not in coupled]
            group += coupled
        groups.append(tuple(sorted(group)))
    return groups


def _normalised(G: Array) -> tuple[Array, Array]:
    """One over the norm of each column, 0 for a column of zeros, and G in columns of norm 1."""
    norm = np.sqrt(np.diagonal(G, axis1=1, axis2=2))
    scale = np.divide(1.0, norm, out=np.zeros(norm.shape), where=norm > 0.0)
    return scale, G * scale[:, :, None] * scale[:, None, :]


def _basis(columns: Array) -> Array:
    """Orthonormal columns that span the same as those of each matrix, and columns of zeros."""
    norm = np.linalg.norm(columns, axis=1, keepdims=True)
    basis, spread, _ = np.linalg.svd(np.divide(columns, norm, out=np.zeros_like(columns), where=norm > 0.0))
    return basis * (spread > ARITHMETIC_ENERGY)[:, None, :]
