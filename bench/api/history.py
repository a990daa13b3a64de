"""The routes of the past, from the catalogue: what a drive's estimates were, what happened to it, its parameters."""

from datetime import UTC, datetime, timedelta
from typing import Annotated, Final

from fastapi import FastAPI, Query

from bench.api.exchange.answers import (
    DRIVE,
    PROBLEM,
    Answers,
    Before,
    DriveName,
    Limit,
    of_known,
    place_before,
    time_of,
    told_place,
)
from bench.api.models.history import (
    EventKind,
    EventsModel,
    HistoryModel,
    SnapshotsModel,
    course_model,
    event_model,
    parameters_model,
)
from bench.errors import UnavailableError
from bench.service.service import Service
from bench.store.catalogue.memory import Memory

_LONGEST: Final = 100.0 * 366.0 * 86_400.0  # s
_ASKED: Answers = {
    422: {"description": "Not a time"} | PROBLEM, 503: {"description": "The catalogue cannot be had"} | PROBLEM,
}


def install(app: FastAPI, service: Service) -> None:
    """Add the routes to an application."""

    known = of_known(service)

    @app.get("/api/drives/{name}/history", summary="Estimates in the past", responses=_ASKED | DRIVE,
             dependencies=known)
    def history(
        name: DriveName,
        seconds: Annotated[float, Query(description="how far back, s", ge=1.0, le=_LONGEST)] = 3600.0,
        until: Annotated[
            str | None, Query(description="RFC 3339; default: now", json_schema_extra={"format": "date-time"})
        ] = None,
    ) -> HistoryModel:
        """Each second of the last day, each minute and each hour of all the time before; thinned, extremes kept."""
        end = datetime.now(UTC) if until is None else time_of(until, "until")
        begin = end.timestamp() - seconds
        span, courses = _memory(service).history(name, begin, end.timestamp())
        return HistoryModel(
            drive=name, since=end - timedelta(seconds=seconds), until=end, span_s=span,
            parameters={one: course_model(one, course) for one, course in courses.items()},
        )

    @app.get("/api/drives/{name}/events", summary="What happened to a drive", responses=_ASKED | DRIVE,
             dependencies=known)
    def events(
        name: DriveName, kind: Annotated[EventKind | None, Query(description="these alone")] = None,
        before: Before = None, limit: Limit = 50,
    ) -> EventsModel:
        """Links lost and back, states and faults, every write that reached it, and who controlled it; the newest first.
        """
        begin = place_before(before)
        page, total = _memory(service).chronicle.page(name, kind, begin, limit)
        return EventsModel(
            events=[event_model(one) for one in page], total=total,
            next=told_place(page[-1].place) if total > limit else None,
        )

    @app.get("/api/drives/{name}/parameters", summary="A drive's parameters in the past", responses=_ASKED | DRIVE,
             dependencies=known)
    def parameters(name: DriveName, before: Before = None, limit: Limit = 50) -> SnapshotsModel:
        """Read at each connect and when a recording, a capture or an experiment begins; kept where they have changed.
        """
        begin = place_before(before)
        found, total = _memory(service).chronicle.snapshots(name, begin, limit + 1)
        pairs = [*zip(found, [*found[1:], None], strict=False)][:limit]
        return SnapshotsModel(
            snapshots=[parameters_model(one, earlier) for one, earlier in pairs], total=total,
            next=told_place(pairs[-1][0].place) if len(found) > limit else None,
        )


def _memory(service: Service) -> Memory:
    """The catalogue. Raises UnavailableError."""
    if service.history is None or (memory := service.history.open()) is None:
        why = "the service has none" if service.history is None else service.history.failure
        raise UnavailableError(f"the catalogue cannot be had: {why}")
    return memory
