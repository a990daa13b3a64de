"""Explain: which set of effects the recording calls for, by Bayesian evidence over a regression's sums.

Every set's coefficients have a normal prior, so its evidence has a closed form, and what a set gains over another is a
log-odds. Noise is white only where nothing is left unexplained: every column's gain is divided by how much more the
residual's projections on it scatter from stretch to stretch than white noise would let them, so that what is left
unexplained does not lend its energy to a name.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final, cast

import numpy as np

from estimator.arrays import Array
from estimator.diagnosis.likelihood.columns import BENDS, Regression
from estimator.physics.effect import AddedVoltage
from estimator.physics.flux_map import MISSED as BEND_MISSED
from estimator.physics.library import BY_NAME

Choice = tuple[tuple[str, int], ...]
"""Effects with the number of their shapes; -1 for those of the present model."""

ENTRY_LOG_ODDS: Final = 9.0  # log-odds that an effect must bring
MOST_EFFECTS: Final = 6  # effects
FAINT: Final = 0.03  # of a typical size
_OF_RIVALS: Final = 0.01  # of what others explain, that a faint effect may be which looks like them
PAIRED: Final = 6  # likeliest effects, of which two may be added together
_MADE_UP_FOR: Final = 0.5  # of what one effect leaves, that two may, to be added together
PLACED: Final = 0.25  # of what is left, that an effect has to explain where it is best
_PLACED_FAR: Final = 0.05  # the same before it is there, where that is no chance,
_NO_CHANCE: Final = 500.0  # chi square
_EXCHANGED: Final = 0.05  # of what is left, that an effect has to explain more of than the one whose place it takes
_ONLY_IF_THERE: Final = 0.5  # of what is left, more than which one effect explains only if it is there
FORM: Final = 1.5  # times the root of the energy that an equation misses, standard deviation of a size
_NEARLY_SINGULAR: Final = 1e-13  # of a column's square: sums of columns that are alike tell no better
_NOISE_UNSURE: Final = 0.03  # of the noise's power, by which its estimate may be wrong


@dataclass(frozen=True, slots=True, eq=False)
class SetFit:
    """A set's coefficients."""

    choice: Choice
    places: tuple[int, ...]  # columns
    value: Array
    covariance: Array  # for white noise
    log_evidence: float
    chi2: float


def one_cause(one: tuple[str, int], other: tuple[str, int]) -> bool:
    """Two effects are forms of one."""
    return BY_NAME[one[0]].other_form_of == other[0] or BY_NAME[other[0]].other_form_of == one[0]


def sizes_more(one: tuple[str, int], other: tuple[str, int]) -> int:
    """By how many sizes an effect is the freer form of another's cause; 0 where it is none."""
    more = len(BY_NAME[one[0]].sizes) - len(BY_NAME[other[0]].sizes)
    return max(more, 0) if one_cause(one, other) else 0


def is_freer(name: str) -> bool:
    """An effect has more sizes than the one whose other form it is."""
    other = BY_NAME[name].other_form_of
    return bool(other) and len(BY_NAME[name].sizes) > len(BY_NAME[other].sizes)


