"""Which set of effects the points call for, by what each predicts of points that took no part in its fit.

Odds are pseudo-Bayes factors: the likelihood of every left-out group, for noise whose size is not known, so that on
each axis log odds = N/2 log(missed without / missed with) (S. Geisser, W. F. Eddy, "A predictive approach to model
selection", J. American Statistical Association 74, 1979). N is divided by how much more the residual's projections on
the effect scatter from group to group than white noise would let them: neighbouring rows of a log are not independent.
"""

import math
from collections.abc import Sequence
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array
from estimator.diagnosis.likelihood.evidence import ENTRY_LOG_ODDS, MOST_EFFECTS
from estimator.diagnosis.points.fit import PointsFit, fitted_points
from estimator.diagnosis.points.problem import Key, Problem

PointsChoice = tuple[str, ...]
NEGLIGIBLE: Final = 0.03  # of a typical size: less is not told from what steady points miss
_CHOICE_ROUNDS: Final = 3  # of choosing, and of telling the noise from what is left
_LIKELY: Final = 4  # effects, of which pairs are tried


class PointsSearch:
    """Sets of effects over one problem."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.noise = np.ones(len(problem.y))
        self._fits: dict[PointsChoice, PointsFit] = {}

    def fit(self, choice: PointsChoice) -> PointsFit:
        """A set's fit."""
        choice = tuple(sorted(choice))
        if choice not in self._fits:
            smaller = [tuple(c for c in choice if c != name) for name in choice]
            starts = [self._fits[less] for less in smaller if less in self._fits]
            best = min(starts, key=lambda fit: fit.missed, default=None)
            self._fits[choice] = fitted_points(self.problem, choice, self.noise, None if best is None else best.values)
        return self._fits[choice]

    def chosen(self) -> PointsChoice:
        """The set that nothing added, taken away or exchanged makes better."""
        self._learn_noise(self.fit(()))
        choice: PointsChoice = ()
        for _ in range(_CHOICE_ROUNDS):
            before, choice = choice, self._best(choice)
            self._learn_noise(self.fit(choice))
            if before == choice and choice:
                break
        return self._without_needless(choice)

    def gain(self, choice: PointsChoice, more: str) -> float:
        """Log-odds that an effect brings to a set."""
        return self.log_odds(self.fit((*choice, more)), self.fit(choice), more)

    def brings(self, choice: PointsChoice) -> dict[str, float]:
        """Log-odds that each effect of a set brings to the others."""
        return {name: self.gain(tuple(c for c in choice if c != name), name) for name in choice}

    def log_odds(self, fit: PointsFit, other: PointsFit, effect: str) -> float:
        """Log-odds of one fit, which has the effect, against another; no more than its standard errors bear."""
        own = fit.places(effect)
        if all(abs(fit.x[k]) < NEGLIGIBLE * fit.sizes[k].typical for k in own):
            return -math.inf
        return min(self.predicted(fit.left_out, other.left_out) / self.scatter(fit, effect), self.distance(fit, effect))

    def predicted(self, left_out: Array, by_other: Array) -> float:
        """Log-odds of one model's errors on rows left out against another's, for independent rows."""
        total = 0.0
        for axis in np.unique(self.problem.axis):
            on = self.problem.axis == axis
            least = (self.problem.exact * float(np.max(np.abs(self.problem.y))) / float(self.noise[on][0])) ** 2
            mine, others = (max(float(np.mean(errors[on] ** 2)), least) for errors in (left_out, by_other))
            total += 0.5 * float(on.sum()) * math.log(others / mine)
        return total

    def distance(self, fit: PointsFit, effect: str) -> float:
        """Half the squared distance of an effect's sizes from none, in standard errors."""
        own = [k for k in fit.places(effect) if fit.covariance[k, k] > 0.0]
        if not own:
            return 0.0
        return 0.5 * float(fit.x[own] @ np.linalg.solve(fit.covariance[np.ix_(own, own)], fit.x[own]))

    def scatter(self, fit: PointsFit, effect: str) -> float:
        """How the residual's projections on what an effect adds scatter from group to group, over white noise."""
        own = [k for k in fit.places(effect) if abs(fit.x[k]) > 0.0]
        signal = self.signal(fit, effect, own)
        size = float(signal @ signal)
        if size <= 0.0:
            return 1.0
        scores = np.bincount(self.problem.group, weights=signal * fit.left_out)
        return max(1.0, float(scores @ scores) / (size * fit.scale**2))

    def signal(self, fit: PointsFit, effect: str, own: Sequence[int]) -> Array:
        """What an effect adds, over noise, less what the rest of the model could make of it."""
        rest = [k for k, size in enumerate(fit.sizes) if size.owner != effect]
        typical = np.array([size.typical for size in fit.sizes])
        column = fit.J[:, own] @ (fit.x[own] / typical[own])
        along = np.linalg.lstsq(fit.J[:, rest], column, rcond=1e-10)[0]
        return column - fit.J[:, rest] @ along

    def moves(self, choice: PointsChoice, parts: Sequence[NDArray[np.bool_]]) -> dict[Key, float]:
        """By how much sizes move where they are fitted to parts of the equations."""
        choice = tuple(sorted(choice))
        whole = self.fit(choice)
        moved: dict[Key, float] = {}
        for inside in parts:
            part = fitted_points(self.problem.part(inside), choice, self.noise[inside], whole.values)
            for key, value in part.values.items():
                moved[key] = max(moved.get(key, 0.0), abs(value - whole.values[key]))
        return moved

    def free(self, choice: PointsChoice) -> list[str]:
        """Effects that are not in a set."""
        return [name for name in self.problem.effects if name not in choice]

    def _best(self, choice: PointsChoice) -> PointsChoice:
        choice, seen = self._exchanged(self._without_needless(choice)), set[PointsChoice]()
        while len(choice) < MOST_EFFECTS and choice not in seen:  # alike ones may take each other's place for ever
            seen.add(choice)
            if not (more := self._more(choice)):
                break
            choice = self._exchanged(self._without_needless((*choice, *more)))
        return choice

    def _more(self, choice: PointsChoice) -> PointsChoice:
        """The effect to be added, or two that only help together."""
        gains = {name: self.gain(choice, name) for name in self.free(choice)}
        ranked = sorted(gains, key=lambda name: -gains[name])
        if ranked and gains[ranked[0]] > ENTRY_LOG_ODDS:
            return (ranked[0],)
        if len(choice) + 2 > MOST_EFFECTS:
            return ()
        for one, other in combinations(ranked[:_LIKELY], 2):
            if min(self.gain((*choice, one), other), self.gain((*choice, other), one)) > ENTRY_LOG_ODDS:
                return (one, other)
        return ()

    def _without_needless(self, choice: PointsChoice) -> PointsChoice:
        while choice:
            gains = self.brings(choice)
            least = min(gains, key=lambda name: gains[name])
            if gains[least] > ENTRY_LOG_ODDS:
                break
            choice = tuple(c for c in choice if c != least)
        return choice

    def _exchanged(self, choice: PointsChoice) -> PointsChoice:
        best = choice
        for one in choice:
            rest = tuple(c for c in choice if c != one)
            for other in self.free(choice):
                if self.fit((*rest, other)).missed < self.fit(best).missed:
                    best = (*rest, other)
        return best

    def _learn_noise(self, fit: PointsFit) -> None:
        """Each axis's noise by what is left there; what was fitted with another is forgotten."""
        left = fit.left_out * self.noise
        for axis in np.unique(self.problem.axis):
            on = self.problem.axis == axis
            self.noise[on] = max(math.sqrt(float(np.mean(left[on] ** 2))), 1e-9)
        self._fits.clear()
