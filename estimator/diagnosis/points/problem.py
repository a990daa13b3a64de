"""What is asked: equations of steady points, and the sizes that a machine and its effects may have in them."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array
from estimator.diagnosis.points.table import Places

Key = tuple[str, str]
PointSizes = Mapping[Key, float]
"""Values by owner - an effect, or the machine - and name, SI; what is not there is zero."""

MACHINE: Final = "machine"


@dataclass(frozen=True, slots=True)
class Size:
    """A parameter of the machine or of an effect."""

    owner: str
    name: str
    unit: str
    typical: float  # SI
    low: float = -math.inf
    high: float = math.inf
    starts: tuple[float, ...] = (0.0,)  # where fits begin
    shape: bool = False

    @property
    def key(self) -> Key:
        return self.owner, self.name


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Equations, one number each, that the machine explains with or without effects."""

    y: Array  # V, measured
    axis: Places  # of each equation; every axis has noise of its own
    group: Places  # of each equation; groups are left out one by one
    kin: Places  # of each equation; what an equation misses, its kin may miss alike
    machine: tuple[Size, ...]
    effects: Mapping[str, tuple[Size, ...]]
    predict: Callable[[PointSizes], Array]  # V
    exact: float  # of the largest voltage: what is smaller is nobody's proof
    generic: Array  # (equations, columns): what anything without a name may do, to see whether something is left

    def part(self, inside: NDArray[np.bool_]) -> "Problem":
        """Some of the equations."""

        def predict(sizes: PointSizes) -> Array:
            return self.predict(sizes)[inside]

        return replace(
            self, y=self.y[inside], axis=self.axis[inside], group=self.group[inside], kin=self.kin[inside],
            generic=self.generic[inside], predict=predict,
        )  # fmt: skip

    def sizes(self, choice: tuple[str, ...]) -> tuple[Size, ...]:
        """The machine's, and those of some effects."""
        return (*self.machine, *(size for name in choice for size in self.effects[name]))
