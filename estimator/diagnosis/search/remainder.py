"""The remainder: whether what a fit leaves matters, what it looks like, and which effects only stand for it.

A stranger to the library that is strong enough makes effects up: a resonance looks like iron loss below its frequency,
a voltage that comes and goes like an imbalance of a machine that cannot be. Knows nothing of verdicts.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from estimator.arrays import Vector
from estimator.diagnosis.angle.angle_rounding import hidden_energy
from estimator.diagnosis.likelihood.given import FAR_OFF, Given
from estimator.diagnosis.likelihood.identifiability import (
    LEAST_EVIDENT_SHARE,
    WEAK,
    held_at_bound,
    least_moved,
    like_machine,
    unconfounded,
)
from estimator.diagnosis.likelihood.noise import Noise, as_in, filter_of, flux_errors, noise_of, whitened
from estimator.diagnosis.likelihood.thinning import PARTS, in_parts, thinned
from estimator.diagnosis.search.fitting import Fitted, by_one, fitted, of_model, without
from estimator.diagnosis.unnamed.describe import RESONANCE, best_resonance, describe, rings
from estimator.diagnosis.verdict import Unexplained
from estimator.machine import PARAMETERS
from estimator.physics import voltage_delay
from estimator.physics.mains import of_mains
from estimator.physics.rows import Rows
from estimator.twin.model import Model, residual, samples_in_mean

_NO_MISMATCH: Final = 0.045  # of the noise's power: no mismatch that matters
_NOISE_CHANCE: Final = 4.0  # standard deviations of what noise leaves above itself
_CERTAIN: Final = 50.0  # chi square, by which one of two models explains more than the other, or at all
_RESOUNDS: Final = 150.0  # chi square of a resonance: of machines without any it was 65, more only by loud rounding
ROUNDED: Final = 0.01  # of the angle's rounding, that one of two models may explain more of by chance
_FAR_ABOVE_FORM: Final = 5.0  # times what something without a name leaves, that likely effects leave in its place
_CLEARLY_OFF: Final = 1.2  # times the tolerance, that a parameter lies beyond for certain
TRADES: Final = 0.01  # of its energy, that an effect has beyond what the machine's parameters look like
_ONCE: Final = 2.0  # changes, of what comes and goes
LIKE_RESONANCE: Final = ("iron_loss", "ac_resistance")


class WithoutSpurious(NamedTuple):
    """A fit without effects that only lean on what is left."""

    found: Fitted
    left: Unexplained | None
    resonance: Unexplained | None = None  # a faint one, which explains as much as losses of the fit


def unexplained_by(rows: Rows, found: Fitted) -> Unexplained | None:
    """What is left, where it is more than the effects' equations may miss, or an effect is not what it looks like."""
    left: Unexplained | None = None
    if leaves_some(found) or rings(*_flux_errors(rows, found), _discrepancy(found)):
        left = _described(rows, found)
    return _faint_resonance(rows, found) if left is None else left


def _faint_resonance(rows: Rows, found: Fitted) -> Unexplained | None:
    """One that is there for certain beside the machine alone or its map, however little of all that is left.

    Not where currents move little beyond their noise: voltages that answer noise look like it.
    """
    if found.choice or least_moved(found.own)[1] < WEAK:
        return None
    at, least = _flux_errors(rows, found), _RESOUNDS + ROUNDED * hidden_of(found) + found.own.discrepancy(())
    told = best_resonance(*at, found.smooth.with_machine(found.model.machine), least)
    return told[0] if told is not None and told[1].gain > least * at[2][0] * at[2][1] else None


def leaves_some(found: Fitted) -> bool:
    """More than noise and what the effects' equations may miss, be it an encoder's rounding."""
    n = int(found.rows.joined.sum())
    return excess_of(found) > found.own.discrepancy(found.choice) + _NO_MISMATCH * 2.0 * n


def _discrepancy(found: Fitted) -> float:
    """Chi square that effects' equations may leave, and the angle's rounding in voltages that are read early."""
    early, noise = found.model.effects.get(voltage_delay.EFFECT.name), found.noise
    foreseen = 0.0 if early is None else voltage_delay.foreseen_energy(found.rows, early)
    return found.own.discrepancy(found.choice) + foreseen / (noise[0] * noise[1])


