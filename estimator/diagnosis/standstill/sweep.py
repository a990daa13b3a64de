"""What a sweep of sine voltages on a standing motor says: effects that the frequencies left out of a fit bear out.

Every set of terms is fitted as often as there are frequencies, each time without one of them, and judged by the error
on that one. The smallest set that no other beats by odds of a hundred is what is named. Intervals hold what the fit
leaves, what each frequency does to it, and which of three current sensors is to blame for a sum that is not zero.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np

from estimator.arrays import Array
from estimator.diagnosis.answer.sentences import quantity, with_sentence
from estimator.diagnosis.standstill import sweep_fit as terms_of
from estimator.diagnosis.standstill.sensors import Sum, sum_of
from estimator.diagnosis.standstill.sweep_fit import Sweep, SweepTerms
from estimator.diagnosis.standstill.tones import Tone, Tones, tones_of
from estimator.diagnosis.trust.rivals import POWER_99, SURE_LOG_ODDS
from estimator.diagnosis.verdict import (
    Ambiguity,
    Candidate,
    Diagnosis,
    ErrorChange,
    Experiment,
    Finding,
    Fit,
    LeaveOneOut,
    Place,
    Quantity,
    Rival,
    Unexplained,
    verdict_of,
)

_EFFECT_OF_TERM: Final = {
    terms_of.LOST: "inverter_voltage_error", terms_of.DIFFUSION: "ac_resistance", terms_of.RUNG: "ac_resistance",
    terms_of.BESIDE: "ac_resistance", terms_of.SATURATION: "d_axis_saturation",
}  # fmt: skip
_LOSSES: Final = (None, terms_of.DIFFUSION, terms_of.RUNG, terms_of.BESIDE)
_FEWEST_TONES: Final = 5  # frequencies
_UNEXPLAINED_TONES: Final = 3.0  # times the noise: left unexplained
_EQUATION_GOOD: Final = 0.003  # of a voltage: as good as the equation is for a switched bridge
_TOLD_SHARE: Final = 0.1  # of a parameter: less well told, nothing is said of a mismatch
_ACROSS: Final = 0.03  # of the current along the axis: worth a word
LOSS_AT_STANDSTILL: Final = Ambiguity(
    ("ac_resistance", "iron_loss"),
    "currents induced in the winding and currents induced in the iron make the same impedance at standstill",
    Experiment(
        "turning the unloaded motor at two speeds would tell: iron loss takes torque without current there, the "
        "resistance of a winding does not"
    ),
)


@dataclass(frozen=True, slots=True, eq=False)
class SweepTried:
    """A set of terms: fitted to all frequencies, and to all but each."""

    fit: terms_of.SweepFit
    without: tuple[terms_of.SweepFit, ...]
    left: Array  # (tones,) error on each that was left out, as a share of its voltage

    @property
    def rms(self) -> float:
        """Over the frequencies."""
        return math.sqrt(float(np.mean(self.left**2)))


def diagnose_sweep(stretches: Sequence[Tone]) -> Diagnosis:
    """Diagnose a sweep. Raises ValueError with what it lacks."""
    tones = tones_of(stretches)
    n = len(tones.frequency)
    if n < _FEWEST_TONES:
        raise ValueError(f"expected a sweep of at least {_FEWEST_TONES} frequencies, got {n}")
    sweep = Sweep(tones)
    noise = math.sqrt(float(np.mean((tones.noise / np.abs(tones.i[:, 1])) ** 2)))
    tried = {terms: _tried_tones(sweep, terms) for terms in _without_saturation()}
    scores = {terms: _score(one, noise) for terms, one in tried.items()}
    chosen = smallest_set(scores)
    for rest in dict.fromkeys(((), chosen, *(tuple(t for t in chosen if t != term) for term in chosen))):
        terms = (*rest, terms_of.SATURATION)
        tried[terms] = _tried_tones(sweep, terms)
        scores[terms] = _score(tried[terms], noise)
    return _diagnosis_of_sweep(sweep, tried, scores, smallest_set(scores), noise)


def _score(tried: SweepTried, noise: float) -> float:
    """Minus the logarithm of how likely the frequencies left out are, but for a constant."""
    return 2.0 * len(tried.left) * math.log(math.hypot(tried.rms, noise, _EQUATION_GOOD))


def _without_saturation() -> list[SweepTerms]:
    return [tuple(t for t in terms if t is not None) for terms in product((None, terms_of.LOST), _LOSSES)]


def _tried_tones(sweep: Sweep, terms: SweepTerms) -> SweepTried:
    fit, n = sweep.fit(terms), len(sweep.tones.frequency)
    without = tuple(sweep.fit(terms, [m for m in range(n) if m != k], fit) for k in range(n))
    return SweepTried(fit, without, np.array([abs(one.error[k]) for k, one in enumerate(without)]) / sweep.size)


def smallest_set(scores: Mapping[SweepTerms, float]) -> SweepTerms:
    """The smallest set that no other beats by far; of those as small, the best."""
    best = min(scores.values())
    near = [terms for terms, score in scores.items() if score - best < SURE_LOG_ODDS]
    return min(near, key=lambda terms: (len(terms), scores[terms]))


# --- what is said


def _diagnosis_of_sweep(
    sweep: Sweep, tried: dict[SweepTerms, SweepTried], scores: dict[SweepTerms, float], chosen: SweepTerms, noise: float
) -> Diagnosis:
    base, found = tried[()], tried[chosen]
    summed = sum_of(sweep.tones)
    blamed = _blamed(sweep.tones, found.fit) if summed.shows else []
    findings = [_sweep_finding(sweep, term, tried, scores, chosen, blamed) for term in chosen]
    doubts = [LOSS_AT_STANDSTILL] if any(_EFFECT_OF_TERM[term] == "ac_resistance" for term in chosen) else []
    if summed.finding is not None:
        findings.append(summed.finding)
    if summed.ambiguity is not None:
        doubts.append(summed.ambiguity)
    left = _left_of_tones(sweep, found, noise)
    after = _axis_machine(found, blamed)
    instead = record_instead(after)
    return with_sentence(Diagnosis(
        verdict=verdict_of(findings, doubts, left, instead), sentence="",
        findings=tuple(findings), ambiguous=tuple(doubts),
        unexplained=left, detectable=_detectable_by_tones(tried, chosen), machine_before=_axis_machine(base, []),
        machine_after=after, fit=_sweep_quality(sweep, base, found),
        candidates=_sweep_candidates(scores, chosen),
        remarks=(*_sweep_remarks(sweep, found, summed), *instead), traces=None,
    ))  # fmt: skip


def record_instead(machine: Mapping[str, Quantity]) -> list[str]:
    """What to record instead, where a recording tells too little of the machine."""
    sizes = {name: machine[name] for name in ("R_s", "L_d")}
    vague = " and ".join(name for name, x in sizes.items() if (x.std or 0.0) > _TOLD_SHARE * abs(x.value or 0.0))
    return [f"{vague} not told within {quantity(_TOLD_SHARE, '1')}: record larger currents"] if vague else []


def _blamed(tones: Tones, fit: terms_of.SweepFit) -> list[dict[str, float]]:
    """Sizes, were one current sensor alone to blame for what the currents' sum says."""
    return [Sweep(tones.blaming(phase)).fit(fit.terms, None, fit).values for phase in range(3)]


