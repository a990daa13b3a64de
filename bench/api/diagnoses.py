"""The routes of diagnoses, over a running service."""

from typing import Annotated, Any, Final
from urllib.parse import quote

from fastapi import FastAPI, Path, Response
from fastapi.responses import HTMLResponse, JSONResponse

from bench.api.answers import PROBLEM, SHAPES, Answers, body_of, json_object
from bench.api.models.diagnoses import DIAGNOSIS, FIGURES, DiagnosisJobModel, job_model
from bench.diagnoses.report.page import POLICY
from bench.service.service import Service

_ROOT: Final = "/api/recordings/{id}/diagnosis"
_ONE: Answers = {404: {"description": "No diagnosis of a recording of that name"} | PROBLEM}
_ASKED: Answers = {
    404: {"description": "No recording of that name"} | PROBLEM,
    409: {"description": "It is being diagnosed"} | PROBLEM,
    422: {"description": "Not a nominal machine that is whole, or a trust that cannot be"} | PROBLEM,
    503: {"description": "Too many are waiting"} | PROBLEM,
}
_NOT_NOW: Answers = {409: {"description": "The diagnosis is in another state"} | PROBLEM}


def _json(what: str, shape: str) -> Answers:
    return {200: {"description": what, "content": {"application/json": {"schema": {"$ref": f"{SHAPES}{shape}"}}}}}


_RESULT: Answers = _json("The diagnosis", DIAGNOSIS)
_FIGURES: Answers = _json("The pictures", FIGURES)
RecordingId = Annotated[str, Path(alias="id", description="name of a recording of the service's, or latest")]


def _file(media: str, what: str) -> Answers:
    return {200: {"description": what, "content": {media: {"schema": {"type": "string", "format": "binary"}}}}}


def install(app: FastAPI, service: Service) -> None:
    """Add the routes to an application."""

    jobs = service.diagnoses

    @app.post(_ROOT, summary="Diagnose a recording", status_code=202, responses=_ASKED,
              openapi_extra=body_of("DiagnosisRequestModel"))
    def ask_diagnosis(
        id_: RecordingId, response: Response,
        given: Annotated[dict[str, Any], json_object({"trust": {"R_s": 0.2}}, required=False)],
    ) -> DiagnosisJobModel:
        """Which physics the recording shows that the nominal machine leaves out. One at a time, the others wait.

        It is worked on in a process of its own; drives, streams and estimates go on meanwhile.
        """
        job = jobs.ask(id_, given)
        response.headers["Location"] = f"/api/recordings/{quote(job.id)}/diagnosis"
        return job_model(job)

    @app.get(_ROOT, summary="State of a diagnosis", responses=_ONE)
    def diagnosis(id_: RecordingId) -> DiagnosisJobModel:
        """How far the recording's latest diagnosis is; verdict and sentence once it is done."""
        return job_model(jobs.one(id_))

    @app.get(f"{_ROOT}/result", summary="A diagnosis", responses=_RESULT | _NOT_NOW | _ONE)
    def diagnosis_result(id_: RecordingId) -> JSONResponse:
        """All that is said, as `pmsm-bench diagnose --json` writes it.

        While another one is under way, or where it has failed or been cancelled, that of the last that was done.
        """
        return JSONResponse(jobs.done(id_).content)

    @app.get(f"{_ROOT}/figures", summary="The pictures of a diagnosis", response_class=JSONResponse,
             responses=_FIGURES | _NOT_NOW | _ONE)
    def diagnosis_figures(id_: RecordingId) -> Response:
        """What the report draws, as data: panels with axes and traces. Colours are whose draws them."""
        return Response(jobs.figures(id_), media_type="application/json")

    @app.get(f"{_ROOT}/report.html", summary="A diagnosis as a page", response_class=HTMLResponse,
             responses=_file("text/html", "The page") | _NOT_NOW | _ONE)
    def diagnosis_report(id_: RecordingId) -> HTMLResponse:
        """With pictures; it needs nothing else, runs no script, and can be printed."""
        return HTMLResponse(jobs.report(id_), headers={"Content-Security-Policy": POLICY})

    @app.get(f"{_ROOT}/machine.toml", summary="The machine after a diagnosis", response_class=Response,
             responses=_file("application/toml", "The machine file") | _NOT_NOW | _ONE)
    def diagnosis_machine(id_: RecordingId) -> Response:
        """A machine file with the parameters and the effects found; 409 where nothing could be fitted."""
        return Response(jobs.machine(id_), media_type="application/toml")

    @app.delete(_ROOT, summary="Cancel a diagnosis", responses=_NOT_NOW | _ONE)
    def cancel_diagnosis(id_: RecordingId) -> DiagnosisJobModel:
        """Ends the process that works on it; a diagnosis that has ended stays as it is."""
        return job_model(jobs.cancel(id_))
