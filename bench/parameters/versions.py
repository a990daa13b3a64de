"""What the history of a drive's flashes says of a set, and of what the drive holds now. It forbids nothing.

Knows nothing of drives that are connected.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from bench.parameters.journal import ENDS, Step
from bench.parameters.parameter_set import ParameterSet
from bench.parameters.plan import different

_NAMED: Final = 5  # of what is different


def remarks_on(
    given: ParameterSet, present: Mapping[str, float], flashed: Sequence[Mapping[str, Any]]
) -> tuple[str, ...]:
    """Sentences of a set, of what the drive holds (SI), and of lines of its history."""
    return (*_changed_since(present, flashed), *_on_version(given, flashed))


def _changed_since(present: Mapping[str, float], flashed: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """Where the drive no longer holds what the latest flash left in it."""
    begun, step = _last_ended(flashed)
    if begun is None:
        return ()
    names = different(begun["wanted"] if step == Step.DONE else begun["image"], present)
    if not names:
        return ()
    said = f"the drive does not hold any more what the flash of {begun['since'][:19]}Z left in it"
    return (f"{said}: {_some(names)}",)


def _on_version(given: ParameterSet, flashed: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """Where the latest set of this name is a later version, or the same one with other values."""
    latest = _last_ended(flashed, lambda begun, step: step == Step.DONE and begun["name"] == given.name)[0]
    if latest is None:
        return ()
    version, since = latest["version"], latest["since"][:19]
    if given.version < version:
        return (f"version {given.version} is lower than that of the latest {given.name!r}, {version} of {since}Z",)
    if given.version > version:
        return ()
    names = different(given.values, latest["wanted"])
    if not names:
        return ()
    return (f"version {version} of {given.name!r} was flashed with other values on {since}Z: {_some(names)}",)


def _last_ended(
    flashed: Sequence[Mapping[str, Any]], is_meant: Callable[[Mapping[str, Any], str], bool] = lambda _begun, _how: True
) -> tuple[Mapping[str, Any] | None, str]:
    """What the newest of those that are meant was to do, and how it ended."""
    found, how, begun = None, "", None
    for line in flashed:
        if line["step"] == Step.BEGUN:
            begun = line
        elif line["step"] in ENDS and begun is not None and is_meant(begun, line["step"]):
            found, how = begun, line["step"]
    return found, how


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return f"{', '.join(names[:_NAMED])}{more}"