def _quantity(name: str, tried: SweepTried, blamed: Sequence[dict[str, float]]) -> Quantity:
    """A size with what the fit, each frequency and each sensor leave open."""
    value, variance = tried.fit.values[name], jackknife([one.values[name] for one in tried.without])
    sensors = float(np.mean([(one[name] - value) ** 2 for one in blamed])) if blamed else 0.0
    return Quantity(
        value, math.sqrt(max(tried.fit.covariance[name, name], variance) + sensors), terms_of.SIZE_UNITS[name]
    )


def jackknife(values: Sequence[float]) -> float:
    """Variance of a size by its values without each of what it was fitted to."""
    return (len(values) - 1) * float(np.var(values))


def _axis_machine(tried: SweepTried, blamed: Sequence[dict[str, float]]) -> dict[str, Quantity]:
    names = {"R_s": "R_s", "L_d": "L_d", "voltage_delay": "delay"}
    return {told: _quantity(name, tried, blamed) for told, name in names.items()}


def _sweep_finding(
    sweep: Sweep, term: str, tried: dict[SweepTerms, SweepTried], scores: dict[SweepTerms, float], chosen: SweepTerms,
    blamed: Sequence[dict[str, float]],
) -> Finding:  # fmt: skip
    found, effect = tried[chosen], _EFFECT_OF_TERM[term]
    rest = tuple(other for other in chosen if other != term)
    instead: dict[str, float] = {}  # log-odds against another effect in its place
    for other, score in scores.items():
        new = [t for t in other if t not in rest]
        if set(rest) <= set(other) and len(new) == 1 and _EFFECT_OF_TERM[new[0]] != effect:
            log = score - scores[chosen]
            instead[_EFFECT_OF_TERM[new[0]]] = min(log, instead.get(_EFFECT_OF_TERM[new[0]], log))
    rivals = tuple(Rival(name, odds_told(log)) for name, log in sorted(instead.items(), key=lambda pair: pair[1]))
    sizes = {told: _quantity(name, found, blamed) for name, told in _term_sizes(term).items()}
    hidden = {name: tried[rest].fit.values[name] - found.fit.values[name] for name in ("R_s", "L_d")}
    next_best = min(scores[rest] - scores[chosen], *instead.values())
    return Finding(effect, sizes, _place(sweep, tried[rest], found), odds_told(next_best), rivals, hidden)


