"""Shapes of what the REST interface says of diagnoses; that of a diagnosis itself is the published schema's."""

from collections.abc import Callable
from datetime import datetime
from typing import Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from bench.api.answers import SHAPES
from bench.diagnoses.diagnosis_jobs import Job
from bench.diagnoses.diagnosis_request import Trust
from bench.diagnoses.figures.figure import schema as figures_schema
from bench.diagnoses.published import schema
from bench.machine_file import Tables

DIAGNOSIS: Final = "DiagnosisModel"
FIGURES: Final = "FiguresModel"
_ID = "emulated-20260131-120000-000"


class DiagnosisRequestModel(BaseModel):
    """How to diagnose; what is left out is as usual."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [{"trust": {"R_s": 0.2}}, {"nominal": {
        "machine": {"R_s": 0.97, "L_d": 4.2e-3, "L_q": 6.2e-3, "psi_f": 0.12, "n_p": 4, "i_rated": 6.0},
        "drive": {"u_dc": 310.0},
    }}]})  # fmt: skip

    trust: Trust = {}
    nominal: Tables | None = Field(
        None, description="tables as in a MACHINE.toml; left out: those of the drive's configuration", examples=[None]
    )


class DiagnosisJobModel(BaseModel):
    """A diagnosis: asked for, under way, or ended."""

    recording: str = Field(examples=[_ID])
    state: Literal["queued", "running", "done", "failed", "cancelled"] = Field(
        description="the last three are ends", examples=["done"]
    )
    progress: float = Field(description="0 to 1", examples=[1.0])
    phase: str = Field(description="what is being done, in words", examples=[""])
    reason: str = Field(description="a sentence: why it failed", examples=[""])
    asked: datetime = Field(examples=["2026-01-31T12:00:00Z"])
    verdict: str | None = Field(description="once it is done", examples=["explained"])
    sentence: str | None = Field(
        description="the answer in words", examples=["The inverter's voltage error was left out: 2.0 us of dead time."]
    )


def job_model(job: Job) -> DiagnosisJobModel:
    """A diagnosis as REST shows it."""
    content = job.content or {}
    return DiagnosisJobModel.model_validate({
        "recording": job.id, "state": job.state.value, "progress": job.progress, "phase": job.phase,
        "reason": job.reason, "asked": job.asked, "verdict": content.get("verdict"),
        "sentence": content.get("sentence"),
    })


def diagnosis_shapes() -> dict[str, Any]:
    """The published schemas' shapes as an OpenAPI document has them."""
    return _shapes(DIAGNOSIS, schema) | _shapes(FIGURES, figures_schema)


def _shapes(name: str, published: Callable[[str], dict[str, Any]]) -> dict[str, Any]:
    whole = published(f"{SHAPES}{{model}}Model")
    parts: dict[str, Any] = whole.pop("$defs")
    shape = {key: value for key, value in whole.items() if not key.startswith("$")}
    return {name: shape} | {f"{part}Model": shape for part, shape in parts.items()}
