"""Fitting: a recording, a nominal machine and the library to the model that explains it, found step by step.

Each round linearises the model where it stands, lets the search add at most one effect, and moves on, by rows that the
model so far has taken noise off. Knows nothing of words.
"""

import math
from collections.abc import Callable, Collection, Sequence, Set
from dataclasses import replace
from functools import cached_property
from typing import Final

import numpy as np

from estimator.arrays import Vector
from estimator.diagnosis.angle.angle_rounding import hidden_energy
from estimator.diagnosis.likelihood.cleaning import Clean, Following, cleaned, raw
from estimator.diagnosis.likelihood.columns import BENDS, VoltageSlopes, regression
from estimator.diagnosis.likelihood.evidence import PLACED, Choice, Search
from estimator.diagnosis.likelihood.given import Given
from estimator.diagnosis.likelihood.noise import Noise, as_in, flux_errors
from estimator.diagnosis.likelihood.thinning import PARTS, in_parts, thinned
from estimator.diagnosis.search.flux_step import with_step_in_place
from estimator.machine import PARAMETERS, Machine
from estimator.physics.effect import Effect, Sizes
from estimator.physics.library import BY_NAME, LIBRARY
from estimator.physics.rows import Rows
from estimator.twin.model import Model, residual
from estimator.twin.response import Response

ROUNDS: Final = 9
POLISHED: Final = 6  # times a round
_POLISHED_AGAIN: Final = 2  # times a round, where fewer rows have found a model
_FINDING_BLOCKS: Final = (8_000, 16)  # periods and blocks of them, that find what costs much to follow
_FIND: Final = 2  # times as often as all rows
_NO_LESS: Final = 0.99  # of what a set left before: who comes back to it goes round
_BEYOND_LINES: Final = 3  # the same, where equations are far from lines
_ATTEMPTS: Final = 3  # searches, each from what the one before had need of
_LASTS: Final = 4  # steps, that slopes of what the bridge loses serve
_NEAR_IT: Final = 0.5  # of what a model leaves: less, and it is another one
_SAME_FIT: Final = 0.1  # standard errors: a step that does not matter
_NEARLY_THERE: Final = 2.0  # the same where it leads to the end
_FIT_HALVINGS: Final = 3
_OF_NOISE: Final = 2.0  # energy that noise leaves, a period, and
_MUCH: Final = 0.5  # more than that: steps may have led astray
_WORTH_TRYING: Final = 0.5  # of what the likeliest effect explains where equations are lines, that others have to
_HOPELESS: Final = 2.0  # times what noise leaves, from which on a step that leads nowhere is the last
_OF_HALF: Final = 0.75  # of what a line promises, at half of the way: who brings it is not past a bend


class Fitted:
    """What a recording's rows say."""

    def __init__(
        self, rows: Rows, model: Model, clean: Clean, own: Search, search: Callable[[], Search] | None = None
    ) -> None:
        assert clean.noise is not None
        self.model: Final = model
        self.choice: Final = _present(model)
        self.rows: Final = rows.with_machine(model.machine)
        self.smooth: Final = clean.rows
        self.z: Final[Vector] = clean.z
        """Vs, whitened residual."""
        self.noise: Final = clean.noise
        self.own: Final = own
        """Around the model, of its own effects at least."""
        self._search = search

    @cached_property
    def search(self) -> Search:
        """Around the model, of all effects: it takes longer than many a fit that is asked for its rest alone."""
        return self.own if self._search is None else self._search()


Progress = Callable[[float, str], None]
"""What is done, as a share, and its name."""
_Polish = Callable[[Rows, Clean, Model, Given], tuple[Model, Clean, bool]]


