"""Partial demagnetisation: from a moment on, the magnets give less flux.

    psi_f = psi_f0 (1 - share)        after `time`, in a straight line over `duration`

The field in the air gap cannot jump with the magnets: the flux linkage stays and the current makes up for it at first.
Irreversible loss of remanence: S. Ruoho et al., "Comparison of demagnetization models for finite-element analysis of
permanent-magnet synchronous machines", IEEE Trans. Magnetics, 2007.

Shows as a step of the back-EMF; looks like a speed error before and after.
"""

from typing import Annotated, NamedTuple

from emulator.bounds import Bound
from emulator.kernel import kernel


class Demagnetisation(NamedTuple):
    """Sizes."""

    share: Annotated[float, Bound(low=0.0, high=0.9)] = 0.0  # of psi_f
    time: Annotated[float, Bound("s", low=0.0)] = 0.0
    duration: Annotated[float, Bound("s", above=0.0)] = 2e-3


@kernel
def flux_factor(demagnetisation: Demagnetisation, t: float) -> float:
    """psi_f over that before, at a time (s)."""
    share, time, duration = demagnetisation
    return 1.0 - share * min(max((t - time) / duration, 0.0), 1.0)