def _term_sizes(term: str) -> dict[str, str]:
    """What is told of a term, by name, and how it is called."""
    return {
        terms_of.LOST: {"u_lost": "u_lost", "zero_crossing_width": "zero_crossing_width"},
        terms_of.DIFFUSION: {"R_x": "resistance_at_1_kHz"},
        terms_of.RUNG: {"R_x": "resistance_above_corner", "corner": "corner"},
        terms_of.BESIDE: {"corner": "corner"},
        terms_of.SATURATION: {"b": "flux_per_cube"},
    }[term]


def odds_told(log: float) -> float:
    """Odds by their logarithm, no larger than means something."""
    return math.exp(min(log, 60.0))


def _place(sweep: Sweep, without: SweepTried, found: SweepTried) -> Place:
    """The frequencies that hold most of what an effect explains."""
    gained = np.maximum(without.left**2 - found.left**2, 0.0)
    order = np.argsort(-gained)
    shares = np.cumsum(gained[order]) / max(float(gained.sum()), 1e-300)
    count = int(np.searchsorted(shares, 0.8)) + 1
    at = np.sort(sweep.tones.frequency[order[:count]])
    sentence = f"at {', '.join(f'{f:g}' for f in at)} Hz"
    return Place(sentence, {"frequency": (float(at[0]), float(at[-1]))}, float(shares[count - 1]), count / len(order))


def _sweep_quality(sweep: Sweep, base: SweepTried, found: SweepTried) -> Fit:
    tones = sweep.tones

    def volts(tried: SweepTried) -> float:
        return _rms_of_tones([one.error[k] for k, one in enumerate(tried.without)])

    def amperes(tried: SweepTried) -> float:
        return _rms_of_tones([one.error[k] / sweep.impedance(one, 1)[k] for k, one in enumerate(tried.without)])

    u, i = (volts(base), volts(found)), (amperes(base), amperes(found))
    floor = _rms_of_tones(tones.noise * sweep.size / np.abs(tones.i[:, 1]))
    loo = LeaveOneOut("frequency", len(tones.frequency), base.rms, found.rms, "1", {}) if found is not base else None
    white = ErrorChange(math.nan, math.nan)
    return Fit(True, ErrorChange(*u, floor), ErrorChange(*i), 1.0 - (u[1] / u[0]) ** 2, white, loo)


def _rms_of_tones(amplitudes: Sequence[complex] | Array) -> float:
    return math.sqrt(0.5 * float(np.mean(np.abs(np.asarray(amplitudes)) ** 2)))