def restarted_from_fewer(rows: Rows, found: Fitted, given: Given) -> Fitted:
    """The fit, or, where it leaves some and the machine alone, or with one effect, leaves less than with all, one that
    begins there: steps led astray.
    """
    if not found.choice or excess_of(found) < hidden_of(found) + by_chance(rows):
        return found
    fewer = [_bare(found, given)]
    if len(found.choice) > 1:
        strongest = max(found.choice, key=lambda one: found.own.explained(found.choice, one))
        fewer.append(without(found, [name for name, _ in found.choice if name != strongest[0]], given))
        part = in_parts(rows)[0]
        one = by_one(part, given)
        if one is not None and excess_of(one) * len(rows) < excess_of(found) * len(part):
            fewer.append(of_model(rows, one.model, given))
    least = min(fewer, key=excess_of, default=found)
    return fitted(rows, given, begin=least.model) if excess_of(least) < excess_of(found) else found


def _bare(found: Fitted, given: Given) -> Fitted:
    """The machine without any of the effects."""
    return without(found, [name for name, _ in found.choice], given)


def _described(rows: Rows, found: Fitted) -> Unexplained | None:
    return describe(*_flux_errors(rows, found), _discrepancy(found))


def _flux_errors(rows: Rows, found: Fitted) -> tuple[Rows, Vector, tuple[float, float]]:
    """What is left (Vs) as voltages make it, whatever the inductances at a current are, and its noise.

    Of the nominal machine, where what is left has led a parameter to its bound.
    """
    there, model = rows.with_machine(found.model.machine), found.model
    if model.bend is None and held_at_bound(found.own, found.choice):
        there, model = rows, Model(rows.machine)
    elif model.bend is None:
        return there, found.z, found.noise[:2]
    z = whitened(residual(there, found.smooth, model), filter_of(there, model.machine))
    return there, z, noise_of(z, None, rows, samples_in_mean(found.model))[:2]


class _Rung(NamedTuple):
    """A resonance in the place of effects."""

    bare: Fitted  # without them
    told: Unexplained
    left: float  # chi square beside it, above that of white noise
    machine: Mapping[str, float]  # R_s, L_d, L_q, psi_f beside it
    angle: float  # rad, by which the zero is turned there


def _ringing(
    rows: Rows, found: Fitted, left: Unexplained | None, given: Given
) -> tuple[Fitted, Unexplained, bool] | None:
    """A fit without effects in whose place a resonance explains as much, the resonance, and if it explains all they do.

    In the place of losses, which rise with frequency; or of all effects, where there are losses or something is left.
    """
    losses, names = [name for name, _ in found.choice if name in LIKE_RESONANCE], [name for name, _ in found.choice]
    if found.model.bend is not None or not (losses or (left is not None and names)):
        return None
    tried = [losses] * bool(losses) + [names] * (len(names) > len(losses))
    rounded = hidden_of(found) if _as_data_sheet(found, given) else -math.inf  # what another machine may lend of that
    rungs = [
        rung for drop in tried if (rung := _rung(rows, found, without(found, drop, given)))
        and (_healthy(rung, given) or excess_of(found) - rung.left > rounded)
        and (rung.left > -by_chance(rows) or excess_of(found) > by_chance(rows))  # otherwise it explains noise
    ]  # fmt: skip
    if not rungs:
        return None
    rung = min(rungs, key=lambda one: one.left)
    more = excess_of(found) - rung.left
    equal = _CERTAIN + found.own.discrepancy(found.choice) + ROUNDED * hidden_of(found)
    if more < -_CERTAIN or (not losses and more < equal):
        return None
    form = _described(rows, rung.bare) if rung.left > by_chance(rows) else None
    if form is not None and _has_form(form) and not form.description.startswith(RESONANCE):
        return None  # and that explains more
    if more > equal and (both := _rung(rows, found, found)) is not None and both.left < rung.left - _CERTAIN:
        return None  # they explain some beside it
    return rung.bare, rung.told, more > equal


