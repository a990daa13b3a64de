"""Whitening: voltages whose noise is a difference, to flux errors whose noise is white.

Noise n of the sampled current enters a period's voltage as (R_s + L d/dt) n: alike at both ends, with opposite signs.
The filter

    z[k+1] = exp(-jD/2) (rho exp(-jD/2) z[k] + T_s v[k])        rho = exp(-R_s T_s / L)

undoes it - z = L n - and is the same for every column of a regression. It forgets as the machine's own current does, so
z / L is also the error of a free-running simulation. Knows nothing of effects.
"""

import numpy as np
from numpy.typing import NDArray

from estimator.kernel import kernel

Vector = NDArray[np.complex128]
Vectors = NDArray[np.complex128]
Bools = NDArray[np.bool_]


@kernel
def whiten(v: Vectors, half: Vector, joined: Bools, T_s: float, rho: float, state: Vector) -> None:
    """Filter the rows of v (columns x periods) in place; `state` (columns) goes on from stretch to stretch."""
    for c in range(v.shape[0]):
        z = state[c]
        for k in range(v.shape[1]):
            back = half[k].conjugate()
            z = back * (rho * back * z + T_s * v[c, k]) if joined[k] else 0j
            v[c, k] = z
        state[c] = z
