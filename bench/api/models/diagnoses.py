"""Shapes of what the REST interface says of diagnoses; that of a diagnosis itself is the published schema's."""

from collections.abc import Callable
from datetime import datetime
from typing import Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from bench.api.exchange.answers import SHAPES
from bench.diagnoses.diagnosis_jobs import Job
from bench.diagnoses.diagnosis_request import Trust
from bench.diagnoses.figures.figure import schema as figures_schema
from bench.diagnoses.published import schema
from bench.machine_file import Tables
from bench.witness import Texts
from estimator.diagnosis.verdict import Verdict

DIAGNOSIS: Final = "DiagnosisModel"
DIAGNOSIS_FIGURES: Final = "FiguresModel"
_ID = "20260131-120000-000"
_RECORDING = "emulated-20260131-115900-000"


class DiagnosisRequestModel(BaseModel):
    """How to diagnose; what is left out is as usual."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [{
        "trust": {"R_s": 0.2}, "witness": {"psi_f": "0.1203+-0.5%"},
    }, {"nominal": {
        "machine": {"R_s": 0.97, "L_d": 4.2e-3, "L_q": 6.2e-3, "psi_f": 0.12, "n_p": 4, "i_rated": 6.0},
        "drive": {"u_dc": 310.0},
    }}]})  # fmt: skip

    trust: Trust = {}
    nominal: Tables | str | None = Field(
        None, description="tables as in a MACHINE.toml, or its text; left out: those of the drive's configuration",
        examples=[None],
    )
    witness: Texts = {}


class DiagnosisJobModel(BaseModel):
    """A diagnosis: asked for, under way, or ended."""

    id: str = Field(examples=[_ID])
    recording: str = Field(description="id of what it is of", examples=[_RECORDING])
    recording_there: bool = Field(description="false: the recording has been deleted since", examples=[True])
    drive: str = Field(
        description="that made the recording; empty where that does not say", examples=["emulated"]
    )
    state: Literal["queued", "running", "done", "failed", "cancelled"] = Field(
        description="the last three are ends", examples=["done"]
    )
    progress: float = Field(description="0 to 1", examples=[1.0])
    phase: str = Field(description="what is being done, in words", examples=[""])
    reason: str = Field(description="a sentence: why it failed", examples=[""])
    asked: datetime = Field(examples=["2026-01-31T12:00:00Z"])
    started: datetime | None = Field(description="null: it waits, or has never been", examples=["2026-01-31T12:00:00Z"])
    ended: datetime | None = Field(description="null: it has not", examples=["2026-01-31T12:00:40Z"])
    verdict: Verdict | None = Field(description="once it is done", examples=["explained"])
    sentence: str | None = Field(
        description="the answer in words", examples=["The inverter's voltage error was left out: 2.0 us of dead time."]
    )
    request: dict[str, Any] = Field(
        description="trust, nominal and witness, by which another one is asked for alike; those that were the drive's "
        "are told",
        examples=[{"trust": {"R_s": 0.2}, "nominal": {"machine": {"n_p": 4}, "drive": {}}, "witness": {}}],
    )
    remark: str = Field(
        description="a sentence: why it is not kept on disk; empty of one that is, or has not ended", examples=[""]
    )


class DiagnosesModel(BaseModel):
    """Diagnoses, the newest first."""

    diagnoses: list[DiagnosisJobModel]
    total: int = Field(description="that the filters let through", examples=[1])
    next: str | None = Field(description="before which the next page begins; null on the last one", examples=[None])


def job_model(job: Job, *, recording_there: bool) -> DiagnosisJobModel:
    """A diagnosis as REST shows it."""
    return DiagnosisJobModel.model_validate({
        "id": job.id, "recording": job.recording, "recording_there": recording_there, "drive": job.drive,
        "state": job.state.value, "progress": job.progress, "phase": job.phase, "reason": job.reason,
        "asked": job.asked, "started": job.started, "ended": job.ended, "verdict": job.verdict,
        "sentence": job.sentence, "request": job.request, "remark": job.lost,
    })  # fmt: skip


def diagnosis_shapes() -> dict[str, Any]:
    """The published schemas' shapes as an OpenAPI document has them."""
    return _shapes(DIAGNOSIS, schema) | _shapes(DIAGNOSIS_FIGURES, figures_schema)


def _shapes(name: str, published: Callable[[str], dict[str, Any]]) -> dict[str, Any]:
    whole = published(f"{SHAPES}{{model}}Model")
    parts: dict[str, Any] = whole.pop("$defs")
    shape = {key: value for key, value in whole.items() if not key.startswith("$")}
    return {name: shape} | {f"{part}Model": shape for part, shape in parts.items()}
