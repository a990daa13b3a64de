"""Shapes of what the REST interface says of the past. SI units."""

from datetime import datetime
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from bench.store.catalogue.chronicle import LEASE, WRITE, Happening, ParameterSet
from bench.store.catalogue.memory import Course
from drivers.wire.dictionary import signal_named
from estimator.machine import UNITS

EventKind = Literal["link", "clock", "state", "fault", "flash", "write", "lease"]


class CourseModel(BaseModel):
    """A parameter over time: lists of equal length."""

    unit: str = Field(examples=["ohm"])
    t: list[float] = Field(
        description="s since 1970, UTC: where each span begins", examples=[[1769860800.0, 1769860860.0]]
    )
    value: list[float] = Field(description="mean over the span", examples=[[0.9663, 0.9671]])
    std: list[float | None] = Field(
        description="mean standard error; null: a value that is held", examples=[[1.9e-4, 2.1e-4]]
    )
    low: list[float] = Field(description="least value in the span", examples=[[0.9659, 0.9668]])
    high: list[float] = Field(description="largest value in the span", examples=[[0.9668, 0.9674]])
    status: list[Literal["held", "ok", "doubtful"]] = Field(
        description="the worst in the span", examples=[["ok", "ok"]]
    )


class HistoryModel(BaseModel):
    """A drive's estimates in the past; where there was none, and while they were stale, a span is missing."""

    drive: str = Field(examples=["emulated"])
    since: datetime = Field(description="begin of the time asked for", examples=["2026-01-31T12:00:00Z"])
    until: datetime = Field(description="its end", examples=["2026-01-31T13:00:00Z"])
    span_s: int = Field(description="of each point, s: as short as makes no more than 1,500 of them", examples=[60])
    parameters: dict[str, CourseModel] = Field(description="empty where nothing is remembered")


class WriteModel(BaseModel):
    """A write, as the log of writes has it."""

    who: str = Field(description="address", examples=["127.0.0.1"])
    by: str = Field(description="how it was let in: loopback, token, page", examples=["loopback"])
    method: str = Field(examples=["POST"])
    path: str = Field(examples=["/api/drives/emulated/stop"])
    status: int = Field(description="of the answer", examples=[200])
    outcome: str = Field(description="done, or why not", examples=["done"])
    body: str = Field(description="as it came, shortened", examples=['{"i_q_ref": 2.0}'])
    before: Any = Field(description="what it changed, as it was; null where it is not told", examples=[None])
    after: Any = Field(examples=[None])


class LeaseModel(BaseModel):
    """Who controlled a drive, from `at` on."""

    part: Literal["control", "recorder"] = Field(description="of the drive")
    holder: str = Field(examples=["capture emulated-20260131-120000-000"])
    ended: datetime | None = Field(
        description="null: it goes on, or when is not known", examples=["2026-01-31T12:00:40Z"]
    )
    how: str = Field(description="it ended; empty: it goes on", examples=["done"])


class EventModel(BaseModel):
    """Something that happened to a drive."""

    at: datetime = Field(examples=["2026-01-31T12:00:00Z"])
    kind: EventKind
    sentence: str = Field(examples=["switch on disabled"])
    write: WriteModel | None = Field(description="null but of a write")
    lease: LeaseModel | None = Field(description="null but of a lease")


class EventsModel(BaseModel):
    """What happened to a drive, the newest first."""

    events: list[EventModel]
    total: int = Field(description="before that time, of that kind", examples=[1])
    next: str | None = Field(description="before which the next page begins; null on the last one", examples=[None])


class ParameterChangeModel(BaseModel):
    """A parameter that is other than before; SI."""

    model_config = ConfigDict(populate_by_name=True)

    name: str = Field(examples=["bandwidth"])
    unit: str = Field(examples=["rad/s"])
    before: float | None = Field(
        serialization_alias="from", description="null: it was not read before, or is not finite", examples=[1000.0]
    )
    after: float | None = Field(description="null: not finite", serialization_alias="to", examples=[1500.0])


class ParametersModel(BaseModel):
    """A drive's parameters at a moment."""

    at: datetime = Field(examples=["2026-01-31T12:00:00Z"])
    why: str = Field(description="they were read: what began", examples=["connected"])
    device: str = Field(description="by which the drive is known again", examples=["a drive, serial 1"])
    values: dict[str, float | None] = Field(description="by signal, SI", examples=[{"bandwidth": 1500.0}])
    changed: list[ParameterChangeModel] = Field(
        description="what is not as in the one before; empty where there is none before"
    )


class SnapshotsModel(BaseModel):
    """A drive's parameters, whenever they were other than before; the newest first."""

    snapshots: list[ParametersModel]
    total: int = Field(description="before that time", examples=[1])
    next: str | None = Field(description="before which the next page begins; null on the last one", examples=[None])


def event_model(one: Happening) -> EventModel:
    """Something that happened as REST shows it."""
    return EventModel.model_validate({
        "at": one.at, "kind": one.kind, "sentence": one.sentence,
        "write": one.told if one.kind == WRITE else None, "lease": one.told if one.kind == LEASE else None,
    })  # fmt: skip


def parameters_model(one: ParameterSet, before: ParameterSet | None) -> ParametersModel:
    """A snapshot as REST shows it."""
    then = one.values if before is None else before.values
    changed = [
        ParameterChangeModel(name=name, unit=_unit(name), before=then.get(name), after=value)
        for name, value in one.values.items() if name not in then or then[name] != value
    ]
    return ParametersModel(at=one.at, why=one.why, device=one.device, values=dict(one.values), changed=changed)


def _unit(name: str) -> str:
    """Empty for a signal of another version's."""
    try:
        return signal_named(name).unit
    except KeyError:
        return ""


def course_model(name: str, course: Course) -> CourseModel:
    """A parameter's past as REST shows it."""
    return CourseModel(
        unit=UNITS[name], t=list(course.t), value=list(course.value), std=list(course.std), low=list(course.low),
        high=list(course.high), status=list(course.status),  # pyright: ignore[reportArgumentType]
    )  # fmt: skip