def fitted(
    rows: Rows, given: Given, progress: Progress = lambda _share, _phase: None,
    library: Sequence[Effect] = LIBRARY, begin: Model | None = None,
) -> Fitted:  # fmt: skip
    """The model that explains the rows.

    Blocks of rows find it, then more of them, and all of them have the last word. It begins with the nominal machine,
    or what is given, and anew where what some rows found leaves far more than noise.
    """
    *parts, whole = in_parts(rows)
    first, anew = begin or Model(given.machine), begin is None and library is LIBRARY
    model, share = first, 1.0 / (len(parts) + 1)
    for n, part in enumerate(parts):
        on = _from(progress, n * share, share)
        found = _fitted_from(part, model, model is not first, given, on, library)
        one = by_one(part, given) if anew and model is first and _leaves_much(found) else None
        if one is not None:
            other = _fitted_from(part, one.model, True, given, on, library)
            if _energy_left(part, other.smooth, other.model, found.own) < _left(found):  # by the same noise
                found = other
        model = first if _left(found) > _OF_NOISE * _HOPELESS else found.model
    return _fitted_from(whole, model, model is not first, given, _from(progress, 1.0 - share, share), library)


def _left(found: Fitted) -> float:
    return found.own.regression.left


def _leaves_much(found: Fitted) -> bool:
    """More than noise by far, be it an encoder's rounding besides."""
    rounded = hidden_energy(found.rows) / (found.noise[0] * found.noise[1] * len(found.rows))
    return _left(found) > _OF_NOISE + max(_MUCH, rounded)


def by_one(part: Rows, given: Given) -> Fitted | None:
    """The fit by the one effect that leaves least of few rows at its best, where it is more than nothing.

    Lines at the nominal machine tell which are tried: what explains most there need not at its best. Of a cause whose
    forms do not pass into one another, all are: their lines say little of where each leads.
    """
    bare = of_model(part, Model(given.machine), given, LIBRARY)
    search, left = bare.search, bare.own.fit(()).chi2
    gains = {one: left - search.fit((one,)).chi2 for one in search.candidates()}
    worth = {one for one, gain in gains.items() if gain > _WORTH_TRYING * max(gains.values())}
    formed = {name for name, _ in worth if any(parameter.discrete for parameter in BY_NAME[name].parameters)}
    worth |= {one for one in gains if one[0] in formed}
    best = min((exchanged(bare, (), one, given) for one in sorted(worth)), key=_left, default=bare)
    return best if best.choice else None


def _from(progress: Progress, done: float, share: float) -> Progress:
    """Progress of a part that is a share of the whole, where others are done."""
    return lambda there, phase: progress(done + share * there, phase)


def at_nominal(rows: Rows, given: Given) -> Search:
    """Around the nominal machine, of no effect, by currents as they are; of a long recording, by blocks of it."""
    part = thinned(rows, *PARTS[-1])
    return _search(part, raw(part), Model(given.machine), given, ())


def of_model(rows: Rows, begin: Model, given: Given, library: Sequence[Effect] = ()) -> Fitted:
    """The best model of a model's own effects, needed or not; its search knows these alone, without a library."""
    model, clean, _ = polished(rows, raw(rows), begin, given)
    own = _search(rows, clean, model, given, _own(model))
    return Fitted(rows, model, clean, own, (lambda: _search(rows, clean, model, given, library)) if library else None)


def _fitted_from(
    rows: Rows, model: Model, nearly: bool, given: Given, progress: Progress, library: Sequence[Effect]
) -> Fitted:  # fmt: skip
    """From a model on; `nearly`: blocks of the rows have found it.

    Where the voltage answers its row's currents, any resistance explains what is noise of both: effects show only once
    the machine has taken it off.
    """
    clean, settled = raw(rows), False
    if nearly or given.answered:
        model, clean, settled = polished(rows, clean, model, given, _POLISHED_AGAIN if nearly else POLISHED)
    attempt, barred = 1, frozenset[str]()
    while True:
        model, clean, last = _rounds(rows, clean, model, settled, nearly, given, progress, library, barred)
        needed = last.without_needless(_present(model))
        if len(needed) == len(model.effects):
            break
        if attempt > 1:  # it came back to what is not needed
            barred |= frozenset(model.effects) - {name for name, _ in needed}
        model, clean, last = _pruned(rows, clean, model, needed, given, roughly_polished, library)
        last.barred |= barred
        if attempt == _ATTEMPTS or set(last.best(_present(model))) == set(_present(model)):
            break
        attempt += 1  # others show without what led astray
    if model.steep:
        model, clean, last = _pruned(rows, clean, model, _present(model), given, _polished, library)
    return Fitted(rows, model, clean, last)


