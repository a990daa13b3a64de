"""Cleaning: rows with less noise of their currents, by a model that explains them.

What is left of the voltage tells the currents' noise, too: less of it makes columns that are not correlated with it.
Knows nothing of sets and searches.
"""

from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Final, NamedTuple

import numpy as np

from estimator.arrays import Vector
from estimator.diagnosis.likelihood.columns import Follow
from estimator.diagnosis.likelihood.noise import Noise, flux_errors, noise_of
from estimator.physics.effect import Branch
from estimator.physics.library import of_kind
from estimator.physics.rows import Rows
from estimator.twin.currents import followed_currents, response_of
from estimator.twin.model import Model, residual, samples_in_mean, zero_residual
from estimator.twin.response import Response

_FOLLOWED_SHARES: Final = (0.02, 0.1, 0.4)  # a period, of what is between measured currents and those of the model
_NOISY: Final = 1.5  # times the noise: what is between them is no more
_AVERAGED: Final = 25  # periods to each side; slower than that is not noise


class Clean(NamedTuple):
    """Rows with less noise of their currents, by a model."""

    rows: Rows
    z: Vector  # Vs, whitened residual
    noise: Noise | None  # None where no model has told it yet
    follow: Follow | None = None  # rows and lost voltage by another model, where currents follow it
    response: Callable[[Model], Response] | None = None  # and what the lost voltage answers
    following: "Following | None" = None  # what it all comes from, where currents follow this model


class Following:
    """Rows with currents that follow a model, and the voltage (V) that the bridge loses. See `followed`.

    The last two are kept: a step that was tried is taken, and then looked around from.
    """

    def __init__(self, rows: Rows) -> None:
        self._rows = rows
        self._last: deque[tuple[float, Model, tuple[Rows, Vector]]] = deque(maxlen=2)
        self.farthest = 0  # of `_FOLLOWED_SHARES`, that measured currents have asked for so far

    def knows(self, model: Model) -> bool:
        """Currents that follow it are kept."""
        return any(of == model for _, of, _ in self._last)

    def __call__(self, share: float, model: Model) -> tuple[Rows, Vector]:
        for at, of, found in self._last:
            if (at, of) == (share, model):
                return found
        there = self._rows.with_machine(model.machine)
        near = next((found[0].i for at, _, found in reversed(self._last) if at == share), None)
        i, lost = followed_currents(there, model, share, near)
        found = there.with_currents(i), lost
        self._last.append((share, model, found))
        return found


def raw(rows: Rows) -> Clean:
    """Rows as they are."""
    return Clean(rows, np.zeros(0, np.complex128), None)


def cleaned(rows: Rows, smooth: Rows, model: Model, following: Following) -> Clean:
    """Rows with less noise of their currents than these, and how much of it is white noise.

    Only what changes within a few periods, and no more than white noise makes of it, counts as noise. An effect of the
    currents sees them as they were: from time to time that settles - but where it drops as much of a fast change as the
    inductances do, and currents follow the model at once.
    """
    rows, smooth = rows.with_machine(model.machine), smooth.with_machine(model.machine)
    if model.steep:
        return _cleaned_following(rows, model, following)
    if any(branch.fast_resistance is not None for branch, _ in of_kind(Branch, model.effects)):
        return _cleaned_following(rows, model, following)._replace(follow=None, response=None)
    z = flux_errors(residual(rows, smooth, model), rows, model)
    noise = noise_of(z, zero_residual(rows, smooth, model), rows, samples_in_mean(model))
    w = min(_AVERAGED, max(1, len(z) // 4))
    sums = np.cumsum(np.concatenate((np.zeros(w + 1), z, np.zeros(w))))
    fast = z - (sums[2 * w + 1 :] - sums[: -2 * w - 1]) / (2 * w + 1)
    m = model.machine
    part_d = min(1.0, noise[0] ** 2 / max(float(np.mean(fast.real**2)), 1e-300))
    part_q = min(1.0, noise[1] ** 2 / max(float(np.mean(fast.imag**2)), 1e-300))
    i = rows.i.copy()
    i[1:] += part_d * fast.real / m.L_d + 1j * part_q * fast.imag / m.L_q
    return Clean(rows.with_currents(i), z, noise)


def _cleaned_following(rows: Rows, model: Model, following: Following) -> Clean:
    """Rows cleaned for effects that change more within the noise of currents than these do in a period.

    Currents follow the model, as closely as it is true.
    """
    m = model.machine

    def by(share: float) -> tuple[Clean, Noise]:
        follow = partial(following, share)
        smooth, _ = follow(model)
        z = flux_errors(residual(rows, smooth, model), rows, model)
        noise = noise_of(z, zero_residual(rows, smooth, model), rows, samples_in_mean(model))
        return Clean(smooth, z, noise, follow, partial(_response, rows, smooth, share), following), noise

    while True:
        clean, noise = by(_FOLLOWED_SHARES[following.farthest])
        off = clean.rows.i - rows.i
        d, q = off.real * (m.L_d / noise[0]), off.imag * (m.L_q / noise[1])
        loud = max(float(np.mean(d**2)), float(np.mean(q**2)))
        if loud < _NOISY**2 or following.farthest == len(_FOLLOWED_SHARES) - 1:
            return clean
        following.farthest += 1


def _response(rows: Rows, smooth: Rows, share: float, model: Model) -> Response:
    return response_of(rows.with_machine(model.machine), model, share, smooth)
