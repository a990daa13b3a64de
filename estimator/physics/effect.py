"""The shape that every effect of the library has."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from estimator.arrays import Array, Vector
from estimator.physics.rows import Rows

Sizes = Sequence[float]
"""Values of an effect's parameters, in their order."""

Together = Callable[[Rows, Mapping[str, Sizes]], Vector]
"""Voltage, V of each period, that several effects add, by their names."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """A physical number of an effect. Without the effect its sizes are zero; shapes have no such value."""

    name: str
    unit: str
    typical: Callable[[Rows], float]  # how large it commonly is, SI: the standard deviation before data are seen
    low: Callable[[Rows], float] | None = None  # plausible range
    high: Callable[[Rows], float] | None = None
    shape: bool = False
    discrete: bool = False  # a shape that does not move by small steps
    smooths: bool = False  # a shape that is how far currents are known, and nothing to those that follow a model
    ends: bool = False  # a shape at the end of whose range noise and rounding may look like the effect


@dataclass(frozen=True, slots=True)
class Effect:
    """A piece of physics that may have been left out of a machine's model.

    `voltage(rows, sizes)` is what it adds, in V of each period in the rotor frame, to the voltage that the currents and
    the rotor's turning imply; linear in its sizes, or nearly so, at given shapes. Effects whose voltages do not add up
    share a function `together`. `zero(rows, sizes)` is what it makes of the mean of the three measured phase currents,
    A at samples.
    """

    name: str
    title: str  # in a sentence: "the inverter's voltage error"
    parameters: tuple[Parameter, ...]
    voltage: Callable[[Rows, Sizes], Vector]
    shapes: Callable[[Rows], tuple[tuple[float, ...], ...]]  # values of the shapes to begin with, in their order
    fingerprint: str
    confused_with: tuple[str, ...]
    zero: Callable[[Rows, Sizes], Array] | None = None
    told: Callable[[Rows, Sizes], dict[str, tuple[float, str]]] | None = None  # value and unit of what users are told
    current_error: Callable[[Rows, Sizes], Vector] | None = None  # A at samples, stationary frame; measured less true
    moved: Callable[[Rows, Sizes], Vector] | None = None  # A, stationary, by which true currents then have; an error
    # of the current that goes by its slope has this
    angle_error: Callable[[Rows, Sizes], Array | float] | None = None  # rad electrical at samples; measured less true
    misreads_voltage: bool = False  # `voltage` is what the recorded one is too high by
    together: Together | None = None  # `voltage` of all effects that share this
    remembers: Callable[[Rows, Sizes], object] | None = None  # works out what depends on all that came before
    fast_stiffness: Callable[[Sizes], float] | None = None  # 1/H of a branch beside the machine, within a period
    fast_resistance: Callable[[Rows, Sizes], float] | None = None  # ohm, to what changes within a period
    heats: Callable[[Rows, Sizes], Array] | None = None  # A^2 at samples, to |i|^2 in what warms the winding
    beside: Callable[[Rows, Sizes], Vector] | None = None  # A at samples, that flows beside what makes flux
    lasts: bool = False  # it remembers all of the recording, not its last tenths of a second
    sees_voltage: bool = False  # it follows the voltage at the terminals, of which a bridge may lose some
    emf: Callable[[Rows, Sizes], Vector] | None = None  # V at samples, that it takes from what drives the current
    bends: bool = False  # its size multiplies the machine's parameters, and they trade along a curve
    steep: bool = False  # it changes more with a current than the noise of the current allows to see
    by_speed: float = 0.0  # share of the effect's energy that errors of the speed make of the machine's own voltage
    missed: float = 5e-4  # share of the effect's energy that its equation may miss in a real one
    in_proportion_to: str = ""  # the parameter of the machine that `voltage` grows with, where it is one alone
    scales: Callable[[Rows, Sizes], float] | None = None  # share by which it may scale all voltages, unseen

    @property
    def sizes(self) -> tuple[int, ...]:
        """Places of the parameters that are sizes."""
        return tuple(k for k, parameter in enumerate(self.parameters) if not parameter.shape)

    @property
    def measures(self) -> bool:
        """It is an error of measurement, that recordings can be rid of; `voltage` is then what a small one adds."""
        return self.current_error is not None or self.angle_error is not None or self.misreads_voltage


def no_shapes(_rows: Rows) -> tuple[tuple[float, ...], ...]:
    """Of an effect that has sizes only."""
    return ((),)


def constant(value: float) -> Callable[[Rows], float]:
    """A typical value or a bound that is the same for every machine."""
    return lambda _rows: value


DEGREE: Final = math.radians(1.0)