def _rung(rows: Rows, found: Fitted, bare: Fitted) -> _Rung | None:
    """The best branch, as the machine moves on beside it; None where it explains little."""
    best: _Rung | None = None
    at, model = _flux_errors(rows, bare), bare.model
    while (told := best_resonance(*at, bare.smooth.with_machine(model.machine))) is not None:
        if told[1].gain < _CERTAIN * at[2][0] * at[2][1]:
            break
        left = above_noise(as_in(model.machine, found.model.machine, told[1].left), found.noise, rows)
        if best is not None and left > best.left - _CERTAIN:
            break
        *by, turned = map(float, told[1].changes)
        moved = {name: getattr(model.machine, name) + change for name, change in zip(PARAMETERS, by, strict=True)}
        best = _Rung(bare, told[0], left, moved, model.angle + turned)
        if not min(moved.values()) > 0.0:
            break
        model = replace(model, machine=replace(model.machine, **moved), angle=model.angle + turned)
        there = rows.with_machine(model.machine)
        at = there, flux_errors(residual(there, bare.smooth, model), there, model), at[2]
    return best


def alone(rows: Rows, given: Given) -> tuple[Fitted, Unexplained] | None:
    """The machine without effects, and what it leaves, where that is a form which explains all but noise.

    The likeliest effects leave far more in its place. Of a long recording blocks are asked first.
    """
    part = thinned(rows, *PARTS[-1])
    if part is not rows and alone(part, given) is None:
        return None
    bare = of_model(rows, Model(given.machine), given)
    excess, chance = excess_of(bare), by_chance(rows)
    if excess < _FAR_ABOVE_FORM * chance or (left := _described(rows, bare)) is None:
        return None
    if not _has_form(left) or left.where.region["frame"] != "stationary" or _came_once(left) or _hums(left):
        return None
    beside = _left_by_form(left, excess)
    if left.description.startswith(RESONANCE):
        rung = _rung(rows, bare, bare)
        if rung is None or not _healthy(rung, given):
            return None
        left, beside = rung.told, rung.left
    if _FAR_ABOVE_FORM * (beside + chance) > excess:
        return None
    found = _bare(bare, given)
    search = found.search
    by_effects = excess_of(found) + search.fit(search.best(())).chi2 - search.fit(()).chi2
    return (found, left) if _FAR_ABOVE_FORM * (beside + chance) < by_effects else None


def _healthy(rung: _Rung, given: Given) -> bool:
    """The machine beside a resonance is as its data sheet says: no other has lent its energy to it."""
    as_told = all(given.within(name, value) for name, value in rung.machine.items())
    return as_told and abs(rung.angle) <= given.angle_step


def without_spurious(rows: Rows, found: Fitted, left: Unexplained | None, given: Given) -> WithoutSpurious:
    """A fit without effects that only lean on what is left, and what is left then.

    None of them where what is left without any has a form that explains more than they do, or where their machine is
    none: they are its disguise. Where nothing is left without those that are gone, they had led astray: others may
    show now. Nor one that looks like the machine, which is none with it.
    """
    while (held := held_at_bound(found.own, found.choice) is not None) or _far_off(found, given):
        name = like_machine(found.own, found.choice)
        other = found if name is None else without(found, [name], given)
        if other is found or not (held or (_is_machine(other, given) and _by_rounding(other, found))):
            break
        found, left = other, unexplained_by(rows, other)
    if (other := _as_told(found, given)) is not found:
        found, left = other, unexplained_by(rows, other)
    before = found
    resonance: Unexplained | None = None
    faint: Unexplained | None = None
    if (rung := _ringing(rows, found, left, given)) is not None:
        bare, told, plain = rung
        if plain:
            found, left, resonance = bare, told, told
        else:
            faint = told
    while left is not None and (dropped := {*_outshone(found), *(alike := _likely_instead(found, left))}):
        resonance = left if alike else resonance
        found = without(found, sorted(dropped), given)
        left = _described(rows, found)
    if found is not before and left is resonance is None and set(found.search.best(found.choice)) != set(found.choice):
        found = fitted(rows, given, begin=found.model)
        return WithoutSpurious(found, unexplained_by(rows, found), faint)
    left = resonance or left  # it is plainest where a loss takes its slow part
    if left is not None and found.choice:
        bare = _bare(found, given)
        form = _described(rows, bare)
        if form is not None and _has_form(form):
            left_by_form = _left_by_form(form, excess_of(bare))
            same = resonance is not None and form.description.startswith(RESONANCE)
            if same or left_by_form < excess_of(found) or held_at_bound(found.own, found.choice):
                return WithoutSpurious(bare, form)
    return WithoutSpurious(found, left, faint)


