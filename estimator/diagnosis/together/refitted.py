"""Refitted: a recording with the effects of all recordings, whether it shows them or not; what it says of each then.

Knows nothing of other recordings.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Final

import numpy as np

from estimator.diagnosis.answer.finding import told_sizes
from estimator.diagnosis.answer.parameters import ToldMachine, told_machine
from estimator.diagnosis.likelihood.given import Given
from estimator.diagnosis.search.fitting import Fitted, fitted, of_model
from estimator.diagnosis.search.remainder import excess_of, hidden_of, unexplained_by
from estimator.diagnosis.trust.rivals import SURE_LOG_ODDS
from estimator.diagnosis.verdict import Quantity, Unexplained
from estimator.physics.effect import Sizes
from estimator.physics.library import BY_NAME
from estimator.physics.rows import Rows

CONSTANTS: Final = ("L_d", "L_q")
"""Parameters that no temperature moves."""
MISSED: Final = {"R_s": 3e-4, "L_d": 2.5e-3, "L_q": 2.5e-3, "psi_f": 3e-4}
"""Share of a parameter that the machine's equations may miss, in each recording another: of constants half of the 0.5 %
within which estimates are to be, as no recording is called another machine's for less.
"""


class Refitted:
    """One recording's fit."""

    def __init__(self, rows: Rows, given: Given, found: Fitted) -> None:
        self.rows: Final = rows
        self.given: Final = given
        self.found: Final = found
        self._others: dict[frozenset[str], Refitted] = {}

    @property
    def effects(self) -> Mapping[str, Sizes]:
        """Those of its model."""
        return self.found.model.effects

    @property
    def changes(self) -> bool:
        """It can be fitted with other effects: it has no flux map, whose shapes are fitted in their place."""
        return self.found.model.bend is None

    def with_effects(self, effects: Mapping[str, Sizes]) -> "Refitted":
        """The same recording with these effects and no other, from these sizes on, or its own where it has them.

        Where it leaves more with others besides its own, as of a delay that has no size of none, it has them not.
        """
        names, own = frozenset(effects), self.effects
        if names == frozenset(own) or not self.changes:
            return self
        if names not in self._others:
            begin = replace(self.found.model, effects={name: own.get(name, effects[name]) for name in sorted(names)})
            other = Refitted(self.rows, self.given, of_model(self.rows, begin, self.given))
            worse = names >= own.keys() and self.likelier_than(other) > SURE_LOG_ODDS
            self._others[names] = self if worse else other
        return self._others[names]

    @cached_property
    def machine(self) -> dict[str, Quantity]:
        """R_s, L_d, L_q, psi_f; no value where the recording does not tell one."""
        told = self._told
        return {
            name: replace(size, value=None, std=None) if name in told.unidentified else size
            for name, size in told.after.items()
        }

    @cached_property
    def _told(self) -> ToldMachine:
        return told_machine(self.found, None, 0.0 if self.left is None else max(excess_of(self.found), 0.0), self.given)

    @property
    def outside(self) -> Mapping[str, str]:
        """Parameters beyond their tolerance, a sentence each."""
        return self._told.outside

    @cached_property
    def left(self) -> Unexplained | None:
        """What has no name."""
        return unexplained_by(self.rows, self.found)

    def by_effects_of(self, donors: Sequence["Refitted"]) -> "Refitted":
        """The recording explained from what explains others, where that leaves less."""
        best = self
        for model in (one.found.model for one in donors if one.changes and one.effects):
            begin = replace(model, angle=self.found.model.angle, zero=self.found.model.zero)
            other = Refitted(self.rows, self.given, fitted(self.rows, self.given, begin=begin))
            best = other if excess_of(other.found) < excess_of(best.found) else best
        return best

    def sizes(self, name: str) -> dict[str, tuple[Quantity, float]]:
        """What users are told of an effect, and the standard error of it that its equation makes in any recording.

        Of one that is not seen nothing but its size.
        """
        effect, one = BY_NAME[name], (name, -1)
        smooth = self.found.smooth.with_machine(self.found.model.machine)
        told = told_sizes(effect, smooth, self.found, one)
        form = told_sizes(effect, smooth, self.found, one, self.found.search.form_covariance(self.found.choice))
        if not self.shows(name):
            at_none = effect.none_at(self.effects[name])
            sized = {p.name: at_none[k] for k, p in enumerate(effect.parameters)}
            if effect.told is not None:
                sized = {name: value for name, (value, _) in effect.told(smooth, at_none).items()}
            told = {name: size for name, size in told.items() if sized.get(name) == 0.0}
        return {name: (size, form[name].std or 0.0) for name, size in told.items()}

    def shows(self, name: str) -> bool:
        """The recording calls for the effect by itself."""
        return self.gain(name) > 0.0

    def gain(self, name: str) -> float:
        """Log-odds that an effect brings."""
        one: tuple[str, int] = (name, -1)
        return self.found.search.gain(tuple(other for other in self.found.choice if other != one), one)

    def likelier_than(self, other: "Refitted") -> float:
        """Log-odds over another fit of the same recording; what rounding and equations may leave makes none likelier.

        Each coefficient costs what it explains of noise (H. Akaike, A new look at the statistical model identification,
        IEEE Trans. Automatic Control 19(6), 1974).
        """
        more = excess_of(other.found) - excess_of(self.found)
        lent = hidden_of(self.found) + self.found.search.discrepancy(self.found.choice)
        sure = math.copysign(max(abs(more) - lent, 0.0), more)
        return 0.5 * sure + self._other_coefficients(other)

    def _other_coefficients(self, other: "Refitted") -> int:
        """How many the other has more."""
        return len(other.found.search.places(other.found.choice)) - len(self.found.search.places(self.found.choice))

    def raw_sizes(self, name: str) -> list[tuple[float, float, float]]:
        """Of each size of an effect: value, standard error, standard deviation before data are seen; SI."""
        return [(value, std, prior) for _, value, std, prior in self._coefficients(name)]

    def size_stds(self, name: str) -> dict[int, float]:
        """Standard errors of an effect's sizes, by their places in its equation; SI."""
        return {place: std for place, _, std, _ in self._coefficients(name)}

    def _coefficients(self, name: str) -> Iterator[tuple[int, float, float, float]]:
        """Of each size: place in the equation, value, standard error, standard deviation before data are seen."""
        search, choice = self.found.search, self.found.choice
        fit = search.fit(choice)
        covariance = search.free_covariance(choice) + search.form_covariance(choice)
        for n, j in enumerate(fit.places):
            column = search.columns[j]
            if column.owner == name and not column.shape and search.gram[j, j] > 0.0:
                yield column.place, float(fit.value[n]), float(np.sqrt(covariance[n, n])), column.prior[1]


def all_effects(some: Sequence[Refitted]) -> dict[str, Sizes]:
    """The effects of several recordings, with the sizes of the one that shows it most."""
    best: dict[str, tuple[float, Sizes]] = {}
    for one in some:
        for name, sizes in one.effects.items():
            gain = one.gain(name)
            if name not in best or gain > best[name][0]:
                best[name] = gain, sizes
    return {name: sizes for name, (_, sizes) in best.items()}


def joint_equation(name: str, some: Sequence[Refitted]) -> tuple[float, ...]:
    """An effect's equation by recordings that have it: mean sizes, at the shapes of the one that shows it most."""
    best = max(some, key=lambda one: one.gain(name))
    equation = list(best.effects[name])
    told = [(one.effects[name], one.size_stds(name)) for one in some]
    for place in best.size_stds(name):
        each = [(sizes[place], stds[place] ** -2) for sizes, stds in told if stds.get(place, 0.0) > 0.0]
        if each:
            equation[place] = sum(size * weight for size, weight in each) / sum(weight for _, weight in each)
    return tuple(equation)
