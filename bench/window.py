"""The window's settings: what a user may change while the stream runs. Knows nothing of streams."""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, cast

from bench.errors import LimitError, shown
from estimator.machine import PARAMETERS, PLAUSIBLE, UNITS
from estimator.window_ls import check_window


@dataclass(frozen=True, slots=True)
class Window:
    """Length in samples, periods per row m, the parameters to estimate, and values (SI) for those held."""

    length: int = 1000
    periods_per_row: int = 1
    estimated: tuple[str, ...] = PARAMETERS
    held: Mapping[str, float] = field(default_factory=dict[str, float])

    def changed(self, change: Mapping[str, Any]) -> "Window":
        """This window with some settings replaced. Raises LimitError, in a sentence, when it cannot work."""
        for key in change:
            if key not in ("length", "periods_per_row", "estimated", "held"):
                raise LimitError(f"expected length, periods_per_row, estimated or held, got {shown(key)}")
        window = replace(
            self,
            length=_whole(change, "length", self.length),
            periods_per_row=_whole(change, "periods_per_row", self.periods_per_row),
            estimated=_names(change.get("estimated", self.estimated)),
            held={**self.held, **_values(change.get("held", {}))},
        )
        try:
            check_window(window.length, window.periods_per_row, len(window.estimated))
        except ValueError as error:
            raise LimitError(str(error)) from None
        for name in PARAMETERS:
            if name not in window.estimated and name not in window.held:
                raise LimitError(f"{name} is not estimated, so a held value in {UNITS[name]} is needed, got none")
        return window


def _whole(change: Mapping[str, Any], key: str, otherwise: int) -> int:
    value = change.get(key, otherwise)
    if isinstance(value, bool) or not isinstance(value, int):
        raise LimitError(f"{key}: expected a whole number, got {shown(value)}")
    if abs(value) > 10**18:  # JSON's and TOML's integers have no end
        raise LimitError(f"{key}: expected a whole number of at most 18 digits, got {shown(value)}")
    return value


def _names(value: object) -> tuple[str, ...]:
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise LimitError(f"estimated: expected a list of {', '.join(PARAMETERS)}, got {shown(value)}")
    names = cast(Sequence[object], value)
    for name in names:
        if name not in PARAMETERS:
            raise LimitError(f"estimated: expected {', '.join(PARAMETERS)}, got {shown(name)}")
    if not names:
        raise LimitError(f"estimated: expected at least one of {', '.join(PARAMETERS)}, got none")
    return tuple(name for name in PARAMETERS if name in names)


def _values(value: object) -> dict[str, float]:
    if not isinstance(value, Mapping):
        raise LimitError(f"held: expected values of {', '.join(PARAMETERS)}, got {shown(value)}")
    values: dict[str, float] = {}
    for name, number in cast(Mapping[str, object], value).items():
        if name not in PARAMETERS:
            raise LimitError(f"held: expected {', '.join(PARAMETERS)}, got {shown(name)}")
        if isinstance(number, bool) or not isinstance(number, int | float) or not 0 < number <= sys.float_info.max:
            raise LimitError(f"held {name}: expected a number of {UNITS[name]} above zero, got {shown(number)}")
        low, high = PLAUSIBLE[name]
        if not low <= number <= high:
            unit = UNITS[name]
            raise LimitError(f"held {name}: expected {low:g} to {high:g} {unit} (SI, per phase), got {shown(number)}")
        values[name] = float(number)
    return values