def _far_off(found: Fitted, given: Given) -> bool:
    """A parameter is as no machine of the data sheet has it."""
    return not _as_data_sheet(found, given, FAR_OFF)


def _as_told(found: Fitted, given: Given) -> Fitted:
    """The fit, or one without an effect that takes a parameter which it looks like off the data sheet's and explains no
    more than rounding of the angle may.
    """
    if _as_data_sheet(found, given, _CLEARLY_OFF):
        return found
    trading = [name for name, share in unconfounded(found.own, found.choice).items() if share < TRADES]
    others = (without(found, [name], given) for name in trading)
    return next((other for other in others if _as_data_sheet(other, given) and _by_rounding(other, found)), found)


def _as_data_sheet(found: Fitted, given: Given, times: float = 1.0) -> bool:
    """All parameters are as the data sheet says, or so many times their tolerance off; of a map nothing is compared."""
    told = given.told if found.model.bend is None else []
    return all(given.within(name, getattr(found.model.machine, name), times) for name in told)


def _by_rounding(other: Fitted, found: Fitted) -> bool:
    """What one fit leaves more than another may be the angle's rounding."""
    return excess_of(other) - excess_of(found) <= hidden_of(other)


def _is_machine(found: Fitted, given: Given) -> bool:
    """No parameter is far off, or held at its bound."""
    return held_at_bound(found.own, found.choice) is None and not _far_off(found, given)


def _has_form(left: Unexplained) -> bool:
    """It looks like something that the library does not hold: what goes by the rotor's turning may be its effects'."""
    region = left.where.region
    return "frame" in region and not region.keys() & {"electrical_order", "mechanical_order"}


def _came_once(left: Unexplained) -> bool:
    """A voltage that came or went once, as one that is there all the time looks beside a machine that is none."""
    changes = left.where.region.get("changes")
    return isinstance(changes, float) and changes <= _ONCE


def _hums(left: Unexplained) -> bool:
    """It is at a frequency of the mains, which the library holds: as a voltage, and as what looks like one."""
    frequency = left.where.region.get("frequency")
    return isinstance(frequency, float) and of_mains(frequency)


def _left_by_form(form: Unexplained, excess: float) -> float:
    """What of an excess a form leaves."""
    return (1.0 - form.where.energy_share) * excess


def by_chance(rows: Rows) -> float:
    """Chi square that noise may leave above itself."""
    return _NOISE_CHANCE * math.sqrt(4.0 * len(rows))


def excess_of(found: Fitted) -> float:
    """Chi square of what is left, above that of white noise."""
    return above_noise(found.z, found.noise, found.rows)


def hidden_of(found: Fitted) -> float:
    """Chi square that rounding of the angle may leave."""
    return hidden_energy(found.rows) / (found.noise[0] * found.noise[1])


def above_noise(z: Vector, noise: Noise, rows: Rows) -> float:
    """Chi square of flux errors (Vs), above that of white noise."""
    d, q = z.real / noise[0], z.imag / noise[1]
    return float(np.sum(d * d) + np.sum(q * q)) - 2.0 * int(rows.joined.sum())


def _outshone(found: Fitted) -> list[str]:
    """Effects that explain little beside what is left without a name: they only lean on it."""
    search, choice, excess = found.own, found.choice, excess_of(found)
    return [one[0] for one in choice if search.explained(choice, one) < LEAST_EVIDENT_SHARE * excess]


def _likely_instead(found: Fitted, left: Unexplained) -> list[str]:
    """Effects that are what is left without a name, as far as it reaches: below its frequency a resonance is a loss."""
    return [name for name, _ in found.choice if name in LIKE_RESONANCE and left.description.startswith(RESONANCE)]
