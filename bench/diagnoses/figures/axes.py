"""Axes and their ends, and numbers with as many digits as a picture shows. Knows nothing of what is drawn."""

import math
import re
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bench.diagnoses.figures.figure import Axis, Numbers, Trace

_ROOM: Final = 0.04  # of an axis, beyond what stands on it
_DIGITS: Final = 5
_SAME: Final = 1e-9  # of a number: what differs by less is the same
_LABEL: Final = re.compile(r"(?P<label>.*?)(?:, (?P<unit>[^,()]+)| \((?P<bracketed>[^()]+)\))?")

Values = NDArray[np.float64]


def split(text: str) -> tuple[str, str]:
    """Label and unit of `i_q, A` or `speed (rpm)`."""
    found = _LABEL.fullmatch(text)
    if found is None:
        return text, ""
    return found["label"], found["unit"] or found["bracketed"] or ""


def over(label: str, unit: str, *values: Values) -> Axis:
    """From the least value to the greatest."""
    return axis(label, unit, *_ends(values))


def around(label: str, unit: str, *values: Values) -> Axis:
    """With room at both ends."""
    low, high = _ends(values)
    room = _ROOM * (high - low)
    return axis(label, unit, low - room, high + room)


def from_zero(label: str, unit: str, traces: Sequence[Trace]) -> Axis:
    """From zero to the greatest value of traces, with room beyond it."""
    most = max((value for trace in traces for value in trace.y if value is not None), default=1.0)
    return axis(label, unit, 0.0, (1.0 + _ROOM) * most or 1.0)


def axis(label: str, unit: str, low: float, high: float) -> Axis:
    """From one number to another."""
    start, end = numbers(np.array([low, high]))
    assert start is not None
    assert end is not None
    return Axis(label, unit, start, end)


def _ends(values: Sequence[Values]) -> tuple[float, float]:
    """The least and the greatest that are finite, with something between them; 0 to 1 where none is."""
    finite = [value[np.isfinite(value)] for value in values]
    whole = np.concatenate(finite) if finite else np.zeros(0)
    low, high = (float(whole.min()), float(whole.max())) if len(whole) else (0.0, 1.0)
    if high - low > _SAME * max(abs(low), abs(high)):
        return low, high
    room = 0.05 * abs(low) or 1.0
    return low - room, high + room


def numbers(values: Values) -> Numbers:
    """With as many digits as a picture shows of how they differ."""
    finite = values[np.isfinite(values)]
    most, span = (float(np.abs(finite).max()), float(np.ptp(finite))) if len(finite) else (0.0, 0.0)
    beyond = math.floor(math.log10(most / span)) if span > _SAME * most else 0
    digits = _DIGITS + max(beyond, 0)
    return tuple(float(f"{value:.{digits}g}") if math.isfinite(value) else None for value in map(float, values))
