"""Diagnose steady points: a table of them to a verdict with findings, doubts and how well left-out points are met.

A pure function: the same points give the same answer. Knows nothing of files and reports.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array
from estimator.diagnosis.answer.sentences import quantity, with_contradictions, with_interval, with_sentence
from estimator.diagnosis.likelihood.evidence import ENTRY_LOG_ODDS
from estimator.diagnosis.points import judge, model
from estimator.diagnosis.points.fit import PointsFit
from estimator.diagnosis.points.judge import Coordinate, odds_text
from estimator.diagnosis.points.search import PointsChoice, PointsSearch
from estimator.diagnosis.points.table import FEWEST_POINTS, Points, steady
from estimator.diagnosis.points.witnessed import witnessed
from estimator.diagnosis.trust.rivals import SURE_LOG_ODDS
from estimator.diagnosis.verdict import (
    Ambiguity,
    Diagnosis,
    ErrorChange,
    Experiment,
    Finding,
    Hold,
    LeaveOneOut,
    Quantity,
    Scatter,
    Unexplained,
    Verdict,
    verdict_of,
)
from estimator.diagnosis.verdict import Fit as Quality
from estimator.diagnosis.words import number, rounded
from estimator.machine import PARAMETERS
from estimator.physics.library import BY_NAME
from estimator.witness import Witness

_STANDING_SPEED: Final = 1e-3  # of the largest speed
_GROUPS: Final = 5
_SURELY: Final = 3.0  # standard errors
_WELL_TOLD: Final = 0.5  # of a value, that its standard error may be
_COLOURED: Final = 2.0  # times the noise from row to row: more is left than noise
_TELLING: Final = 4  # points of an experiment
_SECONDS: Final = 2.0  # at each
_POINT_SPEEDS: Final = (1.0, 0.5, 0.2, -0.2, -0.5, -1.0)  # of the fastest
_POINT_I_D: Final = (0.0, -0.5, -1.0, 0.5)  # of the largest current
_POINT_I_Q: Final = (0.0, 0.2, -0.2, 0.7, -0.7)
_RPM: Final = 30.0 / math.pi


def diagnose_points(
    points: Points, *, n_p: int | None = None, i_rated: float | None = None,
    witnesses: Mapping[str, Witness] | None = None,
) -> Diagnosis:
    """Diagnose points with both voltages and both currents. `n_p`: pole pairs, for the speeds of experiments."""
    kept = steady(points)
    points, remarks = kept.points, list(kept.remarks)
    if len(points) < FEWEST_POINTS:
        remarks.append(f"expected at least {FEWEST_POINTS} steady points with current and speed, came {len(points)}")
        return no_verdict(remarks, "record more operating points, each until nothing moves")
    if np.any(np.abs(points.omega_e) < _STANDING_SPEED * np.max(np.abs(points.omega_e), initial=1e-9)):
        remarks.append("at standstill what an inverter loses depends on the angle: its voltage error is that of a turn")
    rated = i_rated or float(np.max(np.abs(points.i)))
    if rated <= 0.0:
        remarks.append("expected points with current, came none")
        return no_verdict(remarks, "record points with current on both axes")
    problem = model.points_problem(points, rated)
    groups = len(np.unique(problem.group))
    if groups < _GROUPS:
        remarks.append(f"expected at least {_GROUPS} different operating points, came {groups}")
        return no_verdict(remarks, "record more operating points: other speeds and currents on both axes")
    search = PointsSearch(problem)
    choice = search.chosen()
    if i_rated is None and any(name.endswith("saturation") for name in choice):
        remarks.append(f"drops of inductance are those at {number(rated)} A, the largest current among these points")
    return _diagnosis_of_points(points, search, choice, remarks, n_p, witnesses or {})


def no_verdict(remarks: Sequence[str], instead: str) -> Diagnosis:
    """Nothing can be fitted: what is wrong, and what to record instead."""
    return with_sentence(Diagnosis(
        Verdict.NOT_ENOUGH_EXCITATION, "", (), (), None, {}, {}, {}, None, (), tuple(remarks), None, Experiment(instead)
    ))  # fmt: skip


def _diagnosis_of_points(
    points: Points, search: PointsSearch, choice: PointsChoice, remarks: list[str], n_p: int | None,
    witnesses: Mapping[str, Witness],
) -> Diagnosis:
    coordinates = _coordinates(points)
    before, after = search.fit(()), search.fit(choice)
    floor = noise_floor(points, _error_of_points(search, after, left_out=False))
    left = _left_of_points(search, choice, coordinates, floor)
    doubted = {} if left is None else search.moves(choice, _halves(coordinates))
    gains = search.brings(choice)
    by_odds = sorted(choice, key=lambda name: -gains[name])
    told = witnessed(after.doubted(doubted), witnesses)
    found = [
        replace(judge.finding(search, choice, effect, coordinates, {}), parameters=judge.sizes(told.fit, effect))
        for effect in by_odds
    ]
    remarks += told.remarks
    doubts = [doubt for f in found if (doubt := _doubt(points, search, choice, f, n_p)) is not None]
    unsure = {doubt.effects[0] for doubt in doubts}
    findings = tuple(f for f in found if f.effect not in unsure)
    hints = judge.hints(search, choice)
    if hints and not found:
        doubts.append(_hinted(points, search, choice, hints, n_p))
    elif hints:
        remarks.append(_hints_text(hints))
    remarks += _drifts(points, search, choice)
    machine_before, machine_after = judge.machine(before), judge.machine(told.fit)
    negative = [name for name, size in machine_after.items() if (size.value or 0.0) < -_SURELY * (size.std or 0.0)]
    if negative:
        return _wrong_way(negative, machine_before, remarks)
    unidentified = [
        name for name, size in machine_after.items() if not (size.std or 0.0) < _WELL_TOLD * abs(size.value or 0.0)
    ]
    instead = None
    if unidentified:
        remarks.append(f"these points do not tell {', '.join(unidentified)}")
        instead = Experiment("record steady points at several speeds with several levels of i_d and of i_q")
    return with_contradictions(with_sentence(Diagnosis(
        verdict_of(findings, doubts, left, unidentified), "", findings, tuple(doubts), left,
        judge.detectable_at_points(search, choice), machine_before, machine_after,
        quality(
            search, _rms_of_points(search, _error_of_points(search, before)),
            _rms_of_points(search, _error_of_points(search, after)), floor,
            "stretch of time" if points.t is not None else "operating point", {},
        ),
        judge.point_candidates(search, choice), tuple(remarks), None, instead,
        _scatter_of_points(search, before, after, coordinates),
    )), told.against)  # fmt: skip


def _wrong_way(names: Sequence[str], machine: Mapping[str, Quantity], remarks: Sequence[str]) -> Diagnosis:
    """No machine is like this: nothing that is said of it would hold."""
    why = (
        f"{', '.join(names)} come out negative: expected peak dq quantities in the motor's sign convention, d on the "
        "magnets' flux; look for a wrong sign of speed, voltage or current, or for swapped axes"
    )
    diagnosis = with_sentence(Diagnosis(
        Verdict.UNEXPLAINED, "", (), (), None, {}, machine, {}, None, (), (why,), None,
        Experiment("look up the signs and axes of the points in the drive's manual"),
    ))  # fmt: skip
    return replace(diagnosis, remarks=(*remarks, why))


def quality(
    search: PointsSearch, was: float, now: float, floor: float | None, left_out: str, alternatives: Mapping[str, float]
) -> Quality:
    """How well rows that took no part are met: rms (V) without and with the effects."""
    groups = len(np.unique(search.problem.group))
    loo = LeaveOneOut(left_out, groups, was, now, "V", alternatives)
    explained = max(0.0, 1.0 - (now / was) ** 2) if was > 0.0 else 0.0
    nothing = ErrorChange(math.nan, math.nan)
    return Quality(True, ErrorChange(was, now, floor), nothing, explained, nothing, loo)


def _error_of_points(search: PointsSearch, fit: PointsFit, *, left_out: bool = True) -> Array:
    return (fit.left_out if left_out else fit.r) * search.noise


def _rms_of_points(search: PointsSearch, error: Array) -> float:
    axes = len(np.unique(search.problem.axis))
    return math.sqrt(axes * float(np.mean(error**2)))


def _coordinates(points: Points) -> tuple[Coordinate, ...]:
    of_points = (
        ("abs(omega_e)", "rad/s", np.abs(points.omega_e)), ("abs(i_q)", "A", np.abs(points.i.imag)),
        ("i_d", "A", points.i.real), ("abs(i)", "A", np.abs(points.i)),
    )  # fmt: skip
    return tuple(Coordinate(name, unit, np.tile(x, 2)) for name, unit, x in of_points)  # on both axes


def _halves(coordinates: tuple[Coordinate, ...]) -> list[NDArray[np.bool_]]:
    """Points at more speed, and at more current, than half of them: what equations miss moves sizes there."""
    speed, current = coordinates[0].value, coordinates[-1].value
    return [speed >= np.median(speed), current >= np.median(current)]


# --- doubts


def _doubt(
    points: Points, search: PointsSearch, choice: PointsChoice, found: Finding, n_p: int | None
) -> Ambiguity | None:
    """The effect and a rival that these points do not tell apart."""
    if not found.rivals or found.rivals[0].odds >= math.exp(SURE_LOG_ODDS):
        return None
    one, rival = found.effect, found.rivals[0]
    rest = tuple(name for name in choice if name != one)
    told = _telling(points, search.fit(choice), search.fit((*rest, rival.effect)), n_p)
    return Ambiguity((one, rival.effect), judge.alike(search, choice, found), told)


def _hinted(
    points: Points, search: PointsSearch, choice: PointsChoice, hints: Mapping[str, float], n_p: int | None
) -> Ambiguity:
    """Effects that nearly earned their name, where none did."""
    one, *others = hints
    there = search.fit((*choice, one))
    against = search.fit((*choice, others[0])) if others else search.fit(choice)
    experiment = _telling(points, there, against, n_p)
    return Ambiguity((one, *others), _hints_text(hints), experiment, rivals=bool(others))


def _hints_text(hints: Mapping[str, float]) -> str:
    told = ", ".join(f"{BY_NAME[name].title} (odds {odds_text(odds)})" for name, odds in hints.items())
    return f"too little to be named, for which odds of {odds_text(ENTRY_LOG_ODDS)} are asked: {told}"


def _telling(points: Points, one: PointsFit, other: PointsFit, n_p: int | None) -> Experiment:
    """Points within reach of those there at which two explanations differ most."""
    fastest = float(np.max(np.abs(points.omega_e)))
    most, reach = float(np.max(np.abs(points.i))), float(np.max(np.abs(points.u)))
    levels = [level for level in product(_POINT_SPEEDS, _POINT_I_D, _POINT_I_Q) if math.hypot(*level[1:]) <= 1.0]
    i = np.array([most * complex(d, q) for _, d, q in levels], np.complex128)
    t = None if points.t is None else np.full(len(i), float(np.max(points.t)))
    asked = Points(fastest * np.array([speed for speed, _, _ in levels]), i, np.zeros(len(i), np.complex128), t)
    u, v = (model.voltage(asked, most, fit.values) for fit in (one, other))
    gap = np.where(np.maximum(np.abs(u), np.abs(v)) <= reach, np.abs(u - v), 0.0)
    chosen = [int(k) for k in np.argsort(-gap, kind="stable")[:_TELLING] if gap[k] > 0.0]
    if not chosen:
        return Experiment("record more points at other speeds and currents")
    held = [(float(asked.omega_e[k]), complex(asked.i[k])) for k in chosen]
    speed = (f"{number(w, 2)} rad/s" for w, _ in held) if n_p is None else (
        f"{number(w * _RPM / n_p, 2)} rpm" for w, _ in held
    )
    where = "; ".join(
        f"{rpm}, i_d {number(i.real, 2)} A, i_q {number(i.imag, 2)} A" for rpm, (_, i) in zip(speed, held, strict=True)
    )
    sentence = f"steady points at {where} would tell: there the two differ by up to {quantity(float(gap.max()), 'V')}"
    if n_p is None:
        return Experiment(sentence)
    holds = tuple(Hold(rounded(w * _RPM / n_p), rounded(i.real), rounded(i.imag), _SECONDS) for w, i in held)
    speeds, i_d, i_q = (tuple(sorted({getattr(hold, name) for hold in holds})) for name in ("speed_rpm", "i_d", "i_q"))
    return Experiment(sentence, speeds, i_d, i_q, _SECONDS * len(holds), holds)


# --- what is told besides


def _drifts(points: Points, search: PointsSearch, choice: PointsChoice) -> list[str]:
    """What a log can tell of slow changes, and what not."""
    if points.t is None:
        return []
    told: list[str] = []
    halves = _halves(_coordinates(points))
    length = float(np.max(points.t) - np.min(points.t))
    smallest = judge.detectable_at_points(search, choice)
    for name in model.TIMED:
        if name in choice:
            continue
        (size,) = search.problem.effects[name]
        fit = search.fit((*choice, name))
        moved = search.moves((*choice, name), halves)
        value, std = fit.value(*size.key), math.hypot(fit.std(*size.key), moved[size.key])
        drift = f"{'+' if value > 0.0 else ''}{with_interval(100.0 * value, 100.0 * std)} %"
        limit = smallest[name].value if name in smallest else None
        told.append(
            f"{BY_NAME[name].title} is not told from none: {drift} from first to last of {number(length)} s"
            + ("" if limit is None else f"; one of {100.0 * limit:.2g} % would have been named")
        )
    return told


def noise_floor(points: Points, error: Array) -> float | None:
    """Rms of the voltage vector that neighbouring rows of a log do not share; None where there are none."""
    if points.t is None or len(points) < FEWEST_POINTS:
        return None
    step = np.diff(points.t)
    near = np.flatnonzero(step <= 1.01 * float(np.min(step)))
    e = error[: len(points)] + 1j * error[len(points) :]
    return math.sqrt(float(np.mean(np.abs(np.diff(e)[near]) ** 2)) / 2.0)


def _left_of_points(
    search: PointsSearch, choice: PointsChoice, coordinates: tuple[Coordinate, ...], floor: float | None
) -> Unexplained | None:
    """What is left beyond noise."""
    log_odds, signal = judge.nameless(search, choice)
    fit = search.fit(choice)
    total = _rms_of_points(search, _error_of_points(search, fit, left_out=False))
    if floor is not None and total > _COLOURED * floor:
        e = fit.r
        where = judge.place(search, e, coordinates)
        rms = math.sqrt(total**2 - floor**2)
        return Unexplained(rms, where, (
            f"{quantity(rms, 'V')} that neighbouring rows share, beside {quantity(floor, 'V')} of noise from row to "
            f"row, {where.sentence}"
        ))  # fmt: skip
    if log_odds <= ENTRY_LOG_ODDS:
        return None
    rms = _rms_of_points(search, signal * search.noise)
    where = judge.place(search, signal, coordinates)
    return Unexplained(
        rms, where, f"a voltage of {quantity(rms, 'V')} that goes smoothly with speed and current, {where.sentence}"
    )


def _scatter_of_points(
    search: PointsSearch, before: PointsFit, after: PointsFit, coordinates: tuple[Coordinate, ...]
) -> tuple[Scatter, ...]:
    was, now = _error_of_points(search, before), _error_of_points(search, after)
    axis = search.problem.axis
    return tuple(
        Scatter(f"{c.name}, {c.unit}", f"u_{'dq'[int(a)]}", c.value[axis == a], was[axis == a], now[axis == a])
        for a in np.unique(axis) for c in coordinates[:3]
    )  # fmt: skip


def given_off(machine: Mapping[str, Quantity], given: Mapping[str, float], trust: Mapping[str, float]) -> list[str]:
    """Fitted parameters that sit outside what a nominal machine allows, in words."""
    return [
        f"{name} is {quantity(machine[name].value, machine[name].unit)}, the nominal machine says "
        f"{quantity(given[name], machine[name].unit)}"
        for name in PARAMETERS
        if name in machine and name in given and abs((machine[name].value or 0.0) - given[name])
        > trust.get(name, 0.1) * given[name] + 3.0 * (machine[name].std or 0.0)
    ]  # fmt: skip
