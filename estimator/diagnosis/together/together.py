"""Several recordings of one machine in one diagnosis: what they share, and what differs between them.

Each recording is diagnosed alone first; then each is fitted with the effects of all. R_s, psi_f and what drifts are
states: each recording has its own, and that they differ is told. L_d, L_q and the sizes of effects are one number for
all recordings where chance makes their difference; where it does not, that is told, too: so an effect shows that was
switched on. Knows nothing of files.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from estimator.diagnosis.answer.sentences import plural, quantity, title_of
from estimator.diagnosis.diagnose import Examined, examined
from estimator.diagnosis.together.alike import shared
from estimator.diagnosis.together.decided import Decision, decided
from estimator.diagnosis.together.differences import is_none, of_effect, of_machine
from estimator.diagnosis.together.refitted import CONSTANTS, MISSED, Refitted, all_effects, joint_equation
from estimator.diagnosis.together.said import Kind, Shared, SharedFinding, Together
from estimator.diagnosis.verdict import Ambiguity, Diagnosis, Quantity, Unexplained, Verdict, odds_of, verdict_of
from estimator.diagnosis.words import listed, sentence_start
from estimator.machine import PARAMETERS, Machine
from estimator.physics import convention_error
from estimator.physics.effect import Sizes
from estimator.physics.library import BY_NAME
from estimator.samples import Samples
from estimator.witness import Witness

_ALONE: Final = 0.8  # share of the work
_OPEN: Final = (Verdict.AMBIGUOUS, Verdict.NOT_ENOUGH_EXCITATION)
_TOLD: Final = 0.5  # of a tolerance: a parameter that is uncertain by more is not told


@dataclass(frozen=True, slots=True)
class Named:
    """A recording by the name that users know it by."""

    name: str
    runs: Sequence[Samples]


def diagnose_together(recordings: Sequence[Named], nominal: Machine, *, trust: Mapping[str, float] | None = None,
                      witnesses: Mapping[str, Witness] | None = None,
                      progress: Callable[[float, str], None] = lambda _share, _phase: None) -> Together:
    """Diagnose recordings of one machine. `trust`, `witnesses`: as in `diagnose`. `progress` may raise.

    Raises ValueError, in a sentence, for fewer than two recordings, two of one name, and samples that cannot be
    diagnosed.
    """
    names = [one.name for one in recordings]
    if len(set(names)) < max(len(names), 2):
        raise ValueError(f"expected two recordings or more, each of its own name, got {', '.join(names) or 'none'}")
    alone: list[Examined] = []
    for k, recording in enumerate(recordings):

        def of_one(share: float, phase: str, k: int = k, name: str = recording.name) -> None:
            progress(_ALONE * (k + share) / len(recordings), f"{name}: {phase}")

        try:
            alone.append(examined(recording.runs, nominal, trust=trust, witnesses=witnesses, progress=of_one))
        except ValueError as error:
            raise ValueError(f"{recording.name}: {error}") from error
    for k, one in enumerate(alone):  # a convention of one recording alone, which does not explain it
        if _unexplained(one) is not None and _of_convention(one) and not all(map(_of_convention, alone)):
            progress(_ALONE, f"{names[k]}: as recorded")
            other = examined(recordings[k].runs, nominal, trust=trust, witnesses=witnesses, as_recorded=True)
            alone[k] = other if other.judged is not None and _unexplained(other) is None else one
    for k, one in enumerate(alone):  # what a recording does not tell of the constants others may
        known = _constants([other for n, other in enumerate(alone) if n != k])
        if one.diagnosis.verdict in _OPEN and known:
            progress(_ALONE, f"{names[k]}: with L_d and L_q of the others")
            witnessed = {**known, **(witnesses or {})}
            other = examined(recordings[k].runs, nominal, trust=trust, witnesses=witnessed)
            alone[k] = one if len(other.diagnosis.ambiguous) > len(one.diagnosis.ambiguous) else other
    progress(_ALONE, "all together")
    fits = {
        name: Refitted(one.judged.rows, one.given, one.judged.explained.found)
        for name, one in zip(names, alone, strict=True)
        if one.judged is not None and one.given is not None and one.judged.poorly is None
    }  # fmt: skip
    for name, fit in fits.items():
        if fit.left is not None:
            fits[name] = fit.by_effects_of([one for other, one in fits.items() if other != name and one.left is None])
    return _said(names, [one.diagnosis for one in alone], fits)


def _constants(some: Sequence[Examined]) -> dict[str, Witness]:
    """L_d and L_q as the recording tells them that tells them best; none where no recording does."""
    found: dict[str, Witness] = {}
    for name in CONSTANTS:
        told = [one.diagnosis.machine_after.get(name) for one in some if one.diagnosis.verdict not in _OPEN]
        each = [Witness(x.value, math.hypot(x.std, MISSED[name] * x.value)) for x in told if x and x.value and x.std]
        if each:
            found[name] = min(each, key=lambda one: one.std)
    return found


def _unexplained(one: Examined) -> Unexplained | None:
    return None if one.judged is None else one.judged.explained.left


def _of_convention(one: Examined) -> bool:
    """A convention is told, or may be one."""
    findings, doubts = one.diagnosis.findings, one.diagnosis.ambiguous
    return convention_error.NAME in {*(each.effect for each in findings), *(x for each in doubts for x in each.effects)}


def _said(names: Sequence[str], diagnoses: Sequence[Diagnosis], fits: Mapping[str, Refitted]) -> Together:
    silent = [name for name in names if name not in fits]
    doubts = [
        doubt for name, diagnosis in zip(names, diagnoses, strict=True) if name in fits or not fits
        for doubt in diagnosis.ambiguous
    ]  # fmt: skip
    effects, decisions = _settled(doubts, list(fits.values()))
    fits = {name: one.with_effects(effects) for name, one in fits.items()}
    doubts = _still_open(doubts, decisions, diagnoses)
    doubted = {name for doubt in doubts for name in doubt.effects}
    numbers = len(PARAMETERS) + sum(len(BY_NAME[name].sizes) for name in effects)
    machine = {name: _parameter(name, names, fits, numbers) for name in PARAMETERS}
    named = {finding.effect for one in diagnoses for finding in one.findings} | {one.effect for one in decisions}
    findings = [
        *(_of_no_column(name, names, diagnoses) for name in sorted(named - BY_NAME.keys() - doubted)),
        *(_finding(name, names, fits, diagnoses, numbers) for name in effects if name in named and name not in doubted),
    ]
    differences = [
        *(each for name, number in machine.items() for each in of_machine(name, number, names)),
        *(each for one in findings for each in of_effect(one, names)),
    ]
    outside = [f"{name}: {said}" for name, one in fits.items() for said in one.outside.values()]
    settled = (Verdict.EXPLAINED, Verdict.NO_MISMATCH, Verdict.NOT_ENOUGH_EXCITATION)
    ill = [name for name, one in zip(names, diagnoses, strict=True) if name in silent and one.verdict not in settled]
    astray = bool(outside or ill) or any(each.kind is Kind.CONSTANT for each in differences)
    remarks = [f"{name} has no part in the numbers: it tells the machine too poorly" for name in silent]
    remarks += [f"{name}: {remark}" for name, one in zip(names, diagnoses, strict=True) for remark in one.remarks]
    said = Together(
        _verdict(findings, doubts, machine, fits, astray=astray), "", tuple(names), machine, tuple(findings),
        tuple(differences), tuple(doubts), tuple(dict.fromkeys((*remarks, *outside))), tuple(diagnoses),
    )
    left = {name: one.left for name, one in fits.items() if one.left is not None}
    return replace(said, sentence=_sentence_of(said, decisions, left, silent))


def _settled(doubts: Sequence[Ambiguity], fits: Sequence[Refitted]) -> tuple[dict[str, Sizes], list[Decision]]:
    """The effects of all recordings, and what has become of doubts between two of them."""
    effects, decisions = all_effects(fits), list[Decision]()
    for doubt in doubts:
        if any({one.effect, one.other} == set(doubt.effects) for one in decisions):
            continue
        one = decided(doubt, effects, fits)
        if one is not None and one.sure:
            decisions.append(one)
            effects = {name: at for name, at in effects.items() if name != one.other} | {one.effect: one.sizes}
    return effects, decisions


def _still_open(
    doubts: Sequence[Ambiguity], decisions: Sequence[Decision], diagnoses: Sequence[Diagnosis]
) -> list[Ambiguity]:
    """Doubts that no other recording settles, each once: whether an effect is there at all, one that names it does."""
    named = {finding.effect for one in diagnoses for finding in one.findings}
    settled = [{one.effect, one.other} for one in decisions]
    kept: dict[frozenset[str], Ambiguity] = {}
    for doubt in doubts:
        effects = set(doubt.effects)
        if effects not in settled and (doubt.rivals or not effects <= named):
            kept.setdefault(frozenset(effects), doubt)
    return list(kept.values())


def _parameter(name: str, names: Sequence[str], fits: Mapping[str, Refitted], numbers: int) -> Shared:
    each = [fits[one].machine[name] if one in fits else None for one in names]
    apart = [
        None if one is None or one.value is None or one.std is None
        else replace(one, std=math.hypot(one.std, MISSED[name] * one.value)) for one in each
    ]  # fmt: skip
    found = shared(apart, numbers)
    return replace(shared(each, numbers), each=tuple(each if found.alike else apart), alike=found.alike)


def _finding(
    effect: str, names: Sequence[str], fits: Mapping[str, Refitted], diagnoses: Sequence[Diagnosis], numbers: int
) -> SharedFinding:  # fmt: skip
    """Where its sizes are not alike, what it has in common is that of recordings that show it."""
    named_by = tuple(
        name for name, one in zip(names, diagnoses, strict=True)
        if any(finding.effect == effect for finding in one.findings)
    )  # fmt: skip
    with_it = {name: one for name, one in fits.items() if effect in one.effects}
    sizes = {name: one.sizes(effect) for name, one in with_it.items()}
    shows = {name for name, one in with_it.items() if one.shows(effect)}

    def told(parameter: str, some: set[str]) -> Shared:
        each = [sizes[name][parameter] if parameter in sizes.get(name, {}) else None for name in names]
        form = min(one[1] for one in each if one is not None)
        common = shared([one[0] if one and name in some else None for name, one in zip(names, each, strict=True)],
                        numbers, form)  # fmt: skip
        return replace(common, each=tuple(one and one[0] for one in each))

    parameters = list(dict.fromkeys(each for some in sizes.values() for each in some))
    all_told = {parameter: told(parameter, set(names)) for parameter in parameters}
    if not all(one.alike for one in all_told.values()):
        all_told = {name: told(name, shows) if one.alike else one for name, one in all_told.items()}
    gain = sum(with_it[name].gain(effect) for name in shows)
    of = tuple(with_it)
    if not all(one.alike for one in all_told.values()):
        of = tuple(name for name in with_it if name in shows)[-1:] or of[-1:]
    equation = joint_equation(effect, [with_it[name] for name in of])
    return SharedFinding(effect, all_told, named_by, odds_of(gain), equation, of)


def _of_no_column(effect: str, names: Sequence[str], diagnoses: Sequence[Diagnosis]) -> SharedFinding:
    """A cause that was undone before any fit, such as a convention: as recordings tell it, each by itself."""
    found = {
        name: finding for name, one in zip(names, diagnoses, strict=True)
        for finding in one.findings if finding.effect == effect
    }  # fmt: skip
    parameters = dict.fromkeys(parameter for finding in found.values() for parameter in finding.parameters)
    told = {
        parameter: shared([found[name].parameters.get(parameter) if name in found else None for name in names], 1)
        for parameter in parameters
    }
    odds = min(finding.odds_against_next for finding in found.values())
    return SharedFinding(effect, told, tuple(found), odds)


def _verdict(
    findings: Sequence[SharedFinding], doubts: Sequence[Ambiguity], machine: Mapping[str, Shared],
    fits: Mapping[str, Refitted], *, astray: bool,
) -> Verdict:  # fmt: skip
    """`astray`: a machine beyond its tolerance, or whose constants differ; an ill recording that has no part."""
    if not fits:
        return Verdict.NOT_ENOUGH_EXCITATION
    given = next(iter(fits.values())).given
    untold = [
        name for name, number in machine.items()
        if not (number.joint.std or math.inf) <= _TOLD * given.tolerance[name] * getattr(given.machine, name)
    ]  # fmt: skip
    left = next((one.left for one in fits.values() if one.left is not None), None)
    if astray and not doubts:
        return Verdict.PARTLY_EXPLAINED if findings else Verdict.UNEXPLAINED
    return verdict_of(findings, doubts, left, untold)


def _sentence_of(
    said: Together, decisions: Sequence[Decision], left: Mapping[str, Unexplained], silent: Sequence[str]
) -> str:
    parts: list[str] = []
    for one in said.findings:
        if one.effect == convention_error.NAME:
            parts.append(f"what is recorded in {listed(one.named_by)} follows {convention_error.TITLE}")
            continue
        told = {name: number.joint for name, number in one.parameters.items() if number.alike}
        sizes = [f"{name.replace('_', ' ')} {_told(size)}" for name, size in told.items() if not is_none(size)]
        title = title_of(one.effect)
        were = "were" if plural(title) else "was"
        of = f" in {listed(one.named_by)}" if 0 < len(one.named_by) < len(said.recordings) else ""
        parts.append(f"{title} {were} left out{of}{': ' if sizes else ''}{', '.join(sizes)}")
    for one in decisions:
        odds = f"{odds_of(one.log_odds):.2g} to 1"
        parts.append(f"it is {title_of(one.effect)} and not {title_of(one.other)}: so all recordings say, odds {odds}")
    parts += [one.sentence for one in said.differences]
    for doubt in said.ambiguous:
        titles = [title_of(name) for name in doubt.effects]
        are = "are" if len(titles) > 1 or plural(titles[0]) else "is"
        what = " from ".join(titles) if doubt.rivals else f"whether {' and '.join(titles)} {are} there"
        parts.append(f"cannot tell {what}: {doubt.reason}; {doubt.experiment.sentence}")
    parts += [f"in {name} something has no name in the library: {one.description}" for name, one in left.items()]
    alike = {name: number.joint for name, number in said.machine.items() if number.alike}
    told = [f"{name} = {_told(size)}" for name, size in alike.items() if size.value is not None]
    if silent:
        parts.append(f"{listed(silent)} tells the machine too poorly to have a part in the numbers")
    taking_part = [name for name in said.recordings if name not in silent]
    whose = f"{len(taking_part)} recordings as one" if len(taking_part) > 1 else f"{''.join(taking_part)} alone"
    parts.append(f"of {whose}: {', '.join(told)}" if told else "")
    return ". ".join(sentence_start(part) for part in parts if part) + "."


def _told(size: Quantity) -> str:
    return quantity(size.value, size.unit, size.std)
