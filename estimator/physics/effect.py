"""What an effect is, and the kinds of effects there are."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Final

from estimator.arrays import Array, Vector
from estimator.physics.rows import Rows

Sizes = Sequence[float]
"""Values of an effect's parameters, in their order."""


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
    fine: bool = False  # a shape that is known closely: its typical size is that of a change
    smooths: bool = False  # a shape that is how far currents are known, and nothing to those that follow a model
    ends: bool = False  # a shape at the end of whose range noise and rounding may look like the effect


@dataclass(frozen=True, slots=True)
class Effect:
    """A piece of physics that may have been left out of a machine's model; each is of one of three kinds.

    It adds a voltage (`AddedVoltage`; a `Branch` beside the machine and a `BridgeError` are such), changes the machine
    (`ResistanceChange`, `saturation.FluxChange`), or errs a sensor (`SensorError`).
    """

    name: str
    title: str  # in a sentence: "the inverter's voltage error"
    parameters: tuple[Parameter, ...]
    shapes: Callable[[Rows], tuple[tuple[float, ...], ...]]  # values of the shapes to begin with, in their order
    fingerprint: str
    confused_with: tuple[str, ...]
    _: KW_ONLY
    discrepancy: float  # share of the effect's energy that its equation may miss in a real one, and
    misses_more: Callable[[Sizes], float] | None = None  # the same beyond it, of these sizes
    told: Callable[[Rows, Sizes], dict[str, tuple[float, str]]] | None = None  # value and unit of what users are told
    remembers: Callable[[Rows, Sizes], object] | None = None  # works out what depends on all that came before
    emf: Callable[[Rows, Sizes], Vector] | None = None  # V at samples, that it takes from what drives the current
    in_proportion_to: str = ""  # the parameter of the machine that `voltage` grows with, where it is one alone
    undoes: str = ""  # an effect that it is there to undo, and hides
    other_form_of: str = ""  # an effect of the same cause in another form: never both
    without_current: bool = False  # it is read with the bridge off as well, where no current flows
    while_speed_changes: bool = False  # it acts only then
    bends: bool = False  # its size multiplies the machine's parameters, and they trade along a curve

    @property
    def sizes(self) -> tuple[int, ...]:
        """Places of the parameters that are sizes."""
        return tuple(k for k, parameter in enumerate(self.parameters) if not parameter.shape)

    def missed(self, sizes: Sizes) -> float:
        """Share of its energy that its equation may miss at these sizes."""
        return self.discrepancy + (self.misses_more(sizes) if self.misses_more is not None else 0.0)

    @property
    def moves(self) -> bool:
        """It has a shape that moves by small steps."""
        return any(parameter.shape and not parameter.discrete for parameter in self.parameters)

    def in_order(self, shapes: Sequence[float], sizes: Mapping[int, float] | None = None) -> tuple[float, ...]:
        """Its parameters of these shapes and sizes, these by their places; sizes that are not given are none."""
        left, given = iter(shapes), sizes or {}
        return tuple(next(left) if p.shape else given.get(k, 0.0) for k, p in enumerate(self.parameters))

    def none_at(self, sizes: Sizes) -> tuple[float, ...]:
        """Its parameters where there is none of it, and its shapes are as they are."""
        return tuple(x if p.shape else 0.0 for x, p in zip(sizes, self.parameters, strict=True))

    def voltage(self, rows: Rows, sizes: Sizes) -> Vector:
        """What it adds (V of each period, rotor frame) to the voltage that the currents and the rotor's turning imply.

        Linear in its sizes, or nearly so, at given shapes. Of an error of measurement: what a small one adds.
        """
        raise NotImplementedError


@dataclass(frozen=True, slots=True)
class Smoothing:
    """What becomes of currents on their way into the recording, where that is linear and alike in all directions."""

    through: Callable[[Rows, Sizes, Vector], Vector]  # of a voltage (V of each period, stationary) that drives currents
    before: Callable[[Rows, Sizes], Vector]  # A at samples, stationary: currents as they were
    share: Callable[[Sizes], float]  # of them
    samples: Callable[[Sizes], int] = lambda _sizes: 1  # of which each value is the mean, with their noise


@dataclass(frozen=True, slots=True, kw_only=True)
class AddedVoltage(Effect):
    """Adds a voltage to the machine's equation, whatever other effects there are."""

    adds: Callable[[Rows, Sizes], Vector]  # V of each period
    smooths: Smoothing | None = None  # measured currents are smoothed, and what other effects add comes with them
    by_speed: float = 0.0  # share of the effect's energy that errors of the speed make of the machine's own voltage

    def voltage(self, rows: Rows, sizes: Sizes) -> Vector:
        """V of each period."""
        return self.adds(rows, sizes)


@dataclass(frozen=True, slots=True, kw_only=True)
class BridgeError(AddedVoltage):
    """What a bridge loses: it changes more with a current than the noise of the current allows to see."""

    scales: Callable[[Rows, Sizes], float]  # share by which it may scale all voltages, unseen


@dataclass(frozen=True, slots=True, kw_only=True)
class Branch(AddedVoltage):
    """A current beside the one that makes flux, which follows its voltage with a lag."""

    sees_voltage: bool = False  # it follows that at the terminals, of which a bridge may lose some
    beside: Callable[[Rows, Sizes], Vector] | None = None  # A at samples, that flows beside what makes flux
    heats: Callable[[Rows, Sizes], Array] | None = None  # A^2 at samples, to |i|^2 in what warms the winding
    fast_stiffness: Callable[[Sizes], float] | None = None  # 1/H within a period, to the machine's
    fast_resistance: Callable[[Rows, Sizes], float] | None = None  # ohm, to what changes within a period


@dataclass(frozen=True, slots=True, kw_only=True)
class ResistanceChange(AddedVoltage):
    """Changes the winding's resistances; what it remembers lasts all of the recording."""

    raises: Callable[[Rows, Sizes], tuple[Array | float, complex]]  # share to R_s, in each period; the phases' excess
    # over it as a vector, ohm


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorError(Effect):
    """An error of measurement, of which rows can be rid."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VoltageError(SensorError):
    """The recorded voltage is too high by this."""

    error: Callable[[Rows, Sizes], Vector]  # V of each period; recorded less acting
    of_recorded: bool = True  # told of the recorded voltage, so that of the acting one its size is none

    def voltage(self, rows: Rows, sizes: Sizes) -> Vector:
        """V of each period."""
        return self.error(rows, sizes)


def no_shapes(_rows: Rows) -> tuple[tuple[float, ...], ...]:
    """Of an effect that has sizes only."""
    return ((),)


def constant(value: float) -> Callable[[Rows], float]:
    """A typical value or a bound that is the same for every machine."""
    return lambda _rows: value


def rated(share: float) -> Callable[[Rows], float]:
    """A share of the rated current, A."""
    return lambda rows: share * rows.i_rated


def periods(times: float) -> Callable[[Rows], float]:
    """A typical value or a bound in s that goes with the control period."""
    return lambda rows: times * rows.T_s


DEGREE: Final = math.radians(1.0)
