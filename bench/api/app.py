"""The application: routes over a running service, the page's files, the live stream."""

import asyncio
import math
import threading
import time
from collections.abc import AsyncIterator, Callable
from dataclasses import asdict
from importlib import metadata, resources
from pathlib import Path
from typing import Annotated, Any

from fastapi import Depends, FastAPI, Header, Query, Request, Response
from fastapi.responses import FileResponse, PlainTextResponse
from fastapi.sse import EventSourceResponse, ServerSentEvent
from fastapi.staticfiles import StaticFiles
from pydantic import TypeAdapter

from bench.api import (
    captures,
    commissionings,
    control,
    diagnoses,
    docs,
    experiments,
    flashes,
    history,
    recordings,
    signals,
)
from bench.api.commissionings import CommissioningRequestModel
from bench.api.exchange import problems
from bench.api.exchange.answers import (
    CHANGED,
    DRIVE,
    PROBLEM,
    SAME,
    SHAPES,
    Answers,
    DriveName,
    body_of,
    complete,
    json_object,
    knows_query,
    of_known,
    says_json,
)
from bench.api.exchange.kinds import READS
from bench.api.experiments import ExperimentRequestModel
from bench.api.guard.preconditions import TAGGED, IfMatch, IfNoneMatch, check_match, is_known, tag_of
from bench.api.guard.record import changes
from bench.api.models.captures import CaptureRequestModel, capture_model
from bench.api.models.control import SetPointsModel, state_model
from bench.api.models.diagnoses import DiagnosisRequestModel, diagnosis_shapes
from bench.api.models.drives import (
    DriveModel,
    DrivesModel,
    EstimatesModel,
    HealthModel,
    NothingModel,
    ProblemModel,
    SnapshotModel,
    ThreadModel,
    WindowChangeModel,
    WindowModel,
    drive_model,
    estimates_model,
    link_model,
    window_model,
)
from bench.api.models.flashes import ParameterSetModel, ResumeRequestModel, RollbackRequestModel
from bench.api.models.metrics import MEDIA, metrics_text
from bench.api.models.recent import place_of, recent_model
from bench.api.models.recordings import AnnotationModel, MarkRequestModel, RecordingRequestModel
from bench.api.signals import SignalValuesModel
from bench.live.recent import Place
from bench.service.service import Service

_FIRST = Place(0, 0)  # of no rows yet: all that are kept come after it
DISPLAY_PERIOD = 0.1  # s between two events of the live stream
VERSION = metadata.version("pmsm-bench")

_CHANGE: Answers = {
    422: {"description": "Not a window that can work"} | PROBLEM,
    503: {"description": "The estimation is too far behind"} | PROBLEM,
}
_TAGGED: Answers = {200: {"description": "Successful Response", "headers": TAGGED}}
_METRICS: Answers = {200: {"description": "The metrics", "content": {"text/plain": {"schema": {
    "type": "string", "examples": ["pmsm_bench_link_up{drive=\"emulated\"} 1\n"]}}}}}
_EVENTS: Answers = {
    200: {"description": "Events called snapshot, and rows where asked for, ten a second", "content": {
        "text/event-stream": {"itemSchema": {"properties": {"data": {
            "contentMediaType": "application/json",
            "contentSchema": {"anyOf": [{"$ref": f"{SHAPES}SnapshotModel"}, {"$ref": f"{SHAPES}RecentModel"}]},
        }}}}
    }}
}


