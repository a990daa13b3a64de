"""The pictures of a diagnosis of several recordings: what each tells, and all as one. Knows nothing of drawing."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from bench.diagnoses.figures.axes import Values, around, numbers
from bench.diagnoses.figures.figure import Axis, Figure, Panel, Role, Trace
from bench.engineering import scaled, words
from estimator.diagnosis.together.said import Shared, Together
from estimator.diagnosis.verdict import Quantity
from estimator.interval import half_width

FOREST: Final = "each-and-joint"
"""The part of a report that has them."""
_TITLE: Final = "Each recording, and all as one"
_LONGEST: Final = 16  # letters of a recording's name in a picture
_WIDE: Final = 12.0  # times the narrowest interval: wider ones do not stretch an axis
_NAMES: Final[dict[Role, str]] = {
    "each": "a recording", "differs": "a recording that differs from another", "joint": "all as one",
}
_IN_PLAIN: Final = ("rad", "1")  # units that a picture shows as deg and %


def forests(said: Together) -> tuple[Figure, ...]:
    """The machine's numbers, then those of each effect; a panel each."""
    rows = ("all as one", *_short(said.recordings)[::-1])
    y = Axis("", "", -0.5, len(rows) - 0.5, names=rows)
    of_machine = "R_s, L_d, L_q and psi_f with the effects of all recordings, ± 95 %."
    groups = [("machine", of_machine, dict(said.machine))]
    for one in said.findings:
        title = words(one.effect)
        sizes = {words(name): number for name, number in one.parameters.items()}
        groups.append((one.effect.replace("_", "-"), f"{title[:1].upper()}{title[1:]}, ± 95 %.", sizes))
    figures = list[Figure]()
    for name, caption, told in groups:
        panels = tuple(_panel(title, number, y) for title, number in told.items() if _is_told(number))
        if panels:
            figures.append(Figure(FOREST, f"{FOREST}-{name}", _TITLE, caption, panels, beside=True))
    return tuple(figures)


def _is_told(number: Shared) -> bool:
    return any(one is not None and one.value is not None for one in number.each)


def _panel(title: str, number: Shared, y: Axis) -> Panel:
    """The joint number below those of recordings; where they are not alike there is none."""
    told = [*number.each[::-1]]
    by, unit = _in_plain([*told, number.joint])
    each = _intervals("each" if number.alike else "differs", told, by, 1)
    joint = _intervals("joint", [number.joint], by, 0) if number.alike else None
    traces = [trace for trace in (each, joint) if trace is not None]
    if joint is not None and joint.x[0] is not None:
        middle = (number.joint.value or 0.0) / by
        ends = numbers(np.array([middle, middle]))
        traces.append(Trace(joint.name, "joint", "line", ends, (y.low, y.high)))
    return Panel(title, around("", unit, _shown([*told, number.joint] if joint else told, by)), y, tuple(traces))


def _intervals(role: Role, some: Sequence[Quantity | None], by: float, begin: int) -> Trace | None:
    """A trace of 95 % intervals, from this row of a picture on."""
    ends = [end / by for one in some for end in _ends(one)]
    if not np.isfinite(ends).any():
        return None
    rows = tuple(float(begin + k) for k in range(len(some)))
    return Trace(_NAMES[role], role, "intervals", numbers(np.array(ends)), rows)


def _ends(one: Quantity | None) -> tuple[float, float]:
    if one is None or one.value is None:
        return math.nan, math.nan
    half = half_width(one.std) or 0.0
    return one.value - half, one.value + half


def _shown(some: Sequence[Quantity | None], by: float) -> Values:
    """What an axis has room for: all values, and what of their intervals is not far wider than others'."""
    told = [(one.value / by, (half_width(one.std) or 0.0) / by) for one in some if one and one.value is not None]
    halves = [half for _, half in told if half > 0.0]
    most = _WIDE * min(halves, default=0.0)
    return np.array([value + side * min(half, most) for value, half in told for side in (-1.0, 1.0)])


def _in_plain(some: Sequence[Quantity | None]) -> tuple[float, str]:
    """By what to divide numbers for a picture, and the unit that they have then."""
    unit = next((one.unit for one in some if one is not None and one.value is not None), "1")
    largest = max((abs(one.value) for one in some if one is not None and one.value is not None), default=0.0)
    return scaled(largest, unit) if unit in _IN_PLAIN else (1.0, unit)


def _short(names: Sequence[str]) -> list[str]:
    """Names that a picture has room for: the ends of long ones, with a number where these are the same."""
    cut = [name if len(name) <= _LONGEST else f"…{name[1 - _LONGEST:]}" for name in names]
    return cut if len(set(cut)) == len(cut) else [f"{k + 1}: {name}" for k, name in enumerate(cut)]
