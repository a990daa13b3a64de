"""Numbers as an engineer reads them: prefixes, and no more digits than an interval leaves."""

import math
import re
from typing import Final

from estimator.interval import half_width

_PREFIXES: Final = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "u"), (1e-9, "n"), (1e-12, "p"))
PREFIXED: Final = ("ohm", "H", "Vs", "V", "A", "s", "Hz", "S", "W")
_PLAIN: Final = ("", "1")
_SYMBOL: Final = re.compile(r"(?<![A-Za-z])(?=[A-Za-z]_|psi_|omega_|theta_)([A-Za-z]+_[A-Za-z0-9]+)|_")
_AXIS: Final = re.compile(r"\b([dq])_axis")
_DEGREES: Final = 180.0 / math.pi


def scaled(value: float, unit: str) -> tuple[float, str]:
    """By what to divide a value, and others beside it, and the unit of the quotient."""
    if unit == "rad":
        return 1.0 / _DEGREES, "deg"
    if unit == "1" and 0 < abs(value) < 1:  # a share
        return 0.01, "%"
    if unit not in PREFIXED or value == 0 or not math.isfinite(value):
        return 1.0, "" if unit in _PLAIN else unit
    size, prefix = next((p for p in _PREFIXES if abs(value) >= 0.9995 * p[0]), _PREFIXES[-1])
    return size, prefix + unit


def number(value: float | None, half: float | None = None, digits: int = 3) -> str:
    """A value to the second digit of half its interval, or to so many digits; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return "–"
    if half is None or not math.isfinite(half) or half <= 0:
        return _significant(value, digits)
    decimals = max(0, 1 - math.floor(math.log10(half)))
    return f"{value:.{decimals}f}" if decimals <= 12 else f"{value:.{digits}g}"


def quantity(value: float | None, unit: str, std: float | None = None, like: float | None = None) -> str:
    """A value with its unit, and half its 95 % interval where it has a standard error: `2.000 ± 0.059 us`.

    Scaled as `like` would be.
    """
    if value is None or not math.isfinite(value):
        return "–"
    by, shown = scaled(value if like is None else like, unit)
    half = half_width(None if std is None else std / by)
    text = number(value / by, half)
    if half is not None and math.isfinite(half):
        text += f" ± {_significant(half, 2)}"
    return f"{text} {shown}".rstrip()


def odds(value: float | None) -> str:
    """Odds as they fit a table: `3.2`, `410`, `3e9`, `over 1e12`."""
    if value is None or math.isnan(value):
        return "–"
    if value >= 1e12:
        return "over 1e12"
    if value >= 1e4:
        return f"{value:.0e}".replace("e+", "e").replace("e0", "e")
    return f"{value:.2g}" if value < 100 else f"{value:.0f}"


def words(name: str) -> str:
    """An identifier in words; letters keep their index: `d-axis saturation`, `L_d drop`."""
    return _AXIS.sub(r"\1-axis", _SYMBOL.sub(lambda found: found.group(1) or " ", name))


def _significant(value: float, digits: int) -> str:
    if value == 0:
        return "0"
    decimals = digits - 1 - math.floor(math.log10(abs(value)))
    if -3 <= decimals <= 9:
        return f"{round(value, decimals):.{max(0, decimals)}f}"
    return f"{value:.{digits}g}"
