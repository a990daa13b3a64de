"""Whitening: voltages whose noise is a difference, to flux errors whose noise is white.

Noise n of the sampled current enters a period's voltage as (R_s + L d/dt) n: alike at both ends, with opposite signs.
The filter

    z[k+1] = exp(-jD/2) (rho[k] exp(-jD/2) z[k] + T_s v[k])        rho[k] -> rho = exp(-R_s T_s / L)

undoes it - z = L n - and is the same for every column of a regression. It forgets as the machine's own current does, so
z / L is also the error of a free-running simulation. Where it begins the current's noise is not known, and would stay
in z for as long: the first poles are those of the innovations of a moving average,

    rho[k] = rho / V[k]        V[k+1] = 1 + rho^2 - rho^2 / V[k]        V[0] = 1 + rho^2

(P. J. Brockwell, R. A. Davis, Time Series: Theory and Methods, 2nd ed. 1991, section 5.3). Knows nothing of effects.
"""

import numpy as np
from numpy.typing import NDArray

from estimator.kernel import kernel

Vector = NDArray[np.complex128]
Vectors = NDArray[np.complex128]
Reals = NDArray[np.float64]
Bools = NDArray[np.bool_]


@kernel
def poles_of(joined: Bools, rho: float) -> Reals:
    """rho[k] of each period; runs begin where one is not joined."""
    poles, begun, variance = np.zeros(len(joined)), False, 1.0
    for k in range(len(joined)):
        if joined[k]:
            variance = 1.0 + rho * rho - (rho * rho / variance if begun else 0.0)
            poles[k] = rho / variance  # of the next
        begun = joined[k]
    poles[1:] = poles[:-1].copy()
    poles[0] = 0.0
    return poles


@kernel
def whiten(v: Vectors, half: Vector, joined: Bools, poles: Reals, T_s: float, state: Vector) -> None:
    """Filter the rows of v (columns x periods) in place; `state` (columns) goes on from stretch to stretch."""
    for c in range(v.shape[0]):
        z = state[c]
        for k in range(v.shape[1]):
            back = half[k].conjugate()
            z = back * (poles[k] * back * z + T_s * v[c, k]) if joined[k] else 0j
            v[c, k] = z
        state[c] = z


@kernel
def whiten_into(
    white: Reals, v: Vectors, middle: Vector, rotor: Vector, joined: Bools, poles: Reals, T_s: float,
    noise: tuple[float, float], state: Vector,
) -> NDArray[np.intp]:  # fmt: skip
    """The same over the noise on d and q, as real numbers (columns x 2 x periods); which columns are not zero yet.

    Only those are written, one after the other. By way of the stationary frame: `middle` is exp(j theta_e) in the
    periods' middle, of v's frame, `rotor` that at their ends, of the flux errors' frame.
    """
    there = np.empty(v.shape[0], np.intp)
    count = 0
    for c in range(v.shape[0]):
        z_s, some = state[c], state[c] != 0.0
        for k in range(v.shape[1]):
            v[c, k] *= T_s * middle[k]
        for k in range(v.shape[1]):
            z_s = poles[k] * z_s + v[c, k] if joined[k] else 0j
            v[c, k] = z_s
            some = some or z_s != 0.0
        state[c] = z_s
        if not some:
            continue
        for k in range(v.shape[1]):
            z = v[c, k] * rotor[k].conjugate()
            white[count, 0, k], white[count, 1, k] = z.real / noise[0], z.imag / noise[1]
        there[count] = c
        count += 1
    return there[:count]
