"""Diagnose the q axis alone: what its equation tells of the machine and of the effects that act in it.

An i_d that was not recorded is taken for zero to within a share of i_q, which stands in the intervals. What acts by
the d axis is not looked for, and the answer says so.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array
from estimator.diagnosis.answer.sentences import quantity, title_of, with_contradictions, with_sentence
from estimator.diagnosis.likelihood.evidence import ENTRY_LOG_ODDS
from estimator.diagnosis.points import judge
from estimator.diagnosis.points.diagnose import no_verdict, quality
from estimator.diagnosis.points.fit import PointsFit
from estimator.diagnosis.points.judge import Coordinate
from estimator.diagnosis.points.problem import MACHINE, Key
from estimator.diagnosis.points.q_axis import (
    AS_GOOD,
    LOOKED_FOR,
    QAxis,
    aligned,
    groups_in_time,
    q_axis_of,
    q_axis_problem,
)
from estimator.diagnosis.points.search import PointsChoice, PointsSearch
from estimator.diagnosis.points.table import FEWEST_POINTS, Places, Points, groups_of, kin_of, steady
from estimator.diagnosis.points.witnessed import witnessed
from estimator.diagnosis.trust.rivals import SURE_LOG_ODDS
from estimator.diagnosis.verdict import (
    Ambiguity,
    Diagnosis,
    Experiment,
    Finding,
    Quantity,
    Scatter,
    Unexplained,
    Verdict,
    verdict_of,
)
from estimator.diagnosis.watch import mismatch_of, place_in_window
from estimator.diagnosis.words import continued, listed, number
from estimator.online import window_ls
from estimator.online.fit import I_D
from estimator.physics.library import BY_NAME
from estimator.samples import Samples
from estimator.witness import Witness

_GROUPS: Final = 8
_WELL_TOLD: Final = 0.5  # of a value, that its standard error may be
_NOISY: Final = 0.1  # of the slope's energy, that noise may be where L_q is told
_LONG: Final = 0.5  # of L_q/R_s, that a row may take where L_q is told
_OFFSET: Final = "voltage_offset"
_FORM: Final = 1.5  # times the share of its energy, rms, that an effect's equation may miss
_SEEN: Final = 2.0  # times what an i_d that is missed may make, rms, from which an effect is named
_MATTERS: Final = 2e-3  # of the voltage, rms: less that is left does not
_INSTEAD: Final = "record u_d and i_d too; else several speeds and currents of both signs, and steps of i_q"


def diagnose_q_log(
    runs: Sequence[Samples], *, aligned_already: bool = False, witnesses: Mapping[str, Witness] | None = None
) -> Diagnosis:
    """Diagnose a recording's runs. Unless it is aligned already, its voltage may be that of another instant."""
    if aligned_already or sum(len(run) - 8 for run in runs if len(run) > 8) < FEWEST_POINTS:
        return diagnose_q_axis(q_axis_of(runs), witnesses=witnesses)
    best = aligned(runs)
    diagnosis = _by_each_row(runs, diagnose_q_axis(best.q, moved=best.moved, witnesses=witnesses))
    if best.shift:
        way = "later" if best.shift > 0.0 else "earlier"
        said = (
            f"u_q goes best with the rest {abs(best.shift):g} rows {way} than it stands in the file, and is taken "
            f"there: --align u={best.shift:g}"
        )
        return replace(diagnosis, remarks=(said, *diagnosis.remarks))
    named = [one.effect for one in diagnosis.findings]
    named += [name for one in diagnosis.ambiguous for name in one.effects]
    if best.plain and named:
        way = "later" if best.plain > 0.0 else "earlier"
        reason = (
            f"with u_q {abs(best.plain):g} rows {way} the machine alone meets the rows about as well: "
            f"--align u={best.plain:g}"
        )
        doubt = Ambiguity((*dict.fromkeys(named), "voltage_delay"), reason, Experiment(_INSTEAD))
        return _said(replace(diagnosis, verdict=Verdict.AMBIGUOUS, findings=(), ambiguous=(doubt,)))
    return diagnosis


