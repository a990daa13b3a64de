"""What a diagnosis of several recordings of one machine says. Knows nothing of how it was found."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

from estimator.diagnosis.verdict import Ambiguity, Diagnosis, Quantity, Verdict


class Kind(StrEnum):
    """What is different between recordings."""

    STATE = "state"  # what moves with temperature and time: R_s, psi_f, drifts
    CONSTANT = "constant"  # L_d, L_q: of one machine they do not
    EFFECT = "effect"


@dataclass(frozen=True, slots=True)
class Shared:
    """A number that several recordings tell."""

    each: Annotated[tuple[Quantity | None, ...], "by recording, in their order; null where one tells nothing of it"]
    joint: Annotated[Quantity, "of all of them, where they are alike"]
    alike: Annotated[bool, "chance makes as much of a difference as there is"]


@dataclass(frozen=True, slots=True)
class SharedFinding:
    """An effect that was left out."""

    effect: str
    parameters: Mapping[str, Shared]
    named_by: Annotated[tuple[str, ...], "recordings whose own diagnosis names it"]
    odds: Annotated[float, "of all recordings, in favour of having it beside the others"]
    equation: tuple[float, ...] = ()  # its equation's parameters, in their order, for a twin
    equation_of: tuple[str, ...] = ()  # recordings that these are of: one alone where sizes are not alike


@dataclass(frozen=True, slots=True)
class Difference:
    """What is not alike in two recordings."""

    what: Annotated[str, "a parameter of the machine, or an effect"]
    parameter: Annotated[str, "the effect's; else empty"]
    kind: Kind
    between: Annotated[tuple[str, str], "the two recordings"]
    change: Annotated[Quantity, "from the first to the second"]
    share: Annotated[Quantity | None, "the same as a share of the first; null where the first is none"]
    sentence: str


@dataclass(frozen=True, slots=True)
class Together:
    """The whole answer; `diagnoses` are those of each recording alone."""

    verdict: Verdict
    sentence: str
    recordings: tuple[str, ...]
    machine: Mapping[str, Shared]
    findings: tuple[SharedFinding, ...]
    differences: tuple[Difference, ...]
    ambiguous: tuple[Ambiguity, ...]
    remarks: tuple[str, ...]
    diagnoses: tuple[Diagnosis, ...]