def _pruned(
    rows: Rows, clean: Clean, model: Model, needed: Choice, given: Given, polish: _Polish,
    library: Sequence[Effect] | None = None,
) -> tuple[Model, Clean, Search]:  # fmt: skip
    """The best model with only the effects that are needed, and of these only what brings its due then; and a search
    around it, of no other effects without a library.
    """
    while True:
        kept = replace(model, effects={name: model.effects[name] for name, _ in needed})
        model, clean, _ = polish(rows, clean, kept, given)
        last = _search(rows, clean, model, given, library or _own(model))
        needed = last.without_needless(_present(model))
        if len(needed) == len(model.effects):
            return model, clean, last


def _rounds(
    rows: Rows, clean: Clean, model: Model, settled: bool, nearly: bool, given: Given,
    progress: Progress, library: Sequence[Effect], barred: Set[str],
) -> tuple[Model, Clean, Search]:  # fmt: skip
    """Effects are added, taken away and exchanged until nothing changes; those that are `barred` are not added, nor one
    whose promise equations have not borne out near this model.
    """
    times = _POLISHED_AGAIN if nearly else POLISHED
    seen, kept = dict[Set[str], float](), True  # sets, and what they left
    in_vain = dict[str, tuple[float, Set[str]]]()  # what was left where they promised, and beside which effects
    for n in range(ROUNDS):
        search = _search(rows, clean, model, given, library)
        search.barred |= barred | {
            name for name, (left, beside) in in_vain.items()
            if search.regression.left > _NEAR_IT * left and beside == set(model.effects)
        }  # fmt: skip
        before = frozenset(model.effects)
        if kept and search.regression.left > _NO_LESS * seen.get(before, math.inf):
            return model, clean, search
        seen[before] = search.regression.left
        choice = search.best(_present(model))
        if (settled or nearly) and set(choice) == set(_present(model)):
            placed = _placed(rows, clean, search, choice, times, given, library)
            if placed is None:
                return model, clean, search
            model, clean, settled = placed
            continue
        towards, kept = moved(search, choice), True
        better = _no_worse(rows, clean, model, towards, search)
        if better is not None:
            model = better
        elif any(seed >= 0 for _, seed in choice):  # beyond the bend it may be better still
            beyond, cleaner, _ = polished(rows, clean, towards, given, _BEYOND_LINES * times)
            if _energy_left(rows, cleaner.rows, beyond, search) < search.regression.left:
                model, clean = beyond, cleaner
            else:
                at = search.regression.left, set(model.effects)
                in_vain |= {name: at for name, seed in choice if seed >= 0}
                kept = False
        model, clean, settled = roughly_polished(rows, clean, model, given, times)
        progress((n + 1) / ROUNDS, f"fitting, effects so far: {len(model.effects) or 'none'}")
        if kept and (n > 0 or nearly) and frozenset(model.effects) == before:
            break
    return model, clean, _search(rows, clean, model, given, library)


def _placed(
    rows: Rows, clean: Clean, search: Search, choice: Choice, times: int, given: Given, library: Sequence[Effect]
) -> tuple[Model, Clean, bool] | None:
    """A set's model with one effect more that brings its due at its moment, where there is such an effect."""
    one = search.to_place(choice)
    if one is None:
        return None
    with_it = moved(search, (*choice, one))
    model, clean, settled = polished(rows, clean, with_it, given, times)
    there, placed = _search(rows, clean, model, given, library), (one[0], -1)
    present, due = _present(model), there.without_needless(_present(model))
    enough = placed in due and there.explained(present, placed) > PLACED * search.unexplained(choice)
    return (model, clean, settled) if enough else None


