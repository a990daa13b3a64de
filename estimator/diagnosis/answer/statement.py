"""Statement: a judged fit as a diagnosis - findings, doubts with what would tell, a verdict.

Knows nothing of how the set of effects was found.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Final

from estimator.diagnosis.answer.common_scale import scaled, uncalibrated
from estimator.diagnosis.answer.design import experiment
from estimator.diagnosis.answer.finding import finding_of
from estimator.diagnosis.answer.held_out import no_help
from estimator.diagnosis.answer.judged import Judged
from estimator.diagnosis.likelihood.evidence import Choice
from estimator.diagnosis.likelihood.given import Given
from estimator.diagnosis.search.fitting import Fitted
from estimator.diagnosis.search.flux_map_stage import saturations
from estimator.diagnosis.search.remainder import excess_of, leaves_some
from estimator.diagnosis.trust.rivals import SURE_LOG_ODDS, ambiguity, candidates, detectable, rivals
from estimator.diagnosis.verdict import (
    Ambiguity,
    Diagnosis,
    Experiment,
    Finding,
    Fit,
    Quantity,
    Unexplained,
    Verdict,
    verdict_of,
)
from estimator.diagnosis.words import number
from estimator.interval import Z_95
from estimator.machine import PARAMETERS
from estimator.twin.model import Model

_SEVERAL: Final = 2  # parameters
_NO_HELP: Final = "on stretches that took no part in the fit the error does not fall with it"


def stated(given: Given, judged: Judged) -> Diagnosis:
    """The diagnosis, but for its sentence and remarks on the recording."""
    (found, left, *_), machine, poorly = judged.explained, judged.machine, judged.poorly
    search, choice, model = found.search, found.choice, found.model
    faint = {one for some in judged.reasons.values() for one in some}
    outside, lacks = list(machine.outside.values()), poorly is not None or bool(machine.unidentified)
    richer = _would_tell(given, judged) if lacks or faint else None
    holds = not (lacks or outside or left is not None) and _same_without(found, faint, machine.after)
    doubts = [
        Ambiguity(tuple(name for name, _ in some), why, richer, rivals=False, machine_holds=holds)
        for why, some in judged.reasons.items() if richer is not None
    ]  # fmt: skip
    findings, rivalled = _findings(given, judged, tuple(one for one in choice if one not in faint))
    findings = [*saturations(judged.rows, found, machine.flux_map, machine.after), *findings]
    doubts = _once([*doubts, *rivalled])
    if findings and (why := _withheld(found, judged.fit, machine.after, given, machine.outside)) is not None:
        richer = richer or _would_tell(given, judged)
        doubts.append(Ambiguity(tuple(finding.effect for finding in findings), why, richer, rivals=False))
        findings = []
    if poorly is not None and richer is not None:
        why = f"{poorly}: what looks like it may be the machine's parameters, which this recording does not tell"
        findings = []
        if choice:
            doubts, left = [Ambiguity(tuple(name for name, _ in choice), why, richer, rivals=False)], None
    else:
        asked = machine.flux_map is None and (len(machine.outside) > 1 or (left is None and not doubts))
        beyond = scaled(machine.after, machine.outside, given.machine, given.tolerance, machine.scales) if asked else []
        doubts.extend(beyond or uncalibrated(findings, machine.scales, given.tolerance))
    verdict = verdict_of(findings, doubts, left, machine.unidentified)
    if outside and not doubts:  # effects do not explain the machine
        verdict = Verdict.PARTLY_EXPLAINED if findings else Verdict.UNEXPLAINED
    if poorly is not None and not doubts and left is None:
        verdict, outside = Verdict.NOT_ENOUGH_EXCITATION, [poorly]
    return Diagnosis(
        verdict, "", tuple(findings), tuple(doubts),
        _of_no_such_machine(left, [name for name in machine.outside if machine.after[name].std is None]),
        detectable(search, choice, excess_of(found), given.tolerance), machine.before, machine.after, judged.fit,
        candidates(search, choice), tuple(outside), judged.pictures, richer if lacks else None, scales=machine.scales,
        flux_map=None if machine.flux_map is None or not findings else machine.flux_map.table(), angle=model.angle,
    )  # fmt: skip


def _same_without(found: Fitted, faint: Collection[tuple[str, int]], after: Mapping[str, Quantity]) -> bool:
    """The machine fitted without what is in doubt lies within the intervals of the one that was fitted with it."""
    if found.model.bend is not None:
        return False
    without = found.search.fit(tuple(one for one in found.choice if one not in faint)).value
    return all(
        told.value is not None and told.std is not None and abs(told.value - value) <= Z_95 * told.std
        for told, value in zip((after[name] for name in PARAMETERS), without, strict=False)
    )


def _would_tell(given: Given, judged: Judged) -> Experiment:
    """What to record where the machine is not told, or an effect is in doubt."""
    noise = judged.explained.found.noise
    return experiment(judged.rows, Model(given.machine), noise, given.machine, given.tolerance)


def _findings(given: Given, judged: Judged, choice: Choice) -> tuple[list[Finding], list[Ambiguity]]:
    """Effects that are told, and those that a rival may be in the place of."""
    found, findings, doubts = judged.explained.found, list[Finding](), list[Ambiguity]()
    for one in choice:
        others = rivals(found.search, found.choice, one, judged.explained.at_best)
        close = [doubt for doubt in others if doubt.log_odds < SURE_LOG_ODDS]
        if close:
            pair, model = (one[0], close[0].effect), replace(found.model, bend=None)
            would_tell = experiment(judged.rows, model, found.noise, given.machine, given.tolerance, pair)
            doubts.append(ambiguity(one[0], close[0], would_tell))
            continue
        findings.append(finding_of(judged.rows, found, one, others, judged.residual))
    return findings, doubts


def _of_no_such_machine(left: Unexplained | None, ends: Sequence[str]) -> Unexplained | None:
    """What is left, described as no physics where several of L_d, L_q, psi_f are at the ends of what is searched."""
    if left is None or len({"L_d", "L_q", "psi_f"} & set(ends)) < _SEVERAL:
        return left
    no_such = (
        f"{number(left.rms_V)} V rms, beside a machine that is far from the nominal one: what it is cannot be told; "
        "check the nominal values, and the columns, their units and conventions"
    )
    return replace(left, description=no_such)


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
    kept: dict[frozenset[str], Ambiguity] = {}
    for doubt in doubts:
        kept.setdefault(frozenset(doubt.effects), doubt)
    return list(kept.values())
