"""What a search says of an effect: how sure, how large, where, in whose place; and what is left without a name."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array
from estimator.diagnosis.answer.sentences import title_of
from estimator.diagnosis.likelihood.evidence import ENTRY_LOG_ODDS
from estimator.diagnosis.points.fit import PointsFit
from estimator.diagnosis.points.problem import MACHINE, Key
from estimator.diagnosis.points.search import NEGLIGIBLE, PointsChoice, PointsSearch
from estimator.diagnosis.points.table import Places
from estimator.diagnosis.trust.rivals import POWER_99
from estimator.diagnosis.verdict import Candidate, Finding, Place, Quantity, Rival
from estimator.diagnosis.words import number, percent
from estimator.machine import PARAMETERS, UNITS

MOST_LOG_ODDS: Final = 300.0
HINT: Final = math.log(20.0)  # log-odds that are worth telling, though no name follows
_ENERGY: Final = 0.8  # of a signal, that a region is to hold
_REGION: Final = 0.6  # of the equations, that a region may be at most
_SMALL: Final = 1e-3  # of a typical size, at which an effect is straight


@dataclass(frozen=True, slots=True)
class Coordinate:
    """A quantity of every equation's point, by which places are told."""

    name: str
    unit: str
    value: Array


def point_rivals(search: PointsSearch, choice: PointsChoice, effect: str) -> tuple[Rival, ...]:
    """Other effects in the place of one, likeliest first."""
    rest = tuple(name for name in choice if name != effect)
    full = search.fit(choice)
    found = {other: search.log_odds(full, search.fit((*rest, other)), effect) for other in search.free(choice)}
    likely = sorted(found, key=lambda name: found[name])
    return tuple(Rival(other, math.exp(min(found[other], MOST_LOG_ODDS))) for other in likely)


def finding(
    search: PointsSearch, choice: PointsChoice, effect: str, coordinates: tuple[Coordinate, ...],
    doubted: Mapping[Key, float],
) -> Finding:  # fmt: skip
    """An effect of the set. `doubted`: standard errors besides the fit's."""
    fit, rest = search.fit(choice), tuple(name for name in choice if name != effect)
    without = search.fit(rest)
    others = point_rivals(search, choice, effect)
    alone = math.exp(min(search.log_odds(fit, without, effect), MOST_LOG_ODDS))
    absorbed = {name: without.value(MACHINE, name) - fit.value(MACHINE, name) for name in machine_names(fit)}
    signal = search.signal(fit, effect, fit.places(effect))
    return Finding(
        effect, sizes(fit.doubted(doubted), effect), place(search, signal, coordinates),
        min([alone, *(rival.odds for rival in others)]), others, absorbed,
    )  # fmt: skip


def machine_names(fit: PointsFit) -> list[str]:
    """R_s, L_d, L_q, psi_f as far as they are in a fit."""
    return [size.name for size in fit.sizes if size.owner == MACHINE and size.name in PARAMETERS]


def machine(fit: PointsFit) -> dict[str, Quantity]:
    """The machine's parameters."""
    names = machine_names(fit)
    return {name: Quantity(fit.value(MACHINE, name), fit.std(MACHINE, name), UNITS[name]) for name in names}


def sizes(fit: PointsFit, effect: str) -> dict[str, Quantity]:
    """An effect's sizes as users are told them; a shape that the points do not tell is left out."""
    found: dict[str, Quantity] = {}
    for size in fit.sizes:
        if size.owner != effect:
            continue
        value, std = fit.value(*size.key), fit.std(*size.key)
        if size.name == "conductance" and value > 0.0:
            found["R_c"] = Quantity(1.0 / value, std / value**2, "ohm")
        elif not size.shape or 0.0 < std < 0.5 * abs(value):
            found[size.name] = Quantity(value, std, size.unit)
    return found


def place(search: PointsSearch, signal: Array, coordinates: tuple[Coordinate, ...]) -> Place:
    """The smallest region, by axis and one quantity, that holds most of a signal's energy."""
    energy = (signal * search.noise) ** 2
    total, axis = max(float(energy.sum()), 1e-300), search.problem.axis
    best = Place("in nearly all points", {}, 1.0, 1.0)
    for on, label in _equation_groups(axis, energy, total):
        for c in coordinates:
            for up in (True, False):
                inside = _end(c.value, energy, on, up, _ENERGY * total)
                share = float(np.mean(inside))
                if inside.any() and share < min(best.samples_share, _REGION):
                    best = _region(c, label, inside, float(energy[inside].sum()) / total, share, up)
    return best


def _equation_groups(axis: Places, energy: Array, total: float) -> Iterator[tuple[NDArray[np.bool_], dict[str, str]]]:
    """All equations, and those of an axis that holds most of the energy."""
    yield np.ones(len(axis), np.bool_), {}
    if len(np.unique(axis)) > 1:
        for one in np.unique(axis):
            on = axis == one
            if float(energy[on].sum()) > _ENERGY * total:
                yield on, {"axis": "dq"[int(one)]}


def _end(value: Array, energy: Array, on: NDArray[np.bool_], up: bool, wanted: float) -> NDArray[np.bool_]:
    """The upper or lower end of a quantity that holds so much energy; rows of one value belong together."""
    order = np.flatnonzero(on)[np.argsort(value[on] * (-1.0 if up else 1.0), kind="stable")]
    count = int(np.searchsorted(np.cumsum(energy[order]), wanted))
    if count >= len(order):
        return np.zeros(len(on), np.bool_)
    edge = float(value[order[count]])
    return on & ((value >= edge) if up else (value <= edge))


