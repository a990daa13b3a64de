"""Shapes of what the REST interface says of the past. SI units."""

from datetime import datetime
from typing import Literal

from pydantic import BaseModel, Field

from bench.store.catalogue.memory import Course
from estimator.machine import UNITS


class CourseModel(BaseModel):
    """A parameter over time: lists of equal length."""

    unit: str = Field(examples=["ohm"])
    t: list[float] = Field(description="s since 1970, UTC: where each span begins")
    value: list[float] = Field(description="mean over the span")
    std: list[float | None] = Field(description="mean standard error; null: a value that is held")
    low: list[float] = Field(description="least value in the span")
    high: list[float] = Field(description="largest value in the span")
    status: list[Literal["held", "ok", "doubtful"]] = Field(description="the worst in the span")


class HistoryModel(BaseModel):
    """A drive's estimates in the past; where there was none, and while they were stale, a span is missing."""

    drive: str = Field(examples=["emulated"])
    since: datetime
    until: datetime
    span_s: int = Field(description="of each point, s: as short as makes no more than 1,500 of them", examples=[60])
    parameters: dict[str, CourseModel] = Field(description="empty where nothing is remembered")


def course_model(name: str, course: Course) -> CourseModel:
    """A parameter's past as REST shows it."""
    return CourseModel(
        unit=UNITS[name], t=list(course.t), value=list(course.value), std=list(course.std), low=list(course.low),
        high=list(course.high), status=list(course.status),  # pyright: ignore[reportArgumentType]
    )  # fmt: skip
