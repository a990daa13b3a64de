"""Shapes of what the REST interface says of captures. SI units."""

from datetime import datetime
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from bench.actions.capture import Status
from bench.actions.capture_request import NEEDED, TIMEOUT
from drivers.wire.dictionary import CAPTURE_SAMPLES, CHANNELS

_ID = "emulated-20260131-120000-000"
_SIGNALS = f"1 to 8 of {', '.join(CHANNELS[1:])}"


class LevelModel(BaseModel):
    """A trigger: a signal crosses a level."""

    model_config = ConfigDict(extra="forbid")

    signal: str = Field(description="any that can be recorded", examples=["i_q"])
    level: float = Field(description="in the signal's SI unit: A, V, rad/s, rad", examples=[2.0])
    edge: Literal["rising", "falling", "either"] = Field("rising", examples=["rising"])


class CaptureRequestModel(BaseModel):
    """What to capture; what is left out is as usual."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [
        {"length": 5000}, {"trigger": "i_q > 2.0", "pre_trigger": 0.1, "timeout_s": 30.0},
        {"signals": ["i_a", "i_b", "i_c", "u_dc"], "length": 65536, "decimation": 2, "trigger": "command"},
    ]})

    signals: list[str] = Field(
        list(NEEDED), description=f"{_SIGNALS}; the usual ones are those the estimation rests on",
        examples=[list(NEEDED)],
    )
    length: int = Field(10_000, description=f"samples, 1 to {CAPTURE_SAMPLES}", examples=[10_000])
    decimation: int = Field(
        1, description="control periods per sample, 1 to 1000; an estimation needs each period", examples=[1]
    )
    pre_trigger: float = Field(
        0.0, description="share of the samples from before the trigger, 0 to 1", examples=[0.1]
    )
    trigger: LevelModel | str = Field(
        "now", description='now: at once; command: by POST .../trigger; or a level, also as "i_q > 2.0" (rising), '
        '"i_q < -2.0" (falling)', examples=["now"],
    )
    timeout_s: float = Field(
        60.0, description=f"time for the trigger to come, {TIMEOUT[0]:g} to {TIMEOUT[1]:g} s", examples=[60.0]
    )


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
    """A drive's captures since the service started, the newest first."""

    captures: list[CaptureModel]


def capture_model(status: Status) -> CaptureModel:
    """A capture as REST shows it."""
    return CaptureModel.model_validate({
        "id": status.id, "drive": status.drive, "state": status.state.value, "progress": status.progress,
        "samples": status.samples, "reason": status.reason, "remark": status.remark,
        "file": None if status.file is None else str(status.file),
        "asked": status.asked, "request": status.request.as_json(),
    })
