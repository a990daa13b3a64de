"""Shapes of what the REST interface says of captures. SI units."""

from dataclasses import dataclass
from datetime import datetime
from typing import ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field

from bench.actions.capture import Status
from bench.actions.capture_request import Request
from bench.expected import CLOSED

_ID = "emulated-20260131-120000-000"


@dataclass(frozen=True, slots=True)
class CaptureRequestModel(Request):
    """What to capture; what is left out is as usual."""

    __pydantic_config__: ClassVar = CLOSED | ConfigDict(json_schema_extra={"examples": [
        {"length": 5000}, {"trigger": "i_q > 2.0", "pre_trigger": 0.1, "timeout_s": 30.0},
        {"signals": ["i_a", "i_b", "i_c", "u_dc"], "length": 65536, "decimation": 2, "trigger": "command"},
    ]})


class CaptureModel(BaseModel):
    """A capture: asked for, under way, or ended."""

    id: str = Field(examples=[_ID])
    drive: str = Field(examples=["emulated"])
    state: Literal["armed", "triggered", "uploading", "done", "failed", "cancelled"] = Field(
        description="triggered: the drive is recording; the last three are ends", examples=["done"]
    )
    progress: float = Field(description="share of the samples, 0 to 1: recorded, then uploaded", examples=[1.0])
    samples: int = Field(description="recorded so far, then uploaded so far", examples=[10_000])
    reason: str = Field(description="a sentence: why it failed, or what it waits for", examples=[""])
    remark: str = Field(
        description="a sentence: what the recording lacks, as of a drive that is off", examples=[""]
    )
    file: str | None = Field(
        description="the recording, on the service's machine; of a capture that failed in mid-upload a partial one",
        examples=[f"/home/ada/.local/share/pmsm-bench/captures/{_ID}.parquet"],
    )
    asked: datetime = Field(description="when it was asked for", examples=["2026-01-31T12:00:00Z"])
    request: CaptureRequestModel


class CapturesModel(BaseModel):
    """A drive's captures, the newest first."""

    captures: list[CaptureModel]


def capture_model(status: Status) -> CaptureModel:
    """A capture as REST shows it."""
    return CaptureModel.model_validate({
        "id": status.id, "drive": status.drive, "state": status.state.value, "progress": status.progress,
        "samples": status.samples, "reason": status.reason, "remark": status.remark,
        "file": None if status.file is None else str(status.file),
        "asked": status.asked, "request": status.request.as_json(),
    })
