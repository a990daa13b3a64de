"""A diagnosis's flux map: whether it takes the place of the library's saturations, and what these are by it.

Knows nothing of verdicts.
"""

import math
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from estimator.diagnosis.likelihood.columns import as_parameters
from estimator.diagnosis.likelihood.given import Given
from estimator.diagnosis.likelihood.identifiability import LEAST_EVIDENT_SHARE
from estimator.diagnosis.likelihood.noise import filter_of, flux_errors, noise_of, whitened
from estimator.diagnosis.likelihood.thinning import PARTS, thinned
from estimator.diagnosis.search.fitting import Fitted, fitted
from estimator.diagnosis.search.flux_map_fit import FluxMap, map_begun, told_map
from estimator.diagnosis.search.remainder import above_noise, excess_of
from estimator.diagnosis.verdict import Finding, Quantity, odds_of
from estimator.diagnosis.where.place import place_of
from estimator.machine import PARAMETERS
from estimator.physics.rows import Rows
from estimator.twin.model import Model, residual

_SPEEDS_APART: Final = 0.2  # of the fastest, by which speeds differ where a map is told
_PROMISING: Final = 0.8  # of what is left unexplained, that a first fit of a flux map leaves at most


def fitted_by_map(rows: Rows, given: Given, found: Fitted, progress: Callable[[float, str], None]) -> Fitted | None:
    """A free flux map in the place of the library's saturations, with the effects found beside it.

    None where it does not explain most of what the library leaves, or speed hardly changes: then all that depends on
    currents looks like a map.
    """
    slow, fast = np.quantile(np.abs(rows.omega_e[rows.joined]), [0.02, 0.98]).tolist()
    if fast - slow < _SPEEDS_APART * fast:
        return None
    part, starts = thinned(rows, *PARTS[-1]), list[tuple[float, Model]]()
    for model in (Model(given.machine), found.model):
        if (begin := map_begun(part, model)) is not None:
            z = flux_errors(residual(part, part, begin), part, begin)
            starts.append((above_noise(z, noise_of(z, None, part), part), begin))
    least, begin = min(starts, key=lambda start: start[0], default=(math.inf, None))
    left = excess_of(found)
    if least * len(rows) > _PROMISING * left * len(part):
        return None
    by_map = fitted(rows, given, lambda share, _: progress(0.72 + 0.02 * share, "fitting a flux map"), begin=begin)
    return by_map if left > LEAST_EVIDENT_SHARE * excess_of(by_map) and has_map(by_map) else None


def has_map(found: Fitted) -> bool:
    """A fit's map is none of straight lines."""
    return any(departure.told for departure in told_map(found.search, found.choice).departures().values())


def saturations(rows: Rows, found: Fitted, flux_map: FluxMap | None, after: Mapping[str, Quantity]) -> list[Finding]:
    """The saturations that a flux map shows, by how far each takes it from straight lines; none without a map."""
    shown: list[Finding] = []
    if flux_map is None:
        return shown
    by = filter_of(rows, found.model.machine)
    for name, departure in flux_map.departures().items():
        if departure.told:
            v = rows.balance(flux_map.part(name, rows.i))
            where = place_of(rows, whitened(v, by), (0.0, 0.0))
            log_odds = 0.5 * departure.sure**2
            looks = as_parameters(rows, v)
            absorbed = {p: looks[p] for p in PARAMETERS if abs(looks[p]) > 2.0 * (after[p].std or math.inf)}
            shown.append(Finding(name, flux_map.sizes(name), where, odds_of(log_odds), (), absorbed))
    return shown
