"""Given: what is known of a drive before its recording is looked at."""

from collections.abc import Mapping
from dataclasses import dataclass

from estimator.machine import Machine


@dataclass(frozen=True, slots=True)
class Given:
    """The nominal machine, and how well it and the angle are known."""

    machine: Machine
    tolerance: Mapping[str, float]  # of R_s, L_d, L_q, psi_f as a share
    angle_step: float  # rad, the angle's resolution
    untold: frozenset[str] = frozenset()  # inductances that the recording does not tell: they stay within tolerance

    def within(self, name: str, value: float) -> bool:
        """A parameter lies within its tolerance."""
        return abs(value / getattr(self.machine, name) - 1.0) <= self.tolerance[name]
