"""Timing errors: of the computation, of what is recorded, and rows that are lost.

`delay` more control periods pass between a sample and the voltage computed from it; the recording is right about it. At
-1 the voltage is applied over the period that its sample begins, which the firmware knows.
`shift` puts the voltage of another period into a row: 1 the one after (recorded early), -1 the one before (late).
`lost` is the share of rows that a recording lacks, one by one and by chance; its time tells the gaps.

A voltage recorded one period late or early shows as an error in proportion to how fast the voltage changes; in the
rotor frame and at steady state it is all but invisible. A row that holds the answer to its own current, by a delay of
-1 or a shift of 1, holds the answer to that current's noise: at one operating point hardly anything else.
"""

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from emulator.bounds import Bound
from emulator.kernel import kernel
from emulator.noise import uniform

_LOST = 41  # source of noise


class Timing(NamedTuple):
    """Sizes."""

    delay: Annotated[int, Bound("periods", low=-1, high=1)] = 0
    shift: Annotated[int, Bound("periods", low=-1, high=1)] = 0
    lost: Annotated[float, Bound(low=0.0, high=0.5)] = 0.0


@kernel
def kept(timing: Timing, seed: int, tick: int, periods: int) -> NDArray[np.bool_]:
    """Which of so many rows from a tick on a recording has."""
    has = np.ones(periods, np.bool_)
    if timing.lost > 0.0:
        for n in range(periods):
            has[n] = uniform(seed, _LOST, tick + n) >= timing.lost
    return has
