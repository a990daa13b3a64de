"""The routes of commissionings, over a running service, and the shapes of what they say."""

from dataclasses import dataclass
from datetime import datetime
from typing import Annotated, Any, ClassVar, Final, Literal
from urllib.parse import quote

from fastapi import FastAPI, Path, Response
from fastapi import Request as HttpRequest
from fastapi.responses import HTMLResponse
from jinja2 import TemplateError
from pydantic import BaseModel, ConfigDict, Field

from bench.api.exchange.answers import DRIVE, PROBLEM, Answers, DriveName, body_of, json_object, of_known
from bench.api.guard.idempotency import REPEATABLE
from bench.api.models.flashes import StepModel
from bench.commissioning.commissionings import Request, Status, as_json
from bench.commissioning.report import report
from bench.diagnoses.report.page import POLICY
from bench.errors import ConfigError, ConflictError
from bench.expected import CLOSED
from bench.service.service import Service

_ONE: Answers = DRIVE | {404: {"description": "No drive, or no commissioning, of that name"} | PROBLEM}
_ASKED: Answers = {
    409: {"description": "Another writer has the drive, or there is nothing to hold its loops against"} | PROBLEM,
    422: {"description": "Not what a commissioning takes; nothing has moved"} | PROBLEM,
    503: {"description": "There is no link to the drive"} | PROBLEM,
}
_PAGE: Answers = {200: {"description": "The page", "content": {"text/html": {"schema": {"type": "string"}}}}}
_NOT_NOW: Answers = {409: {"description": "The commissioning is in another state"} | PROBLEM}
CommissioningId = Annotated[str, Path(alias="id", description="id of a commissioning, or latest")]
_EXAMPLE: Final[dict[str, Any]] = {"kind": "identify"}


@dataclass(frozen=True, slots=True)
class CommissioningRequestModel(Request):
    """What is to be found out."""

    __pydantic_config__: ClassVar = CLOSED | ConfigDict(json_schema_extra={"examples": [_EXAMPLE]})


class CommissioningModel(BaseModel):
    """A commissioning: under way, or ended; its drive is off then, its parameters as they were."""

    id: str = Field(examples=["emulated-identify-20260131-120000-000"])
    drive: str = Field(examples=["emulated"])
    state: Literal["running", "done", "failed", "cancelled"] = Field(examples=["running"])
    phase: str = Field(description="what is being done, in words", examples=["stepping i_d by 3 A"])
    steps: list[StepModel] = Field(description="so far; how far one has come is said with it")
    reason: str = Field(description="a sentence: why it failed", examples=[""])
    asked: datetime = Field(description="when it was asked for", examples=["2026-01-31T12:00:00Z"])
    request: CommissioningRequestModel = Field(examples=[_EXAMPLE])
    result: dict[str, Any] = Field(
        description="once it is done, by kind, SI: what was found, the set that is proposed as TOML, loops against "
        "their promise, mean steps", examples=[{"said": "4 pole pairs; the encoder counts with the field"}],
    )  # fmt: skip
    file: str | None = Field(description="where that is kept, on the service's machine", examples=[None])


class CommissioningsModel(BaseModel):
    """Commissionings of a drive."""

    commissionings: list[CommissioningModel] = Field(description="the newest first")


def _model(status: Status) -> CommissioningModel:
    return CommissioningModel.model_validate(as_json(status))


def install(app: FastAPI, service: Service) -> None:
    """Add the routes to an application."""
    known, jobs = of_known(service), service.commissionings

    @app.post("/api/drives/{name}/commissionings", summary="Commission a drive", status_code=202,
              responses=_ASKED | DRIVE, openapi_extra=body_of("CommissioningRequestModel") | REPEATABLE,
              dependencies=known)
    def ask_commissioning(
        name: DriveName, request: HttpRequest, response: Response,
        given: Annotated[dict[str, Any], json_object(_EXAMPLE)],
    ) -> CommissioningModel:
        """Finds out about a motor that nobody knows, or tries its loops. The motor turns, within the drive's limits.

        It has the drive's lease until it ends; however it ends, the drive is off then, its parameters as they were. A
        set that it proposes is flashed where somebody asks for that.
        """
        status = service.begin_commissioning(name, given, "" if request.client is None else request.client.host)
        response.headers["Location"] = f"/api/drives/{quote(name)}/commissionings/{quote(status.id)}"
        return _model(status)

    @app.get("/api/drives/{name}/commissionings", summary="Commissionings of a drive", responses=DRIVE,
             dependencies=known)
    def all_commissionings(name: DriveName) -> CommissioningsModel:
        """The latest 50 of all drives, the newest first, also of services before."""
        return CommissioningsModel(commissionings=[_model(status) for status in jobs.all(name)])

    @app.get("/api/drives/{name}/commissionings/{id}", summary="State of a commissioning", responses=_ONE,
             dependencies=known)
    def one_commissioning(name: DriveName, id_: CommissioningId) -> CommissioningModel:
        """How far it is, what was found, and why it failed where it did."""
        return _model(jobs.one(name, id_))

    @app.get("/api/drives/{name}/commissionings/{id}/report.html", summary="A commissioning as a page",
             response_class=HTMLResponse, responses=_PAGE | _NOT_NOW | _ONE, dependencies=known)
    def commissioning_report(name: DriveName, id_: CommissioningId) -> Response:
        """Of an identification that is done, with the first start that it followed, and the loops tried again after a
        flash. It needs nothing else, and can be printed.
        """
        found, checked, first = jobs.whole(name, id_)
        when = f"Asked for at {found.asked:%Y-%m-%d %H:%M} UTC"
        if checked is not None:
            lacks = checked.result.get("lacks", [])
            with_it = f"without {len(lacks)} of the set's values in the drive" if lacks else "with the set in the drive"
            when += f"; the loops were tried again at {checked.asked:%Y-%m-%d %H:%M} UTC, {with_it}"
        try:
            page = report(name, f"{when}.", found.result, checked and checked.result, first and first.result)
        except (LookupError, TypeError, ValueError, TemplateError, ConfigError) as error:
            raise ConflictError(f"what is kept of {found.id} cannot be read as a commissioning: {error}") from None
        return HTMLResponse(page, headers={"Content-Security-Policy": POLICY})

    @app.delete("/api/drives/{name}/commissionings/{id}", summary="Cancel a commissioning", responses=_NOT_NOW | _ONE,
                dependencies=known)
    def cancel_commissioning(name: DriveName, id_: CommissioningId) -> CommissioningModel:
        """Stops the drive; one that has ended stays as it is."""
        return _model(jobs.cancel(name, id_))