def _present(model: Model) -> Choice:
    return tuple((name, -1) for name in model.effects)


def _own(model: Model) -> tuple[Effect, ...]:
    return tuple(BY_NAME[name] for name in model.effects)


def _search(
    rows: Rows, clean: Clean, model: Model, given: Given, library: Sequence[Effect] = LIBRARY,
    slopes: VoltageSlopes | None = None, response: Response | None = None,
) -> Search:  # fmt: skip
    """Of all effects, or, to polish them, of the model's alone."""
    follow = None if library else clean.follow
    return Search(regression(rows, clean.rows, model, given, clean.noise, library, follow, slopes, response))


def without(found: Fitted, dropped: Sequence[str], given: Given) -> Fitted:
    """The best model without some of its effects, and without what does not bring its due then."""
    kept = {name: sizes for name, sizes in found.model.effects.items() if name not in dropped}
    return _needed_of(found, replace(found.model, effects=kept), given, polished)


def exchanged(found: Fitted, dropped: Sequence[str], one: tuple[str, int], given: Given) -> Fitted:
    """The best model with another effect in the place of some, and without what does not bring its due then."""
    choice = (*(each for each in found.choice if each[0] not in dropped), one)
    return _needed_of(found, moved(found.search, choice), given, polished)


def with_more(found: Fitted, names: Sequence[str], given: Given) -> Fitted:
    """A model with effects of no shape besides, and without what does not bring its due then; roughly the best."""
    none = {name: (0.0,) * len(BY_NAME[name].parameters) for name in names}
    begin = replace(found.model, effects={**found.model.effects, **none})
    rows, clean = found.rows, Clean(found.smooth, found.z, found.noise)
    begin, *_ = roughly_polished(rows, clean, begin, given, 2 * POLISHED)
    return _needed_of(found, begin, given, roughly_polished)


def closely(found: Fitted, given: Given) -> Fitted:
    """The best model of a rough one's effects, and without what does not bring its due then."""
    return _needed_of(found, found.model, given, polished) if found.model.steep else found


def _needed_of(found: Fitted, model: Model, given: Given, polish: _Polish) -> Fitted:
    """The best model of those effects of a model that bring their due."""
    rows, clean = found.rows, Clean(found.smooth, found.z, found.noise)
    model, clean, own = _pruned(rows, clean, model, _present(model), given, polish)
    return Fitted(rows, model, clean, own, lambda: _search(rows, clean, model, given))


def searched(rows: Rows, model: Model, given: Given, name: str) -> tuple[Search, Vector, Noise]:
    """Around a model that is true of the rows: one more effect beside its own; what is left (Vs, whitened), its noise.
    """
    clean, following = raw(rows), Following(rows)
    for _ in range(2):  # by currents of which the model has taken noise off
        clean = cleaned(rows, clean.rows, model, following)
    assert clean.noise is not None
    library = tuple(BY_NAME[other] for other in {**model.effects, name: ()})
    return _search(rows, clean, model, given, library), clean.z, clean.noise


def polished(rows: Rows, clean: Clean, model: Model, given: Given, times: int = POLISHED) -> tuple[Model, Clean, bool]:
    """A set's best model, rows cleaned by it, and whether it moves no more."""
    part = _few(rows, model)
    if part is not rows:
        model, *_ = _polished(part, raw(part), model, given, _FIND * times)
    return _polished(rows, clean, model, given, times)


def roughly_polished(
    rows: Rows, clean: Clean, model: Model, given: Given, times: int = POLISHED
) -> tuple[Model, Clean, bool]:
    """A set's best model by blocks of the rows, where it costs much to follow: good enough to seek other effects by."""
    part = _few(rows, model)
    if part is rows:
        return _polished(rows, clean, model, given, times)
    model, _, settled = _polished(part, raw(part), model, given, _FIND * times)
    model = with_step_in_place(rows, clean.rows, model)  # it may lie between the blocks
    return model, cleaned(rows, clean.rows, model, Following(rows)), settled


