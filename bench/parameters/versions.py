"""Versions of a set: what the history of a drive's flashes says of another of the same name. It forbids nothing.

Knows nothing of drives that are connected.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from bench.parameters.journal import Step
from bench.parameters.parameter_set import ParameterSet
from bench.parameters.plan import different

_NAMED: Final = 5  # of what is different


def remarks_on(given: ParameterSet, flashed: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """A sentence where the latest set of this name, of those that were flashed (lines of a history), is a later
    version, or the same one with other values.
    """
    latest = _latest(given.name, flashed)
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
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    said = f"version {version} of {given.name!r} was flashed with other values on {since}Z"
    return (f"{said}: {', '.join(names[:_NAMED])}{more}",)


def _latest(name: str, flashed: Sequence[Mapping[str, Any]]) -> Mapping[str, Any] | None:
    """The newest of this name that was done."""
    found = begun = None
    for line in flashed:
        if line["step"] == Step.BEGUN:
            begun = line
        elif line["step"] == Step.DONE and begun is not None and begun["name"] == name:
            found = begun
    return found