def _region(
    c: Coordinate, label: dict[str, str], inside: NDArray[np.bool_], energy_share: float, share: float, up: bool
) -> Place:
    low, high = float(c.value[inside].min()), float(c.value[inside].max())
    if low == high:
        reach = f"= {number(low)} {c.unit}"
    else:
        reach = f"from {number(low)} {c.unit} on" if up else f"up to {number(high)} {c.unit}"
    axis = f"in u_{label['axis']} " if label else ""
    sentence = f"{axis}at {c.name} {reach}, where {percent(energy_share)} of its energy is"
    return Place(sentence, {**label, c.name: (low, high)}, energy_share, share)


def point_candidates(search: PointsSearch, choice: PointsChoice) -> tuple[Candidate, ...]:
    """Every effect, by how much it helps."""
    by, gains = math.log(10.0), search.brings(choice)
    gains |= {name: search.gain(choice, name) for name in search.free(choice)}
    found = [Candidate(name, search.gain((), name) / by, gain / by, name in choice) for name, gain in gains.items()]
    return tuple(sorted(found, key=lambda c: (not c.chosen, -c.log10_odds_after)))


def hints(search: PointsSearch, choice: PointsChoice) -> dict[str, float]:
    """Effects that nearly earned their name, with their log-odds, likeliest first."""
    found = {name: search.gain(choice, name) for name in search.free(choice)}
    return {name: gain for name, gain in sorted(found.items(), key=lambda one: -one[1]) if gain > HINT}


def detectable_at_points(search: PointsSearch, choice: PointsChoice) -> dict[str, Quantity]:
    """The smallest first size of every other effect that would have been named at 99 % power."""
    fit, found = search.fit(choice), dict[str, Quantity]()
    known = fit.values
    at = search.problem.predict(known)
    for name in search.free(choice):
        size, *shapes = search.problem.effects[name]
        smallest = math.inf
        for k in range(max((len(s.starts) for s in shapes), default=1)):
            shape = {s.key: s.starts[min(k, len(s.starts) - 1)] for s in shapes}
            there = search.problem.predict({**known, **shape, size.key: _SMALL * size.typical})
            column = (there - at) / search.noise / _SMALL
            column = column - fit.J @ np.linalg.lstsq(fit.J, column, rcond=1e-10)[0]
            energy = float(column @ column)
            if not math.isfinite(energy) or energy < 1e-12:
                continue
            scores = np.bincount(search.problem.group, weights=column * fit.left_out)
            scatter = max(1.0, float(scores @ scores) / (energy * fit.scale**2))
            std = fit.scale * math.sqrt(scatter / energy) * size.typical
            smallest = min(smallest, std * (math.sqrt(2.0 * ENTRY_LOG_ODDS) + POWER_99))
        if smallest < size.high:  # else nothing that could be is seen
            found[name] = Quantity(max(smallest, NEGLIGIBLE * size.typical), None, size.unit)
    return found


def nameless(search: PointsSearch, choice: PointsChoice) -> tuple[float, Array]:
    """Log-odds that smooth functions of the operating point explain what is left, and what they explain, over noise."""
    fit = search.fit(choice)
    columns = search.problem.generic / search.noise[:, None]
    K = np.hstack((fit.J, columns))
    count = int(np.linalg.matrix_rank(K))
    none = np.zeros(len(fit.r))
    if len(fit.r) < 3 * count or not len(columns.T):
        return 0.0, none
    A = np.linalg.pinv(K.T @ K, rcond=1e-12)
    r = fit.r - K @ (A @ (K.T @ fit.r))
    signal = fit.r - r
    left_out = r.copy()
    for group in np.unique(search.problem.group):
        rows = np.flatnonzero(search.problem.group == group)
        H = K[rows] @ A @ K[rows].T
        left_out[rows] = np.linalg.lstsq(np.eye(len(rows)) * (1.0 + 1e-9) - H, r[rows], rcond=None)[0]
    energy = float(signal @ signal)
    if energy <= 0.0:
        return 0.0, none
    missed = float(left_out @ left_out)
    scores = np.bincount(search.problem.group, weights=signal * left_out)
    scatter = max(1.0, float(scores @ scores) / (energy * missed / len(r)))
    return search.predicted(left_out, fit.left_out) / scatter, signal


def odds_text(log_odds: float) -> str:
    """Odds as a sentence has them."""
    return f"{math.exp(min(log_odds, MOST_LOG_ODDS)):.2g} to 1"


def alike(search: PointsSearch, choice: PointsChoice, found: Finding) -> str:
    """Why a finding and its likeliest rival are not told apart."""
    one, rival = found.effect, found.rivals[0]
    return (
        f"{title_of(one)} and {title_of(rival.effect)} explain these points about equally well (odds "
        f"{odds_text(math.log(max(rival.odds, 1e-300)))}; their signals are collinear to "
        f"{abs(collinear(search, choice, one, rival.effect)):.2f} here)"
    )


def collinear(search: PointsSearch, choice: PointsChoice, one: str, other: str) -> float:
    """Correlation of what two effects add to a set, less what the machine and the rest could make of it."""
    rest = tuple(c for c in choice if c not in (one, other))
    fits = {name: search.fit((*rest, name)) for name in (one, other)}
    a, b = (search.signal(fit, name, fit.places(name)) for name, fit in fits.items())
    size = math.sqrt(float(a @ a) * float(b @ b))
    return float(a @ b) / size if size > 0.0 else 0.0
