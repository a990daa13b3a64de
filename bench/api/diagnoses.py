"""The routes of diagnoses, over a running service."""

import asyncio
from collections.abc import AsyncIterator, Callable
from typing import Annotated, Any, Final
from urllib.parse import quote

from anyio import to_thread
from fastapi import Depends, FastAPI, Header, Path, Query, Response
from fastapi.responses import HTMLResponse
from fastapi.sse import EventSourceResponse, ServerSentEvent

from bench.api.exchange.answers import PROBLEM, SHAPES, Answers, Before, Limit, body_of, json_object, page_of
from bench.api.guard.idempotency import REPEATABLE
from bench.api.guard.preconditions import tag_of
from bench.api.models.diagnoses import DIAGNOSIS, DIAGNOSIS_FIGURES, DiagnosesModel, DiagnosisJobModel, job_model
from bench.diagnoses.diagnosis_jobs import FIGURES, MACHINE, REPORT, RESULT, DiagnosisJobs, Job, JobState
from bench.diagnoses.report.page import POLICY
from bench.errors import UnknownError
from bench.service.service import Service
from estimator.diagnosis.verdict import Verdict

_OF: Final = "/api/recordings/{id}/diagnosis"
_ALL: Final = "/api/diagnoses"
_ROOT: Final = "/api/diagnoses/{id}"
_LATEST: Answers = {404: {"description": "No diagnosis of a recording of that name"} | PROBLEM}
_ONE: Answers = {404: {"description": "No diagnosis of that id"} | PROBLEM}
_WRONG: Answers = {422: {"description": "Not what can be asked for"} | PROBLEM}
_ASKED: Answers = {
    404: {"description": "No recording of that name"} | PROBLEM,
    409: {"description": "It is being diagnosed"} | PROBLEM,
    422: {"description": "A nominal machine that is not whole, a trust or witness that cannot be; a stream's rows"}
    | PROBLEM,
    503: {"description": "Too many are waiting"} | PROBLEM,
}
_NOT_NOW: Answers = {409: {"description": "The diagnosis is in another state"} | PROBLEM}
_RESULT: Answers = {200: {"description": "The diagnosis", "content": {"application/json": {"schema": {
    "$ref": f"{SHAPES}{DIAGNOSIS}"}}}}}
_FIGURES: Answers = {200: {"description": "The figures", "content": {"application/json": {"schema": {
    "$ref": f"{SHAPES}{DIAGNOSIS_FIGURES}"}}}}}
_EVENTS: Answers = {200: {"description": "Events called progress", "content": {
    "text/event-stream": {"itemSchema": {"properties": {"data": {
        "contentMediaType": "application/json", "contentSchema": {"$ref": f"{SHAPES}DiagnosisJobModel"}}}}}}}}
_PERIOD: Final = 0.1  # s between two looks at one that is followed
RecordingId = Annotated[str, Path(alias="id", description="name of a recording of the service's, or latest")]
DiagnosisId = Annotated[str, Path(alias="id", description="id of a diagnosis, or latest")]


def _file(media: str, what: str) -> Answers:
    return {200: {"description": what, "content": {media: {"schema": {"type": "string", "format": "binary"}}}}}


_MEDIA: Final = {
    RESULT: "application/json", FIGURES: "application/json", REPORT: "text/html", MACHINE: "application/toml",
}
_PAGE: Final = _file(_MEDIA[REPORT], "The page")
_MACHINE: Final = _file(_MEDIA[MACHINE], "The machine file")


def install(app: FastAPI, service: Service, ending: Callable[[], bool]) -> None:
    """Add the routes to an application; event streams end where `ending` says so."""

    _install_of_recording(app, service.diagnoses)
    _install_all(app, service.diagnoses)
    _install_progress(app, service.diagnoses, ending)


