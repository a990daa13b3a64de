"""Skin and proximity effect: a resistance that rises with frequency, as one rung of a ladder in series with R_s.

    u_x = R_x (i - i_x)        L_x d(i_x)/dt = R_x (i - i_x)

Nothing at dc; at a frequency omega the rung adds R_x (omega L_x)^2 / (R_x^2 + (omega L_x)^2) of resistance. For
the physics: P. L. Dowell, "Effects of eddy currents in transformer windings", Proc. IEE, 1966,
doi 10.1049/piee.1966.0236; one rung of a ladder holds it over a decade of frequency.

Shows as R_s that rises with speed, and with how fast the current is excited.
"""

import math
from typing import Annotated, NamedTuple

from emulator.bounds import Bound
from emulator.kernel import kernel


class Skin(NamedTuple):
    """Sizes: the resistance at `frequency` is (1 + rise) R_s; it levels off at twice that rise."""

    rise: Annotated[float, Bound(low=0.0, high=5.0)] = 0.0
    frequency: Annotated[float, Bound("Hz", low=20.0, high=5000.0)] = 500.0


@kernel
def rung_resistance(skin: Skin, R_s: float) -> float:
    """R_x (ohm)."""
    return 2.0 * skin.rise * R_s


@kernel
def rung_inductance(skin: Skin, R_s: float) -> float:
    """L_x (H): with it the rung is halfway up at `frequency`."""
    return rung_resistance(skin, R_s) / (2.0 * math.pi * skin.frequency)


def stored_energy(skin: Skin, R_s: float, i_x: complex) -> float:
    """Magnetic energy (J) of the rung."""
    return 0.75 * rung_inductance(skin, R_s) * abs(i_x) ** 2
