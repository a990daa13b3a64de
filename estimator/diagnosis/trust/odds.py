"""Odds: what the evidence of an effect is worth, told as odds that are right as often as they say.

    log(odds) = PRIOR + WORTH log(Bayes factor)

An effect that is thought of is there in one recording of some thirty, before that is looked at. And the Bayes factor
takes equations for exact and noise for Gaussian, so that it says too much. Both numbers are measured: by
`python -m tests.score.reliability` over recordings with a measuring chain drawn for each, healthy ones and some with
one effect near its detection limit. Of a size that may not change its sign, half the Gaussian counts.
"""

import math
from typing import Final

from estimator.diagnosis.likelihood.evidence import Choice, Search

PRIOR: Final = -2.6
WORTH: Final = 0.25
_FURTHEST: Final = 30.0  # standard errors beyond none, from which on nothing changes


def log_odds(search: Search, choice: Choice, more: tuple[str, int]) -> float:
    """That an effect is there beside a set."""
    return PRIOR + WORTH * log_bayes_factor(search, choice, more)


def log_bayes_factor(search: Search, choice: Choice, more: tuple[str, int]) -> float:
    """Of an effect beside a set, over none."""
    gain, (beyond, complexity) = search.gain(choice, more), _held(search, choice, more)
    if beyond is None:
        return gain
    beyond = min(beyond, _FURTHEST)
    return gain + complexity + 0.5 * beyond**2 + math.log(math.erfc(beyond / math.sqrt(2.0)))


def _held(search: Search, choice: Choice, more: tuple[str, int]) -> tuple[float | None, float]:
    """By how many standard errors the data want sizes beyond none, where they are held there, and what they cost."""
    with_it = search.fit((*choice, more))
    own = [n for n, place in enumerate(with_it.places) if place in search.sizes_of(more)]
    if any(with_it.covariance[n, n] > 0.0 or with_it.value[n] != 0.0 for n in own):
        return None, 0.0
    free, without = search.unbounded((*choice, more)), search.unbounded(choice)
    beyond = math.sqrt(max(without.chi2 - free.chi2, 0.0))
    return beyond, free.log_evidence - without.log_evidence - 0.5 * (without.chi2 - free.chi2)
