"""What voltage pulses on a held rotor say: saliency, and effects that the angles left out of a fit bear out.

Every set of terms is fitted as often as there are angles, each time without one of them, and judged by the error on
that one. All volts are told by the dc link's reading alone, so what is told of its gain is nothing.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np

from estimator.diagnosis.answer.sentences import quantity, with_interval, with_sentence
from estimator.diagnosis.standstill import pulse_fit as terms_of
from estimator.diagnosis.standstill.pulse_fit import Pulses, PulseTerms, Train
from estimator.diagnosis.standstill.sweep import LOSS_AT_STANDSTILL, jackknife, odds_told, record_instead, smallest_set
from estimator.diagnosis.trust.rivals import POWER_99, SURE_LOG_ODDS
from estimator.diagnosis.verdict import (
    Candidate,
    Diagnosis,
    ErrorChange,
    Finding,
    Fit,
    LeaveOneOut,
    Place,
    Quantity,
    Rival,
    Unexplained,
    verdict_of,
)

_TERMS: Final[PulseTerms] = (terms_of.LOST, terms_of.RUNG, terms_of.SATURATION)
_EFFECT_OF_PULSE: Final = {
    terms_of.LOST: "inverter_voltage_error", terms_of.RUNG: "ac_resistance", terms_of.SATURATION: "d_axis_saturation",
}  # fmt: skip
_UNITS: Final = {"R_s": "ohm", "L_d": "H", "L_q": "H", "u_lost": "V", "resistance_above_corner": "ohm", "corner": "Hz",
                 "flux_per_cube": "H/A^2"}  # fmt: skip
_FEWEST_ANGLES: Final = 5  # angles
_UNEXPLAINED_NOISE: Final = 1.2  # times the noise: left unexplained
_POLE_PAIRS_AS_GOOD: Final = 1.001  # times the least squares: another number of pole pairs is as good


@dataclass(frozen=True, slots=True, eq=False)
class PulsesTried:
    """A set of terms: fitted to all angles, and to all but each."""

    fit: terms_of.PulseFit
    without: tuple[terms_of.PulseFit, ...]
    rms: float  # A, on the angles left out


def diagnose_pulses(trains: Sequence[Train], n_p: int | None = None, R_s: float | None = None) -> Diagnosis:
    """Diagnose pulses. `R_s`: measured with a meter. Raises ValueError with what they lack."""
    angles = len({train.angle for train in trains})
    if angles < _FEWEST_ANGLES:
        raise ValueError(f"expected pulses at no fewer than {_FEWEST_ANGLES} angles, got {angles}")
    pulses = Pulses(trains, n_p)
    sets: list[PulseTerms] = [terms for count in range(len(_TERMS) + 1) for terms in combinations(_TERMS, count)]
    tried = {terms: _tried_pulses(pulses, terms) for terms in sets}
    scores = {terms: 2.0 * angles * math.log(one.rms) for terms, one in tried.items()}
    chosen = smallest_set(scores)
    findings = tuple(_pulse_finding(term, tried, scores, chosen) for term in chosen)
    doubts = (LOSS_AT_STANDSTILL,) if terms_of.RUNG in chosen else ()
    left = _left_of_pulses(pulses, tried[chosen])
    after = _held_machine(pulses, tried, chosen)
    instead = record_instead(after)
    return with_sentence(Diagnosis(
        verdict=verdict_of(findings, doubts, left, instead), sentence="",
        findings=findings, ambiguous=doubts, unexplained=left,
        detectable=_detectable_by_angles(tried, chosen), machine_before=_held_machine(pulses, tried, ()),
        machine_after=after, fit=_pulse_quality(pulses, tried[()], tried[chosen]),
        candidates=_pulse_candidates(scores, chosen),
        remarks=(*_pulse_remarks(pulses, tried, chosen, R_s), *instead), traces=None,
    ))  # fmt: skip


def _tried_pulses(pulses: Pulses, terms: PulseTerms) -> PulsesTried:
    fits = tuple(pulses.fit(terms, k) for k in range(len(pulses.angles)))
    squares = [pulses.rms(fit, [k]) ** 2 for k, fit in enumerate(fits)]
    return PulsesTried(pulses.fit(terms), fits, math.sqrt(float(np.mean(squares))))


def _pulse_sizes(fit: terms_of.PulseFit) -> dict[str, float]:
    v = fit.values
    salient = math.hypot(v["L_1"], v["L_2"])
    return {
        "R_s": v["R_s"], "L_d": v["L_0"] - salient, "L_q": v["L_0"] + salient, "u_lost": v["u_lost"],
        "resistance_above_corner": v["R_x"], "corner": 0.5 / (math.pi * fit.tau), "flux_per_cube": v["b"],
    }  # fmt: skip


def _sizes_by_angle(
    tried: Mapping[PulseTerms, PulsesTried], terms: PulseTerms, names: Sequence[str]
) -> dict[str, Quantity]:
    """Sizes with what each angle does to them, and each term more that is not borne out."""
    at, each = _pulse_sizes(tried[terms].fit), [_pulse_sizes(fit) for fit in tried[terms].without]
    more = [_pulse_sizes(other.fit) for t, other in tried.items() if len(t) == len(terms) + 1 and set(terms) <= set(t)]
    found: dict[str, Quantity] = {}
    for name in names:
        angles = jackknife([sizes[name] for sizes in each])
        models = max(((sizes[name] - at[name]) ** 2 for sizes in more), default=0.0)
        grid = (terms_of.STEP_OF_TAU * at[name]) ** 2 / 12.0 if name == "corner" else 0.0
        # Before two phases at once the current also goes across: that lowers an inductance by so much at most
        across = (at["L_q"] - at["L_d"]) ** 2 / (4.0 * at["L_q"]) if name in ("L_d", "L_q") else 0.0
        found[name] = Quantity(at[name], math.sqrt(angles + models + grid + across**2), _UNITS[name])
    return found


def _held_machine(pulses: Pulses, tried: Mapping[PulseTerms, PulsesTried], terms: PulseTerms) -> dict[str, Quantity]:
    return _sizes_by_angle(tried, terms, ("R_s", "L_d", "L_q")) | {"n_p": Quantity(float(pulses.n_p), None, "1")}


def _pulse_finding(
    term: str, tried: Mapping[PulseTerms, PulsesTried], scores: Mapping[PulseTerms, float], chosen: PulseTerms
) -> Finding:
    names = {
        terms_of.LOST: ("u_lost",), terms_of.RUNG: ("resistance_above_corner", "corner"),
        terms_of.SATURATION: ("flux_per_cube",),
    }[term]  # fmt: skip
    rest = tuple(other for other in chosen if other != term)
    rivals = {other: scores[t] - scores[chosen] for other in _TERMS if other not in chosen
              for t in scores if set(t) == {*rest, other}}  # fmt: skip
    odds = tuple(
        Rival(_EFFECT_OF_PULSE[t], odds_told(log)) for t, log in sorted(rivals.items(), key=lambda pair: pair[1])
    )
    before, after = _pulse_sizes(tried[rest].fit), _pulse_sizes(tried[chosen].fit)
    hidden = {name: before[name] - after[name] for name in ("R_s", "L_d", "L_q")}
    gained = np.maximum(tried[rest].fit.residual - tried[chosen].fit.residual, 0.0)
    share = float(gained.sum() / max(float(tried[rest].fit.residual.sum()), 1e-300))
    where = Place("at every angle, where the current bends after a change of voltage" if term == terms_of.RUNG
                  else "at every angle", {}, share, 1.0)  # fmt: skip
    return Finding(_EFFECT_OF_PULSE[term], _sizes_by_angle(tried, chosen, names), where,
                   odds_told(min(scores[rest] - scores[chosen], *rivals.values())), odds, hidden)  # fmt: skip


def _pulse_quality(pulses: Pulses, base: PulsesTried, found: PulsesTried) -> Fit:
    volts = base.fit.values["L_0"] / pulses.duration  # per ampere of error at the end of a stretch
    loo = None
    if found is not base:
        loo = LeaveOneOut("angle", len(pulses.angles), base.rms, found.rms, "A", {"current noise": pulses.noise})
    return Fit(
        True, ErrorChange(volts * base.rms, volts * found.rms, volts * pulses.noise), ErrorChange(base.rms, found.rms),
        1.0 - (found.rms / base.rms) ** 2, ErrorChange(math.nan, math.nan), loo,
    )  # fmt: skip


def _left_of_pulses(pulses: Pulses, found: PulsesTried) -> Unexplained | None:
    if found.rms < _UNEXPLAINED_NOISE * pulses.noise:
        return None
    amperes = math.sqrt(found.rms**2 - pulses.noise**2)
    volts = amperes * found.fit.values["L_0"] / pulses.duration
    said = f"{quantity(amperes, 'A')} of current beyond its noise of {quantity(pulses.noise, 'A')}"
    return Unexplained(volts, Place("at every angle", {}, 1.0, 1.0), said)


def _detectable_by_angles(tried: Mapping[PulseTerms, PulsesTried], chosen: PulseTerms) -> dict[str, Quantity]:
    """The smallest size that would have been seen at 99 % power, by how it scatters from angle to angle."""
    found: dict[str, Quantity] = {}
    for term, _, size in _not_borne_out(tried, chosen):
        if size.std:
            least = size.std * (math.sqrt(2.0 * SURE_LOG_ODDS) + POWER_99)
            found[_EFFECT_OF_PULSE[term]] = Quantity(least, None, size.unit)
    return found


def _not_borne_out(
    tried: Mapping[PulseTerms, PulsesTried], chosen: PulseTerms
) -> Iterator[tuple[str, PulsesTried, Quantity]]:
    """Terms that were not chosen, the sets with them, and their sizes there."""
    for term, name in ((terms_of.LOST, "u_lost"), (terms_of.SATURATION, "flux_per_cube")):
        if term not in chosen:
            terms = tuple(t for t in _TERMS if t in chosen or t == term)
            yield term, tried[terms], _sizes_by_angle(tried, terms, (name,))[name]


def _pulse_candidates(scores: Mapping[PulseTerms, float], chosen: PulseTerms) -> tuple[Candidate, ...]:
    def score(terms: set[str]) -> float:
        return next(s for t, s in scores.items() if set(t) == terms)

    return tuple(
        Candidate(_EFFECT_OF_PULSE[term], (score(set()) - score({term})) / math.log(10.0),
                  (score(set(chosen) - {term}) - score(set(chosen) | {term})) / math.log(10.0), term in chosen)
        for term in _TERMS
    )  # fmt: skip


def _pulse_remarks(
    pulses: Pulses, tried: Mapping[PulseTerms, PulsesTried], chosen: PulseTerms, R_s: float | None
) -> tuple[str, ...]:
    machine = _held_machine(pulses, tried, chosen)
    said = [
        "R_s, L_d, L_q and every volt are in proportion to the dc link's reading: dc_link_gain is not to be told from "
        "pulses alone; R_s measured with a meter, or the dc link, would tell"
    ]
    found = machine["R_s"]
    if R_s is not None and found.value and found.std:
        gain = with_interval(found.value / R_s, found.std / R_s)
        said[0] = (
            f"every volt is in proportion to the dc link's reading: were R_s {quantity(R_s, 'ohm')}, as the machine "
            f"file has it, it would read {gain} times too high"
        )
    values = tried[()].fit.values
    series, swing = 2.0 * values["L_0"], 2.0 * math.hypot(values["L_1"], values["L_2"])
    said.append(
        f"two phases in series have {quantity(series, 'H')}, {quantity(swing, 'H')} more or less with the angle, as "
        "the slopes have it; L_d is taken to be the smaller one"
    )
    best = min(pulses.by_pairs.values())
    alike = [str(n) for n, error in pulses.by_pairs.items() if error < _POLE_PAIRS_AS_GOOD * best]
    said.append(f"by how the inductance goes round with the angle the rotor has {' or '.join(alike)} pole pairs")
    for term, there, size in _not_borne_out(tried, chosen):
        title = {terms_of.LOST: "the inverter's voltage error", terms_of.SATURATION: "saturation"}[term]
        if not size.value:
            said.append(f"{title} is not borne out: the recording calls for none")
            continue
        said.append(
            f"{title} is not borne out: with {quantity(size.value, size.unit, size.std)} of it "
            f"the error on an angle left out is {quantity(there.rms, 'A')}, without it "
            f"{quantity(tried[chosen].rms, 'A')}"
        )
    return tuple(said)
