"""Diagnose: a recording and a nominal machine to a verdict with findings, doubts, a model and how well it fits.

A pure function: the same samples give the same answer. Knows nothing of files and reports.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

from estimator.diagnosis.answer.common_scale import scaled, uncalibrated
from estimator.diagnosis.answer.design import experiment
from estimator.diagnosis.answer.finding import finding_of, told_sizes
from estimator.diagnosis.answer.held_out import no_help, odd_stretches, shown_held_out
from estimator.diagnosis.answer.parameters import told_machine
from estimator.diagnosis.answer.quality import SHORTEST, longest
from estimator.diagnosis.answer.sentences import sentence_of
from estimator.diagnosis.intake.bad_samples import without_bad
from estimator.diagnosis.intake.convention import Suspicion, suspected
from estimator.diagnosis.intake.data_sheet import contradicted
from estimator.diagnosis.intake.drive_data import believed
from estimator.diagnosis.intake.input_check import checked
from estimator.diagnosis.intake.prepared import prepared
from estimator.diagnosis.likelihood.columns import STRETCHES
from estimator.diagnosis.likelihood.evidence import Choice, Search
from estimator.diagnosis.likelihood.given import Given
from estimator.diagnosis.likelihood.identifiability import (
    APART,
    apart,
    not_borne_out,
    poorly_told,
    unidentified_inductances,
)
from estimator.diagnosis.search.exchange import all_saturations_at_once, one_for_others, without_idle
from estimator.diagnosis.search.fitting import Fitted, at_nominal, fitted, without
from estimator.diagnosis.search.flux_map_stage import fitted_by_map, has_map, saturations
from estimator.diagnosis.search.remainder import (
    LIKE_RESONANCE,
    alone,
    excess_of,
    leaves_some,
    not_astray,
    unexplained_by,
    upright,
)
from estimator.diagnosis.trust.rivals import SURE_LOG_ODDS, ambiguity, candidates, detectable, rivals
from estimator.diagnosis.trust.surrogate import Surrogates
from estimator.diagnosis.verdict import (
    Ambiguity,
    Diagnosis,
    Experiment,
    Finding,
    Fit,
    Place,
    Quantity,
    Unexplained,
    Verdict,
    verdict_of,
)  # fmt: skip
from estimator.diagnosis.words import continued, number
from estimator.machine import PARAMETERS, Machine
from estimator.physics import convention_error, voltage_delay
from estimator.physics.library import BY_NAME
from estimator.physics.rows import Rows
from estimator.samples import Samples
from estimator.twin.model import Model, residual

TOLERANCE: Final = 0.10  # of a data sheet's R_s, L_d, L_q, psi_f
_FEWEST: Final = 50 * STRETCHES  # rows
_MAPPED: Final = (
    "the flux linkages bend as no saturation curve of the library does: a free map of them over the currents is a part "
    "of this diagnosis"
)
_MOST_OF_A_ROW: Final = 0.5
_SEVERAL: Final = 2  # parameters
_NO_SIZE: Final = "what is found of it is less than its standard error"
_NO_HELP: Final = "on stretches that took no part in the fit the error does not fall with it"


def _silent(_share: float, _phase: str) -> None:
    return


def diagnose(runs: Sequence[Samples], nominal: Machine, *, trust: Mapping[str, float] | None = None,
             progress: Callable[[float, str], None] = _silent) -> Diagnosis:
    """Diagnose a recording's runs. `trust`: tolerance of R_s, L_d, L_q, psi_f as a share. `progress` may raise.

    Raises ValueError, in a sentence, for samples that cannot be diagnosed.
    """
    tolerance = {name: (trust or {}).get(name, TOLERANCE) for name in PARAMETERS}
    runs, left_out = without_bad(runs, nominal)
    checks = checked(runs, nominal)
    checks = checks._replace(remarks=(*left_out, *checks.remarks))
    long_enough = [run for run in runs if len(run) >= 3]
    rows_there = sum(map(len, long_enough))
    if checks.stop or rows_there < _FEWEST:
        few = f"expected at least {_FEWEST} rows to tell effects from noise, came {rows_there}; record some seconds"
        return _no_verdict(checks.remarks if checks.stop else (*checks.remarks, few))
    if (suspicion := suspected(long_enough, nominal, tolerance)) is not None:
        diagnosis = _explained_without(long_enough, nominal, tolerance, checks.remarks, progress, suspicion)
        if diagnosis is not None:
            return diagnosis
    elif (wrong := contradicted(long_enough, nominal)) is not None:
        return _no_verdict((*checks.remarks, wrong))
    diagnosis = _explained_without(long_enough, nominal, tolerance, checks.remarks, progress)
    assert diagnosis is not None
    return diagnosis


def _explained_without(
    runs: Sequence[Samples], nominal: Machine, tolerance: Mapping[str, float], remarks: Sequence[str],
    progress: Callable[[float, str], None], suspicion: Suspicion | None = None,
) -> Diagnosis | None:  # fmt: skip
    """The diagnosis of the recording without a suspected cause; None where the library takes some of that back."""
    if suspicion is not None:
        runs, nominal = suspicion.runs, suspicion.machine
    runs, not_used = believed(runs)
    remarks = (*remarks, *not_used)
    rows, given = prepared(runs, nominal, tolerance)
    if longest(odd_stretches(len(rows)) & rows.joined) < SHORTEST:
        return _no_verdict((*remarks, (
            f"expected stretches of at least {SHORTEST} periods without a gap to judge by; record over a faster link, "
            "or by a capture buffer"
        )))  # fmt: skip
    progress(0.0, "fitting")
    given = replace(given, untold=unidentified_inductances(at_nominal(rows, given)))
    by_form = alone(rows, given)
    there = _by_effects(rows, given, progress) if by_form is None else _There(*by_form)
    if suspicion is not None and _taken_back(suspicion, there.found.model, tolerance):
        return None
    diagnosis = _judged_fit(rows, given, there, progress)
    if suspicion is not None:
        diagnosis = _with_convention(diagnosis, suspicion)
    said = sentence_of(diagnosis, "" if suspicion is None else suspicion.says)
    causes = () if suspicion is None else (suspicion.sentence,)
    mapped = () if diagnosis.flux_map is None else (_MAPPED,)
    return replace(diagnosis, remarks=(*remarks, *causes, *diagnosis.remarks, *mapped), sentence=said)


class _There(NamedTuple):
    """What a recording holds."""

    found: Fitted
    left: Unexplained | None
    plain: Search | None = None  # what explains the rows without a flux map, where the model has one
    resonance: Unexplained | None = None  # what explains as much as the losses of the model
    again: bool = False  # what was doubted, or led astray, has been taken away
    at_best: Mapping[tuple[str, str], float] | None = None  # log-odds of effects over others at their best shapes


def _by_effects(rows: Rows, given: Given, progress: Callable[[float, str], None]) -> _There:
    found = fitted(rows, given, lambda share: progress(0.7 * share, "fitting"))
    progress(0.7, "judging")
    found, at_best = one_for_others(rows, found, given)
    compared = set(found.choice)
    progress(0.71, "judging")
    found = without_idle(all_saturations_at_once(rows, found, given), given)
    progress(0.72, "judging")
    found = not_astray(rows, found, given)
    left = unexplained_by(rows, found)
    if left is not None and (by_map := fitted_by_map(rows, given, found, progress)) is not None:
        by_map, left_by_map, _ = upright(rows, by_map, unexplained_by(rows, by_map), given)
        if has_map(by_map):
            return _There(by_map, left_by_map, found.search)
    found, left, resonance = upright(rows, found, left, given)
    return _There(found, left, resonance=resonance, at_best=at_best if set(found.choice) == compared else None)


def _taken_back(suspicion: Suspicion, model: Model, tolerance: Mapping[str, float]) -> bool:
    """What the library finds speaks against the cause: a machine that fits better as recorded, or rows moved too far,
    so that voltages act later than the corrected rows say.
    """
    if model.bend is None and suspicion.contradicted(model.machine, tolerance):
        return True
    shift, delay = suspicion.parameters.get("u_shift"), model.effects.get(voltage_delay.EFFECT.name)
    if shift is None or shift.value is None or delay is None:
        return False
    periods, direction = delay
    return periods * direction * math.copysign(1.0, shift.value) > _MOST_OF_A_ROW


def _no_verdict(remarks: Sequence[str]) -> Diagnosis:
    """Nothing can be fitted: what is wrong, and what to record instead."""
    said = "not enough to judge: " + "; ".join(remarks)
    return Diagnosis(
        Verdict.NOT_ENOUGH_EXCITATION, said[0].upper() + said[1:], (), (), None, {}, {}, {}, None, (), tuple(remarks),
        None,
    )  # fmt: skip


def _with_convention(diagnosis: Diagnosis, suspicion: Suspicion) -> Diagnosis:
    """The diagnosis of the corrected recording, and the cause that was corrected: in doubt where another does as well,
    or where parameters are off as by another scale still.
    """
    said = suspicion.sentence.removesuffix(".")
    perhaps = f"perhaps {continued(said)}"
    if suspicion.ambiguous:
        told = Experiment("look up the recording's units and conventions in the drive's manual")
        why = f"{perhaps}; it would look the same if {' or if '.join(suspicion.ambiguous[1:])}"
        names = (convention_error.NAME, *suspicion.rival_effects)
        doubt = Ambiguity(names, why, told, rivals=len(names) > 1)
        return replace(diagnosis, verdict=Verdict.AMBIGUOUS, ambiguous=(doubt, *diagnosis.ambiguous))
    off = [doubt for doubt in diagnosis.ambiguous if diagnosis.remarks and convention_error.NAME in doubt.effects]
    if off:
        doubt = replace(off[0], reason=f"{perhaps}; but even then {off[0].reason}")
        others = [other for other in diagnosis.ambiguous if other not in off]
        return replace(diagnosis, ambiguous=(doubt, *others))
    everywhere = Place("in every row", {}, 1.0, 1.0)
    finding = Finding(
        convention_error.NAME, suspicion.parameters, everywhere, min(suspicion.odds, 1e300), suspicion.rivals, {}
    )
    verdict = diagnosis.verdict
    if verdict is Verdict.NO_MISMATCH:
        verdict = Verdict.EXPLAINED
    elif verdict is Verdict.UNEXPLAINED:
        verdict = Verdict.PARTLY_EXPLAINED
    return replace(
        diagnosis, verdict=verdict, findings=(finding, *diagnosis.findings), pole_pairs=suspicion.machine.n_p
    )


def _judged_fit(rows: Rows, given: Given, there: _There, progress: Callable[[float, str], None]) -> Diagnosis:
    found, left, plain, resonance, again, at_best = there
    nominal, tolerance = given.machine, given.tolerance
    search, choice, model = found.search, found.choice, found.model
    rows = rows.with_machine(model.machine)
    findings: list[Finding] = []
    excess = excess_of(found)
    lent = max(excess, 0.0) if left is not None else 0.0
    machine_before, machine_after, flux_map, off, blind, scales = told_machine(found, plain, lent, given)
    outside = list(off.values())
    poorly = poorly_told(search, choice, nominal, outside)
    surrogates = Surrogates(found, given)
    reasons = _doubted(found, blind, excess, resonance, surrogates.stands_out)
    faint = tuple(one for some in reasons.values() for one in some)
    progress(0.75, "simulating")
    r_after = residual(rows, found.smooth, model)
    fit, pictures = shown_held_out(rows, found, r_after, plain or search)
    if faint and (other := _undoubted(rows, found, faint, fit, given, surrogates, again)) is not found:
        return _judged_fit(rows, given, _There(other, unexplained_by(rows, other), plain, again=True), progress)
    progress(0.9, "judging")
    lacks = poorly is not None or bool(blind)
    richer = experiment(rows, Model(nominal), found.noise, nominal, tolerance) if lacks or faint else None
    doubts = [
        Ambiguity(tuple(name for name, _ in some), why, richer, rivals=False)
        for why, some in reasons.items() if richer is not None
    ]  # fmt: skip
    for one in (each for each in choice if each not in faint):
        others = rivals(search, choice, one, at_best)
        close = [doubt for doubt in others if doubt.log_odds < SURE_LOG_ODDS]
        if close:
            pair = (one[0], close[0].effect)
            would_tell = experiment(rows, replace(model, bend=None), found.noise, nominal, tolerance, pair)
            doubts.append(ambiguity(one[0], close[0], would_tell))
            continue
        findings.append(finding_of(rows, found, one, others, r_after))
    findings = [*saturations(rows, found, flux_map, machine_after), *findings]
    doubts = _once(doubts)
    if findings and (why := _withheld(found, fit, machine_after, given, off)) is not None:
        richer = richer or experiment(rows, Model(nominal), found.noise, nominal, tolerance)
        doubts.append(Ambiguity(tuple(finding.effect for finding in findings), why, richer, rivals=False))
        findings = []
    if poorly is not None and richer is not None:
        why = f"{poorly}: what looks like it may be the machine's parameters, which this recording does not tell"
        findings = []
        if choice:
            doubts, left = [Ambiguity(tuple(name for name, _ in choice), why, richer, rivals=False)], None
    else:
        asked = flux_map is None and (len(off) > 1 or (left is None and not doubts))
        beyond = scaled(machine_after, off, nominal, tolerance, scales) if asked else []
        doubts.extend(beyond or uncalibrated(findings, scales, tolerance))
    verdict = verdict_of(findings, doubts, left, blind)
    if outside and not doubts:  # effects do not explain the machine
        verdict = Verdict.PARTLY_EXPLAINED if findings else Verdict.UNEXPLAINED
    if poorly is not None and not doubts and left is None:
        verdict, outside = Verdict.NOT_ENOUGH_EXCITATION, [poorly]
    limits = detectable(search, choice, excess_of(found), tolerance)
    return Diagnosis(
        verdict, "", tuple(findings), tuple(doubts),
        _of_no_such_machine(left, [name for name in off if machine_after[name].std is None]),
        limits, machine_before, machine_after, fit,
        candidates(search, choice), tuple(outside), pictures, richer if lacks else None, scales=scales,
        flux_map=None if flux_map is None or not findings else flux_map.table(), angle=model.angle,
    )  # fmt: skip


def _of_no_such_machine(left: Unexplained | None, ends: Sequence[str]) -> Unexplained | None:
    """What is left, described as no physics where several of L_d, L_q, psi_f are at the ends of what is searched."""
    if left is None or len({"L_d", "L_q", "psi_f"} & set(ends)) < _SEVERAL:
        return left
    no_such = (
        f"{number(left.rms_V)} V rms, beside a machine that is far from the nominal one: what it is cannot be told; "
        "check the nominal values, and the columns, their units and conventions"
    )
    return replace(left, description=no_such)


def _doubted(
    found: Fitted, blind: Sequence[str], excess: float, resonance: Unexplained | None,
    stands: Callable[[tuple[str, int], Choice, bool], bool],
) -> dict[str, Choice]:  # fmt: skip
    """Effects that get no name, by why. `stands`: one, which may be doubted, stands out from what surrogates without it
    show.
    """
    reasons = not_borne_out(found.search, found.choice, blind, excess, stands)
    already = [one for some in reasons.values() for one in some]
    if nothing := tuple(one for one in found.choice if one not in already and _of_no_size(found, one)):
        reasons, already = {**reasons, _NO_SIZE: nothing}, [*already, *nothing]
    losses = tuple(one for one in found.choice if one[0] in LIKE_RESONANCE and one not in already)
    return {**reasons, f"it may as well be {resonance.description}": losses} if resonance and losses else reasons


def _of_no_size(found: Fitted, one: tuple[str, int]) -> bool:
    """An effect's only size, as it would be told, is less than its standard error."""
    effect, rows = BY_NAME[one[0]], found.smooth.with_machine(found.model.machine)
    shapes = {parameter.name for parameter in effect.parameters if parameter.shape}
    sizes = [told for name, told in told_sizes(effect, rows, found, one).items() if name not in shapes]
    return len(sizes) == 1 and sizes[0].value is not None and abs(sizes[0].value) < (sizes[0].std or 0.0)