def _few(rows: Rows, model: Model) -> Rows:
    """Rows that find what costs much to follow."""
    return thinned(rows, *_FINDING_BLOCKS) if model.steep else rows


def _polished(rows: Rows, clean: Clean, model: Model, given: Given, times: int = POLISHED) -> tuple[Model, Clean, bool]:
    """A set's best model, by rows as they are, from one that is near it."""
    settled, slopes, response, following, before = False, VoltageSlopes(), None, clean.following, math.inf
    if following is None or not following.knows(model):
        following = Following(rows)
    for n in range(times):
        model = with_step_in_place(rows, clean.rows, model)
        clean = cleaned(rows, clean.rows, model, following)
        if n % _LASTS == 0:
            slopes.clear()
            response = None if clean.response is None else clean.response(model)
        own = _search(rows, clean, model, given, (), slopes, response)
        if own.regression.left > max(before, _OF_NOISE * _HOPELESS) and not _bends_model(model):  # of both axes
            return model, clean, settled
        before = own.regression.left
        towards = moved(own, _present(model))
        better = _no_worse(rows, clean, model, towards, own)
        if better is None and _bends_model(model) and not _close(own, model, towards, _SAME_FIT):
            better = _by_bends(rows, clean, model, towards, own, given)
        if better is None:
            return model, clean, settled
        settled = _close(own, model, better, _SAME_FIT if clean.follow is None else _NEARLY_THERE)
        if settled and clean.follow is None:
            return model, clean, settled
        model = better
        if settled:
            break
    return model, cleaned(rows, clean.rows, model, following), settled


def _close(search: Search, one: Model, other: Model, most: float) -> bool:
    """No size has moved by more than so many of its standard errors, or a thousandth of what is typical."""
    choice = _present(one)
    fit, covariance = search.fit(choice), search.free_covariance(choice)
    for n, place in enumerate(fit.places):
        column = search.columns[place]
        if column.owner == "machine":
            if column.place > 3:
                continue
            change = getattr(other.machine, column.parameter) - getattr(one.machine, column.parameter)
        else:
            change = other.effects[column.owner][column.place] - one.effects[column.owner][column.place]
        least = (1e-2 if column.shape else 1e-4) * column.prior[1]
        if abs(change) > max(most * math.sqrt(max(float(covariance[n, n]), 0.0)), least):
            return False
    return True


def _no_worse(rows: Rows, clean: Clean, now: Model, towards: Model, search: Search) -> Model | None:
    """The model, or one on the way to it, that leaves no more of the voltage than there was: equations are not lines.

    None where there is none.
    """
    model, best = towards, (math.inf, towards)
    enough = search.regression.left - (_OF_HALF * search.promised(_present(towards)) if _bends_model(towards) else 0.0)
    for _ in range(_FIT_HALVINGS):
        left = _energy_left_by(rows, clean, model, search)
        if left >= best[0]:
            break
        best = left, model
        if left <= enough:
            break
        model = _between(now, model)
    return best[1] if best[0] <= 1.02 * search.regression.left + 0.02 else None


def _by_bends(rows: Rows, clean: Clean, now: Model, towards: Model, search: Search, given: Given) -> Model | None:
    """A model with what bends on the way to another, and all else solved there, which leaves less: they trade."""
    held = [name for name in now.effects if BY_NAME[name].bends]
    for _ in range(_FIT_HALVINGS):
        towards = _between(now, towards)
        effects: dict[str, Sizes] = {}
        for name, sizes in now.effects.items():
            both = zip(BY_NAME[name].parameters, sizes, towards.effects[name], strict=True)
            effects[name] = tuple(y if p.shape or name in held else x for p, x, y in both)
        there = replace(now, effects=effects)
        response = None if clean.response is None else clean.response(there)
        own = _search(rows, clean, there, given, (), response=response)
        model = moved(own, _present(there), shaped=True, held=held)
        if _energy_left_by(rows, clean, model, search) < search.regression.left:
            return model
    return None