def _left_of_tones(sweep: Sweep, found: SweepTried, noise: float) -> Unexplained | None:
    """What the frequencies left out still miss, beyond their noise and what the equation is good for."""
    if found.rms < _UNEXPLAINED_TONES * max(noise, _EQUATION_GOOD):
        return None
    worst = int(np.argmax(found.left))
    f = float(sweep.tones.frequency[worst])
    where = Place(f"most at {f:g} Hz", {"frequency": f}, float(found.left[worst] ** 2 / np.sum(found.left**2)),
                  1.0 / len(found.left))
    said = f"{quantity(found.rms, '1')} of the voltage, most at {f:g} Hz, against {quantity(noise, '1')} of noise"
    return Unexplained(_rms_of_tones(np.array([one.error[k] for k, one in enumerate(found.without)])), where, said)


def _detectable_by_tones(tried: dict[SweepTerms, SweepTried], chosen: SweepTerms) -> dict[str, Quantity]:
    """The smallest size of an effect not found that would have been seen at 99 % power."""
    found: dict[str, Quantity] = {}
    for term, name in ((terms_of.LOST, "u_lost"), (terms_of.DIFFUSION, "R_x"), (terms_of.SATURATION, "b")):
        if _EFFECT_OF_TERM[term] not in {_EFFECT_OF_TERM[t] for t in chosen}:
            more = next((one for terms, one in tried.items() if set(terms) == {*chosen, term}), None)
            if more is None:
                continue
            std = math.sqrt(more.fit.covariance[name, name])
            found[_EFFECT_OF_TERM[term]] = Quantity(
                std * (math.sqrt(2.0 * SURE_LOG_ODDS) + POWER_99), None, terms_of.SIZE_UNITS[name]
            )
    return found


def _sweep_candidates(scores: dict[SweepTerms, float], chosen: SweepTerms) -> tuple[Candidate, ...]:
    found: dict[str, Candidate] = {}
    taken = {_EFFECT_OF_TERM[term] for term in chosen}
    for effect in dict.fromkeys(_EFFECT_OF_TERM.values()):
        alone = max(
            scores[()] - score for terms, score in scores.items() if [_EFFECT_OF_TERM[t] for t in terms] == [effect]
        )
        rest = tuple(term for term in chosen if _EFFECT_OF_TERM[term] != effect)
        wanted = {effect, *(_EFFECT_OF_TERM[t] for t in rest)}
        more = [score for terms, score in scores.items()
                if set(rest) <= set(terms) and {_EFFECT_OF_TERM[t] for t in terms} == wanted]
        after = scores[rest] - min(more, default=scores[rest])
        found[effect] = Candidate(effect, alone / math.log(10.0), after / math.log(10.0), effect in taken)
    return tuple(found.values())


def _sweep_remarks(sweep: Sweep, found: SweepTried, summed: Sum) -> list[str]:
    said: list[str] = []
    fit, tones = found.fit, sweep.tones
    if terms_of.LOST in fit.terms:
        names = ("R_s", "u_lost")
        spread = math.sqrt(math.prod(fit.covariance[name, name] for name in names))
        said.append(
            f"R_s and the inverter's voltage error trade off (correlation {fit.covariance[names] / spread:.2f}); "
            "u_lost is all that a leg loses: dead time and drops are not to be told apart at one dc-link voltage"
        )
        measured, implied, doubt = (values[0] for values in sweep.third(fit))
        turned = math.degrees(float(np.angle(measured / implied)))
        said.append(
            f"third harmonic of current at {tones.frequency[0]:g} Hz, which no resistance makes: measured "
            f"{quantity(abs(measured), 'A', float(doubt))}, by the model "
            f"{quantity(abs(implied), 'A')}; they are {turned:.0f} deg apart"
        )
    if summed.remark:
        said.append(summed.remark)
    across = np.abs(tones.across / tones.i[:, 1])
    if float(across.max()) > _ACROSS:
        said.append(
            f"current across the voltage's axis: {quantity(float(across[0]), '1')} of that along it at "
            f"{tones.frequency[0]:g} Hz, {quantity(float(across[-1]), '1')} at {tones.frequency[-1]:g} Hz: a "
            "salient rotor off this axis makes it rise so; its angle and its saliency are not to be told apart at one "
            "position"
        )
    return said
