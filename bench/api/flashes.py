"""The routes of parameter sets and flashes, over a running service."""

from collections.abc import Callable, Mapping
from typing import Annotated, Any, Final, Literal
from urllib.parse import quote

from fastapi import FastAPI, Header, Path, Query, Request, Response
from pydantic import TypeAdapter

from bench.actions.flashes import Status
from bench.api.exchange.answers import (
    DRIVE,
    PROBLEM,
    SHAPES,
    Answers,
    DriveName,
    Limit,
    body_of,
    json_object,
    of_known,
    text_or_object,
)
from bench.api.exchange.kinds import TOML
from bench.api.guard.idempotency import REPEATABLE
from bench.api.models.flashes import (
    SET,
    FlashesModel,
    FlashModel,
    ParameterSetModel,
    PlanModel,
    ResumeRequestModel,
    RollbackRequestModel,
    cut_model,
    flash_model,
    past_model,
    plan_model,
    written,
)
from bench.errors import ConflictError, LimitError
from bench.expected import Table, taken
from bench.parameters.formats.a2l import as_a2l
from bench.parameters.formats.c_header import as_c_header
from bench.parameters.formats.dcf import as_dcf
from bench.parameters.journal import BEGINNING
from bench.parameters.parameter_set import LONGEST_NAME, ParameterSet, as_document, as_toml, of_document, of_toml
from bench.service.service import Service

_ONE: Answers = DRIVE | {404: {"description": "No drive, or no flash, of that name"} | PROBLEM}
_READ: Answers = DRIVE | {
    409: {"description": "The drive refused"} | PROBLEM,
    503: {"description": "There is no link to the drive"} | PROBLEM,
}
_JUDGED: Answers = _READ | {422: {"description": "Nothing that can be read as a set"} | PROBLEM}
_ASKED: Answers = _READ | {
    409: {"description": "The drive is on, somebody is at it, or a flash of it was cut; nothing was written"} | PROBLEM,
    422: {"description": "Not a set, or problems, or doubts without a reason; nothing was written"} | PROBLEM,
}
_NONE: Final = "no flash from here was done, or none of that time, or more than one"
_BACK: Answers = _READ | {409: {"description": f"The drive refused, or {_NONE}"} | PROBLEM}
_ASKED_BACK: Answers = _READ | {
    409: {"description": f"As for a flash, or {_NONE}; nothing was written"} | PROBLEM,
    422: {"description": "Not the time of a flash; nothing was written"} | PROBLEM,
}
_TIME: Final = "2026-01-31T12:00:00Z"
_SET_BODY: Final[dict[str, Any]] = {"requestBody": {"required": True, "content": {
    "application/json": {"schema": {"$ref": f"{SHAPES}ParameterSetModel"}},
    TOML: {"schema": {"type": "string", "examples": ['name = "slower"\n[parameters]\nbandwidth = 900.0\n']}},
}}}  # fmt: skip
Form = Literal["json", "toml", "dcf", "c", "a2l"]
_TEXTS: Final[Mapping[str, tuple[str, str]]] = {  # media type and ending of files
    "toml": (TOML, "toml"), "dcf": ("text/plain", "dcf"), "c": ("text/x-c", "h"), "a2l": ("text/plain", "a2l"),
}
_FORMS: Answers = {200: {"description": "The set", "content": {
    "application/json": {"schema": {"$ref": f"{SHAPES}ParameterSetModel"}},
    **{media: {"schema": {"type": "string"}} for media, _ in _TEXTS.values()},
}}}  # fmt: skip
FlashId = Annotated[str, Path(alias="id", description="id of a flash, or latest")]
BeforeFlash = Annotated[str | None, Query(
    description="`since` of a past flash that was done, or a beginning that no other one has; left out: the latest",
    json_schema_extra={"pattern": BEGINNING, "examples": [_TIME]},
)]  # fmt: skip
_ROLLBACK: Final = TypeAdapter(Annotated[RollbackRequestModel, Table("expected an object")])
_RESUME: Final = TypeAdapter(Annotated[ResumeRequestModel, Table("expected an object with finish")])
_SetBody = Annotated[str | dict[str, Any], text_or_object(SET)]


def install(app: FastAPI, service: Service) -> None:
    """Add the routes to an application."""
    _install_sets(app, service)
    _install_flashes(app, service)


def _check_own(service: Service, name: str) -> None:
    """Raise ConflictError while something has changed settings of the drive that are not to stay."""
    if (doing := service.experiment_on(name)) is not None:
        raise ConflictError(f"{doing} has changed settings of the drive for as long: expected it to have ended")


