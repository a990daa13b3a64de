"""A file and what is known of its machine to a diagnosis, and the diagnosis as JSON: a pure function of both.

The JSON is described by `diagnosis.schema.json`. Knows nothing of terminals and HTTP.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any, Final, cast

from bench.diagnoses.diagnosed_machine import machine_text
from bench.diagnoses.diagnosis_request import Request, Result, Tell
from bench.diagnoses.formats import format_of
from bench.diagnoses.formats.format import Diagnosed
from bench.diagnoses.report import report
from estimator.diagnosis.verdict import Before, Fit

MOST_ODDS: Final = 1e12  # beyond, a figure says no more than that


def diagnose_recording(request: Request, tell: Tell = lambda share, phase: None) -> Diagnosed:
    """Read and diagnose a file. Raises ConfigError, RecordingError, and what `tell` raises to cancel."""
    diagnosed, nominal = format_of(request).diagnose(request, tell), request.nominal
    if not nominal.effects:
        return diagnosed
    said = diagnosed.diagnosis
    unused = f"the effects in {nominal.source}'s [effects] are not used by a diagnosis: it looks for them anew"
    return replace(diagnosed, diagnosis=replace(said, remarks=(*said.remarks, unused)))


def work(request: Request, tell: Tell) -> Result:
    """A diagnosis in texts, as a process for such work makes it."""
    diagnosed = diagnose_recording(request, tell)
    diagnosis = diagnosed.diagnosis
    fitted = bool(diagnosis.machine_after)
    return Result(
        as_json(diagnosed),
        machine_text(diagnosis, diagnosed.nominal, request.file.name) if fitted else None,
        report(diagnosis, diagnosed.recording, diagnosed.nominal) if request.report else None,
    )


def as_json(diagnosed: Diagnosed) -> dict[str, Any]:
    """A diagnosis as plain values, SI; what is not finite is null."""
    said, recording = diagnosed.diagnosis, diagnosed.recording
    fit = said.fit
    return _plain({
        "verdict": said.verdict.value,
        "sentence": said.sentence,
        "findings": [
            {name: value for name, value in _fields(finding).items() if name != "equation"} | {
                "odds_against_next": min(finding.odds_against_next, MOST_ODDS),
                "rivals": [{"effect": r.effect, "odds": min(r.odds, MOST_ODDS)} for r in finding.rivals],
            }
            for finding in said.findings
        ],
        "ambiguous": said.ambiguous,
        "unexplained": said.unexplained,
        "detectable": said.detectable,
        "machine": {
            "nominal": diagnosed.nominal.told, "before": said.machine_before, "after": said.machine_after,
            "scales": said.scales,
        },
        "flux_map": None if said.flux_map is None else {k: v.tolist() for k, v in _fields(said.flux_map).items()},
        "fit": None if fit is None else _fit(fit),
        "candidates": said.candidates,
        "remarks": said.remarks,
        "experiment": said.experiment,
        "recording": {"path": recording.path, "rows": recording.rows, "duration": recording.duration},
    })


def _fit(fit: Fit) -> dict[str, Any]:
    told = _fields(fit) | {
        "one_step_rms_V": _fields(fit.one_step_rms_V),
        "free_run_rms_A": _two(fit.free_run_rms_A),
        "whiteness": _two(fit.whiteness),
    }
    if fit.leave_one_out is None:
        del told["leave_one_out"]
    return told


def _fields(value: Any) -> dict[str, Any]:
    return {field.name: getattr(value, field.name) for field in fields(value)}


def _two(value: Before) -> dict[str, float]:
    return {"before": value.before, "after": value.after}


def _plain(value: Any) -> Any:
    """Values that JSON has."""
    if is_dataclass(value):
        return _plain(_fields(value))
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in cast(Mapping[Any, Any], value).items()}
    if isinstance(value, str):
        return str(value)
    if isinstance(value, Sequence):
        return [_plain(item) for item in cast(Sequence[Any], value)]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value
