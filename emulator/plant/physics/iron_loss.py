"""Iron loss: eddy currents and hysteresis as a branch beside the flux, fed by the voltage that changes it.

    d(psi)/dt = R_i i_i + L_i d(i_i)/dt            i_s = i(psi) + i_i
    R_i = R_c |omega_e| / (|omega_e| + omega_h)    L_i = lag R_c

With R_i = R_c the loss is 3/2 |omega_e psi|^2 / R_c: eddy currents, with the square of speed and flux. omega_h is
the speed at which hysteresis, with the first power of speed and the square of flux, loses as much. `lag` is the time
the field takes to enter a lamination; without it every switching edge would drive a current pulse. Equivalent
resistance: S. Morimoto, Y. Tong, Y. Takeda, T. Hirasa, "Loss minimization control of permanent magnet synchronous
motor drives", IEEE Trans. Industrial Electronics, 1994.

Shows as current that makes neither torque nor flux - without load u_d is too high by omega_e^2 L_q psi_f / R_c - and as
drag; looks like cross-coupling at one speed, and like torque lost.
"""

from typing import Annotated, NamedTuple

from emulator.bounds import Bound
from emulator.kernel import kernel

_SLOWEST = 10.0  # rad/s, electrical: below it the resistance falls no further


class IronLoss(NamedTuple):
    """Sizes; none where R_c is zero."""

    R_c: Annotated[float, Bound("ohm", low=0.0)] = 0.0
    omega_h: Annotated[float, Bound("rad/s", low=0.0, high=1e5)] = 0.0  # electrical
    lag: Annotated[float, Bound("s", low=2e-5, high=1e-2)] = 1e-4


@kernel
def resistance(iron: IronLoss, omega_e: float) -> float:
    """R_i (ohm) at an electrical speed (rad/s)."""
    speed = abs(omega_e) + _SLOWEST
    return iron.R_c * speed / (speed + iron.omega_h)


@kernel
def rate_of(iron: IronLoss, e: complex, omega_e: float, i_i: complex) -> complex:
    """d(i_i)/dt (A/s) under the voltage e = d(psi)/dt (V)."""
    return (e - resistance(iron, omega_e) * i_i) / (iron.lag * iron.R_c)


def stored_energy(iron: IronLoss, i_i: complex) -> float:
    """Magnetic energy (J) of the branch."""
    return 0.75 * iron.lag * iron.R_c * abs(i_i) ** 2
