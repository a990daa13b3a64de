"""The application: routes over a running service, the page's files, the live stream."""

import asyncio
from collections.abc import AsyncIterator
from importlib import metadata, resources
from pathlib import Path
from typing import Annotated, Any

from fastapi import Body, Depends, FastAPI
from fastapi.responses import FileResponse
from fastapi.sse import EventSourceResponse, ServerSentEvent
from fastapi.staticfiles import StaticFiles

from bench.api import problems
from bench.api.models import (
    DriveModel,
    DrivesModel,
    EstimatesModel,
    HealthModel,
    SnapshotModel,
    ThreadModel,
    WindowModel,
    drive_model,
    estimates_model,
    link_model,
    window_model,
)
from bench.service import Service

DISPLAY_PERIOD = 0.1  # s between two events of the live stream
VERSION = metadata.version("pmsm-bench")

_PROBLEM: dict[int | str, dict[str, Any]] = {404: {"description": "Unknown drive (problem document)"}}


def create_app(service: Service) -> FastAPI:
    """The HTTP application over a running service."""
    app = FastAPI(
        title="pmsm-bench", version=VERSION, docs_url=None, redoc_url=None,
        description="Live parameters of permanent-magnet synchronous motor drives. SI units, peak dq quantities, "
        "electrical angles. Errors are RFC 9457 problem documents.",
    )
    problems.install(app)

    def known(name: str) -> None:
        service.url(name)

    @app.get("/api/drives", summary="All drives")
    def drives() -> DrivesModel:
        return DrivesModel(drives=[drive_model(service, name) for name in service.drives])

    @app.get("/api/drives/{name}", summary="Identity, link, stream of one drive", responses=_PROBLEM)
    def drive(name: str) -> DriveModel:
        return drive_model(service, name)

    @app.get("/api/drives/{name}/estimates", summary="What the window says now", responses=_PROBLEM)
    def estimates(name: str) -> EstimatesModel:
        return estimates_model(service, name)

    @app.get("/api/drives/{name}/window", summary="Settings of the window", responses=_PROBLEM)
    def window(name: str) -> WindowModel:
        return window_model(service.estimates(name).window)

    @app.put("/api/drives/{name}/window", summary="Change settings; the samples held stay",
             responses=_PROBLEM | {422: {"description": "Not a window that can work (problem document)"}})
    def put_window(name: str, change: Annotated[dict[str, Any], Body(examples=[{"length": 2000}])]) -> WindowModel:
        return window_model(service.change_window(name, change))

    @app.get("/api/drives/{name}/stream", summary="Snapshots as server-sent events", responses=_PROBLEM,
             response_class=EventSourceResponse, dependencies=[Depends(known)])
    async def stream(name: str) -> AsyncIterator[ServerSentEvent]:
        while True:
            snapshot = SnapshotModel(drive=drive_model(service, name), estimates=estimates_model(service, name))
            yield ServerSentEvent(event="snapshot", raw_data=snapshot.model_dump_json())
            await asyncio.sleep(DISPLAY_PERIOD)

    @app.get("/api/health", summary="State of every thread and link")
    def health() -> HealthModel:
        return HealthModel(
            status="ok" if service.healthy() else "degraded",
            version=VERSION,
            uptime_s=service.uptime,
            threads=[ThreadModel.model_validate(thread, from_attributes=True) for thread in service.threads()],
            links={name: link_model(service.link(name)) for name in service.drives},
        )

    _serve_page(app)
    return app


def _serve_page(app: FastAPI) -> None:
    page = Path(str(resources.files("web")))
    plotly = Path(str(resources.files("plotly"))) / "package_data" / "plotly.min.js"

    @app.get("/", include_in_schema=False)
    def index() -> FileResponse:
        return FileResponse(page / "index.html")

    @app.get("/assets/plotly.min.js", include_in_schema=False)
    def plotly_bundle() -> FileResponse:
        return FileResponse(plotly, media_type="text/javascript", headers={"Cache-Control": "max-age=86400"})

    @app.get("/favicon.ico", include_in_schema=False)
    def favicon() -> FileResponse:
        return FileResponse(page / "favicon.svg", media_type="image/svg+xml")

    app.mount("/web", StaticFiles(directory=page))
