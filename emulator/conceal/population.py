"""A population: what the sizes of a class are drawn from, and what they are scaled by."""

from collections.abc import Callable
from dataclasses import dataclass

from emulator.bounds import Points
from emulator.conceal.chance import Chance
from emulator.plant.machine import Machine

Sections = dict[str, dict[str, float | Points]]  # keys of `[effects.*]`


@dataclass(frozen=True, slots=True)
class Setting:
    """What sizes are scaled by."""

    machine: Machine  # the true one
    omega_e: float  # rad/s, electrical, at rated speed
    u_dc: float  # V
    T_s: float  # s, control period
    length: float  # s, of the recording
    current_sensors: int = 3

    @property
    def back_emf(self) -> float:
        """V, at rated speed."""
        return self.omega_e * self.machine.psi_f

    @property
    def P_copper(self) -> float:
        """W, at rated current."""
        return 1.5 * self.machine.R_s * self.machine.i_rated**2


@dataclass(frozen=True, slots=True)
class Population:
    """A class: what is drawn, from where to where, and why from there."""

    size: str  # in words
    unit: str
    low: float
    high: float
    why: str
    sizes: Callable[[float, Setting, Chance], Sections]

    def drawn(self, chance: Chance, window: tuple[float, float] = (0.0, 1.0)) -> float:
        """A size; `window` is the part of the range, 0 to 1 of its logarithm, that it is drawn from."""
        if self.low == self.high:
            return self.low
        return self.low * (self.high / self.low) ** chance.uniform(*window)
