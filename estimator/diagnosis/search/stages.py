"""Stages: the way from prepared rows to a set of effects, or to a flux map, and what is left without a name.

Knows nothing of verdicts.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

from estimator.diagnosis.likelihood.evidence import Search
from estimator.diagnosis.likelihood.given import Given
from estimator.diagnosis.search.exchange import (
    all_saturations_at_once,
    begun_without_freer,
    replaced_by_one,
    with_undone,
    without_idle,
)
from estimator.diagnosis.search.fitting import Fitted, fitted
from estimator.diagnosis.search.flux_map_stage import fitted_by_map, has_map
from estimator.diagnosis.search.remainder import alone, restarted_from_fewer, unexplained_by, without_spurious
from estimator.diagnosis.verdict import Unexplained
from estimator.physics.rows import Rows


class Explained(NamedTuple):
    """What a recording holds."""

    found: Fitted
    left: Unexplained | None
    plain: Search | None = None  # what explains the rows without a flux map, where the model has one
    resonance: Unexplained | None = None  # what explains as much as the losses of the model
    again: bool = False  # what was doubted, or led astray, has been taken away
    at_best: Mapping[tuple[str, str], float] | None = None  # log-odds of effects over others at their best shapes


def explained(rows: Rows, given: Given, progress: Callable[[float, str], None]) -> Explained:
    """What explains the rows: something without a name alone, effects of the library, or a flux map beside them."""
    if (by_form := alone(rows, given)) is not None:
        return Explained(*by_form)
    found = fitted(rows, given, lambda share, phase: progress(0.7 * share, phase))
    found = begun_without_freer(rows, found, given)
    progress(0.7, "checking rivals")
    found, at_best = replaced_by_one(rows, found, given)
    compared = set(found.choice)
    found = with_undone(rows, found, given)
    progress(0.71, "checking saturations together")
    found = without_idle(all_saturations_at_once(rows, found, given), given)
    progress(0.72, "checking fewer effects")
    found = restarted_from_fewer(rows, found, given)
    left = unexplained_by(rows, found)
    if left is not None and (by_map := fitted_by_map(rows, given, found, progress)) is not None:
        by_map, left_by_map, _ = without_spurious(rows, by_map, unexplained_by(rows, by_map), given)
        if has_map(by_map):
            return Explained(by_map, left_by_map, found.search)
    found, left, resonance = without_spurious(rows, found, left, given)
    return Explained(found, left, resonance=resonance, at_best=at_best if set(found.choice) == compared else None)
