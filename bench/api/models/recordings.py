"""Shapes of what the REST interface says of recordings. SI units."""

from dataclasses import dataclass
from datetime import datetime
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from bench.actions.recording import Status
from bench.actions.recording_request import RecordingRequest
from bench.expected import CLOSED, Else, Number
from bench.store.annotations import Annotations, Title, Words
from bench.store.samples import Samples
from bench.store.shelf import Recording

_ID = "emulated-20260131-120000-000"


@dataclass(frozen=True, slots=True)
class RecordingRequestModel(RecordingRequest):
    """What to record; what is left out is as usual."""

    __pydantic_config__: ClassVar = CLOSED | ConfigDict(json_schema_extra={"examples": [
        {}, {"title": "warm, 1200 rpm", "seconds": 600.0},
        {"trigger": "i_q > 2.0", "pre_trigger_s": 2.0, "seconds": 5.0},
    ]})  # fmt: skip


@dataclass(frozen=True, slots=True)
class MarkRequestModel:
    """A moment to mark."""

    __pydantic_config__: ClassVar = CLOSED | ConfigDict(json_schema_extra={"examples": [
        {"text": "knocking", "t": 0.05}, {"text": "load on"},
    ]})  # fmt: skip

    text: Annotated[Title, Field(description="what happened", examples=["load on"])]
    t: Annotated[
        Annotated[float, Number(0.0, 1e9)] | None, Else("expected null or a number of 0 to 1e9"),
        Field(description="s from the recording's begin; null: now, of one that is under way"),
    ] = None


@dataclass(frozen=True, slots=True)
class AnnotationModel:
    """What to call a recording; what is left out stays as it is."""

    __pydantic_config__: ClassVar = CLOSED | ConfigDict(json_schema_extra={"examples": [{"title": "warm"}]})

    title: Title | None = None
    note: Words | None = None


class MarkModel(BaseModel):
    """A moment that somebody has marked."""

    t: float = Field(description="s from the recording's begin", examples=[12.5])
    text: str = Field(examples=["load on"])
    whom: str = Field(description="who marked it", examples=["127.0.0.1"])
    at: str = Field(description="when; RFC 3339", examples=["2026-01-31T12:00:12+00:00"])


class StoredRecordingModel(BaseModel):
    """A recording: of a stream, under way or closed, a capture's, an experiment's, or a file that was put there."""

    id: str = Field(examples=[_ID])
    kind: Literal["stream", "capture", "experiment", "file"]
    drive: str = Field(description="its name then; empty where the file does not say", examples=["emulated"])
    url: str = Field(
        description="bus address of the drive, then; empty where the file does not say",
        examples=["canopen://socketcand/127.0.0.1:29536/can0/5"],
    )
    state: Literal["armed", "recording", "closing", "done", "failed", "cancelled"] = Field(
        description="the last three are ends", examples=["done"]
    )
    begun: datetime = Field(
        description="of a file that does not say: when it was written", examples=["2026-01-31T12:00:00Z"]
    )
    rows: int = Field(examples=[60_000])
    seconds: float | None = Field(description="s, gaps included; null where the file does not say", examples=[60.0])
    bytes: int = Field(description="on disk", examples=[1_400_000])
    columns: list[str] = Field(description="empty while it is under way", examples=[["t", "theta_e", "i_d", "i_q"]])
    title: str = Field(examples=["warm, 1200 rpm"])
    note: str = Field(examples=[""])
    marks: list[MarkModel]
    gaps: int = Field(description="breaks between rows", examples=[0])
    rows_lost: int = Field(description="that the drive made in the gaps, as far as it is known", examples=[0])
    whole: bool = Field(description="it has all that it was to have", examples=[True])
    reason: str = Field(
        description="a sentence: why it ended, what it waits for, or what is wrong with its file",
        examples=["stopped by 127.0.0.1"]
    )
    continues: str = Field(description="id of the recording that it goes on with; empty: of none", examples=[""])


class BroughtModel(StoredRecordingModel):
    """A recording that was made of a file."""

    remarks: list[str] = Field(
        description="what was made of the file, and what was left out of it, a sentence each",
        examples=[["columns left out: torque"]],
    )


