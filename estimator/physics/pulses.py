"""Pulses: the ripple of the flux linkage under a bridge's pulses, by the duties of space-vector modulation.

Knows no effect.
"""

from typing import Final

import numpy as np

from estimator.arrays import Array, Vector
from estimator.kernel import kernel
from estimator.physics.vectors import AXES

_NO_PULSE: Final = 1e-5  # of a period: no bridge makes one so short; a leg stays at its rail


@kernel
def add_mean_of_pulses(mean: Vector, M: Vector, D: Array, T_s: float, R_s: float, g_a: Array, g_b: Vector) -> None:
    """Add to mean currents (A, of each period) what the first moments (Vs s) of its pulses add."""
    for k in range(len(mean)):
        mean[k] += mean_of_pulses(M[k], D[k] / T_s, R_s, g_a[k], g_b[k])


@kernel
def mean_of_pulses(M: complex, omega: float, R_s: float, g_a: float, g_b: complex) -> complex:
    """What the first moment (Vs s) of a period's pulses adds to its mean current, A: see `Rows.mean_current`."""
    once = g_a * M + g_b * M.conjugate()
    twice = g_a * once + g_b * once.conjugate()
    return R_s * twice + 2j * omega * g_b * M.conjugate()


@kernel
def moments_of_pulses(duties: Array, u_dc: Array, middle: Vector, T_s: float) -> Vector:
    """First moment (Vs s) of the ripple in each period, rotor frame, for duties of shape (n, 3)."""
    M = np.empty(len(middle), np.complex128)
    for k in range(len(middle)):
        ripple = 0j
        for leg in range(3):
            d = duties[k, leg]
            ripple += 2.0 / 3.0 * AXES[leg] * (d * (1.0 - d * d))
        M[k] = ripple * u_dc[k] * middle[k].conjugate() * (T_s**2 / 24.0)
    return M


@kernel
def powers_of_pulses(duties: Array, u_dc: Array, middle: Vector, T_s: float) -> tuple[Array, Vector]:
    """Means of abs(ripple)^2 and ripple^2 (Vs^2) in each period, for duties of shape (n, 3)."""
    size, square = np.empty(len(middle)), np.empty(len(middle), np.complex128)
    for k in range(len(middle)):
        plain, turning = 0.0, 0j
        for j in range(3):
            for n in range(j + 1):
                both = (1.0 if j == n else 2.0) * _common_ripple(duties[k, j], duties[k, n])
                plain += (AXES[j] * AXES[n].conjugate()).real * both
                turning += AXES[j] * AXES[n] * both
        scale, back = (u_dc[k] * T_s / 3.0) ** 2, middle[k].conjugate()  # (2/3)^2 (T_s/2)^2
        size[k], square[k] = scale * plain, scale * turning * back * back
    return size, square


@kernel
def _common_ripple(one: float, other: float) -> float:
    """Mean product of the ripples of two legs' pulses of such duties, for a link of 1 V and half a period of 1 s."""
    d, e = min(one, other), max(one, other)
    inner = (1.0 - d) * d**3 / 3.0 + d * ((e * e - d * d) / 2.0 - (e**3 - d**3) / 3.0)
    return (1.0 - e) * (inner + d * e * (1.0 - e) ** 2 / 3.0)


@kernel
def duties_of(u_s: Vector, u_dc: Array) -> Array:
    """Duties of the three legs, (n, 3), for voltages (V) in the stationary frame by space-vector modulation."""
    duties = np.empty((len(u_s), 3))
    u = np.empty(3)
    for k in range(len(u_s)):
        for leg in range(3):
            u[leg] = u_s[k].real * AXES[leg].real + u_s[k].imag * AXES[leg].imag
        lift = 0.5 * (max(u[0], u[1], u[2]) + min(u[0], u[1], u[2]))
        for leg in range(3):
            duty = 0.5 + (u[leg] - lift) / u_dc[k]
            duties[k, leg] = 0.0 if duty < _NO_PULSE else 1.0 if duty > 1.0 - _NO_PULSE else duty
    return duties
