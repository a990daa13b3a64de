"""A set in the making: values with intervals, and sentences for what did not go into it.

What comes from JSON may be anything: a number that is none is None here, and what is missing is empty. Knows nothing
of what the values are from.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple, cast

from bench.parameters.parameter_set import OK, Entry, ParameterSet, problem_of
from drivers.wire.dictionary import signal_named
from estimator.interval import Z_95

DOUBTFUL: Final = "doubtful"
_MOST: Final = 1e9  # SI; nothing that is told of a drive is larger


class Size(NamedTuple):
    """A number with its standard error, SI."""

    value: float
    std: float | None = None  # None: not known


@dataclass(frozen=True, slots=True)
class Made:
    """A set, and what a reader should know besides, a sentence each."""

    set: ParameterSet
    remarks: tuple[str, ...]


@dataclass(slots=True)
class Making:
    """Entries as they come."""

    entries: dict[str, Entry] = field(default_factory=dict[str, Entry])
    remarks: list[str] = field(default_factory=list[str])

    def take(self, name: str, size: Size, status: str = OK, source: str = "", **more: Any) -> None:
        """A signal's value; where it cannot have that, a sentence in its place. `more`: see `Entry`."""
        value, std = size
        if problem := problem_of(name, value):
            self.remarks.append(f"{name} is left out: {problem}")
            return
        low, high = interval(value, std)
        self.entries[name] = Entry(value, low, high, status, source, **more)

    def take_all(self, sizes: Mapping[str, Size], status: str = OK, source: str = "", **more: Any) -> str:
        """Signals that go together: all of them, or none and why. Of a table's entries its switch tells the rest."""
        for name, size in sizes.items():
            if problem := problem_of(name, size.value):
                return problem
        for name, size in sizes.items():
            if signal_named(name).table:
                self.take(name, size)
            else:
                self.take(name, size, status, source, **more)
        return ""

    def remark(self, sentence: str) -> None:
        """Once only."""
        if sentence not in self.remarks:
            self.remarks.append(sentence)


def interval(value: float, std: float | None) -> tuple[float | None, float | None]:
    """Of 95 %; none where the standard error is not known."""
    if std is None or not math.isfinite(std):
        return None, None
    return value - Z_95 * std, value + Z_95 * std


def number(given: object) -> float | None:
    """A number that a quantity may be, or None."""
    if isinstance(given, bool) or not isinstance(given, int | float) or not -_MOST < given < _MOST:
        return None
    return float(given)


def part(given: object, key: str) -> Mapping[str, Any]:
    """An object within another; empty where there is none."""
    found = cast(Mapping[str, Any], given).get(key) if isinstance(given, Mapping) else None
    return cast(Mapping[str, Any], found) if isinstance(found, Mapping) else {}


def parts(given: object, key: str) -> list[Mapping[str, Any]]:
    """Objects in a list within another; empty where there is none."""
    return [cast(Mapping[str, Any], one) for one in items(given, key) if isinstance(one, Mapping)]


def items(given: object, key: str) -> Sequence[object]:
    """A list within an object; empty where there is none."""
    found = cast(Mapping[str, Any], given).get(key) if isinstance(given, Mapping) else None
    return cast(list[object], found) if isinstance(found, list) else []


def size_of(given: Mapping[str, Any]) -> Size | None:
    """A value with its standard error, as JSON has it; None where the value is none."""
    value = number(given.get("value"))
    std = number(given.get("std"))
    return None if value is None else Size(value, std if std is not None and std >= 0.0 else None)


def name_of(what: str) -> str:
    """A set's name from a text that may be anything."""
    return "".join(c for c in what if c.isprintable())[:60] or "a set"
