"""Friction beyond the viscous: Coulomb's, and the breakaway that Stribeck found.

    tau = (coulomb + (static - coulomb) exp(-(omega_m / omega_s)^2)) tanh(omega_m / omega_0)

H. Olsson et al., "Friction models and friction compensation", European Journal of Control, 1998,
doi 10.1016/S0947-3580(98)70113-X. The hyperbolic tangent stands for the sign: a shaft at rest creeps under less
torque than the breakaway's, slowly.

Shows in torque and speed on a free shaft; a dynamometer hides it.
"""

import math
from typing import Annotated, NamedTuple

from emulator.bounds import Bound
from emulator.kernel import kernel


class Friction(NamedTuple):
    """Sizes."""

    coulomb: Annotated[float, Bound("Nm", low=0.0)] = 0.0
    static: Annotated[float, Bound("Nm", low=0.0)] = 0.0  # taken as coulomb where it is less
    omega_s: Annotated[float, Bound("rad/s", above=0.0)] = 5.0  # mechanical, where the breakaway has gone
    omega_0: Annotated[float, Bound("rad/s", above=0.0)] = 0.5  # mechanical, width of the sign


@kernel
def torque(friction: Friction, omega_m: float) -> float:
    """Friction torque (Nm), against the speed (rad/s)."""
    coulomb, static, omega_s, omega_0 = friction
    if coulomb == 0.0 and static == 0.0:
        return 0.0
    if static > coulomb:
        coulomb += (static - coulomb) * math.exp(-((omega_m / omega_s) ** 2))
    return coulomb * math.tanh(omega_m / omega_0)
