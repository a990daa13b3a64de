"""Diagnose steady points without load, of which i_q is not known: is the inverter's voltage error there?

Here a fit has no noise to be measured by, as no row repeats another, and half of the physics - load, i_q - stands
outside. So an effect is named only where it explains at least three times what it leaves of points left out, which
halves their error.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from estimator.arrays import Array
from estimator.diagnosis.answer.sentences import quantity, with_contradictions, with_sentence
from estimator.diagnosis.likelihood.evidence import ENTRY_LOG_ODDS
from estimator.diagnosis.points import judge
from estimator.diagnosis.points.diagnose import no_verdict, quality
from estimator.diagnosis.points.fit import PointsFit
from estimator.diagnosis.points.judge import Coordinate, odds_text
from estimator.diagnosis.points.model import VOLTAGE_ERROR
from estimator.diagnosis.points.no_load import OFFSET, NoLoad, flux_name, no_load_problem
from estimator.diagnosis.points.problem import MACHINE
from estimator.diagnosis.points.search import PointsChoice, PointsSearch
from estimator.diagnosis.points.table import speed_groups
from estimator.diagnosis.points.witnessed import witnessed
from estimator.diagnosis.trust.rivals import SURE_LOG_ODDS
from estimator.diagnosis.verdict import Ambiguity, Diagnosis, Experiment, Finding, Quantity, Scatter, Verdict
from estimator.diagnosis.words import number
from estimator.witness import Witness

LEAST_EXPLAINED_RATIO: Final = 3.0  # times what is left, that an effect has to explain
BLIND: Final = 0.02  # of the largest voltage, that an error of the inverter must be to be seen: nothing is judged then
_FEWEST, _SPEEDS = 3, 3  # levels of i_d; speeds at each


def diagnose_no_load(points: NoLoad, witnesses: Mapping[str, Witness] | None = None) -> Diagnosis:
    """Diagnose points of one motor."""
    whole = len(points.y)
    points = _with_speeds(points)
    levels = np.unique(points.i_d)
    if len(levels) < _FEWEST:
        return no_verdict(
            [f"expected at least {_FEWEST} levels of i_d with at least {_SPEEDS} speeds each, came {len(levels)}"],
            "record at least 4 speeds at each of 5 levels of i_d, zero among them",
        )
    search = PointsSearch(no_load_problem(points))
    chosen = search.chosen()
    tried = _tried(points, search)
    before = search.fit(()) if tried["one_offset"] <= tried["no_offset"] else _other(points, "none")
    was = min(tried["one_offset"], tried["no_offset"])
    choice = chosen if _outshines(was, _error_without_load(search, chosen)) else ()
    found = tuple(_no_load_finding(points, search, choice, effect, before) for effect in choice)
    findings = tuple(f for f in found if f.odds_against_next >= math.exp(SURE_LOG_ODDS))
    leaning = {} if choice else search.brings(chosen) | judge.hints(search, ())
    doubts = (
        *(
            Ambiguity((f.effect, f.rivals[0].effect), judge.alike(search, choice, f), Experiment(_INSTEAD))
            for f in found if f not in findings
        ),
        *(_leaning(search, name, odds, was) for name, odds in leaning.items()),
    )
    psi = _at_no_current(points)
    told = witnessed(search.fit(choice), witnesses or {}, {} if psi is None else {"psi_f": psi})
    after = told.fit
    limits = judge.detectable_at_points(search, choice)
    remarks = [_inductance(points, after, levels), *_offset(after), *_rests_on(points, search, choice), *told.remarks]
    if len(points.y) < whole:
        remarks.append(f"points left out at levels with fewer than {_SPEEDS} speeds: {whole - len(points.y)}")
    instead = None
    most = float(np.max(np.abs(points.y)))
    limit = (limits[VOLTAGE_ERROR].value or most) if VOLTAGE_ERROR in limits else most
    if doubts:
        verdict = Verdict.AMBIGUOUS
    elif findings:
        verdict = Verdict.EXPLAINED
    elif limit > BLIND * most:
        verdict, instead = Verdict.NOT_ENOUGH_EXCITATION, Experiment(_INSTEAD)
        remarks.append(
            f"points left out are missed by {quantity(was, 'V')} without and by {quantity(tried[VOLTAGE_ERROR], 'V')} "
            f"with the inverter's voltage error, of which less than {quantity(limit, 'V')} could not be named"
            + _worst(points, search.fit(()))
        )
    else:
        verdict = Verdict.NO_MISMATCH
    return with_contradictions(with_sentence(Diagnosis(
        verdict, "", findings, doubts, None, limits, _no_load_machine(points, before), _no_load_machine(points, after),
        quality(search, was, _error_without_load(search, choice), None, "speed within a level of i_d", tried),
        judge.point_candidates(search, choice), tuple(remarks), None, instead,
        tuple(Scatter(name, "u_q", x, _left_out(search, before), _left_out(search, after))
              for name, x in (("i_d, A", points.i_d), ("omega_e, rad/s", points.omega_e))),
    )), told.against)  # fmt: skip


def _with_speeds(points: NoLoad) -> NoLoad:
    """Points of levels at which several speeds were held: others tell nothing beyond their own flux linkage."""
    group = speed_groups(points.level, points.omega_e)
    several = [k for k in np.unique(points.level) if len(np.unique(group[points.level == k])) >= _SPEEDS]
    kept = np.isin(points.level, several)
    return replace(points, omega_e=points.omega_e[kept], y=points.y[kept], i_d=points.i_d[kept])


def _tried(points: NoLoad, search: PointsSearch) -> dict[str, float]:
    """Rms (V) of what models miss of points left out."""
    return {
        "one_offset": _error_without_load(search, ()), "no_offset": _other(points, "none").scale,
        "free_offsets": _other(points, "each").scale, VOLTAGE_ERROR: _error_without_load(search, (VOLTAGE_ERROR,)),
    }  # fmt: skip


def _other(points: NoLoad, offsets: str) -> PointsFit:
    """The machine with other offsets, its errors in V."""
    return PointsSearch(no_load_problem(points, offsets)).fit(())


def _error_without_load(search: PointsSearch, choice: PointsChoice) -> float:
    return search.fit(choice).scale * float(search.noise[0])


def _left_out(search: PointsSearch, fit: PointsFit) -> Array:
    return fit.left_out * (float(search.noise[0]) if (MACHINE, OFFSET) in fit.values else 1.0)


def _outshines(was: float, now: float) -> bool:
    return was**2 - now**2 >= LEAST_EXPLAINED_RATIO * now**2


_INSTEAD: Final = (
    "record u_q and i_q at slow speeds too, each until nothing moves, at i_d of zero and at small levels of both "
    "signs: there the current turns from one axis to the other, and the inverter's voltage error with it"
)


def _no_load_finding(
    points: NoLoad, search: PointsSearch, choice: PointsChoice, effect: str, before: PointsFit
) -> Finding:
    coordinates = (Coordinate("abs(i_d)", "A", np.abs(points.i_d)), Coordinate("omega_e", "rad/s", points.omega_e))
    found, psi = judge.finding(search, choice, effect, coordinates, {}), _at_no_current(points)
    if len(choice) > 1 or psi is None:
        return found
    return replace(found, absorbed_as={"psi_f": before.value(MACHINE, psi) - search.fit(choice).value(MACHINE, psi)})


def _leaning(search: PointsSearch, name: str, log_odds: float, was: float) -> Ambiguity:
    """An effect that the points lean to, without bearing its name."""
    fit = search.fit((name,))
    size = search.problem.effects[name][0]
    value = quantity(fit.value(*size.key), size.unit, fit.std(*size.key))
    now = _error_without_load(search, (name,))
    odds = f"by odds of {odds_text(log_odds)}" + (
        f", where {odds_text(ENTRY_LOG_ODDS)} are asked for" * (log_odds <= ENTRY_LOG_ODDS)
    )
    reason = (
        f"the points lean to it ({value}) {odds}; leaving one speed out the error goes from {quantity(was, 'V')} to "
        f"{quantity(now, 'V')}" + ("" if _outshines(was, now) else ", where half is asked for")
    )
    return Ambiguity((name,), reason, Experiment(_INSTEAD), rivals=False)


def _at_no_current(points: NoLoad) -> str | None:
    """The flux linkage that is psi_f, where a level has no i_d."""
    levels = np.unique(points.i_d)
    at = int(np.argmin(np.abs(levels)))
    return flux_name(at) if abs(levels[at]) < 0.02 * float(np.max(np.abs(levels))) else None


def _no_load_machine(points: NoLoad, fit: PointsFit) -> dict[str, Quantity]:
    psi = _at_no_current(points)
    return {} if psi is None else {"psi_f": Quantity(fit.value(MACHINE, psi), fit.std(MACHINE, psi), "Vs")}


def _inductance(points: NoLoad, fit: PointsFit, levels: Array) -> str:
    """L_d by current, which these points leave free."""
    psi = _at_no_current(points)
    if psi is None:
        return "no level without i_d: psi_f and L_d are not told apart"
    psi_f = fit.value(MACHINE, psi)
    told = [
        ((fit.value(MACHINE, flux_name(k)) - psi_f) / float(i), float(i))
        for k, i in enumerate(levels) if flux_name(k) != psi
    ]  # fmt: skip
    told.sort(key=lambda one: abs(one[1]))
    near, far = told[0], told[-1]
    return (
        f"L_d is free at every level: (psi_d - psi_f) / i_d goes from {quantity(near[0], 'H')} at {number(near[1])} A "
        f"to {quantity(far[0], 'H')} at {number(far[1])} A"
    )


def _offset(fit: PointsFit) -> list[str]:
    """What is the same at all levels."""
    value, std = fit.value(MACHINE, OFFSET), fit.std(MACHINE, OFFSET)
    if abs(value) < 2.0 * std:
        return []
    if VOLTAGE_ERROR in fit.choice:
        return [f"{quantity(value, 'V', std)} are the same at all levels: R off, by that over i_q"]
    return [
        f"{quantity(value, 'V', std)} are the same at all levels: R off, by that over i_q, or the "
        "inverter's voltage error of a motor that takes much i_q; these points cannot tell"
    ]


def _rests_on(points: NoLoad, search: PointsSearch, choice: PointsChoice) -> list[str]:
    """How much of the gain is one level's."""
    if not choice:
        return []
    gain = search.fit(()).left_out ** 2 - search.fit(choice).left_out ** 2
    by_level = np.bincount(points.level, weights=gain)
    best = int(np.argmax(by_level))
    share = float(by_level[best] / max(float(by_level.sum()), 1e-300))
    level = float(np.unique(points.i_d)[best])
    told = [f"{100.0 * min(share, 1.0):.0f} % of what it explains is at i_d = {number(level)} A"]
    if VOLTAGE_ERROR in choice:
        told.append("the voltage error is that at the little i_q of no load: with more current it may be larger")
    return told


def _worst(points: NoLoad, fit: PointsFit) -> str:
    """The levels that are missed most, where a few hold most of it."""
    energy = np.bincount(points.level, weights=fit.left_out**2)
    order = np.argsort(-energy)
    held = energy[order].cumsum() / energy.sum()
    count = int(np.searchsorted(held, 0.8)) + 1
    if count > len(energy) // 2:
        return ""
    levels = ", ".join(number(float(np.unique(points.i_d)[k])) for k in order[:count])
    share = 100.0 * float(held[count - 1])
    return f"; {share:.0f} % of what is missed is at i_d = {levels} A, which no straight line meets"