class RecordingsModel(BaseModel):
    """Recordings, the newest first."""

    recordings: list[StoredRecordingModel]
    total: int = Field(description="that the filters let through", examples=[1])
    next: str | None = Field(description="before which the next page begins; null on the last one", examples=[None])


class RoomModel(BaseModel):
    """A drive's recording, and what there is room for."""

    recording: StoredRecordingModel | None = Field(description="under way; null: none")
    bytes_per_day: float | None = Field(
        description="that a recording takes at most; null while no rows come", examples=[3.5e9]
    )
    free_bytes: float = Field(description="on the disk, without what recordings leave for others", examples=[8.4e10])
    days: float | None = Field(description="of recording that there is room for, closing it included", examples=[12.0])


class SpreadModel(BaseModel):
    """A signal at each of the times; null where it has no value, or the line is broken by a gap."""

    unit: str = Field(description="empty where nothing says it", examples=["A"])
    low: list[float | None] = Field(
        description="lowest value of the rows that a point stands for", examples=[[1.92, 1.94]]
    )
    mean: list[float | None] = Field(description="mean of these rows", examples=[[2.0, 1.99]])
    high: list[float | None] = Field(
        description="highest value; of a row alone, low, mean and high are its value", examples=[[2.07, 2.05]]
    )


class SamplesModel(BaseModel):
    """A stretch of a recording for a plot. SI; times in s from the recording's begin."""

    id: str = Field(examples=[_ID])
    since: float = Field(description="s from the recording's begin", examples=[0.0])
    until: float = Field(description="s, at most the recording's end", examples=[2.5])
    rows: int = Field(description="in that time", examples=[2500])
    thinned: bool = Field(
        description="points stand for several rows; they reach over the ends by a point at most", examples=[True]
    )
    t: list[float] = Field(
        description="s, of every signal: the middle of the rows that a point stands for, or of a gap",
        examples=[[0.00125, 0.00375]]
    )
    signals: dict[str, SpreadModel]


def samples_model(id_: str, one: Samples) -> SamplesModel:
    """Samples as REST shows them."""
    signals = {
        name: SpreadModel.model_construct(
            unit=one.units[name], low=_values(spread.low), mean=_values(spread.mean), high=_values(spread.high)
        )
        for name, spread in one.course.signals.items()
    }
    return SamplesModel.model_construct(
        id=id_, since=one.since, until=one.until, rows=one.course.rows, thinned=one.course.thinned,
        t=one.course.t.tolist(), signals=signals,
    )


def of_shelf(one: Recording) -> StoredRecordingModel:
    """A closed recording as REST shows it."""
    return StoredRecordingModel.model_validate({
        "id": one.id, "kind": one.kind, "drive": one.drive, "url": one.url, "state": "done", "begun": one.begun,
        "rows": one.rows,
        "seconds": one.seconds, "bytes": one.bytes, "columns": list(one.columns), "title": one.title, "note": one.note,
        "marks": [_mark(mark.t, mark.text, mark.whom, mark.at) for mark in one.marks], "gaps": one.gaps,
        "rows_lost": one.rows_lost, "whole": one.whole, "reason": one.problem or one.ended,
        "continues": one.continues,
    })


def under_way(status: Status, url: str, said: Annotations) -> StoredRecordingModel:
    """A recording under way, or one that has failed, of a drive at a URL, as REST shows it."""
    return StoredRecordingModel.model_validate({
        "id": status.id, "kind": "stream", "drive": status.drive, "url": url, "state": status.state.value,
        "begun": status.asked,
        "rows": status.rows, "seconds": status.seconds, "bytes": status.bytes, "columns": [],
        "title": status.request.title if said.title is None else said.title,
        "note": status.request.note if said.note is None else said.note,
        "marks": [_mark(mark.t, mark.text, mark.whom, mark.at) for mark in (*status.marks, *said.marks)],
        "gaps": status.gaps, "rows_lost": status.rows_lost, "whole": not status.gaps, "reason": status.reason,
        "continues": status.continues,
    })  # fmt: skip


def _values(column: NDArray[np.float64]) -> list[float | None]:
    """With null in place of what is no number."""
    return [None if absent else x for x, absent in zip(column.tolist(), np.isnan(column), strict=True)]


def _mark(t: float, text: str, whom: str, at: str) -> dict[str, object]:
    return {"t": t, "text": text, "whom": whom, "at": at}
