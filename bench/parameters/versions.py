"""What the history of a drive's flashes says of a set, and of what the drive holds now. It forbids nothing.

Knows nothing of drives that are connected.
"""

from collections.abc import Mapping, Sequence
from typing import Final

from bench.parameters.journal import Past, Step
from bench.parameters.parameter_set import ParameterSet
from bench.parameters.plan import different

_NAMED: Final = 5  # of what is different


def remarks_on(given: ParameterSet, present: Mapping[str, float], flashed: Sequence[Past]) -> tuple[str, ...]:
    """Sentences of a set, of what the drive holds (SI), and of its flashes that have ended, the newest last."""
    return (*_changed_since(present, flashed), *_on_version(given, flashed))


def _changed_since(present: Mapping[str, float], flashed: Sequence[Past]) -> tuple[str, ...]:
    """Where the drive no longer holds what the latest flash left in it."""
    if not flashed:
        return ()
    begun, step = flashed[-1].begun, flashed[-1].step
    names = different(begun.wanted if step is Step.DONE else begun.image, present)
    if not names:
        return ()
    said = f"the drive does not hold any more what the flash of {begun.since[:19]}Z left in it"
    return (f"{said}: {some_of(names)}",)


def _on_version(given: ParameterSet, flashed: Sequence[Past]) -> tuple[str, ...]:
    """Where the latest set of this name that was done is a later version, or the same one with other values."""
    done = (one.begun for one in reversed(flashed) if one.step is Step.DONE)
    latest = next((begun for begun in done if begun.name == given.name), None)
    if latest is None:
        return ()
    version, since = latest.version, latest.since[:19]
    if given.version < version:
        return (f"version {given.version} is lower than that of the latest {given.name!r}, {version} of {since}Z",)
    if given.version > version:
        return ()
    names = different(given.values, latest.wanted)
    if not names:
        return ()
    return (f"version {version} of {given.name!r} was flashed with other values on {since}Z: {some_of(names)}",)


def some_of(said: Sequence[str]) -> str:
    """The first few of what is different, and how many more there are."""
    more = f" and {len(said) - _NAMED} more" if len(said) > _NAMED else ""
    return f"{', '.join(said[:_NAMED])}{more}"
