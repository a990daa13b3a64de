"""The speed reference: follows what is asked of it at a limited rate, or swings between two ends around it."""

import math
from typing import NamedTuple

from emulator.kernel import kernel


class Ramp(NamedTuple):
    """Where the reference is."""

    omega_e: float  # rad/s, electrical
    end: int  # 1: on its way to the upper end, or there; -1: to the lower one
    held: int  # periods there


@kernel
def ramped(before: Ramp, wanted: float, step: float, rate: float, hold: int, T_s: float) -> Ramp:
    """The reference one period of T_s (s) later, by at most `rate` (rad/s2; 0: at once) nearer to `wanted` (rad/s).

    With a `step` (rad/s) it goes on to `step` above, stays for `hold` periods, goes `step` below, and so on.
    """
    omega_e, end, held = before
    if step > 0.0 and held >= hold:
        end, held = -end, 0
    aim = wanted + end * step
    away = aim - omega_e
    most = rate * T_s if rate > 0.0 else math.inf
    if abs(away) > most:
        return Ramp(omega_e + math.copysign(most, away), end, 0)
    return Ramp(aim, end, held + 1)
