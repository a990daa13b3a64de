"""Surrogates: a recording as it would be if an effect were not there.

The model without the effect is simulated from the recorded voltages, noise is laid over its currents, the converters'
steps and the encoder's counts round it as they round the recording, and the same regression looks for the effect. What
it finds, of whichever sign, is what noise, rounding and the machine's parameters lend a name here: a parametric
bootstrap (B. Efron, R. J. Tibshirani, An Introduction to the Bootstrap, 1993, chapter 6), which takes the place of
bounds where these leave a doubt. Half of the surrogates keep the recording's own counts, on which the drive has acted:
their rounding goes with the currents as it does there. Of what the library does not hold they know nothing: that has to
stay as small as in the surrogates, or be unlike the effect by far.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from estimator.arrays import Array, Vector
from estimator.diagnosis.angle.angle_rounding import counts_and_numbers, less_angle, unrounded
from estimator.diagnosis.likelihood.evidence import Choice
from estimator.diagnosis.likelihood.given import Given
from estimator.diagnosis.likelihood.noise import white_of
from estimator.diagnosis.search.fitting import Fitted, searched, without
from estimator.diagnosis.search.remainder import above_noise
from estimator.physics.rows import Rows
from estimator.physics.vectors import AXES
from estimator.twin.currents import free_run
from estimator.twin.model import Model, zero_residual

_TIMES: Final = 4  # surrogates
_LEAST_OVER_MEAN: Final = 20.0  # times what they lend an effect on the mean, that it has to explain,
_ABOVE_LENT: Final = 30.0  # and what is in doubt,
_FAR_ABOVE: Final = 100.0  # and what is less than a part of what they leave,
_WITH_ANY_REST: Final = 300.0  # and an even effect where more is left than in them
_NO_MORE: Final = 3.0  # times the same, which is nothing that speaks for it
_LEAST_LENT: Final = 2.0  # chi square that they lend it at least
_DOUBT_SHARE: Final = 0.05  # of what they leave, that part
_EVEN_SCATTER: Final = 5.0  # scatter of an even effect, at most
_UNEVEN: Final = 2.0  # times as uneven as there, at most, where it is not even
_CHANCE_SIGMAS: Final = 2.0  # standard deviations, by which what is left may exceed theirs
_CONVERTER_BINS: Final = 1 << 18  # of currents, to see a converter's steps
_FEWEST_STEPS: Final = 50  # that currents go over, for these to be seen
_GRID_SHARE: Final = 0.5  # share of the values that lie on the steps' grid, where there is one
_UNROUNDED: Final = 0.05  # steps: noise that is there at least before a converter


class _Lent(NamedTuple):
    """What a surrogate shows of an effect that is not there."""

    gained: float  # chi square
    scatter: float
    excess: float  # chi square of what is left, above that of white noise


class Surrogates:
    """A fit beside surrogates without one of its effects each."""

    def __init__(self, found: Fitted, given: Given) -> None:
        self._found, self._given = found, given
        self._kept: dict[tuple[tuple[str, int], Choice], list[_Lent]] = {}

    def stands_out(self, one: tuple[str, int], choice: Choice, doubted: bool) -> bool:
        """An effect of a set explains far more than surrogates without it lend its name, and as evenly as that.

        Where it is `doubted`, by how much more depends on what is left beside it, in the surrogates and beyond.
        """
        search, lent = self._found.search, self._lent_to(one, choice)
        gained, scatter = search.explained(choice, one), search.scatter(search.fit(choice), one)
        above = gained / _on_the_mean(lent)
        if above < _LEAST_OVER_MEAN or scatter > max(_EVEN_SCATTER, _UNEVEN * max(each.scatter for each in lent)):
            return False
        if not doubted:
            return True
        left = [each.excess for each in lent]
        variance = float(np.var(left, ddof=1)) + 4.0 * len(search.regression.rows)
        chance = _CHANCE_SIGMAS * math.sqrt(variance * (1.0 + 1.0 / _TIMES))
        if search.unexplained(choice) - float(np.mean(left)) - chance >= gained:
            return scatter < _EVEN_SCATTER and above >= _WITH_ANY_REST
        return above >= (_ABOVE_LENT if gained >= _DOUBT_SHARE * float(np.mean(left)) else _FAR_ABOVE)

    def show_as_much(self, one: tuple[str, int], choice: Choice) -> bool:
        """Surrogates without an effect lend its name about as much as it explains in a set: nothing speaks for it."""
        return self._found.search.explained(choice, one) < _NO_MORE * _on_the_mean(self._lent_to(one, choice))

    def _lent_to(self, one: tuple[str, int], choice: Choice) -> list[_Lent]:
        if (one, choice) not in self._kept:
            kept = [name for name, _ in choice if name != one[0]]
            dropped = [name for name, _ in self._found.choice if name not in kept]
            bare = without(self._found, dropped, self._given)
            rows = bare.rows
            i, step = free_run(rows, bare.model, len(rows) + 1), converter_step(rows)
            there = (
                _surrogate(rows, bare, i, step, np.random.default_rng(k), own_counts=k % 2 == 0) for k in range(_TIMES)
            )
            self._kept[one, choice] = [_lent(each, bare.model, one[0], self._given) for each in there]
        return self._kept[one, choice]


def _on_the_mean(lent: Sequence[_Lent]) -> float:
    """Chi square that surrogates lend an effect."""
    return max(float(np.mean([each.gained for each in lent])), _LEAST_LENT)


def converter_step(rows: Rows) -> float:
    """The step (A) on whose multiples measured phase currents lie; 0 where no grid is seen."""
    x = np.concatenate(_phases(rows.i_s, rows.zero))
    low, high = float(np.min(x)), float(np.max(x))
    if high <= low:
        return 0.0
    counts, _ = np.histogram(x, _CONVERTER_BINS, (low, high))
    on_grid = np.abs(np.fft.rfft(counts))[_FEWEST_STEPS:] / len(x)  # by steps over the whole range
    steps = int(np.argmax(on_grid))
    return (high - low) / (_FEWEST_STEPS + steps) if on_grid[steps] > _GRID_SHARE else 0.0


def _phases(i_s: Vector, zero: Array | None) -> list[Array]:
    return [(i_s * axis.conjugate()).real + (0.0 if zero is None else zero) for axis in AXES]


def _surrogate(
    rows: Rows, bare: Fitted, i: Vector, step: float, chance: np.random.Generator, *, own_counts: bool
) -> Rows:
    """The rows with simulated currents (A), measured anew. `step`: of the converters, A. Counts of the angle are those
    of the recording, or begin elsewhere.
    """
    off = (rows.i - i)[1:]
    noise = white_of(off.real, rows), white_of(off.imag, rows)
    left = zero_residual(rows, bare.smooth, bare.model)
    zero = None if rows.zero is None or left is None else rows.zero - left
    n = len(i)
    if step > 0.0:
        variance = 0.75 * (noise[0] ** 2 + noise[1] ** 2)  # of a phase: 3/2 of an axis of the vector
        sigma = math.sqrt(max(variance - step**2 / 12.0, (_UNROUNDED * step) ** 2))
        phases = [x + sigma * chance.standard_normal(n) for x in _phases(i * rows.rotor, zero)]
        a, b, c = (step * np.round(x / step) for x in phases)
        i_s: Vector = (2.0 / 3.0) * (a * AXES[0] + b * AXES[1] + c * AXES[2])
        i, zero = i_s * rows.rotor.conj(), None if zero is None else (a + b + c) / 3.0
    else:
        i = i + noise[0] * chance.standard_normal(n) + 1j * noise[1] * chance.standard_normal(n)
        zero = None if zero is None else zero + bare.noise[2] * chance.standard_normal(n)
    count = rows.angle_step
    if count == 0.0:
        return rows.with_currents(i).changed(zero=zero)
    theta_e = rows.theta_e
    for one in counts_and_numbers(rows, count):
        grid = 0.0 if own_counts else chance.uniform(0.0, one)
        theta_e = one * np.round((theta_e + grid) / one) - grid if one > 0.0 else theta_e
    return unrounded(less_angle(rows.with_currents(i).changed(zero=zero), rows.theta_e - theta_e), count)


def _lent(rows: Rows, model: Model, name: str, given: Given) -> _Lent:
    """What of an effect is found in rows where it is not, beside the model that made them."""
    search, z, noise = searched(rows, model, given, name)
    choice = tuple((other, -1) for other in model.effects)

    def gained(one: tuple[str, int]) -> float:
        return search.unbounded(choice).chi2 - search.unbounded((*choice, one)).chi2

    best = max((one for one in search.candidates() if one[0] == name), key=gained)
    return _Lent(gained(best), search.scatter(search.fit((*choice, best)), best), above_noise(z, noise, rows))
