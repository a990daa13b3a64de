"""Doubt: how sure a set of effects is - odds against rivals, what cannot be told apart and what would tell, what could
have been seen. Knows nothing of how the set was found.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from estimator.diagnosis.likelihood.evidence import ENTRY_LOG_ODDS, FAINT, Choice, Search, sizes_more
from estimator.diagnosis.likelihood.identifiability import beside_of, least_borne_out, product_of, signal_of
from estimator.diagnosis.trust.odds import log_odds
from estimator.diagnosis.verdict import Ambiguity, Candidate, Experiment, Quantity
from estimator.physics.library import BY_NAME

SURE_LOG_ODDS: Final = math.log(100.0)  # log-odds below which two effects are not told apart
_UNLIKE_SIGNALS: Final = 0.3  # correlation of signals, below which one does not stand for the other
POWER_99: Final = 2.326  # standard normal at 99 %


@dataclass(frozen=True, slots=True)
class RivalFit:
    """A rival of an effect."""

    effect: str
    log_odds: float  # in favour of the effect found
    collinear: float  # correlation of the two effects' signals, the machine's parameters taken out


def rivals(
    search: Search, choice: Choice, one: tuple[str, int], at_best: Mapping[tuple[str, str], float] | None = None
) -> list[RivalFit]:
    """Other effects in the place of one, likeliest first. None is one that is unlike it, and called for besides.

    `at_best`: log-odds of an effect over another at that one's best shapes, where they are known.
    """
    rest = tuple(c for c in choice if c != one)
    best: dict[str, tuple[str, int]] = {}
    taken = {name for name, _ in choice}
    for other in search.candidates():
        if other[0] in taken or sizes_more(other, one):  # a freer form explains whatever this one does
            continue
        known = best.get(other[0])
        if known is None or search.fit((*rest, other)).log_evidence > search.fit((*rest, known)).log_evidence:
            best[other[0]] = other
    full, discrepancy = search.fit(choice), search.missed(choice, one) * max(0.0, search.explained(choice, one))
    scatter = search.scatter(full, one)
    found: list[RivalFit] = []
    for other in best.values():
        there = search.fit((*rest, other))
        fitted = 0.5 * (there.chi2 - full.chi2)
        complexity = full.log_evidence - there.log_evidence - fitted
        said = (fitted - 0.5 * discrepancy if fitted > 0.0 else fitted) / scatter + complexity
        collinear = _collinear(search, rest, one, other)
        if abs(collinear) < _UNLIKE_SIGNALS:
            said = max(said, search.gain((*rest, other), one))
        said = min(said, (at_best or {}).get((one[0], other[0]), math.inf))
        found.append(RivalFit(other[0], said, collinear))
    return sorted(found, key=lambda doubt: doubt.log_odds)


def _collinear(search: Search, rest: Choice, one: tuple[str, int], other: tuple[str, int]) -> float:
    """Correlation of what two effects add, at their fitted sizes, less what the rest of the model makes of it."""
    a, b = (signal_of(search, (*rest, effect), effect) for effect in (one, other))
    places = search.places(rest)
    size = product_of(search, places, a, a) * product_of(search, places, b, b)
    return product_of(search, places, a, b) / math.sqrt(size) if size > 0.0 else 0.0


def ambiguity(one: str, rival: RivalFit, experiment: Experiment) -> Ambiguity:
    """Two effects that are not told apart, and what would tell."""
    this, that, collinear = BY_NAME[one].title, BY_NAME[rival.effect].title, f"{abs(rival.collinear):.2f} here"
    if rival.log_odds < -SURE_LOG_ODDS:
        reason = (
            f"{that} is likelier than {this} by noise alone, but by no more than what else is left of this recording "
            f"may make (their signals are collinear to {collinear})"
        )
    else:
        reason = (
            f"{this} and {that} explain this recording about equally well (odds {math.exp(rival.log_odds):.2g} to 1; "
            f"their signals are collinear to {collinear})"
        )
    return Ambiguity((one, rival.effect), reason, experiment)


def detectable(search: Search, choice: Choice, excess: float, tolerance: Mapping[str, float]) -> dict[str, Quantity]:
    """The smallest size of every effect that would have been named at 99 % power, in its first parameter that shows.

    Whatever its shapes: the largest of them. `excess` is the energy over noise that is left unexplained.
    """
    found: dict[str, Quantity] = {}
    taken, beside = {name for name, _ in choice}, beside_of(search, excess)
    for more in search.candidates():
        place = next((j for j in search.sizes_of(more) if search.gram[j, j] > 0.0), None)
        if more[0] in taken or place is None:
            continue
        size = max(_named_from(search, choice, more, place), least_borne_out(search, choice, more, place, beside))
        known = found.get(more[0])
        if known is None or (known.value is not None and size > known.value):
            found[more[0]] = Quantity(size, None, BY_NAME[more[0]].parameters[search.columns[place].place].unit)
    least = min(tolerance.values())  # of a gain of all voltages: one parameter lies outside, whatever the true ones are
    gain = 2.0 * least / (1.0 - least) if least < 1.0 else math.inf
    return {**found, "dc_link_gain": Quantity(gain, None, "1")}


def _named_from(search: Search, choice: Choice, more: tuple[str, int], place: int) -> float:
    """The size (of the column at `place`, the effect's others zero) whose gain is enough in 99 of 100 recordings."""
    fit, variance = search.fit((*choice, more)), search.variance_of(choice, more, place)
    scatter, std = search.scatter(fit, more), math.sqrt(variance)
    asked = 2.0 * scatter * (ENTRY_LOG_ODDS - search.complexity(choice, more))
    faint = FAINT * search.columns[place].prior[1]

    def least(*, of_faint: bool) -> float:
        lent = search.lent(choice, more, faint=of_faint)
        return std * (math.sqrt(max(asked + lent, 0.0)) + POWER_99 * math.sqrt(scatter))

    plainly = least(of_faint=False)
    return plainly if plainly > faint else min(least(of_faint=True), faint)


def candidates(search: Search, choice: Choice) -> tuple[Candidate, ...]:
    """Every effect that the recording may show, and the odds that it is there."""
    found: list[Candidate] = []
    chosen, scale = dict(choice), math.log(10.0)
    for name in dict.fromkeys(owner for owner, _ in search.candidates()):
        shapes = [c for c in search.candidates() if c[0] == name]
        alone = max(shapes, key=lambda c: search.fit((c,)).log_evidence)
        if name in chosen:
            one = (name, chosen[name])
            after = log_odds(search, tuple(c for c in choice if c != one), one)
        else:
            more = max(shapes, key=lambda c: search.fit((*choice, c)).log_evidence)
            if not any(search.gram[j, j] > 0.0 for j in search.sizes_of(more)):
                continue
            after = log_odds(search, choice, more)
        found.append(Candidate(name, log_odds(search, (), alone) / scale, after / scale, name in chosen))
    return tuple(sorted(found, key=lambda c: (not c.chosen, -c.log10_odds_after)))
