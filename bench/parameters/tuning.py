"""Gains of the drive's loops by rule, from what the motor is and how long the loop's delays are.

**Current**, by internal model: alpha L and alpha R_s cancel the machine's pole, and leave a first order of bandwidth
alpha (L. Harnefors, H.-P. Nee, "Model-based current control of AC machines using the internal model control method",
IEEE Trans. Industry Applications 34(1), 1998). A voltage acts 1.5 control periods late; with alpha = 1/(3 T_s) the loop
is the magnitude optimum of that delay: it overshoots by 4.3 % (C. Kessler, "Über die Vorausberechnung optimal
abgestimmter Regelkreise", Regelungstechnik 3, 1955).

**Speed**, by symmetrical optimum: with T the sum of the small delays and K the acceleration by a current,

    k_p = 1 / (a K T)      k_i = k_p / (a^2 T)      K = 1.5 n_p^2 psi_f / J, electrical

(C. Kessler, "Das symmetrische Optimum", Regelungstechnik 6, 1958.) The crossover is 1/(a T), the phase margin
atan(a) - atan(1/a): 37 deg with a = 2. The electrical speed is controlled, and the current's peak value.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from bench.errors import LimitError

FASTEST: Final = 1.0 / 3.0  # of 1/T_s: a current loop's bandwidth, where its delay is 1.5 T_s
DELAY: Final = 1.5  # control periods from a sample to the middle of the period its voltage is applied over
_LEAST_A: Final = 1.5  # below, the phase margin is less than 23 deg


@dataclass(frozen=True, slots=True)
class Tuned:
    """Gains by signal, SI, and what they promise."""

    values: Mapping[str, float]
    bandwidth: float  # rad/s, of the loop
    phase_margin: float  # rad


def current_loop(R_s: float, L_d: float, L_q: float, T_s: float, bandwidth: float | None = None) -> Tuned:
    """Gains of the current control (ohm, H, s), of a bandwidth (rad/s) or the fastest one. Raises LimitError."""
    alpha = FASTEST / T_s if bandwidth is None else bandwidth
    check_bandwidth(alpha, T_s)
    values = {
        "own_gains": 1.0, "bandwidth": alpha, "k_p_d": alpha * L_d, "k_i_d": alpha * R_s, "k_p_q": alpha * L_q,
        "k_i_q": alpha * R_s,
    }  # fmt: skip
    return Tuned(values, alpha, 0.5 * math.pi - alpha * DELAY * T_s)


def check_bandwidth(alpha: float, T_s: float) -> None:
    """Raise LimitError where a current control of this bandwidth (rad/s) would be too fast for its period (s)."""
    most = FASTEST / T_s
    if not 0.0 < alpha <= most * (1.0 + 1e-9):
        said = f"expected at most {most:.4g} rad/s with a control period of {T_s:g} s, got {alpha:g}"
        raise LimitError(f"bandwidth: {said}")


def speed_loop(J: float, psi_f: float, n_p: int, delays: float, *, a: float = 2.0) -> Tuned:
    """Gains of the speed control (kg m2, Vs), where small delays are `delays` (s) in all. Raises LimitError.

    Those are 1/bandwidth of the current loop, the speed filter's time constant, and half a control period.
    """
    if a < _LEAST_A:
        raise LimitError(f"a: expected at least {_LEAST_A:g}, the loop would ring, got {a:g}")
    if min(J, psi_f, delays) <= 0.0 or n_p < 1:
        raise LimitError(f"expected inertia, flux and delays above zero, got {J:g} kg m2, {psi_f:g} Vs, {delays:g} s")
    K = 1.5 * n_p**2 * psi_f / J
    k_p = 1.0 / (a * K * delays)
    margin = math.atan(a) - math.atan(1.0 / a)
    return Tuned({"k_p_speed": k_p, "k_i_speed": k_p / (a * a * delays)}, 1.0 / (a * delays), margin)
