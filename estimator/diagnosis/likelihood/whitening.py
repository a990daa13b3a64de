"""Whitening: voltages whose noise is a difference, to flux errors whose noise is white.

Noise n of the sampled current is one of the flux linkage, w = L n, and enters a period's voltage as (R_s + L d/dt) n:
alike at both ends, with opposite signs, each axis by its own decay A = diag(rho_d, rho_q), rho near exp(-R_s T_s / L).
In the frame of the period's end, with T the turn by -D and w of the variance S = diag(L_d^2, L_q^2),

    T_s v[k] exp(-jD/2) = w[k+1] - T A w[k]

The filter that undoes it is the same for every column of a regression. It forgets as the machine's own current does,
so L^-1 z is also the error of a free-running simulation. Where it begins w is not known, and would stay in z for as
long: z is the innovation of this moving average, and X what is not known of w at a period's first sample,

    z[k+1] = M[k] z[k] + T_s v[k] exp(-jD/2)             M[k]   = T A (S - X[k]) S^-1
    V      = S + T A X[k] A' T'                          X[k+1] = S - S V^-1 S           X[0] = S

(P. J. Brockwell, R. A. Davis, Time Series: Theory and Methods, 2nd ed. 1991, section 5.3 and chapter 11). Knows nothing
of effects.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array, Bools, Vector, Vectors
from estimator.kernel import kernel

Axes = tuple[float, float]
"""Of d and q."""

_FADED: Final = 1e-100  # Vs: less, and squares are near the smallest numbers that there are, which take far longer
_UNKNOWN_SHARE: Final = 1e-9  # of w's variance, that is not known


class Whitening(NamedTuple):
    """The filter over some periods; zero where one is not joined. Flux errors are in the frame of periods' ends."""

    M: Array  # (periods, 2, 2), of a flux error's d and q
    gain: Vector  # (periods), Vs per V in the frame of periods' middles

    def over(self, periods: slice) -> "Whitening":
        """A stretch of them."""
        return Whitening(self.M[periods], self.gain[periods])

    def of_voltages(self, turned: Vector) -> "Whitening":
        """This filter, of voltages that are `turned` (vectors of length 1) against those it was of."""
        return Whitening(self.M, self.gain * turned.conj())


def whitening_of(half: Vector, joined: Bools, L: Axes, rho: Axes, T_s: float) -> Whitening:
    """The filter of inductances (H) and decays on d and q; `half`: exp(j D/2) of each period."""
    M, gain = np.zeros((len(half), 2, 2)), np.zeros(len(half), np.complex128)
    _fill_filter(M, gain, half, joined, (L[1] / L[0]) ** 2, rho, T_s)
    return Whitening(M, gain)


@kernel
def _fill_filter(M: Array, gain: Vector, half: Vector, joined: Bools, s: float, rho: Axes, T_s: float) -> None:
    """With S = diag(1, s), the symmetric X = (x_d, x_x; x_x, x_q), and V likewise."""
    rho_d, rho_q = rho
    x_d, x_q, x_x = 1.0, s, 0.0
    for k in range(len(half)):
        if not joined[k]:
            x_d, x_q, x_x = 1.0, s, 0.0
            continue
        back = half[k].conjugate()
        turn = back * back
        gain[k] = T_s * back
        d_d, d_q = rho_d * (1.0 - x_d), -rho_d * x_x / s  # A (S - X) S^-1
        q_d, q_q = -rho_q * x_x, rho_q * (1.0 - x_q / s)
        M[k, 0, 0], M[k, 0, 1] = turn.real * d_d - turn.imag * q_d, turn.real * d_q - turn.imag * q_q
        M[k, 1, 0], M[k, 1, 1] = turn.imag * d_d + turn.real * q_d, turn.imag * d_q + turn.real * q_q
        if x_d < _UNKNOWN_SHARE and x_q < _UNKNOWN_SHARE * s:
            x_d, x_q, x_x = 0.0, 0.0, 0.0
            continue
        mean = 0.5 * (rho_d * rho_d * x_d + rho_q * rho_q * x_q)
        apart = complex(0.5 * (rho_d * rho_d * x_d - rho_q * rho_q * x_q), rho_d * rho_q * x_x) * turn * turn
        v_d, v_q, v_x = 1.0 + mean + apart.real, s + mean - apart.real, apart.imag
        size = v_d * v_q - v_x * v_x
        x_d, x_q, x_x = 1.0 - v_q / size, s - s * s * v_d / size, s * v_x / size


@kernel
def whiten(v: Vectors, M: Array, gain: Vector, state: Vector) -> None:
    """Filter the rows of v (columns x periods) in place; `state` (columns) goes on from stretch to stretch."""
    for c in range(v.shape[0]):
        d, q = state[c].real, state[c].imag
        for k in range(v.shape[1]):
            v[c, k] = gain[k] * v[c, k] if gain[k] != 0.0 else 0j  # there it may be no number
        for k in range(v.shape[1]):
            d, q = M[k, 0, 0] * d + (M[k, 0, 1] * q + v[c, k].real), M[k, 1, 1] * q + (M[k, 1, 0] * d + v[c, k].imag)
            v[c, k] = complex(d, q)
        state[c] = complex(d, q)


@kernel
def whiten_into(
    white: Array, v: Vectors, M: Array, gain: Vector, noise: tuple[float, float], state: Vector
) -> NDArray[np.intp]:
    """Filter into real numbers over the noise on d and q (columns x 2 x periods); which columns are not zero yet.

    Only those are written, one after the other.
    """
    there = np.empty(v.shape[0], np.intp)
    count = 0
    for c in range(v.shape[0]):
        d, q = state[c].real, state[c].imag
        some = d != 0.0 or q != 0.0
        for k in range(v.shape[1]):
            v[c, k] = gain[k] * v[c, k] if gain[k] != 0.0 else 0j
            some = some or v[c, k] != 0.0
        if not some:
            continue
        for k in range(v.shape[1]):
            d, q = M[k, 0, 0] * d + (M[k, 0, 1] * q + v[c, k].real), M[k, 1, 1] * q + (M[k, 1, 0] * d + v[c, k].imag)
            if abs(d) + abs(q) < _FADED:
                d, q = 0.0, 0.0
            white[count, 0, k], white[count, 1, k] = d / noise[0], q / noise[1]
        state[c] = complex(d, q)
        there[count] = c
        count += 1
    return there[:count]