def _install_of_recording(app: FastAPI, jobs: DiagnosisJobs) -> None:
    """Routes of a recording's latest."""

    @app.post(_OF, summary="Diagnose a recording", status_code=202, responses=_ASKED,
              openapi_extra=body_of("DiagnosisRequestModel") | REPEATABLE)
    def ask_diagnosis(
        id_: RecordingId, response: Response,
        given: Annotated[dict[str, Any], json_object({"trust": {"R_s": 0.2}}, required=False)],
    ) -> DiagnosisJobModel:
        """Which physics the recording shows that the nominal machine leaves out. One at a time, the others wait.

        It is worked on in a process of its own; drives, streams and estimates go on meanwhile. Those before it stay.
        """
        job = jobs.ask(id_, given)
        response.headers["Location"] = f"{_ALL}/{quote(job.id)}"
        return _model(jobs, job)

    @app.get(_OF, summary="State of a recording's latest diagnosis", responses=_LATEST)
    def diagnosis(id_: RecordingId) -> DiagnosisJobModel:
        """How far it is; verdict and sentence once it is done."""
        return _model(jobs, jobs.one(id_))

    @app.get(f"{_OF}/result", summary="A recording's latest diagnosis", responses=_RESULT | _NOT_NOW | _LATEST)
    def diagnosis_result(id_: RecordingId) -> Response:
        """All that is said, as `pmsm-bench diagnose --json` writes it.

        While another one is under way, or where it has failed or been cancelled, that of the last that was done.
        """
        return _sent(jobs, jobs.done(id_), RESULT)

    @app.get(f"{_OF}/figures", summary="Figures of a recording's latest diagnosis",
             responses=_FIGURES | _NOT_NOW | _LATEST)
    def diagnosis_figures(id_: RecordingId) -> Response:
        """The pictures of its report as data: panels with axes and traces."""
        return _sent(jobs, jobs.done(id_), FIGURES)

    @app.get(f"{_OF}/report.html", summary="A recording's latest diagnosis as a page", response_class=HTMLResponse,
             responses=_PAGE | _NOT_NOW | _LATEST)
    def diagnosis_report(id_: RecordingId) -> Response:
        """With pictures; it needs nothing else, and can be printed."""
        return _sent(jobs, jobs.done(id_), REPORT)

    @app.get(f"{_OF}/machine.toml", summary="The machine after a recording's latest diagnosis",
             response_class=Response, responses=_MACHINE | _NOT_NOW | _LATEST)
    def diagnosis_machine(id_: RecordingId) -> Response:
        """A machine file with the parameters and the effects found; 409 where nothing could be fitted."""
        return _sent(jobs, jobs.done(id_), MACHINE)

    @app.delete(_OF, summary="Cancel a recording's diagnosis", responses=_NOT_NOW | _LATEST)
    def cancel_diagnosis(id_: RecordingId) -> DiagnosisJobModel:
        """Ends the process that works on it; a diagnosis that has ended stays as it is."""
        return _model(jobs, jobs.cancel(id_))


