"""A diagnosis of several recordings as a machine file: what they tell as one; what differs as the last one tells it."""

from collections.abc import Sequence

from bench.diagnoses.diagnosed_machine import machine_text
from bench.machine_file import Nominal
from estimator.diagnosis.together.said import Shared, SharedFinding, Together
from estimator.diagnosis.verdict import Diagnosis, Finding, Place, Quantity
from estimator.diagnosis.words import listed
from estimator.physics.library import BY_NAME


def machine_text_of(said: Together, nominal: Nominal) -> str | None:
    """TOML that `load_machine` takes; None where nothing could be fitted. Conventions are the last recording's."""
    if all(number.joint.value is None for number in said.machine.values()):
        return None
    machine, notes = dict[str, Quantity](), dict[str, str]()
    for name, number in said.machine.items():
        machine[name] = number.joint
        if not number.alike:
            of, machine[name] = _last(number, said.recordings)
            notes[name] = _note(of)
    notes |= {one.effect: _note(listed(one.equation_of)) for one in said.findings if not _is_one(one)}
    one_of = [one for one in said.diagnoses[::-1] if one.machine_after]
    conventions = [each for one in one_of[:1] for each in one.findings if each.effect not in BY_NAME]
    findings = *conventions, *(_finding(one, said.recordings) for one in said.findings)
    as_one = Diagnosis(
        said.verdict, said.sentence, findings, (), None, {}, {}, machine, None, (), (), None,
        pole_pairs=next((one.pole_pairs for one in one_of if one.pole_pairs is not None), None),
        flux_map=next((one.flux_map for one in one_of if one.flux_map is not None), None),
        angle=next((one.angle for one in one_of), 0.0),
    )  # fmt: skip
    return machine_text(as_one, nominal, listed(said.recordings), notes)


def _note(of: str) -> str:
    return f"not the same in all recordings: this is that of {of}"


def _last(number: Shared, recordings: Sequence[str]) -> tuple[str, Quantity]:
    """The last recording that tells a number, and what it tells."""
    each = zip(recordings[::-1], number.each[::-1], strict=True)
    return next((name, one) for name, one in each if one is not None and one.value is not None)


def _is_one(found: SharedFinding) -> bool:
    return all(number.alike for number in found.parameters.values())


def _finding(found: SharedFinding, recordings: Sequence[str]) -> Finding:
    """As of one recording."""
    sizes = {name: number.joint for name, number in found.parameters.items()}
    if not _is_one(found):
        of = recordings.index(found.equation_of[0])
        sizes = {name: one for name, number in found.parameters.items() if (one := number.each[of]) is not None}
    return Finding(found.effect, sizes, Place("", {}, 1.0, 1.0), found.odds, (), {}, found.equation)
