"""A diagnosis as it is published: the verdict's types as JSON, and the JSON schema that follows from them.

`python -m bench.diagnoses.published` prints the schema. Knows nothing of how a diagnosis is found.
"""

import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass, make_dataclass, replace
from typing import Annotated, Any, Final, get_type_hints

import numpy as np
from pydantic import ConfigDict, TypeAdapter, WithJsonSchema
from pydantic.json_schema import GenerateJsonSchema
from pydantic_core import core_schema

from bench.diagnoses.formats.format import Diagnosed
from estimator.diagnosis.verdict import Diagnosis, Experiment, Finding, Hold, Quantity, Range
from estimator.physics.library import BY_NAME

MOST_ODDS: Final = 1e12  # beyond, a figure says no more than that
UNTOLD: Final = ("equation", "equation_of")
"""Fields that machine files have."""
_AT_TIMES: Final = "leave_one_out"  # left out where there is none
_NUMBER: Final = {"type": "number"}
_TABLE: Final = {"items": {"type": "array", "items": {"anyOf": [_NUMBER, {"type": "null"}]}}}
_SHARE: Final = {"minimum": 0.0, "maximum": 1.0}
_ODDS: Final = {"minimum": 0.0, "maximum": MOST_ODDS}
_EFFECT: Final = {
    "type": "string", "pattern": "^[a-z][a-z0-9_]*$",
    "examples": [*BY_NAME, "dc_link_gain", "convention_error", "speed_lag"],
}  # fmt: skip
_MOTOR: Final = {
    "type": "object", "additionalProperties": False,
    "properties": dict.fromkeys(("R_s", "L_d", "L_q", "psi_f", "i_rated"), _NUMBER) | {"n_p": {"type": "integer"}},
}  # fmt: skip
_ALSO: Final[Mapping[str, Mapping[str, Any]]] = {  # by field: told, and not enforced
    "effect": _EFFECT, "effects": {"items": _EFFECT}, "energy_share": _SHARE, "samples_share": _SHARE,
    "odds": _ODDS, "odds_against_next": _ODDS, "step": {"minimum": 0.0}, "rows": {"minimum": 0},
    "seconds": {"exclusiveMinimum": 0.0, "examples": [2.0]}, "groups": {"minimum": 2, "examples": [32]},
    "scales": {"propertyNames": {"enum": ["voltages", "currents"]}}, "detectable": {"propertyNames": _EFFECT},
    "parameters": {"propertyNames": {"examples": ["dead_time"]}}, "region": {"propertyNames": {"examples": ["i_q"]}},
    "currents": {"propertyNames": {"enum": ["i_d", "i_q"]}},
    "psi_d": _TABLE, "psi_q": _TABLE, "psi_d_std": _TABLE, "psi_q_std": _TABLE,
}  # fmt: skip
_UNLIKE: Final = "in the unit of what it is of"
_OF: Final[Mapping[str, Mapping[str, Any]]] = {  # by type and field: examples, and units that the name does not tell
    "Diagnosis.sentence": {"examples": ["An inverter's voltage error was left out: 2.0 us of dead time."]},
    "Diagnosis.remarks": {"examples": [[]]},
    "Ambiguity.reason": {"examples": ["both act alike at one speed"]},
    "Candidate.log10_odds_alone": {"examples": [512.0]}, "Candidate.log10_odds_after": {"examples": [498.0]},
    "Candidate.chosen": {"examples": [True]},
    "Change.before": {"description": _UNLIKE, "examples": [0.182]},
    "Change.after": {"description": _UNLIKE, "examples": [0.0027]},
    "ErrorChange.before": {"description": _UNLIKE, "examples": [0.261]},
    "ErrorChange.after": {"description": _UNLIKE, "examples": [0.0472]},
    "ErrorChange.noise_floor": {"description": _UNLIKE, "examples": [0.0469]},
    "Experiment.sentence": {"examples": ["record 1200 rpm and 300 rpm at i_q = 2.7 A"]},
    "Finding.odds_against_next": {"examples": [MOST_ODDS]}, "Finding.absorbed_as": {"examples": [{"R_s": 0.004}]},
    "Fit.held_out": {"examples": [True]}, "Fit.explained": {"examples": [0.97]},
    "FluxTable.i_d": {"examples": [[-2.0, 0.0]]}, "FluxTable.i_q": {"examples": [[0.0, 2.0]]},
    "FluxTable.psi_d": {"description": "Vs", "examples": [[[0.111, None], [0.12, 0.119]]]},
    "FluxTable.psi_q": {"description": "Vs", "examples": [[[0.0, None], [0.0, 0.012]]]},
    "FluxTable.psi_d_std": {"description": "Vs", "examples": [[[1e-4, None], [1e-4, 1e-4]]]},
    "FluxTable.psi_q_std": {"description": "Vs", "examples": [[[1e-4, None], [1e-4, 1e-4]]]},
    "Hold.speed_rpm": {"examples": [1200.0]}, "Hold.i_d": {"examples": [-1.5]}, "Hold.i_q": {"examples": [2.7]},
    "Hold.seconds": {"description": "s"},
    "LeaveOneOut.left_out": {"examples": ["a frequency"]}, "LeaveOneOut.before": {"examples": [0.31]},
    "LeaveOneOut.after": {"examples": [0.04]}, "LeaveOneOut.unit": {"examples": ["V"]},
    "LeaveOneOut.alternatives": {"examples": [{"without iron_loss": 0.12}]},
    "Motor.nominal": {"examples": [{"R_s": 0.97, "L_d": 4.2e-3, "L_q": 6.2e-3, "psi_f": 0.12, "n_p": 4}]},
    "Place.sentence": {"examples": ["on q where a phase current changes sign"]},
    "Place.region": {"examples": [{"axis": "q", "i_q": [1.5, 3.0]}]},
    "Place.energy_share": {"examples": [0.74]}, "Place.samples_share": {"examples": [0.31]},
    "Quantity.value": {"description": "in its unit", "examples": [2.0e-6]}, "Quantity.std": {"examples": [1.0e-8]},
    "Quantity.unit": {"examples": ["s"]},
    "Range.least": {"description": "a ratio", "examples": [0.95]},
    "Range.most": {"description": "a ratio", "examples": [1.05]},
    "Recording.path": {"examples": ["run.parquet"]}, "Recording.rows": {"examples": [60_000]},
    "Recording.duration": {"examples": [6.0]}, "Recording.T_s": {"examples": [1e-4]},
    "Recording.u_dc": {"examples": [310.0]},
    "Recording.currents": {"examples": [{"i_d": [-3.4, 1.5], "i_q": [-2.5, 4.5]}]},
    "Rival.odds": {"examples": [MOST_ODDS]},
    "Unexplained.rms_V": {"examples": [0.31]},
    "Unexplained.description": {"examples": ["a 785 Hz voltage of 22.7 V, fixed in the stationary frame"]},
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Motor:
    """The motor, before a diagnosis and after it."""

    nominal: Annotated[Mapping[str, int | float], WithJsonSchema(_MOTOR), "what was known of it before; SI, peak"]
    before: Annotated[Mapping[str, Quantity], "R_s, L_d, L_q, psi_f of a fit without the effects"]
    after: Annotated[Mapping[str, Quantity], "with them"]
    scales: Annotated[
        Mapping[str, Range],
        "what all voltages, or all currents, may be read as over what they are: no recording tells, the nominal "
        "values' tolerance alone; the parameters are off by that",
    ]


@dataclass(frozen=True, slots=True)
class Recording:
    """What was diagnosed."""

    path: str
    rows: int
    duration: Annotated[float, "s"]
    T_s: Annotated[float, "s, control period"]
    u_dc: Annotated[float | None, "V, mean of the dc link, where it is known"]
    currents: Annotated[
        Mapping[str, tuple[float, float]],
        "A, the least and the largest of each axis, but for a thousandth of the rows at either end; empty of points",
    ]


_ABOUT: Final = """What `pmsm-bench diagnose` and POST /api/recordings/{id}/diagnosis say of a recording.

SI units, peak dq quantities, electrical angles; null stands for a number that nothing honest can be said of."""
_PARTS: Final = (
    "verdict", "sentence", "findings", "ambiguous", "unexplained", "detectable", "machine", "flux_map", "fit",
    "candidates", "remarks", "experiment", "recording",
)  # fmt: skip
_KINDS: Final = get_type_hints(Diagnosis, include_extras=True) | {"machine": Motor, "recording": Recording}
PUBLISHED: Final[Any] = make_dataclass("Diagnosis", [(name, _KINDS[name]) for name in _PARTS], namespace={
    "__doc__": _ABOUT, "__pydantic_config__": ConfigDict(extra="forbid", arbitrary_types_allowed=True),
})  # fmt: skip
"""The type of a published diagnosis."""
_ADAPTER: Final = TypeAdapter[Any](PUBLISHED)


def as_json(diagnosed: Diagnosed) -> dict[str, Any]:
    """A diagnosis as plain values, SI; what is not finite is null."""
    said, recording, fit = diagnosed.diagnosis, diagnosed.recording, diagnosed.diagnosis.fit
    parts = {
        "findings": tuple(_within_odds(finding) for finding in said.findings),
        "machine": Motor(diagnosed.nominal.told, said.machine_before, said.machine_after, said.scales),
        "recording": Recording(
            recording.path, recording.rows, recording.duration, recording.T_s, diagnosed.u_dc, diagnosed.seen
        ),
    }
    published = PUBLISHED(**{name: parts[name] if name in parts else getattr(said, name) for name in _PARTS})
    untold = {"findings": {"__all__": {*UNTOLD}}} | ({} if fit is None or fit.leave_one_out else {"fit": {_AT_TIMES}})
    text = _ADAPTER.dump_json(published, exclude=untold, fallback=np.ndarray.tolist, warnings=False)
    return json.loads(text)


def _within_odds(finding: Finding) -> Finding:
    rivals = tuple(replace(rival, odds=min(rival.odds, MOST_ODDS)) for rival in finding.rivals)
    return replace(finding, odds_against_next=min(finding.odds_against_next, MOST_ODDS), rivals=rivals)


class Schema(GenerateJsonSchema):
    """What is annotated to a field describes it, and a number may be null but where it is commanded."""

    commanded = False
    of = _OF  # by type and field

    def float_schema(self, schema: core_schema.FloatSchema) -> dict[str, Any]:
        return {**_NUMBER} if self.commanded else {"anyOf": [_NUMBER, {"type": "null"}]}

    def is_instance_schema(self, schema: core_schema.IsInstanceSchema) -> dict[str, Any]:
        return {"type": "array", "items": _NUMBER}

    def dict_schema(self, schema: core_schema.DictSchema) -> dict[str, Any]:
        return {"propertyNames": {"examples": ["R_s"]}} | super().dict_schema(schema)

    def dataclass_schema(self, schema: core_schema.DataclassSchema) -> dict[str, Any]:
        outer, self.commanded = self.commanded, schema["cls"] in (Experiment, Hold)
        shape = super().dataclass_schema(schema)
        self.commanded = outer
        for name in UNTOLD:
            shape["properties"].pop(name, None)
        for name, hint in get_type_hints(schema["cls"], include_extras=True).items():
            if name in shape["properties"]:
                texts = [text for text in getattr(hint, "__metadata__", ()) if isinstance(text, str)]
                also = _ALSO.get(name, {}) | self.of.get(f"{schema['cls'].__name__}.{name}", {})
                shape["properties"][name] |= also | dict(zip(("description",), texts, strict=False))
        return shape | {"required": [name for name in shape["properties"] if name != _AT_TIMES]}


def schema(references: str = "#/$defs/{model}") -> dict[str, Any]:
    """The JSON schema of a diagnosis (draft 2020-12); the references to its parts as they are to look."""
    return schema_of(_ADAPTER, "urn:pmsm-bench:diagnosis", Schema, references)


def schema_of(kind: TypeAdapter[Any], id_: str, by: type[Schema], references: str) -> dict[str, Any]:
    """The JSON schema of a published type."""
    told = kind.json_schema(ref_template=references, schema_generator=by, mode="serialization")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": id_} | told


if __name__ == "__main__":
    sys.stdout.write(json.dumps(schema(), indent=2) + "\n")
