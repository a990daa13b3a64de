"""A diagnosis of several recordings as it is published: JSON, and the JSON schema that follows from its types.

`python -m bench.diagnoses.together.published` prints the schema. Knows nothing of how a diagnosis is found.
"""

import json
import sys
from collections.abc import Mapping
from dataclasses import make_dataclass, replace
from typing import Annotated, Any, Final, get_type_hints

from pydantic import ConfigDict, TypeAdapter

from bench.diagnoses.published import MOST_ODDS, PUBLISHED, UNTOLD, Schema, schema_of
from bench.diagnoses.published import as_json as one_as_json
from bench.diagnoses.together.request import DiagnosedTogether
from estimator.diagnosis.together.said import Together

_ABOUT: Final = """What `pmsm-bench diagnose --together` says of several recordings of one machine.

SI units, peak dq quantities, electrical angles; null stands for a number that nothing honest can be said of."""
_ALONE: Final = "diagnoses"
_PARTS: Final = (
    "verdict", "sentence", "recordings", "machine", "findings", "differences", "ambiguous", "remarks", _ALONE,
)  # fmt: skip
_KINDS: Final = get_type_hints(Together, include_extras=True) | {
    "recordings": Annotated[tuple[str, ...], "their names, in the order in which all else has them"],
    _ALONE: Annotated[tuple[PUBLISHED, ...], "what each recording says alone, in their order"],
}
_PUBLISHED: Final[Any] = make_dataclass("Together", [(name, _KINDS[name]) for name in _PARTS], namespace={
    "__doc__": _ABOUT, "__pydantic_config__": ConfigDict(extra="forbid", arbitrary_types_allowed=True),
})  # fmt: skip
_ADAPTER: Final = TypeAdapter[Any](_PUBLISHED)
_OF: Final[Mapping[str, Mapping[str, Any]]] = {  # by type and field: examples, and what the types do not tell
    "Together.verdict": {"description": "the answer of all recordings in a word"},
    "Together.sentence": {
        "description": "the answer in words", "examples": ["Of 2 recordings as one: L_d = 4.2399 ± 0.0021 mH."],
    },
    "Together.recordings": {"examples": [["cold", "warm"]]},
    "Together.machine": {
        "description": "R_s (ohm), L_d, L_q (H), psi_f (Vs), with the effects of all recordings; beside them each "
        "recording's own"
    },
    "Together.findings": {"description": "effects that were left out"},
    "Together.differences": {"description": "what is not one number in all recordings"},
    "Together.ambiguous": {"description": "what all recordings cannot tell"},
    "Together.remarks": {
        "description": "what is wrong with recordings, each by its name", "examples": [["warm: runs without a gap: 2"]],
    },
    "Shared.alike": {"examples": [True]},
    "SharedFinding.parameters": {"description": "its sizes, each in its unit"},
    "SharedFinding.named_by": {"examples": [["warm"]]},
    "SharedFinding.odds": {"examples": [MOST_ODDS]},
    "Difference.what": {"examples": ["R_s"]}, "Difference.parameter": {"examples": [""]},
    "Difference.kind": {
        "description": "state: what temperature and time move; constant: L_d and L_q, which in one machine they do "
        "not; effect: the size of one"
    },
    "Difference.between": {"examples": [["cold", "warm"]]},
    "Difference.sentence": {
        "description": "the same in words",
        "examples": ["between cold and warm R_s rose by 6.02 ± 0.11 % (58.2 ± 1.1 mohm)"],
    },
}  # fmt: skip


class _Schema(Schema):
    of = Schema.of | _OF


def as_json(diagnosed: DiagnosedTogether) -> dict[str, Any]:
    """A diagnosis as plain values, SI; what is not finite is null."""
    said = diagnosed.said
    findings = tuple(replace(one, odds=min(one.odds, MOST_ODDS)) for one in said.findings)
    values = {name: getattr(said, name) for name in _PARTS} | {"findings": findings, _ALONE: ()}
    text = _ADAPTER.dump_json(_PUBLISHED(**values), exclude={"findings": {"__all__": {*UNTOLD}}}, warnings=False)
    return json.loads(text) | {_ALONE: [one_as_json(one) for one in diagnosed.each.values()]}


def schema(references: str = "#/$defs/{model}") -> dict[str, Any]:
    """The JSON schema of it (draft 2020-12); the references to its parts as they are to look."""
    return schema_of(_ADAPTER, "urn:pmsm-bench:diagnosis-together", _Schema, references)


if __name__ == "__main__":
    sys.stdout.write(json.dumps(schema(), indent=2) + "\n")