def _install_all(app: FastAPI, jobs: DiagnosisJobs) -> None:
    """Routes of all diagnoses, by ids of their own."""

    @app.get(_ALL, summary="All diagnoses", responses=_WRONG)
    def all_diagnoses(
        drive: Annotated[str, Query(description="of recordings of this drive alone")] = "",
        recording: Annotated[str, Query(description="of this recording alone, by its id")] = "",
        verdict: Annotated[Verdict | None, Query()] = None,
        state: Annotated[JobState | None, Query()] = None,
        text: Annotated[str, Query(description="in id, recording, sentence or reason", max_length=200)] = "",
        before: Before = None,
        limit: Limit = 50,
    ) -> DiagnosesModel:
        """Those under way, and all that have ended and not been deleted; the newest first.

        They outlive the service, and the recordings that they are of.
        """
        wanted = [job for job in jobs.all() if (not drive or job.drive == drive)
                  and (not recording or job.recording == recording) and verdict in (None, job.verdict)
                  and state in (None, job.state) and _mentions(job, text)]
        page, total, more = page_of(wanted, lambda job: (job.asked, job.id), before, limit)
        return DiagnosesModel(diagnoses=[_model(jobs, job) for job in page], total=total, next=more)

    @app.get(_ROOT, summary="State of a diagnosis", responses=_ONE)
    def one_diagnosis(id_: DiagnosisId) -> DiagnosisJobModel:
        """How far it is; verdict and sentence once it is done."""
        return _model(jobs, jobs.named(id_))

    @app.get(f"{_ROOT}/result", summary="A diagnosis", responses=_RESULT | _NOT_NOW | _ONE)
    def one_diagnosis_result(id_: DiagnosisId) -> Response:
        """All that is said, as `pmsm-bench diagnose --json` writes it."""
        return _sent(jobs, jobs.named(id_), RESULT)

    @app.get(f"{_ROOT}/figures", summary="Figures of a diagnosis", responses=_FIGURES | _NOT_NOW | _ONE)
    def one_diagnosis_figures(id_: DiagnosisId) -> Response:
        """The pictures of its report as data: panels with axes and traces."""
        return _sent(jobs, jobs.named(id_), FIGURES)

    @app.get(f"{_ROOT}/report.html", summary="A diagnosis as a page", response_class=HTMLResponse,
             responses=_PAGE | _NOT_NOW | _ONE)
    def one_diagnosis_report(id_: DiagnosisId) -> Response:
        """With pictures; it needs nothing else, and can be printed."""
        return _sent(jobs, jobs.named(id_), REPORT)

    @app.get(f"{_ROOT}/machine.toml", summary="The machine after a diagnosis", response_class=Response,
             responses=_MACHINE | _NOT_NOW | _ONE)
    def one_diagnosis_machine(id_: DiagnosisId) -> Response:
        """A machine file with the parameters and the effects found; 409 where nothing could be fitted."""
        return _sent(jobs, jobs.named(id_), MACHINE)

    @app.delete(_ROOT, summary="Delete a diagnosis", responses=_ONE)
    def delete_diagnosis(
        id_: Annotated[str, Path(alias="id", description="id of a diagnosis, which says which")]
    ) -> DiagnosisJobModel:
        """From the disk, for good; one that is under way is cancelled, and stays as that. Tells what it is, or was."""
        return _model(jobs, jobs.remove(id_))


def _install_progress(app: FastAPI, jobs: DiagnosisJobs, ending: Callable[[], bool]) -> None:
    """The route by which one is followed."""

    def known(id_: DiagnosisId) -> None:
        jobs.named(id_)

    @app.get(f"{_ROOT}/stream", summary="Progress of a diagnosis as server-sent events", responses=_EVENTS | _ONE,
             response_class=EventSourceResponse, dependencies=[Depends(known)])
    async def progress(
        id_: DiagnosisId,
        last_event_id: Annotated[str | None, Header(description="of the last event that came: it is not sent again")]
        = None,
    ) -> AsyncIterator[ServerSentEvent]:
        """Its state whenever that has changed, until it has ended: the last event tells verdict and sentence."""
        one, sent = await to_thread.run_sync(jobs.named, id_), last_event_id
        while not ending():
            told = _model(jobs, one)
            if (tag := tag_of(told).strip('"')) != sent:
                sent = tag
                yield ServerSentEvent(event="progress", id=tag, raw_data=told.model_dump_json())
            if one.state.ended:
                return
            await asyncio.sleep(_PERIOD)
            try:
                one = await to_thread.run_sync(jobs.named, one.id)
            except UnknownError:  # it was deleted
                return


def _model(jobs: DiagnosisJobs, job: Job) -> DiagnosisJobModel:
    return job_model(job, recording_there=jobs.has_recording(job))


def _sent(jobs: DiagnosisJobs, job: Job, name: str) -> Response:
    """A file of a diagnosis. Raises as `DiagnosisJobs.file`."""
    headers = {"Content-Security-Policy": POLICY} if name == REPORT else {}
    return Response(jobs.file(job, name), media_type=_MEDIA[name], headers=headers)


def _mentions(job: Job, text: str) -> bool:
    said = (job.id, job.recording, job.sentence or "", job.reason)
    return text.lower() in " ".join(said).lower()
