"""A compliant shaft: between the motor and its load is a spring with a damper.

    J   d(omega_m)/dt = tau_e - B omega_m - friction - tau_s
    J_L d(omega_L)/dt = tau_s - tau_L
    tau_s = stiffness twist + damping (omega_m - omega_L)        d(twist)/dt = omega_m - omega_L

A dynamometer holds the load's end. R. Isermann, "Mechatronic Systems", 2005, chapter 4.

Shows as speed ripple at the resonance sqrt(stiffness (1/J + 1/J_L)) when the torque steps.
"""

from typing import Annotated, NamedTuple

from emulator.bounds import Bound


class Compliance(NamedTuple):
    """Sizes; a rigid shaft where the stiffness is zero."""

    stiffness: Annotated[float, Bound("Nm/rad", low=0.0)] = 0.0
    damping: Annotated[float, Bound("Nm s/rad", low=0.0)] = 0.0
    J_L: Annotated[float, Bound("kg m2", above=0.0)] = 8e-4  # of the load, beside the motor's J


def stored_energy(compliance: Compliance, twist: float) -> float:
    """Energy (J) of the spring."""
    return 0.5 * compliance.stiffness * twist**2
