"""Suspects: torque on a shaft beyond the equation of motion, each a few columns more of the regression.

Those that explain most of what the equation leaves are in the fit, so that they do not bias J, and put the parameter
that stands for them in doubt. Knows nothing of fits.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from estimator.arrays import Array
from estimator.mechanics.stretches import Stretches

_LEVELS: Final = 8  # of the load, over the time


@dataclass(frozen=True, slots=True)
class Suspect:
    """Torque of a kind."""

    name: str
    parameter: str  # in doubt by it
    clause: str


SQUARE: Final = Suspect("square", "B", "drag goes with the square of the speed")
ANGLE: Final = Suspect("angle", "tau_L", "the load depends on the shaft's angle")
RIPPLE: Final = Suspect("ripple", "tau_L", "the torque ripples six times an electrical turn")
CHANGES: Final = Suspect("changes", "tau_L", "the load changes over time")
SUSPECTS: Final = (SQUARE, ANGLE, RIPPLE, CHANGES)


def columns_of(suspect: Suspect, s: Stretches) -> Array:
    """A suspect's columns, (k, n)."""
    if suspect is SQUARE:
        return s.square[None]
    if suspect is ANGLE:
        return s.angles[:4]
    if suspect is RIPPLE:
        return s.angles[4:]
    first, last = float(s.time[0]), float(s.time[-1])
    level = np.minimum((_LEVELS * (s.time - first) / max(last - first, 1e-12)).astype(np.int64), _LEVELS - 1)
    levels = (level == np.arange(1, _LEVELS)[:, None]).astype(np.float64)
    return levels[levels.any(axis=1)]
