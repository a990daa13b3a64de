"""Estimates as a table, with units an engineer reads, and what they rest on in words."""

from collections import Counter
from collections.abc import Mapping
from datetime import datetime
from typing import Any

from rich.console import Group
from rich.table import Table
from rich.text import Text

from estimator.interval import half_width

_HELD = "held at"
_SCALES = {
    "ohm": ((1.0, "ohm"), (1e-3, "mohm")),
    "H": ((1.0, "H"), (1e-3, "mH"), (1e-6, "uH")),
    "Vs": ((1.0, "Vs"), (1e-3, "mVs")),
}


def estimates_table(content: Mapping[str, Any], settings: Mapping[str, Any], basis: str, title: str = "") -> Group:
    """Estimates as REST and JSON show them, with the settings of the estimation and words on what they rest on.

    A reason that several parameters share is told once, below.
    """
    chosen = chosen_by_data(settings)
    counts = Counter(estimate["reason"] for estimate in content["estimates"].values())
    several = {reason for reason, count in counts.items() if count > 1 and reason and reason not in basis}
    below = [reason for reason in counts if reason in several and not reason.startswith(_HELD)]
    table = Table(title=title or None)
    for heading in ("", "value", "± 95 %", "unit", *(("samples",) if chosen else ()), "status"):
        table.add_column(heading, justify="right" if heading in ("value", "± 95 %", "samples") else "left")
    for name, estimate in content["estimates"].items():
        *cells, status = _row_cells({**estimate, "reason": ""} if estimate["reason"] in below else estimate)
        table.add_row(name, *cells, *((_samples(estimate),) if chosen else ()), status)
    return Group(table, *(Text(line, style="dim") for line in (basis, *below)))


def basis_of(settings: Mapping[str, Any], samples: int) -> str:
    """The method, and the samples that its estimates rest on."""
    if settings["method"] == "rls":
        lam = settings["forgetting_factor"]
        return f"recursive least squares, {samples} samples, forgetting factor {lam:g}"
    if settings["method"] == "ekf":
        return f"extended Kalman filter ({settings['ekf']['preset']}), {samples} samples"
    if chosen_by_data(settings):
        return f"windows chosen by the data, from the last {samples} samples"
    return f"window of the last {samples} samples"


def chosen_by_data(settings: Mapping[str, Any]) -> bool:
    """Each parameter uses a window of its own."""
    return settings["method"] == "wls" and settings["length"] == "auto"


def clock(time_utc: str) -> str:
    """Time of day here."""
    return datetime.fromisoformat(time_utc).astimezone().strftime("%H:%M:%S")


def _samples(estimate: Mapping[str, Any]) -> str:
    return "" if estimate["window"] is None else str(estimate["window"])


def _row_cells(estimate: Mapping[str, Any]) -> list[str]:
    """Value, half the 95 % interval, unit, status of one estimate."""
    value, std = estimate["value"], estimate["std"]
    scales = _SCALES[estimate["unit"]]
    size, unit = next((scale for scale in scales if value is None or abs(value) >= scale[0]), scales[-1])
    half = half_width(None if std is None else std / size)
    status = str(estimate["status"]).replace("_", " ")
    if since := estimate.get("since"):
        status += f" since {clock(since)}"
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
