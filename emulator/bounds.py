"""Bounds: what a parameter may be, declared beside it, and the sentence when it is not.

    R_s: Annotated[float, Bound("ohm", above=0.0)]
    course: Annotated[Points, PointsBound(Bound("s", low=0.0), Bound("degC", high=80.0))] = ()

Knows nothing of the parameters themselves nor of files; `where` names the origin in the sentences.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass
from typing import Annotated, Any, TypeVar, cast, get_args, get_origin, get_type_hints

from emulator.input_file import shown

T = TypeVar("T")
_MOST = 1e300
Points = tuple[tuple[float, float], ...]  # pairs of numbers, the first ones rising


class ScenarioError(ValueError):
    """A scenario that cannot be: one sentence naming file, key, bound and what came."""


@dataclass(frozen=True, slots=True)
class Bound:
    """Unit and range of a number: `above` and `below` exclude the end, `low` and `high` include it."""

    unit: str = "1"
    above: float | None = None
    low: float | None = None
    below: float | None = None
    high: float | None = None

    def admits(self, value: float) -> bool:
        return (
            math.isfinite(value)
            and (self.above is None or value > self.above)
            and (self.low is None or value >= self.low)
            and (self.below is None or value < self.below)
            and (self.high is None or value <= self.high)
        )

    def __str__(self) -> str:
        ends = (("above", self.above), ("at least", self.low), ("below", self.below), ("at most", self.high))
        unit = "" if self.unit == "1" else f" {self.unit}"
        told = " and ".join(f"{word} {end:g}{unit}" for word, end in ends if end is not None)
        return told or f"a finite number{unit}"


@dataclass(frozen=True, slots=True)
class PointsBound:
    """Units and ranges of the two numbers of each point."""

    first: Bound
    second: Bound


def check_bounds(record: object, where: str) -> None:
    """Raise ScenarioError when a field of a dataclass or named tuple is outside its bound."""
    for name, kind, bound in _fields(type(record)):
        if bound is not None:
            _checked(getattr(record, name), kind, bound, f"{where}{name}")


def from_table(kind: type[T], table: Mapping[str, object], where: str) -> T:
    """A dataclass or named tuple from a TOML table; keys that are not there take their default.

    `where` is put before the key in every sentence: `file.toml: motor.`. Raises ScenarioError.
    """
    fields = list(_fields(kind))
    names = [name for name, _, _ in fields]
    for key in table:
        if key not in names:
            raise ScenarioError(f"{where}{shown(key)[1:-1]} is no key here; the keys are {', '.join(names)}")
    values = {
        name: _checked(table[name], of, bound or Bound(), f"{where}{name}")
        for name, of, bound in fields
        if name in table
    }
    missing = [name for name in names if name not in table and not _has_default(kind, name)]
    if missing:
        raise ScenarioError(f"{where}{missing[0]} is missing; it has no default")
    return kind(**values)


def _fields(kind: type) -> Iterator[tuple[str, type, Bound | PointsBound | None]]:
    for name, hint in get_type_hints(kind, include_extras=True).items():
        if get_origin(hint) is Annotated:
            of, bound = get_args(hint)[:2]
            yield name, of, bound
        else:
            yield name, hint, None


def _has_default(kind: type, name: str) -> bool:
    defaults: dict[str, object] = getattr(kind, "_field_defaults", {})  # named tuple
    fields: dict[str, Field[Any]] = getattr(kind, "__dataclass_fields__", {})
    return name in defaults or (name in fields and fields[name].default is not MISSING)


def _checked(value: object, kind: type, bound: Bound | PointsBound, key: str) -> Any:
    """`value` as the field's type, or ScenarioError."""
    if isinstance(bound, PointsBound):
        return _checked_points(value, bound, key)
    if kind in (str, bool):
        if not isinstance(value, kind):
            raise ScenarioError(f"{key} takes {'true or false' if kind is bool else 'a text'}, got {shown(value)}")
        return value
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ScenarioError(f"{key} takes a number, got {shown(value)}")
    if isinstance(value, int) and abs(value) > _MOST:  # TOML's integers have no end
        raise ScenarioError(f"{key} takes {bound}, got {shown(value)}")
    if kind is int and not (math.isfinite(value) and int(value) == value):
        raise ScenarioError(f"{key} takes a whole number, got {shown(value)}")
    if not bound.admits(value):
        raise ScenarioError(f"{key} takes {bound}, got {shown(value)}")
    return kind(value)


def _checked_points(value: object, bound: PointsBound, key: str) -> Points:
    """A list of pairs as points, or ScenarioError."""
    if not isinstance(value, list | tuple):
        units = f"[{bound.first.unit}, {bound.second.unit}]"
        raise ScenarioError(f"{key} takes a list of points {units}, got {shown(value)}")
    points: list[tuple[float, float]] = []
    for n, point in enumerate(cast(Sequence[object], value)):
        pair = list(cast(Sequence[object], point)) if isinstance(point, list | tuple) else []
        if len(pair) != 2:
            units = f"[{bound.first.unit}, {bound.second.unit}]"
            raise ScenarioError(f"{key}[{n}] takes a point {units}, got {shown(cast(object, point))}")
        first = _checked(pair[0], float, bound.first, f"{key}[{n}][0]")
        second = _checked(pair[1], float, bound.second, f"{key}[{n}][1]")
        if points and first <= points[-1][0]:
            raise ScenarioError(f"{key}[{n}][0] takes above {points[-1][0]:g}, the one before, got {shown(pair[0])}")
        points.append((first, second))
    return tuple(points)
