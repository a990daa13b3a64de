"""Estimates as cells of a table, with units an engineer reads."""

from collections.abc import Mapping
from typing import Any

_SCALES = {
    "ohm": ((1.0, "ohm"), (1e-3, "mohm")),
    "H": ((1.0, "H"), (1e-3, "mH"), (1e-6, "uH")),
    "Vs": ((1.0, "Vs"), (1e-3, "mVs")),
}


def row_cells(estimate: Mapping[str, Any]) -> list[str]:
    """Value, half the 95 % interval, unit, status of one estimate."""
    value, std = estimate["value"], estimate["std"]
    scales = _SCALES[estimate["unit"]]
    size, unit = next((scale for scale in scales if value is None or abs(value) >= scale[0]), scales[-1])
    half = None if std is None else 1.96 * std / size
    status = str(estimate["status"]).replace("_", " ")
    reason = estimate["reason"]
    return [
        "-" if value is None else f"{value / size:{_digits(value / size, half)}}",
        "-" if half is None else f"{half:.2g}",
        unit,
        f"{status}: {reason}" if reason else status,
    ]


def _digits(value: float, half: float | None) -> str:
    """Format that shows a value to the second digit of its interval."""
    if not half or half >= abs(value):
        return ".4g"
    decimals = 1
    while decimals < 12 and half * 10**decimals < 9.5:
        decimals += 1
    return f".{decimals}f" if half < 10 else ".4g"
