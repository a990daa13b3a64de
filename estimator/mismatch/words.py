"""Numbers as an engineer writes them in a sentence."""

import math

from estimator.flux_balance import TURN


def number(x: float, digits: int = 3) -> str:
    """To some digits, without an exponent where none is needed."""
    if x == 0.0 or not math.isfinite(x):
        return f"{x:g}"
    if not 1e-4 <= abs(x) < 1e6:
        return f"{x:.{digits - 1}e}"
    places = digits - 1 - math.floor(math.log10(abs(x)))
    return f"{round(x, places):.{max(0, places)}f}"


def percent(share: float) -> str:
    """Two digits, and all where it is."""
    return f"{100.0 * share:.2g} %" if share < 0.995 else "all"


def degrees(direction: float) -> str:
    """A direction (rad) in deg, -180 to 180."""
    return f"{round(math.degrees(math.remainder(direction, TURN)))} deg"