def _bends_model(model: Model) -> bool:
    """A shape moves by small steps, or a size multiplies others, for which equations are no lines."""
    effects = [BY_NAME[name] for name in model.effects]
    return any(effect.bends or effect.moves for effect in effects)


def _energy_left(rows: Rows, smooth: Rows, model: Model, search: Search) -> float:
    """Energy of the whitened residual over a search's noise, a period.

    As the error of a current, not of its flux linkage, which would be the smaller the smaller the inductances are.
    """
    there, clean = rows.with_machine(model.machine), smooth.with_machine(model.machine)
    noise, before = search.regression.noise, search.regression.model.machine
    z = flux_errors(residual(there, clean, model), there, model, before)
    z = as_in(model.machine, before, z)
    d, q = z.real / noise[0], z.imag / noise[1]
    return float(np.mean(d * d) + np.mean(q * q))


def _energy_left_by(rows: Rows, clean: Clean, model: Model, search: Search) -> float:
    """Energy of the residual, a period, with currents that follow the model, where they do."""
    return _energy_left(rows, clean.rows if clean.follow is None else clean.follow(model)[0], model, search)


def _between(one: Model, other: Model) -> Model:
    """Half way; shapes and effects of the other."""
    effects: dict[str, tuple[float, ...]] = {}
    for name, sizes in other.effects.items():
        parameters = BY_NAME[name].parameters
        before = one.effects.get(name, BY_NAME[name].none_at(sizes))
        effects[name] = tuple(
            y if p.discrete else 0.5 * (x + y) for p, x, y in zip(parameters, before, sizes, strict=True)
        )
    a, b = one.machine, other.machine
    machine = Machine(
        0.5 * (a.R_s + b.R_s), 0.5 * (a.L_d + b.L_d), 0.5 * (a.L_q + b.L_q), 0.5 * (a.psi_f + b.psi_f), a.n_p, a.i_rated
    )
    bend = other.bend
    if bend is not None and one.bend is not None:
        bend = replace(bend, size=0.5 * (one.bend.size + bend.size))
    return Model(machine, effects, 0.5 * (one.angle + other.angle), 0.5 * (one.zero + other.zero), bend)


def moved(search: Search, choice: Choice, *, shaped: bool = False, held: Collection[str] = ()) -> Model:
    """The model that a set's coefficients make; one that is `shaped` keeps its shapes, and all of effects `held`."""
    fit = search.fit_of_sizes(choice, held) if shaped else search.fit(choice)
    value = dict(zip(fit.places, fit.value.tolist(), strict=True))
    now, rows = search.regression.model, search.regression.smooth
    found = {(c.owner, c.seed, c.place): value[j] for j, c in enumerate(search.columns) if j in value}
    effects: dict[str, tuple[float, ...]] = {}
    for name, seed in choice:
        effect = BY_NAME[name]
        shapes = iter(effect.shapes(rows)[seed] if seed >= 0 else ())
        sizes: list[float] = []
        for k, parameter in enumerate(effect.parameters):
            if not parameter.shape:
                sizes.append(found[name, seed, k])
            elif seed >= 0:
                sizes.append(next(shapes))
            else:
                sizes.append(now.effects[name][k] + found.get((name, seed, k), 0.0))
        effects[name] = tuple(sizes)
    machine, bend = now.machine, now.bend
    if bend is not None:
        bend = replace(bend, size=np.array([found["machine", -1, BENDS + k] for k in range(len(bend.size))]))
    of = {parameter: found["machine", -1, k] for k, parameter in enumerate(PARAMETERS)}
    return Model(
        Machine(**of, n_p=machine.n_p, i_rated=machine.i_rated), effects,
        found["machine", -1, 4], found.get(("machine", -1, 5), 0.0), bend,
    )  # fmt: skip
