"""Sums over a window's regression rows: all that a solution needs of the window, for any length.

A row, by axis (d, q), is z = (R_s, L_d, L_q, psi_f, h, u): what multiplies each parameter in `flux_balance`, the
place of the small term h, and the voltage. Knows nothing of streams or of solving.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from estimator.arrays import Array
from estimator.samples import NOT_KNOWN, Resolution

SIZE: Final = 6  # of z
H: Final = 4  # place of h, and
U: Final = 5  # of u in it
_PLACES: Final = (np.array([0, 1, 2, 4, 5]), np.array([0, 1, 2, 3, 5]))  # of a d-axis and a q-axis row in z
_UPPER: Final = np.triu_indices(len(_PLACES[0]))


@dataclass(frozen=True, slots=True, eq=False)
class WindowSums:
    """Sums of K windows of one stream."""

    lag0: Array  # (K, 2, 6, 6): by axis, z_k z_k'
    lag1: Array  # (K, 2, 6, 6): by axis, z_k z_{k+1}' + its transpose, over neighbouring rows
    batch: Array  # (K, 2, 6, 6): by axis, b b', b the weighted sum of z over a batch of consecutive rows
    rows: Array  # (K,)
    pairs: Array  # (K,), of neighbouring rows
    batches: Array  # (K,); 0 where there are none, and then `batch` is 0 too
    w_w: Array  # (K,), sum over batches of their weights' squares,
    w_next: Array  # (K,), and of the products of neighbouring weights
    T_s: float  # s, control period
    periods: int  # control periods that a row covers
    resolution: Resolution
    q_only: bool = False  # the d axis has no equation: its sums are zero, but for that of h

    @property
    def axes(self) -> int:
        """Equations of a row."""
        return 1 if self.q_only else 2

    @property
    def T(self) -> float:
        """Time that a row covers in s."""
        return self.T_s * self.periods


def sums_from(
    triangles: Array, counts: Array, T_s: float, periods: int, resolution: Resolution = NOT_KNOWN, *,
    q_only: bool = False,
) -> WindowSums:
    """Sums from upper triangles (K, 6, 15), d and q axis of lag0, lag1 and batch, then the five counts (K, 5)."""
    full = np.zeros((len(triangles), 6, SIZE, SIZE))
    for axis, places in enumerate(_PLACES):
        row, column = places[_UPPER[0]], places[_UPPER[1]]
        full[:, axis::2, row, column] = full[:, axis::2, column, row] = triangles[:, axis::2]
    if q_only:
        h = full[:, 0, H, H].copy()
        full[:, ::2] = 0.0
        full[:, 0, H, H] = h
    rows, pairs, batches, w_w, w_next = counts.T
    return WindowSums(
        full[:, :2], full[:, 2:4], full[:, 4:], rows, pairs, batches, w_w, w_next, T_s, periods, resolution,
        q_only,
    )