def _by_each_row(runs: Sequence[Samples], diagnosis: Diagnosis) -> Diagnosis:
    """The diagnosis, or what is left of the rows without a name: means over them do not tell how much is noise.

    Not of voltages that were moved to their rows: values of an instant leave what changes within a row.
    """
    if diagnosis.verdict is not Verdict.NO_MISMATCH:
        return diagnosis
    state = window_ls.init(sum(map(len, runs)))
    for run in runs:
        state = window_ls.update(state, run, joined=False)
    estimates = window_ls.estimate(state).estimates
    left = mismatch_of(runs, estimates)
    i_d, i_q, omega = (np.concatenate([getattr(run, name) for run in runs]) for name in ("i_d", "i_q", "omega_e"))
    least = 0.0 if np.any(i_d) else _SEEN * _by_missed_current(omega, i_q, estimates["L_q"].value or 0.0)
    if left is None or not left.mismatch or left.rms_V < least:
        return diagnosis
    told = Unexplained(left.rms_V, place_in_window(left), f"a voltage of {quantity(left.rms_V, 'V')} above noise")
    return _said(replace(diagnosis, verdict=Verdict.UNEXPLAINED, unexplained=told))


def _by_missed_current(omega_e: Array, i_q: Array, L_q: float) -> float:
    """V, rms, that an i_d may make which was not recorded."""
    return I_D * abs(L_q) * math.sqrt(float(np.mean(omega_e**2) * np.mean(i_q**2)))


def diagnose_q_points(
    points: Points, *, i_d: bool, witnesses: Mapping[str, Witness] | None = None
) -> Diagnosis:
    """Diagnose steady points, of which the d axis' voltage is not known. `i_d`: whether its current is."""
    kept = steady(points)
    points = kept.points
    q = QAxis(points.omega_e, points.i.imag, points.u.imag, points.i.real if i_d else None, points.t)
    diagnosis = diagnose_q_axis(q, (groups_of(points), kin_of(points)) if len(q) else None, witnesses=witnesses)
    return replace(diagnosis, remarks=(*kept.remarks, *diagnosis.remarks))


def diagnose_q_axis(
    q: QAxis, grouped: tuple[Places, Places] | None = None, moved: Mapping[Key, float] | None = None,
    witnesses: Mapping[str, Witness] | None = None,
) -> Diagnosis:
    """Diagnose rows, of a log unless it is told which of them belong together: each point, and what is its kin.

    `moved`: by how much sizes may be off besides, SI.
    """
    if len(q) < FEWEST_POINTS or not np.any(q.i_q):
        return no_verdict([f"expected at least {FEWEST_POINTS} rows with current, came {len(q)}"], _INSTEAD)
    group, kin = grouped or groups_in_time(q)
    if len(np.unique(group)) < _GROUPS:
        why = f"expected at least {_GROUPS} different operating points, came {len(np.unique(group))}"
        return no_verdict([why], _INSTEAD)
    search = PointsSearch(q_axis_problem(q, group, kin))
    choice = _beyond_missed_current(q, search, search.chosen())
    coordinates = _coordinates(q)
    before, after = search.fit(()), search.fit(choice)
    left = _left(search, choice, coordinates)
    others = _as_good(search, choice)
    doubted = _doubted(q, search, choice, others, moved or {}, left is not None)
    gains = search.brings(choice)
    told = witnessed(after.doubted(doubted), witnesses or {})
    found = [
        replace(judge.finding(search, choice, effect, coordinates, {}), parameters=judge.sizes(told.fit, effect))
        for effect in sorted(choice, key=lambda name: -gains[name])
    ]
    doubts = [doubt for one in found if (doubt := _doubt(search, choice, one, others)) is not None]
    unsure = {doubt.effects[0] for doubt in doubts}
    findings = tuple(one for one in found if one.effect not in unsure)
    machine_before, machine_after = judge.machine(before), judge.machine(told.fit)
    remarks = [_looked_for(search), *told.remarks]
    remarks += [f"i_d is taken for zero to within {I_D:.0%} of i_q"] if q.i_d is None else []
    if (why := _no_L_q(q, machine_after)) and "L_q" in machine_after:
        del machine_after["L_q"]
        remarks.append(f"L_q is not told: {why}")
    unidentified = [name for name, size in machine_after.items() if not _told(size)]
    if unidentified:
        remarks.append(f"these rows do not tell {listed(unidentified)}")
    verdict = verdict_of(findings, doubts, left, unidentified)
    return with_contradictions(_said(Diagnosis(
        verdict, "", findings, tuple(doubts), left, judge.detectable_at_points(search, choice), machine_before,
        machine_after,
        quality(
            search, _rms(search, before), _rms(search, after), None,
            "operating point" if q.slope is None else "stretch of time", {},
        ),
        judge.point_candidates(search, choice), tuple(remarks), None,
        Experiment(_INSTEAD) if verdict is Verdict.NOT_ENOUGH_EXCITATION else None,
        _scatters(search, before, after, coordinates),
    )), told.against)  # fmt: skip