def create_app(
    service: Service, ending: Callable[[], bool] = lambda: False, *, with_token: bool = False
) -> FastAPI:
    """The HTTP application over a running service; event streams end where `ending` says so.

    Its documentation says that a token is needed `with_token`: the application itself does not ask for it.
    """
    app = FastAPI(
        title="pmsm-bench", version=VERSION, docs_url=None, redoc_url=None,
        description="Live parameters of permanent-magnet synchronous motor drives. SI units, peak dq quantities, "
        "electrical angles. Errors are RFC 9457 problem documents.",
        dependencies=[Depends(says_json), Depends(knows_query)],
    )
    problems.install(app)

    known = of_known(service)
    snapshots = dict[str, tuple[float, str]]()  # by drive: when, what; many streams share one

    def snapshot(name: str) -> str:
        made, text = snapshots.get(name, (-math.inf, ""))
        if time.monotonic() - made > DISPLAY_PERIOD / 4:
            latest = service.captures.latest(name)
            text = SnapshotModel(
                drive=drive_model(service, name), estimates=estimates_model(service, name),
                capture=None if latest is None else capture_model(latest),
            ).model_dump_json()
            snapshots[name] = (time.monotonic(), text)
        return text

    @app.get("/api/drives", summary="All drives")
    def drives() -> DrivesModel:
        """Every drive of the configuration, there or not."""
        return DrivesModel(drives=[drive_model(service, name) for name in service.drives])

    @app.get("/api/drives/{name}", summary="Identity, link, stream of one drive", responses=DRIVE)
    def drive(name: DriveName) -> DriveModel:
        """Who the drive is, where its link stands and since when, what its stream delivered and lost."""
        return drive_model(service, name)

    @app.get("/api/drives/{name}/estimates", summary="What the method says now", responses=DRIVE)
    def estimates(name: DriveName) -> EstimatesModel:
        """Each parameter with standard error, unit and status, and what they rest on.

        Renewed 10 times a second; 5 times where the data choose the window.
        """
        return estimates_model(service, name)

    _install_settings(app, service)

    @app.get("/api/drives/{name}/stream", summary="Snapshots as server-sent events", responses=_EVENTS | DRIVE,
             response_class=EventSourceResponse, dependencies=known)
    async def stream(
        name: DriveName,
        rows: Annotated[bool, Query(description="the drive's signals, too, as events called rows")] = False,
        last_event_id: Annotated[
            str | None, Header(description="of the last rows that came: those after it are sent first")
        ] = None,
    ) -> AsyncIterator[ServerSentEvent]:
        """The drive, its estimates and its latest capture at display rate, until the client leaves.

        With `rows`, each event of that name has the bins since the one before, and as its id the last one's name.
        A snapshot is all that is known then; its id goes on after the last rows that came, or, without `rows`, from
        the newest bin, by which `rows` may begin.
        """
        since, recent = None if last_event_id is None else place_of(last_event_id), service.drive(name).recent
        while not ending():
            at = (since or _FIRST) if rows else recent.newest()
            yield ServerSentEvent(event="snapshot", id=str(at), raw_data=snapshot(name))
            if rows and (course := recent.course(since)) is not None:
                since = course.last
                told = recent_model(name, course, service.link(name).age or 0.0)
                yield ServerSentEvent(event="rows", id=str(since), raw_data=told.model_dump_json())
            await asyncio.sleep(DISPLAY_PERIOD)

    captures.install(app, service)
    signals.install(app, service)
    control.install(app, service)
    experiments.install(app, service)
    flashes.install(app, service)
    commissionings.install(app, service)
    recordings.install(app, service)
    history.install(app, service)
    diagnoses.install(app, service, ending)

    @app.get("/api/health", summary="State of every thread and link")
    def health() -> HealthModel:
        """Always 200 while the service lives; its own status says whether all is well."""
        return HealthModel(
            status="ok" if service.healthy() else "degraded",
            version=VERSION,
            uptime_s=service.uptime,
            threads=[ThreadModel.model_validate(thread, from_attributes=True) for thread in service.threads()],
            links={name: link_model(service.link(name)) for name in service.drives},
            drives={name: state_model(service.control(name).state) for name in service.drives},
        )

    @app.get("/metrics", summary="The service for Prometheus", response_class=PlainTextResponse, responses=_METRICS)
    def metrics() -> Response:
        """Links, streams, states and estimates of all drives, and the service itself: text format 0.0.4.

        What is not known now, as an estimate that is stale or held, has no sample.
        """
        return Response(metrics_text(service, VERSION), media_type=MEDIA)

    docs.install(app)
    _serve_page(app)
    _complete(app.openapi())
    complete(app.openapi(), with_token=with_token)
    return app


