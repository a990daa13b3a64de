"""The shaft: held at a speed by an ideal dynamometer, or free. Knows nothing of what drives it.

    J d(omega_m)/dt = tau_e - tau_L - B omega_m - friction

tau_L acts on a free shaft only: a dynamometer holds its speed whatever the torque.
"""

import math
from typing import NamedTuple

from emulator.kernel import kernel
from emulator.plant.physics.compliance import Compliance
from emulator.plant.physics.friction import Friction, torque


class Profile(NamedTuple):
    """Speed over time: from `omega_0` to `omega_1` in a straight line, then there; a swing on top."""

    omega_0: float  # rad/s, mechanical, at t = 0
    omega_1: float  # rad/s, from t_ramp on
    t_ramp: float  # s
    swing: float  # rad/s, amplitude
    swing_f: float  # Hz


class Shaft(NamedTuple):
    """The shaft and what it carries."""

    held: bool  # by a dynamometer that follows the profile whatever the torque
    profile: Profile
    J: float  # kg m2, motor and load
    B: float  # Nm s/rad
    tau_L: float  # Nm
    friction: Friction = Friction()
    compliance: Compliance = Compliance()


@kernel
def profile_speed(profile: Profile, t: float) -> float:
    """Mechanical speed (rad/s) that the profile asks for at a time (s)."""
    omega_m = profile.omega_1
    if t < profile.t_ramp:
        omega_m = profile.omega_0 + (profile.omega_1 - profile.omega_0) * (t / profile.t_ramp)
    if profile.swing != 0.0:
        omega_m += profile.swing * math.sin(2.0 * math.pi * profile.swing_f * t)
    return omega_m


@kernel
def drag(shaft: Shaft, omega_m: float) -> float:
    """Torque (Nm) of all friction at a speed (rad/s)."""
    return shaft.B * omega_m + torque(shaft.friction, omega_m)
