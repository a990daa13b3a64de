"""Differences: what is not one number in two recordings, in numbers and words. Knows nothing of how they were found."""

import math
from collections.abc import Sequence

from estimator.diagnosis.answer.sentences import plural, quantity, title_of
from estimator.diagnosis.together.alike import SEEN
from estimator.diagnosis.together.refitted import CONSTANTS
from estimator.diagnosis.together.said import Difference, Kind, Shared, SharedFinding
from estimator.diagnosis.verdict import Quantity

_Change = tuple[tuple[str, str], Quantity, Quantity | None]


def of_machine(name: str, number: Shared, recordings: Sequence[str]) -> list[Difference]:
    """Of a parameter, between the first recording that tells it and others."""
    kind, found = Kind.CONSTANT if name in CONSTANTS else Kind.STATE, list[Difference]()
    for between, change, share in _changes(number, recordings):
        went = "rose" if (change.value or 0.0) > 0.0 else "fell"
        by = quantity(abs(change.value or 0.0), change.unit, change.std)
        if share is not None:
            by = f"{quantity(abs(share.value or 0.0), '1', share.std)} ({by})"
        said = f"between {between[0]} and {between[1]} {name} {went} by {by}"
        if kind is Kind.CONSTANT:
            said += ", which it does in no machine: it is another one, or one recording hides what it does not name"
        found.append(Difference(name, "", kind, between, change, share, said))
    return found


def of_effect(found: SharedFinding, recordings: Sequence[str]) -> list[Difference]:
    """Of an effect's sizes."""
    differences, title = list[Difference](), title_of(found.effect)
    for parameter, number in found.parameters.items():
        for between, change, share in _changes(number, recordings):
            one, other = (number.each[recordings.index(name)] for name in between)
            assert one is not None
            assert other is not None
            sizes = ", ".join(
                f"{parameter.replace('_', ' ')} {quantity(size.value, size.unit, size.std)} in {name}"
                for name, size in zip(between, (one, other), strict=True)
            )
            are = "are" if plural(title) else "is"
            said = f"{title} {are} not the same in both: {sizes}"
            if is_none(one) != is_none(other):
                there, away = between if is_none(other) else between[::-1]
                said = f"{title} {are} there in {there} and not in {away}: {sizes}"
            differences.append(Difference(found.effect, parameter, Kind.EFFECT, between, change, share, said))
    return differences


def is_none(size: Quantity) -> bool:
    """It is no farther from none than chance makes it."""
    return abs(size.value or 0.0) <= SEEN * (size.std or 0.0)


def _changes(number: Shared, recordings: Sequence[str]) -> list[_Change]:
    """From the first recording that tells a number to each that tells another; as a share where the first is some."""
    told = [(name, one) for name, one in zip(recordings, number.each, strict=True) if one is not None and one.std]
    if number.alike or len(told) < 2:
        return []
    (begin, first), found = told[0], list[_Change]()
    for name, one in told[1:]:
        a, b, s_a, s_b = first.value or 0.0, one.value or 0.0, first.std or 0.0, one.std or 0.0
        change = Quantity(b - a, math.hypot(s_a, s_b), one.unit)
        if is_none(change):
            continue
        share = None if is_none(first) else Quantity(b / a - 1.0, math.hypot(s_b, b / a * s_a) / abs(a), "1")
        found.append(((begin, name), change, share))
    return found
