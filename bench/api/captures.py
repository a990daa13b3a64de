"""The routes of captures, over a running service."""

from typing import Annotated, Any, Final
from urllib.parse import quote

from fastapi import FastAPI, Path, Request, Response
from fastapi.responses import FileResponse

from bench.api.exchange.answers import DRIVE, PROBLEM, Answers, DriveName, body_of, json_object, of_known
from bench.api.guard.idempotency import REPEATABLE
from bench.api.models.captures import CaptureModel, CapturesModel, capture_model
from bench.service.service import Service

MEDIA: Final = "application/vnd.apache.parquet"
_ONE: Answers = DRIVE | {404: {"description": "No drive, or no capture, of that name"} | PROBLEM}
_ASKED: Answers = {
    409: {"description": "Another writer has the drive, or the drive refused"} | PROBLEM,
    422: {"description": "Not a capture that a drive could do"} | PROBLEM,
    503: {"description": "There is no link to the drive"} | PROBLEM,
}
_NOT_NOW: Answers = {409: {"description": "The capture is in another state"} | PROBLEM}
FILE: Answers = {200: {"description": "The recording", "content": {MEDIA: {"schema": {
    "type": "string", "format": "binary"}}}}}
CaptureId = Annotated[str, Path(alias="id", description="id of a capture, or latest")]


def install(app: FastAPI, service: Service) -> None:
    """Add the routes to an application."""

    captures, known = service.captures, of_known(service)

    @app.get("/api/drives/{name}/captures", summary="Captures of a drive", responses=DRIVE, dependencies=known)
    def all_captures(name: DriveName) -> CapturesModel:
        """The latest 200 of all drives, also of services before, the newest first; recordings stay longer."""
        return CapturesModel(captures=[capture_model(status) for status in captures.all(name)])

    @app.post("/api/drives/{name}/captures", summary="Record with the drive's recorder", status_code=202,
              responses=_ASKED | DRIVE, openapi_extra=body_of("CaptureRequestModel") | REPEATABLE,
              dependencies=known)
    def ask(
        name: DriveName, request: Request, response: Response,
        given: Annotated[dict[str, Any], json_object({"length": 2000}, required=False)],
    ) -> CaptureModel:
        """Arms the recorder; the rest happens by itself: waiting for the trigger, upload, recording on disk.

        The capture holds the drive's lease until it ends: nobody else writes to the drive meanwhile. The stream goes
        on. A lost link is waited for, and the upload goes on where it stood, also after a restart of the service.
        """
        status = captures.ask(name, given, "" if request.client is None else request.client.host)
        response.headers["Location"] = f"/api/drives/{quote(name)}/captures/{quote(status.id)}"
        return capture_model(status)

    @app.get("/api/drives/{name}/captures/{id}", summary="State of a capture", responses=_ONE, dependencies=known)
    def one(name: DriveName, id_: CaptureId) -> CaptureModel:
        """How far it is, and why it failed where it did."""
        return capture_model(captures.one(name, id_))

    @app.head("/api/drives/{name}/captures/{id}/file", include_in_schema=False, dependencies=known)
    @app.get("/api/drives/{name}/captures/{id}/file", summary="Download a recording", response_class=FileResponse,
             responses=FILE | _NOT_NOW | _ONE, dependencies=known)
    def file(name: DriveName, id_: CaptureId) -> FileResponse:
        """The recording as Parquet, as `pmsm-bench replay` takes it: t and the signals, with unit and notes."""
        path = captures.file(name, id_)
        return FileResponse(path, media_type=MEDIA, filename=path.name)

    @app.post("/api/drives/{name}/captures/{id}/trigger", summary="Trigger by command", responses=_NOT_NOW | _ONE,
              openapi_extra=body_of("NothingModel"), dependencies=[*known, json_object({}, required=False)])
    def trigger(name: DriveName, id_: CaptureId) -> CaptureModel:
        """Triggers now, whatever the capture waits for."""
        return capture_model(captures.trigger(name, id_))

    @app.delete("/api/drives/{name}/captures/{id}", summary="Cancel a capture", responses=_NOT_NOW | _ONE,
                dependencies=known)
    def cancel(name: DriveName, id_: CaptureId) -> CaptureModel:
        """Stops the drive's recorder and discards what has been uploaded; a capture that has ended stays as it is."""
        return capture_model(captures.cancel(name, id_))
