"""What was flashed, or cut, as plain values."""

from typing import Any, Final

from bench.parameters.journal import Begun, Past, Step
from bench.parameters.plan import different
from drivers.wire.dictionary import signal_named

_STATES: Final = {Step.DONE: "flashed", Step.ROLLED_BACK: "rolled back"}
_TOLD: Final = ("drive", "name", "version", "whom", "since", "override")


def changes_of(begun: Begun) -> dict[str, tuple[float, float]]:
    """By signal, SI: before and then."""
    return {name: (begun.image[name], begun.wanted[name]) for name in different(begun.wanted, begun.image)}


def as_begun(begun: Begun) -> dict[str, Any]:
    """A flash that was begun."""
    changed = [
        {"name": name, "unit": signal_named(name).unit, "before": old, "after": new}
        for name, (old, new) in changes_of(begun).items()
    ]
    return {**{name: getattr(begun, name) for name in _TOLD}, "changed": changed}


def as_past(one: Past) -> dict[str, Any]:
    """A flash that has ended."""
    return {**as_begun(one.begun), "ended": one.at, "state": _STATES[one.step], "said": one.said}
