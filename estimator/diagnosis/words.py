"""Numbers as an engineer writes them in a sentence."""

import math
from collections.abc import Iterable
from typing import Final

from estimator.interval import half_width
from estimator.online.flux_balance import TURN

_MOST_DECIMALS: Final = 9


def number(x: float, digits: int = 3) -> str:
    """To some digits, without an exponent where none is needed."""
    if x == 0.0 or not math.isfinite(x):
        return f"{x:g}"
    if not 1e-4 <= abs(x) < 1e6:
        return f"{x:.{digits - 1}e}"
    places = digits - 1 - math.floor(math.log10(abs(x)))
    return f"{round(x, places):.{max(0, places)}f}"


def with_interval(value: float, std: float | None, digits: int = 3) -> str:
    """A number and half its 95 % interval to two digits of that; without a standard error, to so many digits."""
    half = half_width(std)
    if not half or not math.isfinite(half):
        return f"{value:.{digits}g}"
    places = 1 - math.floor(math.log10(half))
    decimals = min(max(places, 0), _MOST_DECIMALS)
    return f"{value:.{decimals}f} ± {round(half, places):.{decimals}f}"


def rounded(x: float) -> float:
    """To the four digits that a drive is given."""
    return float(f"{x:.4g}")


def listed(words: Iterable[str]) -> str:
    """One or more: a, b and c."""
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last


def percent(share: float) -> str:
    """Two digits, and all where it is."""
    return f"{100.0 * share:.2g} %" if share < 0.995 else "all"


def degrees(direction: float) -> str:
    """A direction (rad) in deg, -180 to 180."""
    return f"{round(math.degrees(math.remainder(direction, TURN)))} deg"


def sentence_start(text: str) -> str:
    """A text as a sentence begins: with a capital letter, but for a symbol, which stays as it is."""
    first = text.partition(" ")[0]
    return text if first in ("d", "q") or "_" in first else f"{text[:1].upper()}{text[1:]}"


def continued(text: str) -> str:
    """A sentence as a part of another one."""
    first = text.partition(" ")[0]
    return text if "_" in first else f"{text[:1].lower()}{text[1:]}"
