"""Finding: one effect of a fit, as users are told it - how sure, how large, where, and against which rivals.

Knows nothing of how the set of effects was found.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from estimator.arrays import Array, Vector
from estimator.diagnosis.likelihood.noise import filter_of, whitened
from estimator.diagnosis.search.fitting import Fitted
from estimator.diagnosis.trust.rivals import RivalFit
from estimator.diagnosis.verdict import Finding, Quantity, Rival, odds_of
from estimator.diagnosis.where.place import place_of
from estimator.machine import PARAMETERS
from estimator.physics.effect import Effect
from estimator.physics.library import BY_NAME
from estimator.physics.rows import Rows
from estimator.twin.model import residual

_SIZE_STEP: Final = 1e-4  # of a size, for differences


def finding_of(rows: Rows, found: Fitted, one: tuple[str, int], others: Sequence[RivalFit], left: Vector) -> Finding:
    search, choice, model = found.search, found.choice, found.model
    rest = tuple(c for c in choice if c != one)
    effect = BY_NAME[one[0]]
    smooth = found.smooth.with_machine(model.machine)
    others_only = replace(model, effects={name: p for name, p in model.effects.items() if name != one[0]})
    signal = whitened(residual(rows, smooth, others_only) - left, filter_of(rows, model.machine))
    full, other = search.fit(choice), search.fit(rest)
    absorbed: dict[str, float] = {}
    for k, name in enumerate(PARAMETERS):
        moved_by = float(other.value[k] - full.value[k])
        if abs(moved_by) > 2.0 * math.sqrt(max(float(full.covariance[k, k]), 0.0)):
            absorbed[name] = moved_by
    against_next = min([doubt.log_odds for doubt in others] + [search.gain(rest, one)])
    return Finding(
        effect.name, told_sizes(effect, smooth, found, one), place_of(rows, signal, (0.0, 0.0)), odds_of(against_next),
        tuple(Rival(doubt.effect, odds_of(doubt.log_odds)) for doubt in others[:5]), absorbed,
        tuple(model.effects[effect.name]),
    )  # fmt: skip


def told_sizes(
    effect: Effect, rows: Rows, found: Fitted, one: tuple[str, int], covariance: Array | None = None
) -> dict[str, Quantity]:
    """An effect's sizes as users are told them, with standard errors; `covariance`: a part of them alone."""
    search, sizes = found.search, found.model.effects[effect.name]
    fit = search.fit(found.choice)
    at = {search.columns[j].place: n for n, j in enumerate(fit.places) if search.columns[j].owner == effect.name}
    silent = {n for n, j in enumerate(fit.places) if search.gram[j, j] <= 0.0}  # nothing here depends on them
    if covariance is None:
        covariance = search.scattered(fit, search.free_covariance(found.choice), one)
        covariance = covariance + search.form_covariance(found.choice) + search.untold_covariance(found.choice)

    def values(p: Sequence[float], rows: Rows = rows) -> dict[str, tuple[float, str]]:
        if effect.told is not None:
            return effect.told(rows, p)
        return {parameter.name: (p[k], parameter.unit) for k, parameter in enumerate(effect.parameters)}

    here = values(sizes)
    slopes = {name: np.zeros(len(fit.places)) for name in here}
    for k, place in at.items():
        h = _SIZE_STEP * max(abs(sizes[k]), 1e-3 * effect.parameters[k].typical(rows))
        there = values([size + h * (n == k) for n, size in enumerate(sizes)])
        for name in here:
            slopes[name][place] = (there[name][0] - here[name][0]) / h
    if effect.in_proportion_to:
        k = PARAMETERS.index(effect.in_proportion_to)
        size = getattr(rows.machine, effect.in_proportion_to)
        other = rows.with_machine(replace(rows.machine, **{effect.in_proportion_to: size * (1.0 + _SIZE_STEP)}))
        there = values(sizes, other)
        for name in here:
            slopes[name][fit.places.index(k)] = (there[name][0] - here[name][0]) / (_SIZE_STEP * size)
    told: dict[str, Quantity] = {}
    for name, (value, unit) in here.items():
        variance = float(slopes[name] @ covariance @ slopes[name])
        depends_on = set(np.flatnonzero(slopes[name]).tolist())
        if depends_on and depends_on <= silent:
            told[name] = Quantity(None, None, unit)
            continue
        told[name] = Quantity(float(value), math.sqrt(variance) if variance > 0.0 else None, unit)
    return told
