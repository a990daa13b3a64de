"""Inter-turn short: a share mu of one phase's turns is bridged by a resistance.

The loop's current i_t flows against the phase's in those turns, so they add mu (i_k - i_t) of magnetomotive force:

    L_t d(i_t)/dt = mu (R_k i_k + d(psi_k)/dt) - (R_t + mu R_k) i_t        i_s = i(psi) + 2/3 mu i_t e_k
    u = ... - 2/3 mu R_k i_t e_k

e_k is the phase's axis, psi_k the flux linkage along it. B. Vaseghi, N. Takorabet,
F. Meibody-Tabar, "Fault analysis and parameter identification of permanent-magnet motors by the finite-element
method", IEEE Trans. Magnetics, 2009. The loop's leakage is set by its time constant, which data sheets do not give.

Shows as a current of twice the electrical frequency in the rotor frame that grows with speed, and a hot spot.
"""

from typing import Annotated, NamedTuple

from emulator.bounds import Bound
from emulator.kernel import kernel

_LAG = 1e-4  # s, time constant of the loop


class TurnShort(NamedTuple):
    """Sizes; none where the share is zero."""

    share: Annotated[float, Bound(low=0.0, high=0.5)] = 0.0  # mu, of the turns of a phase
    R_t: Annotated[float, Bound("ohm", above=0.0)] = 0.1
    phase: Annotated[int, Bound(low=0, high=2)] = 0  # 0, 1, 2: a, b, c


@kernel
def loop_inductance(short: TurnShort, R_s: float) -> float:
    """L_t (H)."""
    return _LAG * (short.R_t + short.share * R_s)


def stored_energy(short: TurnShort, R_s: float, i_t: float) -> float:
    """Magnetic energy (J) of the loop's leakage."""
    return 0.5 * loop_inductance(short, R_s) * i_t**2