class Search:
    """Sets of effects over one regression."""

    def __init__(self, regression: Regression) -> None:
        self.regression = regression
        self.columns = regression.columns
        self.gram = regression.gram.sum(axis=0)
        self.base = [j for j, column in enumerate(self.columns) if column.owner == "machine"]
        self.bent = any(self.columns[j].place >= BENDS for j in self.base)
        self.mean = np.array([column.prior[0] for column in self.columns])
        self.weight = np.array([column.prior[1] ** -2 for column in self.columns])
        self.spread = np.array([column.prior[1] for column in self.columns])
        self.low = np.array([column.bounds[0] for column in self.columns])
        self.high = np.array([column.bounds[1] for column in self.columns])
        self.barred: set[str] = set()
        self._fits: dict[Choice, SetFit] = {}
        self._scatters: dict[tuple[Choice, tuple[str, int]], float] = {}

    def candidates(self) -> list[tuple[str, int]]:
        """All effects with all their shapes."""
        return list(dict.fromkeys((c.owner, c.seed) for c in self.columns if c.owner != "machine"))

    def places(self, choice: Choice) -> list[int]:
        """Columns of a set."""
        return self.base + [j for j, c in enumerate(self.columns) if (c.owner, c.seed) in choice]

    def sizes_of(self, one: tuple[str, int]) -> list[int]:
        """Columns of an effect's sizes."""
        return [j for j, c in enumerate(self.columns) if (c.owner, c.seed) == one and not c.shape]

    def fit(self, choice: Choice) -> SetFit:
        """Coefficients and evidence of a set."""
        choice = tuple(sorted(choice))
        if choice not in self._fits:
            self._fits[choice] = self._solved(choice, self.gram)
        return self._fits[choice]

    def promised(self, choice: Choice) -> float:
        """By how much a set's best coefficients leave less than the present ones, over noise, a period."""
        fit = self.fit(choice)
        there, at = list(fit.places), np.array([self.columns[j].offset for j in fit.places])
        left = float(self.gram[-1, -1] - 2.0 * at @ self.gram[there, -1] + at @ self.gram[np.ix_(there, there)] @ at)
        prior = float(np.sum(self.weight[there] * (at - self.mean[there]) ** 2))
        return (left + prior - fit.chi2) / len(self.regression.rows)

    def unbounded(self, choice: Choice) -> SetFit:
        """A set's fit where coefficients may have any value: what is bounded on one side shows what is on the other."""
        choice = tuple(sorted(choice))
        return self._unbounded(choice, self.places(choice), {}, self.gram)

    def fit_of_sizes(self, choice: Choice, held: Collection[str] = ()) -> SetFit:
        """A set's fit with the shapes of the present model as they are, and all of some effects."""
        choice = tuple(sorted(choice))
        columns = {j: self.columns[j] for j in self.places(choice)}
        as_is = {j: c.offset for j, c in columns.items() if c.shape or c.owner in held}
        return self._solved(choice, self.gram, as_is)

    def _solved(self, choice: Choice, gram: Array, held: dict[int, float] | None = None) -> SetFit:
        """The best coefficients within their bounds: those beyond are held at theirs, and all others solved anew."""
        places = self.places(choice)
        held = {} if held is None else held
        while True:
            free = [j for j in places if j not in held]
            fit = self._unbounded(choice, free, held, gram)
            low, high = self.low[free], self.high[free]
            beyond = np.maximum(low - fit.value, fit.value - high) / self.spread[free]
            worst = int(np.argmax(beyond)) if free else -1
            if worst < 0 or not beyond[worst] > 1e-9:
                break
            held[free[worst]] = float(np.clip(fit.value[worst], low[worst], high[worst]))
        value = np.array([held.get(j, 0.0) for j in places])
        covariance = np.zeros((len(places), len(places)))
        at = [k for k, j in enumerate(places) if j not in held]
        value[at] = fit.value
        covariance[np.ix_(at, at)] = fit.covariance
        return SetFit(choice, tuple(places), value, covariance, fit.log_evidence, fit.chi2)

    def _unbounded(self, choice: Choice, free: list[int], held: dict[int, float], gram: Array) -> SetFit:
        mean, weight = self.mean[free], self.weight[free]
        fixed, at = list(held), np.array(list(held.values()))
        A = gram[np.ix_(free, free)] + np.diag(weight)
        b = gram[free, -1] + weight * mean
        left = float(gram[-1, -1] + np.sum(weight * mean**2))
        if fixed:
            b = b - gram[np.ix_(free, fixed)] @ at
            left += float(at @ gram[np.ix_(fixed, fixed)] @ at - 2.0 * at @ gram[fixed, -1])
            left += float(np.sum(self.weight[fixed] * (at - self.mean[fixed]) ** 2))
        scale = 1.0 / np.sqrt(np.diag(A))
        factor = np.linalg.cholesky(A * np.outer(scale, scale) + _NEARLY_SINGULAR * np.eye(len(free)))
        inverse = np.linalg.inv(factor) * scale
        half = inverse @ b
        chi2 = left - float(half @ half)
        log_det = 2.0 * float(np.sum(np.log(np.diag(factor))) - np.sum(np.log(scale)))
        evidence = -0.5 * chi2 - 0.5 * log_det + 0.5 * float(np.sum(np.log(weight)))
        return SetFit(choice, tuple(free), inverse.T @ half, inverse.T @ inverse, evidence, chi2)

    def gain(self, choice: Choice, more: tuple[str, int]) -> float:
        """Log-odds that one more effect brings to a set, for noise as it scatters and equations as good as they are."""
        with_it, without = self.fit((*choice, more)), self.fit(choice)
        fitted = 0.5 * (without.chi2 - with_it.chi2)
        complexity = self.complexity(choice, more)
        lent = self.lent(choice, more, faint=self.faint(with_it, more)) + self._lent_by_speed(with_it, more)
        return (fitted - 0.5 * lent) / self.scatter(with_it, more) + complexity

    def complexity(self, choice: Choice, more: tuple[str, int]) -> float:
        """Log-odds that one more effect costs a set, however much it explains."""
        with_it, without = self.fit((*choice, more)), self.fit(choice)
        return with_it.log_evidence - without.log_evidence - 0.5 * (without.chi2 - with_it.chi2)

    def _lent_by_speed(self, fit: SetFit, one: tuple[str, int]) -> float:
        """Chi square that errors of the speed may lend an effect that the speed alone tells from the machine's."""
        effect, own = BY_NAME[one[0]], self.sizes_of(one)
        if not isinstance(effect, AddedVoltage) or effect.by_speed == 0.0:
            return 0.0
        sizes = fit.value[[fit.places.index(j) for j in own]]
        return effect.by_speed * float(sizes @ self.gram[np.ix_(own, own)] @ sizes)

    def variance_of(self, choice: Choice, more: tuple[str, int], place: int) -> float:
        """Of one size of an effect beside a set, for white noise, where its other sizes are known and none is held."""
        free, places = self.free_covariance((*choice, more)), self.places((*choice, more))
        own = [places.index(j) for j in self.sizes_of(more)]
        at = own.index(places.index(place))
        std = np.sqrt(np.diag(free)[own])  # sizes may differ by many orders of magnitude
        precision = np.linalg.inv(free[np.ix_(own, own)] / np.outer(std, std))
        return float(std[at] ** 2 / precision[at, at])

    def faint(self, fit: SetFit, one: tuple[str, int]) -> bool:
        """All of an effect's sizes are so small that beside others it must explain more than they may lend."""
        own = self.sizes_of(one)
        value = fit.value[[list(fit.places).index(j) for j in own]]
        return bool(np.all(np.abs(value) < FAINT * self.spread[own]))

    def scatter(self, fit: SetFit, one: tuple[str, int]) -> float:
        """How the residual's projections on an effect's columns scatter from stretch to stretch, over white noise."""
        if (fit.choice, one) not in self._scatters:
            grams, places = self.regression.gram, list(fit.places)
            own = self.sizes_of(one)
            rest = [j for j in places if j not in own]
            A = self.gram[np.ix_(rest, rest)] + np.diag(self.weight[rest])
            along = cast(Array, np.linalg.solve(A, self.gram[np.ix_(rest, own)]))  # of own columns by the rest
            score = grams[:, :, -1] - grams[:, :, places] @ fit.value  # (stretches, P + 1)
            left = score[:, own] - score[:, rest] @ along
            size = cast(Array, np.einsum("sjj->sj", grams[:, own][:, :, own]))
            size = size - 2.0 * np.einsum("spj,pj->sj", grams[:, rest][:, :, own], along)
            size = size + np.einsum("pj,spq,qj->sj", along, grams[:, rest][:, :, rest], along)
            strength = np.maximum(size.sum(axis=0), 1e-300)
            weight = strength * fit.value[[places.index(j) for j in own]] ** 2 + 1e-300
            each = cast(Array, (left**2).sum(axis=0) / strength)
            self._scatters[fit.choice, one] = max(1.0, float(each @ weight / weight.sum()))
        return self._scatters[fit.choice, one]

    def distance(self, fit: SetFit, one: tuple[str, int]) -> float:
        """Half the squared distance of an effect's sizes from none, in standard errors for noise as it scatters and for
        inductances that are not told.

        At its shapes: a size that trades with one is uncertain, but not near none. Of sizes that are held at a bound
        nothing is said: infinite.
        """
        at = [fit.places.index(j) for j in self.sizes_of(one)]
        told = [n for n in at if fit.covariance[n, n] > 0.0]
        if not told:
            return math.inf
        own = [n for n, j in enumerate(fit.places) if (self.columns[j].owner, self.columns[j].seed) == one]
        shapes = [n for n in own if self.columns[fit.places[n]].shape and fit.covariance[n, n] > 0.0]
        covariance = self.scattered(fit, fit.covariance, one) + self.untold_covariance(fit.choice)
        std = np.sqrt(np.maximum(np.diag(covariance), 1e-300))  # sizes may differ by many orders of magnitude
        correlation, x = covariance / np.outer(std, std), (fit.value / std)[told]
        spread = correlation[np.ix_(told, told)]
        if shapes:
            across = correlation[np.ix_(shapes, told)]
            spread = spread - across.T @ np.linalg.lstsq(correlation[np.ix_(shapes, shapes)], across, rcond=1e-12)[0]
        return 0.5 * float(x @ np.linalg.lstsq(spread, x, rcond=1e-12)[0])

    def scattered(self, fit: SetFit, covariance: Array, one: tuple[str, int]) -> Array:
        """A fit's covariance for noise as it scatters along an effect. What is known before the data does not scatter:
        an angle's zero within its count, that an offset trades with, least of all.
        """
        by = self.scatter(fit, one)
        return by * covariance - (by - 1.0) * (covariance * self.weight[list(fit.places)]) @ covariance

    def plain(self) -> SetFit:
        """Of R_s, L_d, L_q, psi_f and the zeros of angle and currents in a machine of straight lines."""
        return self._unbounded((), [j for j in self.base if self.columns[j].place < BENDS], {}, self.gram)

    def free_covariance(self, choice: Choice) -> Array:
        """Of a set's coefficients, none of them held at a bound: how far each may be off, whatever was held."""
        return self.unbounded(choice).covariance

    def untold_covariance(self, choice: Choice) -> Array:
        """What a set's coefficients are more uncertain by than their free covariance: inductances that the recording
        does not tell, and what trades with these, for they lie anywhere within their tolerance.
        """
        free, places = self.free_covariance(choice), self.places(choice)
        held = [n for n, j in enumerate(places) if self.columns[j].parameter in self.regression.unidentified]
        along = free[:, held] @ np.linalg.inv(free[np.ix_(held, held)])  # of each, by those that are not identified
        return (along * self.spread[places][held] ** 2) @ along.T - along @ free[held]

    def parameter_scatter(self, fit: SetFit) -> Array:
        """How every coefficient of a fit scatters over white noise, each less what the others make of it."""
        grams, places = self.regression.gram, list(fit.places)
        score = grams[:, places, -1] - np.einsum("spq,q->sp", grams[:, places][:, :, places], fit.value)
        spread = score.T @ score
        robust = np.diag(fit.covariance @ spread @ fit.covariance)
        return np.maximum(1.0, robust / np.maximum(np.diag(fit.covariance), 1e-300))

    def borne_out(self, choice: Choice) -> float:
        """Share of what a set explains that it explains of stretches left out of its fit too, each half in its turn."""
        told, grams = 0.0, self.regression.gram
        for half, other in ((grams[0::2], grams[1::2].sum(axis=0)), (grams[1::2], grams[0::2].sum(axis=0))):
            search = Search(replace(self.regression, gram=half))
            for sign, some in ((1.0, ()), (-1.0, choice)):
                fit = search.fit(some)
                x, places = np.append(fit.value, -1.0), [*fit.places, len(self.columns)]
                told += sign * float(x @ other[np.ix_(places, places)] @ x)
        return told / max(self.fit(()).chi2 - self.fit(choice).chi2, 1e-300)

    def form_covariance(self, choice: Choice) -> Array:
        """Of a set's coefficients, by what equations miss: each size may be off by as much as its effect's equation.

        Whatever else trades with that size is off with it. Where an effect has several, what its equation misses may
        lie anyhow among them: of sizes that look alike the sum is told, and not each.
        """
        fit, covariance = self.fit(choice), self.free_covariance(choice)
        total = np.zeros_like(covariance)
        for n, place in enumerate(fit.places):
            column = self.columns[place]
            if column.owner != "machine" and not column.shape:
                off = FORM * math.sqrt(self.missed(choice, (column.owner, column.seed))) * float(fit.value[n])
                along = covariance[:, n] * (off / covariance[n, n])
                total += np.outer(along, along)
        for one in choice:
            sizes = self.sizes_of(one)
            if len(sizes) > 1:
                own = [fit.places.index(j) for j in sizes]
                each = self.missed(choice, one) * max(self.explained(choice, one), 0.0) / len(own)
                total[np.ix_(own, own)] += FORM**2 * each * covariance[np.ix_(own, own)]
        return total

    def explained(self, choice: Choice, one: tuple[str, int]) -> float:
        """Chi square that nothing else of a set would explain."""
        return self.fit(tuple(other for other in choice if other != one)).chi2 - self.fit(choice).chi2

    def unexplained(self, choice: Choice) -> float:
        """Chi square that a set leaves above that of noise."""
        return self.fit(choice).chi2 - self.regression.count

    def discrepancy(self, choice: Choice) -> float:
        """What the equations of a set's effects may leave of them, as a part of chi square."""
        total = BEND_MISSED * max(self.plain().chi2 - self.fit(choice).chi2, 0.0) if self.bent else 0.0
        return total + sum(self.missed(choice, one) * max(self.explained(choice, one), 0.0) for one in choice)

    def missed(self, choice: Choice, one: tuple[str, int]) -> float:
        """Share of what an effect of a set explains that its equation may miss."""
        fit = self.fit(choice)
        return BY_NAME[one[0]].missed([float(fit.value[fit.places.index(j)]) for j in self.sizes_of(one)])

    def due_of_freer(self, choice: Choice, one: tuple[str, int], other: tuple[str, int]) -> float:
        """Chi square that an effect of a set has to explain beyond another form of its cause, where it is freer: for
        each size more what an effect has to, for noise as it scatters.
        """
        sizes = sizes_more(one, other)
        return 2.0 * ENTRY_LOG_ODDS * sizes * self.scatter(self.fit(choice), one) if sizes else 0.0

    def lent(self, choice: Choice, more: tuple[str, int], *, faint: bool) -> float:
        """What of chi square the equations of a set's effects may lend another: no one looks like half of all left.

        A faint one: all that they miss, and a part of what those explain that look like it.
        """
        if not faint:
            left = max(self.unexplained(choice), _NOISE_UNSURE * self.regression.count)
            return min(self.discrepancy(choice), _ONLY_IF_THERE * left)
        alike = [
            one for one in choice
            if one[0] in BY_NAME[more[0]].confused_with or more[0] in BY_NAME[one[0]].confused_with
        ]  # fmt: skip
        return self.discrepancy(choice) + _OF_RIVALS * sum(self.explained(choice, one) for one in alike)

    def best(self, start: Choice = ()) -> Choice:
        """A set with at most one effect more, that nothing taken away or exchanged makes better."""
        choice = self._exchanged(self._added(self.without_needless(start)))
        return self._exchanged(self.without_needless(choice))

    def _free(self, choice: Choice) -> list[tuple[str, int]]:
        taken = {name for name, _ in choice} | self.barred
        return [c for c in self.candidates() if c[0] not in taken and not any(one_cause(c, one) for one in choice)]

    def _added(self, choice: Choice) -> Choice:
        if len(choice) >= MOST_EFFECTS:
            return choice
        likely = self._likely(choice)
        single = next(((*choice, more) for more in likely if self.gain(choice, more) > ENTRY_LOG_ODDS), choice)
        return self._paired(choice, likely) or single if len(choice) + 1 < MOST_EFFECTS else single

    def _likely(self, choice: Choice) -> list[tuple[str, int]]:
        """Effects that may be added, each with its likeliest shapes, likeliest first."""
        by_name: dict[str, tuple[str, int]] = {}
        for one in sorted(self._free(choice), key=lambda more: -self.fit((*choice, more)).log_evidence):
            by_name.setdefault(one[0], one)
        return list(by_name.values())

    def _paired(self, choice: Choice, likely: Sequence[tuple[str, int]]) -> Choice | None:
        """The set with two effects more, where either makes up for the other: both explain most, none much alone."""
        alone = min((self.fit((*choice, one)).chi2 for one in likely), default=0.0) - self.regression.count
        pairs = sorted(combinations(likely[:PAIRED], 2), key=lambda pair: self.fit((*choice, *pair)).chi2)
        pairs = [pair for pair in pairs if not one_cause(*pair)]
        for one, other in pairs[:1]:
            left = self.unexplained((*choice, one, other))
            due = min(self.gain((*choice, one), other), self.gain((*choice, other), one))
            if due > ENTRY_LOG_ODDS and left < _MADE_UP_FOR * alone:
                return (*choice, one, other)
        return None

    def to_place(self, choice: Choice) -> tuple[str, int] | None:
        """The likeliest effect that is no line and explains a part of what is left, but as a line too little to be
        added: to be tried where it is best. It has a moment of its own; or it bends, and explains no more than the
        equations of others may miss.
        """
        left, discrepancy = self.unexplained(choice), self.discrepancy(choice)
        for one in self._likely(choice):
            effect = BY_NAME[one[0]]
            explained = self.fit(choice).chi2 - self.fit((*choice, one)).chi2
            if (effect.bends and explained < discrepancy) or any(parameter.discrete for parameter in effect.parameters):
                least = min(PLACED * left, max(_PLACED_FAR * left, _NO_CHANCE))
                return one if len(choice) < MOST_EFFECTS and explained > max(least, 2.0 * ENTRY_LOG_ODDS) else None
        return None

    def without_needless(self, choice: Choice) -> Choice:
        """The set without what does not bring its due."""
        while choice:
            gains = {one: self.gain(tuple(c for c in choice if c != one), one) for one in choice}
            least = min(gains, key=lambda key: gains[key])
            if gains[least] > ENTRY_LOG_ODDS:
                pair = self._needless_pair(choice)
                if pair is None:
                    break
                choice = tuple(c for c in choice if c not in pair)
                continue
            choice = tuple(c for c in choice if c != least)
        return choice

    def _needless_pair(self, choice: Choice) -> tuple[tuple[str, int], tuple[str, int]] | None:
        """Two effects of a set that make up for each other, and together bring no more than one has to."""
        for pair in combinations(choice, 2):
            rest, (one, other) = tuple(c for c in choice if c not in pair), pair
            if self.gain(rest, one) + self.gain((*rest, one), other) <= ENTRY_LOG_ODDS:
                return pair
        return None

    def _exchanged(self, choice: Choice) -> Choice:
        """One effect for another that brings its due, or one shape for another of the same, where that is better."""
        best, at = choice, self.fit(choice).log_evidence
        least = _EXCHANGED * 0.5 * max(self.unexplained(choice), 0.0)
        for one in choice:
            rest = tuple(c for c in choice if c != one)
            for other in self._free(rest):
                if other == one:
                    continue
                due = 0.5 * self.due_of_freer((*rest, other), other, one)
                if (there := self.fit((*rest, other)).log_evidence) <= at + due + 1e-6:
                    continue
                if other[0] == one[0] or (there > at + least and self.gain(rest, other) > ENTRY_LOG_ODDS):
                    best, at = (*rest, other), there
        return best
