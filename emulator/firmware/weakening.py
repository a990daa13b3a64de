"""Field weakening: a current against the magnets' flux where the voltage that the control needs nears the limit.

A PI controller holds the length of the voltage below a share of what the inverter gives, after J.-M. Kim and S.-K. Sul,
"Speed control of interior permanent magnet synchronous motor drive for the flux weakening operation", IEEE Trans. Ind.
Appl. 33(1), 1997. Its gains: at speed |u| is about omega_e (psi_f + L_d i_d), so i_d moves it by omega_e L_d; the zero
is put on the current control's pole alpha, and the loop that is left has the bandwidth alpha_w. Current and voltage are
shortened on the q axis first: a motor that is short of both has less torque, and its flux stays in hand.
"""

import math
from typing import NamedTuple

from emulator.kernel import kernel

_SHARE = 0.2  # alpha_w / alpha


class Weakening(NamedTuple):
    """Where it is."""

    integral: float  # A
    i_d: float  # A, 0 or below: to be added to the reference


NOT_WEAKENED = Weakening(0.0, 0.0)


@kernel
def room(d: float, most: float) -> float:
    """What is left for q (as `most`) beside d."""
    return math.sqrt(max(most * most - d * d, 0.0))


@kernel
def d_first(x: complex, most: float) -> complex:
    """The vector, not longer than `most`: q gives way to d."""
    d = min(max(x.real, -most), most)
    q = room(d, most)
    return complex(d, min(max(x.imag, -q), q))


@kernel
def weakened(
    before: Weakening, spare: float, omega_e: float, slowest: float, L_d: float, alpha: float, lowest: float, T_s: float
) -> Weakening:
    """One control period later. `spare` (V): the limit less the voltage's length; `lowest` (A): most of it, negative.

    `slowest` (rad/s): speed below which no gain grows, where there is nothing to weaken.
    """
    k_i = _SHARE * alpha / (max(abs(omega_e), slowest) * L_d)
    k_p = k_i / alpha
    integral = min(max(before.integral + k_i * T_s * spare, lowest), 0.0)
    return Weakening(integral, min(max(integral + k_p * spare, lowest), 0.0))
