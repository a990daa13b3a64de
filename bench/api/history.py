"""The route of the past: what a drive's estimates were, from the catalogue."""

from datetime import UTC, datetime, timedelta
from typing import Annotated, Final

from fastapi import FastAPI, Query

from bench.api.answers import DRIVE, PROBLEM, Answers, DriveName, of_known, time_of
from bench.api.models.history import HistoryModel, course_model
from bench.errors import UnavailableError
from bench.service.service import Service

_LONGEST: Final = 100.0 * 366.0 * 86_400.0  # s
_ASKED: Answers = {
    422: {"description": "Not a time"} | PROBLEM, 503: {"description": "The catalogue cannot be had"} | PROBLEM,
}


def install(app: FastAPI, service: Service) -> None:
    """Add the route to an application."""

    @app.get("/api/drives/{name}/history", summary="Estimates in the past", responses=_ASKED | DRIVE,
             dependencies=of_known(service))
    def history(
        name: DriveName,
        seconds: Annotated[float, Query(description="how far back, s", ge=1.0, le=_LONGEST)] = 3600.0,
        until: Annotated[
            str | None, Query(description="RFC 3339; default: now", json_schema_extra={"format": "date-time"})
        ] = None,
    ) -> HistoryModel:
        """Each second of the last day, each minute and each hour of all the time before; thinned, extremes kept."""
        end = datetime.now(UTC) if until is None else time_of(until, "until")
        if service.history is None or (memory := service.history.open()) is None:
            why = "the service has none" if service.history is None else service.history.failure
            raise UnavailableError(f"the catalogue cannot be had: {why}")
        begin = end.timestamp() - seconds
        span, courses = memory.history(name, begin, end.timestamp())
        return HistoryModel(
            drive=name, since=end - timedelta(seconds=seconds), until=end, span_s=span,
            parameters={one: course_model(one, course) for one, course in courses.items()},
        )
