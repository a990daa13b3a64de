"""Given: what is known of a drive before its recording is looked at."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from estimator.machine import PARAMETERS, Machine

FAR_OFF: Final = 3.0  # times the tolerance


@dataclass(frozen=True, slots=True)
class Given:
    """The nominal machine, and how well it and the angle are known."""

    machine: Machine
    tolerance: Mapping[str, float]  # of R_s, L_d, L_q, psi_f as a share
    angle_step: float  # rad, the angle's resolution
    unidentified: frozenset[str] = frozenset()  # inductances, which stay within tolerance
    answered: bool = False  # the recorded voltage answers the noise of its own row's currents

    @property
    def told(self) -> list[str]:
        """Parameters that the recording may tell."""
        return [name for name in PARAMETERS if name not in self.unidentified]

    def within(self, name: str, value: float, times: float = 1.0) -> bool:
        """A parameter lies within its tolerance, or so many times that."""
        return abs(value / getattr(self.machine, name) - 1.0) <= times * self.tolerance[name]

    def far_off(self, name: str, value: float) -> bool:
        """A parameter is none that a machine of such a data sheet has."""
        return not self.within(name, value, FAR_OFF)
