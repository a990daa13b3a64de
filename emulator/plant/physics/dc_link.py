"""The dc link: a source with ripple behind a resistance, and a capacitor.

    C du_dc/dt = (E + ripple sin(2 pi f t) - u_dc) / R - i_dc

i_dc is what the bridge draws, edge by edge. N. Mohan, T. M. Undeland, W. P. Robbins, "Power Electronics", 3rd ed.,
2003, chapters 5 and 8.

Shows as voltage that sags with power and ripples at the rectifier's frequency; a drive that measures its dc link makes
up for it, one that does not loses voltage.
"""

import math
from typing import Annotated, NamedTuple

from emulator.bounds import Bound
from emulator.kernel import kernel

_EMPTY = 0.01  # of E: no less, the bridge's diodes hold it there


class DcLink(NamedTuple):
    """Sizes; a stiff link where the capacitor is zero."""

    C: Annotated[float, Bound("F", low=0.0)] = 0.0
    R: Annotated[float, Bound("ohm", above=0.0)] = 0.5
    ripple: Annotated[float, Bound("V", low=0.0)] = 0.0
    frequency: Annotated[float, Bound("Hz", low=0.0, high=2000.0)] = 300.0


@kernel
def charged(link: DcLink, E: float, u_dc: float, drawn: float, t: float, h: float) -> float:
    """u_dc (V) a time h (s) after t, in which the bridge drew so much charge (C). Exact for steady source and draw."""
    source = E + link.ripple * math.sin(2.0 * math.pi * link.frequency * (t + 0.5 * h))
    towards = source - link.R * drawn / h
    return max(towards + (u_dc - towards) * math.exp(-h / (link.R * link.C)), _EMPTY * E)