def _said(diagnosis: Diagnosis) -> Diagnosis:
    return replace(diagnosis, sentence=f"Of the q axis alone: {continued(with_sentence(diagnosis).sentence)}")


def _told(size: Quantity) -> bool:
    value, std = size.value or 0.0, size.std or 0.0
    return value > 0.0 and std < _WELL_TOLD * value


def _rms(search: PointsSearch, fit: PointsFit) -> float:
    return math.sqrt(float(np.mean((fit.left_out * search.noise) ** 2)))


def _coordinates(q: QAxis) -> tuple[Coordinate, ...]:
    t = () if q.t is None else (Coordinate("t", "s", q.t),)
    return (
        Coordinate("omega_e", "rad/s", q.omega_e), Coordinate("i_q", "A", q.i_q),
        Coordinate("abs(i_q)", "A", np.abs(q.i_q)), *t,
    )  # fmt: skip


def _halves(q: QAxis) -> list[NDArray[np.bool_]]:
    """Rows at more speed, at more current, and of the later half: what the equation misses moves sizes there."""
    speed, current = np.abs(q.omega_e), np.abs(q.i_q)
    halves = [speed >= np.median(speed), current >= np.median(current)]
    return halves if q.t is None else [*halves, q.t >= np.median(q.t)]


def _missed_current(q: QAxis, fit: PointsFit) -> dict[Key, float]:
    """What an i_d that was not recorded may do to the machine's parameters, SI: in step with i_q, or constant."""
    values = fit.values
    if q.i_d is not None:
        return {}
    L = abs(values.get((MACHINE, "L_q"), 0.0))
    speed, current = (math.sqrt(float(np.mean(x**2))) for x in (q.omega_e, q.i_q))
    return {(MACHINE, "R_s"): I_D * L * speed, (MACHINE, "psi_f"): I_D * L * current, (MACHINE, "L_q"): I_D * L}


def _no_L_q(q: QAxis, machine: Mapping[str, Quantity]) -> str:
    """Why these rows do not tell L_q, a clause."""
    R_s, L_q = (machine[name].value or 0.0 if name in machine else 0.0 for name in ("R_s", "L_q"))
    if q.noise > _NOISY:
        return "i_q changes too slowly beside its noise"
    if L_q <= 0.0 or q.T * R_s > _LONG * L_q:
        return f"rows of {number(1e3 * q.T)} ms are long beside L_q/R_s"
    return ""


def _looked_for(search: PointsSearch) -> str:
    titles = [title_of(name) for name in LOOKED_FOR if name in search.problem.effects]
    return (
        f"the q axis alone was recorded: {listed(titles)} were looked for; whether any other effect is there cannot be "
        "told, and L_d is not asked for"
    )


def _doubt(
    search: PointsSearch, choice: PointsChoice, found: Finding, others: Sequence[PointsChoice]
) -> Ambiguity | None:
    """The effect and a rival that these rows do not tell apart. A constant may be anything."""
    if found.effect == _OFFSET:
        why = "a constant of u_q may be an offset, or what rows of an instant leave of fast changes"
        return Ambiguity((_OFFSET,), why, Experiment(_INSTEAD), rivals=False)
    if found.rivals and found.rivals[0].odds < math.exp(SURE_LOG_ODDS):
        rival = found.rivals[0].effect
        return Ambiguity((found.effect, rival), judge.alike(search, choice, found), Experiment(_INSTEAD))
    for other in others:
        if found.effect not in other:
            instead = [name for name in other if name not in choice]
            how = f"with {listed(map(title_of, instead))} in its place" if instead else "without it"
            reason = f"{how} the rows are met about as well"
            return Ambiguity((found.effect, *instead), reason, Experiment(_INSTEAD), rivals=bool(instead))
    return None


