"""Frames: phase values, stationary and rotor-fixed space vectors. Amplitude-invariant (peak) throughout.

A space vector is one complex number: `x_ab = x_alpha + j x_beta` in the stationary frame,
`x_dq = x_d + j x_q` in the rotor frame, `x_ab = exp(j theta_e) x_dq`. alpha lies on phase a, d on the magnet
flux.
"""

import math

from emulator.kernel import kernel

TURN = 2.0 * math.pi  # rad
_COS_120, _SIN_120 = -0.5, math.sqrt(3.0) / 2.0


@kernel
def turned(angle: float) -> complex:
    """exp(j angle); multiply to turn a vector by `angle` (rad)."""
    return complex(math.cos(angle), math.sin(angle))


@kernel
def turned_slightly(angle: float) -> complex:
    """`turned` for a small angle (rad): to 1e-16 up to 0.05, and `turned` itself beyond."""
    if abs(angle) > 0.05:
        return turned(angle)
    x = angle * angle
    return complex(
        1.0 - x * (0.5 - x * (1.0 / 24.0 - x * (1.0 / 720.0 - x / 40320.0))),
        angle * (1.0 - x * (1.0 / 6.0 - x * (1.0 / 120.0 - x / 5040.0))),
    )


@kernel
def wrapped(angle: float) -> float:
    """An angle (rad) turned to within 0 to 2 pi."""
    return angle % TURN


@kernel
def nearest(angle: float) -> float:
    """An angle (rad) turned to within -pi to pi: the shortest way between two angles."""
    return angle - TURN * math.floor(angle / TURN + 0.5)


@kernel
def clarke(x_a: float, x_b: float, x_c: float) -> complex:
    """Stationary space vector of three phase values: 2/3 (x_a + x_b e^(j120) + x_c e^(j240))."""
    return complex(
        2.0 / 3.0 * (x_a + _COS_120 * (x_b + x_c)),
        2.0 / 3.0 * _SIN_120 * (x_b - x_c),
    )


@kernel
def phases(x_ab: complex) -> tuple[float, float, float]:
    """Phase values a, b, c of a stationary space vector, without a zero component."""
    x_alpha, x_beta = x_ab.real, x_ab.imag
    return x_alpha, _COS_120 * x_alpha + _SIN_120 * x_beta, _COS_120 * x_alpha - _SIN_120 * x_beta