def _install_settings(app: FastAPI, service: Service) -> None:
    changing = threading.Lock()  # between what a client has seen and the change nothing else changes

    @app.get("/api/drives/{name}/window", summary="Settings of the estimation", responses=_TAGGED | SAME | DRIVE,
             response_model=WindowModel)
    def window(
        name: DriveName, response: Response, if_none_match: IfNoneMatch = None
    ) -> WindowModel | Response:
        """Which method, how many samples it rests on, how they are summed, what is estimated and what is held."""
        told = window_model(service.estimates(name).window)
        tag = _tag_of_settings(told)
        if is_known(tag, if_none_match):
            return Response(status_code=304, headers={"ETag": tag})
        response.headers["ETag"] = tag
        return told

    @app.put("/api/drives/{name}/window", summary="Change settings; the samples held stay",
             responses=_TAGGED | CHANGED | _CHANGE | DRIVE, openapi_extra=body_of("WindowChangeModel"),
             dependencies=of_known(service))
    def put_window(
        name: DriveName, request: Request, response: Response,
        change: Annotated[dict[str, Any], json_object({"length": 2000})], if_match: IfMatch = None,
    ) -> WindowModel:
        """Takes effect at once, on the samples held and those to come. What the body leaves out stays as it is.

        The window keeps its samples under every method. rls and ekf begin with the next sample after they are chosen;
        rls again after a change of periods_per_row, ekf after one of estimated, held or ekf.
        """
        with changing:
            before = service.estimates(name).window
            before.changed(change)  # what cannot be is told so, whatever the client has seen (RFC 9110, 13.2.1)
            check_match(_tag_of_settings(window_model(before)), if_match)
            window = service.change_window(name, change)
        request.state.before, request.state.after = changes(asdict(before), asdict(window))
        told = window_model(window)
        response.headers["ETag"] = _tag_of_settings(told)
        return told


def _tag_of_settings(window: WindowModel) -> str:
    return tag_of(window, exclude={"limits"})


def _complete(document: dict[str, Any]) -> None:
    """Add to the OpenAPI document the shapes that no route's signature tells."""
    for model in (
        ProblemModel, SnapshotModel, WindowChangeModel, CaptureRequestModel, SignalValuesModel, DiagnosisRequestModel,
        ExperimentRequestModel, SetPointsModel, NothingModel, RecordingRequestModel, MarkRequestModel, AnnotationModel,
        ParameterSetModel, ResumeRequestModel, RollbackRequestModel, CommissioningRequestModel,
    ):
        shape = TypeAdapter[Any](model).json_schema(ref_template=f"{SHAPES}{{model}}")
        document["components"]["schemas"] |= shape.pop("$defs", {}) | {model.__name__: shape}
    document["components"]["schemas"] |= diagnosis_shapes()


def _serve_page(app: FastAPI) -> None:
    page = Path(str(resources.files("web")))
    plotly = Path(str(resources.files("plotly"))) / "package_data" / "plotly.min.js"

    @app.api_route("/", methods=[*READS], include_in_schema=False)
    def index() -> FileResponse:
        return FileResponse(page / "index.html")

    @app.api_route("/assets/plotly.min.js", methods=[*READS], include_in_schema=False)
    def plotly_bundle() -> FileResponse:
        return FileResponse(plotly, media_type="text/javascript", headers={"Cache-Control": "max-age=86400"})

    @app.api_route("/favicon.ico", methods=[*READS], include_in_schema=False)
    def favicon() -> FileResponse:
        return FileResponse(page / "favicon.svg", media_type="image/svg+xml")

    app.mount("/web", StaticFiles(directory=page))
