"""The magnets' flux linkage as it changes within a recording: what `magnet_flux_drift`, `magnet_flux_step` and
`magnet_temperature` share.

On a curve that saturates, the inductances rise as magnets lose flux: see `saturation`.
"""

import math
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from estimator.arrays import Array
from estimator.kernel import kernel
from estimator.physics.effect import Sizes
from estimator.physics.rows import Rows
from estimator.physics.temperature_course import share_at

DRIFT: Final = "magnet_flux_drift"
STEP: Final = "magnet_flux_step"
TEMPERATURE: Final = "magnet_temperature"
_BEFORE: Final = 0.5  # of the magnets' time constant, that what warms them has at most


def drifted(rows: Rows, sizes: Sizes) -> Array:
    """Change since the start, Vs at samples."""
    change, time_constant, lag = sizes
    before = min(lag, _BEFORE * time_constant)
    own, first = time_constant / (time_constant - before), before / (time_constant - before)
    t = (rows.t - rows.span[0]) / rows.span[1]
    course = 1.0 - own * np.exp(-t / time_constant) + first * np.exp(-t / before)
    whole = 1.0 - own * math.exp(-1.0 / time_constant) + first * math.exp(-1.0 / before)
    return change * rows.machine.psi_f * course / whole


def stepped(rows: Rows, sizes: Sizes) -> Array:
    """Change by a step, Vs at samples."""
    change, time, duration = map(float, sizes)
    return _stepped(rows.t, rows.span[0] + time * rows.span[1], duration, change * float(rows.machine.psi_f))


@kernel
def _stepped(t: Array, middle: float, duration: float, change: float) -> Array:
    course = np.empty(len(t))
    for k in range(len(t)):
        course[k] = change * min(max((t[k] - middle) / duration + 0.5, 0.0), 1.0)
    return course


def from_outside(rows: Rows, sizes: Sizes) -> Array:
    """Change with a temperature from outside, Vs at samples."""
    return rows.machine.psi_f * share_at(rows, sizes, rows.t)


CHANGES: Final[Mapping[str, Callable[[Rows, Sizes], Array]]] = {
    DRIFT: drifted, STEP: stepped, TEMPERATURE: from_outside,
}


def change_of(rows: Rows, effects: Mapping[str, Sizes]) -> Array | float:
    """What those of the effects that change the magnets' flux linkage add to it, Vs at samples."""
    return sum((CHANGES[name](rows, sizes) for name, sizes in effects.items() if name in CHANGES), start=0.0)