def _undoubted(
    rows: Rows, found: Fitted, faint: Choice, fit: Fit, given: Given, surrogates: Surrogates, again: bool
) -> Fitted:
    """The fit, or, where it went astray or what is in doubt does not help, one from which others may show.

    No doubt is worth telling of what surrogates without it show as much of - but where it looks like the machine's
    parameters, which are off by as much if it is there.
    """
    other = found if again else not_astray(rows, found, given)
    if other is not found and excess_of(other) < excess_of(found):
        return other
    if no_help(found, fit):
        return without(found, [name for name, _ in faint], given)
    shares = apart(found.search, found.choice)
    unlike = [one for one in faint if shares[one[0]] > APART]
    chance = [one[0] for one in unlike if surrogates.show_as_much(one, found.choice)]
    return without(found, chance, given) if chance else found


def _withheld(
    found: Fitted, fit: Fit, after: Mapping[str, Quantity], given: Given, off: Mapping[str, str]
) -> str | None:
    """Why nothing gets a name, in a sentence's part: it does not help, or parameters that are `off` are no machine's,
    where more than noise is left.
    """
    if no_help(found, fit):
        return _NO_HELP
    for name, said in off.items() if leaves_some(found) else ():
        if given.far_off(name, after[name].value or 0.0):
            return f"{said}, and more than noise is left: names may be as wrong as this machine"
    return None


def _once(doubts: Sequence[Ambiguity]) -> list[Ambiguity]:
    seen: set[frozenset[str]] = set()
    kept: list[Ambiguity] = []
    for doubt in doubts:
        if frozenset(doubt.effects) not in seen:
            seen.add(frozenset(doubt.effects))
            kept.append(doubt)
    return kept