def _as_good(search: PointsSearch, choice: PointsChoice) -> list[PointsChoice]:
    """Other sets that meet rows left out about as well: one or two effects more, less, or in the place of one."""
    names = tuple(search.problem.effects)
    tried: set[PointsChoice] = set()
    for less in (choice, *(tuple(c for c in choice if c != one) for one in choice)):
        free = [name for name in names if name not in less]
        tried |= {tuple(sorted((*less, *more))) for k in (0, 1, 2) for more in combinations(free, k)}
    tried -= {tuple(sorted(choice))}
    limit = AS_GOOD * search.fit(choice).missed
    return sorted(other for other in tried if search.fit(other).missed < limit)


def _doubted(
    q: QAxis, search: PointsSearch, choice: PointsChoice, others: Sequence[PointsChoice], moved: Mapping[Key, float],
    left: bool,
) -> dict[Key, float]:  # fmt: skip
    """Standard errors besides the fit's, SI."""
    fit = search.fit(choice)
    parts: list[Mapping[Key, float]] = [_missed_current(q, fit), moved, _missed_by_equations(fit)]
    parts += [search.moves(choice, _halves(q))] if left or choice else []
    at = fit.values
    if _OFFSET in choice:
        others = [*others, tuple(name for name in choice if name != _OFFSET)]
    for other in others:
        parts.append({key: abs(value - at[key]) for key, value in search.fit(other).values.items()
                      if key in at and key[0] == MACHINE})  # fmt: skip
    found: dict[Key, float] = {}
    for key in at:
        own = [part.get(key, 0.0) for part in parts]
        found[key] = math.hypot(own[0], max(own[1:], default=0.0))
    return found


def _missed_by_equations(fit: PointsFit) -> dict[Key, float]:
    """What the effects' equations miss of real ones may do to other sizes: they trade along the fit's covariance."""
    keys = [size.key for size in fit.sizes]
    found = dict.fromkeys(keys, 0.0)
    for name in fit.choice:
        if name not in BY_NAME:
            continue
        for k in fit.places(name):
            off = _FORM * math.sqrt(BY_NAME[name].discrepancy) * float(fit.x[k])
            if fit.covariance[k, k] > 0.0:
                trades = fit.covariance[:, k] / fit.covariance[k, k] * off
                found = {key: math.hypot(found[key], float(by)) for key, by in zip(keys, trades, strict=True)}
    return found


def _beyond_missed_current(q: QAxis, search: PointsSearch, choice: PointsChoice) -> PointsChoice:
    """The set without what is no larger than an i_d that was not recorded may make."""
    while q.i_d is None and choice:
        fit = search.fit(choice)
        least = _SEEN * _by_missed_current(q.omega_e, q.i_q, fit.values.get((MACHINE, "L_q"), 0.0))
        sizes = {
            name: float(np.sqrt(np.mean((search.signal(fit, name, fit.places(name)) * search.noise) ** 2)))
            for name in choice
        }
        faint = min(sizes, key=lambda name: sizes[name])
        if sizes[faint] > least:
            break
        choice = tuple(name for name in choice if name != faint)
    return choice


def _left(search: PointsSearch, choice: PointsChoice, coordinates: tuple[Coordinate, ...]) -> Unexplained | None:
    """What is left that goes smoothly with speed and current, where it matters."""
    log_odds, signal = judge.nameless(search, choice)
    rms = math.sqrt(float(np.mean((signal * search.noise) ** 2)))
    if log_odds <= ENTRY_LOG_ODDS or rms < _MATTERS * math.sqrt(float(np.mean(search.problem.y**2))):
        return None
    where = judge.place(search, signal, coordinates)
    return Unexplained(
        rms, where, f"a voltage of {quantity(rms, 'V')} that goes smoothly with speed and current, {where.sentence}"
    )


def _scatters(
    search: PointsSearch, before: PointsFit, after: PointsFit, coordinates: tuple[Coordinate, ...]
) -> tuple[Scatter, ...]:
    was, now = (fit.left_out * search.noise for fit in (before, after))
    return tuple(Scatter(f"{c.name}, {c.unit}", "u_q", _thin(c.value), _thin(was), _thin(now)) for c in coordinates)


def _thin(x: Array) -> Array:
    return x[:: max(1, len(x) // 1000)]