def _install_sets(app: FastAPI, service: Service) -> None:
    flashes, known = service.flashes, of_known(service)

    @app.get("/api/drives/{name}/parameters/set", summary="A drive's parameters as a set", responses=_FORMS | _READ,
             response_class=Response, dependencies=known)
    def parameter_set(
        name: DriveName,
        form: Annotated[Form | None, Query(
            description="TOML to edit and flash, DCF for CANopen tools, a C header, A2L for calibration tools; left "
            "out: as Accept says, else JSON"
        )] = None,
        kind: Annotated[str, Query(
            alias="type", description="of numbers in C: float, q15, q31, iq1 to iq30", pattern="^[a-z0-9]{1,8}$",
        )] = "float",
        title: Annotated[str, Query(
            alias="name", description="what the set is to be called", min_length=1, max_length=LONGEST_NAME,
        )] = "as it is",
        accept: Annotated[str, Header(description="application/json, or application/toml")] = "",
    ) -> Response:  # fmt: skip
        """All that can be flashed, as the drive has it now; set points, stream and recorder are no part of it."""
        _check_own(service, name)
        if not title.isprintable():
            raise LimitError("name: expected characters that can be printed")
        given = flashes.present(name, title)
        form = form or ("toml" if TOML in accept else "json")
        if form == "json":
            told = ParameterSetModel.model_validate(as_document(given)).model_dump_json()
            return Response(told, media_type="application/json", headers={"Vary": "Accept"})
        media, ending = _TEXTS[form]
        file = f'attachment; filename="{quote(name)}.{ending}"'
        return Response(_text(given, form, kind), media_type=media, headers={
            "Content-Disposition": file, "Vary": "Accept"
        })  # fmt: skip

    @app.post("/api/drives/{name}/parameters/plan", summary="What a set would change", responses=_JUDGED,
              openapi_extra=_SET_BODY, dependencies=known)
    def plan_set(name: DriveName, body: _SetBody) -> PlanModel:
        """Names at once all that forbids it: no such signal, outside its limits or the drive's, for another drive.

        Nothing is written. The set comes as JSON, or as TOML by Content-Type: application/toml.
        """
        _check_own(service, name)
        return plan_model(flashes.planned(name, _set_of(body)))


def _install_flashes(app: FastAPI, service: Service) -> None:
    flashes, known = service.flashes, of_known(service)

    def begun(name: str, request: Request, response: Response, ask: Callable[[str], Status]) -> FlashModel:
        status = ask("" if request.client is None else request.client.host)
        request.state.before, request.state.after = written(status)
        response.headers["Location"] = f"/api/drives/{quote(name)}/flashes/{quote(status.id)}"
        return flash_model(status)

    @app.get("/api/drives/{name}/flashes", summary="Flashes of a drive", responses=DRIVE, dependencies=known)
    def all_flashes(name: DriveName, limit: Limit = 20) -> FlashesModel:
        """Those of this service, with their steps; the history of all, also of command lines; one that was cut."""
        past, left = flashes.past(name), flashes.cut(name)
        return FlashesModel(
            flashes=[flash_model(one) for one in flashes.all(name)[:limit]],
            past=[past_model(one) for one in past[:limit]], total=len(past),
            cut=None if left is None else cut_model(left),
        )

    @app.post("/api/drives/{name}/flashes", summary="Flash a set", status_code=202, responses=_ASKED,
              openapi_extra=_SET_BODY | REPEATABLE, dependencies=known)
    def ask_flash(
        name: DriveName, request: Request, response: Response, body: _SetBody,
        override: Annotated[str, Query(
            description="why doubts do not forbid it; the history keeps it", max_length=200,
            examples=["on a test bench"],
        )] = "",
    ) -> FlashModel:  # fmt: skip
        """Writes, reads back, stores, resets the drive and reads all of it again; else it is rolled back.

        The drive has to be off. The flash has its lease until it ends, and cannot be cancelled; Stop is taken at any
        time. The stream breaks off with the reset, and comes back by itself.
        """
        given = _set_of(body)
        return begun(name, request, response, lambda whom: flashes.ask(name, given, whom, override))

    @app.get("/api/drives/{name}/parameters/rollback", summary="What a roll back would change",
             responses=_BACK, dependencies=known)
    def plan_rollback(name: DriveName, before: BeforeFlash = None) -> PlanModel:
        """To the values before the latest flash, or any earlier one."""
        _check_own(service, name)
        return plan_model(flashes.planned_back(name, before))

    @app.post("/api/drives/{name}/parameters/rollback", summary="Go back to before a flash", status_code=202,
              responses=_ASKED_BACK, openapi_extra=body_of("RollbackRequestModel") | REPEATABLE,
              dependencies=known)
    def ask_rollback(
        name: DriveName, request: Request, response: Response,
        given: Annotated[dict[str, Any], json_object({"before": _TIME}, required=False)],
    ) -> FlashModel:  # fmt: skip
        """Flashes all values that the drive had before the latest one, or any earlier one; no limits judge them."""
        before = taken(_ROLLBACK, given, "", LimitError).before
        return begun(name, request, response, lambda whom: flashes.ask_back(name, whom, before))

    @app.post("/api/drives/{name}/parameters/resume", summary="Finish a flash that was cut, or roll it back",
              status_code=202, responses=_ASKED, openapi_extra=body_of("ResumeRequestModel") | REPEATABLE,
              dependencies=known)
    def ask_resume(
        name: DriveName, request: Request, response: Response,
        given: Annotated[dict[str, Any], json_object({"finish": False})],
    ) -> FlashModel:
        """Of a service, or a command line, that ended in the middle of it: until then no other one is begun."""
        finish = taken(_RESUME, given, "", LimitError).finish
        return begun(name, request, response, lambda whom: flashes.resume(name, whom, finish=finish))

    @app.get("/api/drives/{name}/flashes/{id}", summary="State of a flash", responses=_ONE, dependencies=known)
    def one_flash(name: DriveName, id_: FlashId) -> FlashModel:
        """How far it is, and how it ended."""
        return flash_model(flashes.one(name, id_))


def _set_of(body: str | dict[str, Any]) -> ParameterSet:
    """What is wrong with single values a plan tells. Raises ConfigError where it cannot be read as a set."""
    return of_toml(body, "the set") if isinstance(body, str) else of_document(body, "the set")


def _text(given: ParameterSet, form: str, kind: str) -> str:
    """Raises ConfigError."""
    made = {
        "toml": lambda: as_toml(given), "dcf": lambda: as_dcf(given), "c": lambda: as_c_header(given, kind),
        "a2l": lambda: as_a2l(given),
    }  # fmt: skip
    return made[form]()
