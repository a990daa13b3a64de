"""The routes of experiments, over a running service, and the shapes of what they say."""

from dataclasses import dataclass
from datetime import datetime
from typing import Annotated, Any, Final, Literal
from urllib.parse import quote

from fastapi import FastAPI, Path, Request, Response
from fastapi.responses import FileResponse
from pydantic import BaseModel, ConfigDict, Field

from bench.actions.experiment import MOST_HOLDS, AskedHold, Motor, Step
from bench.actions.experiments import as_json
from bench.api.captures import FILE, MEDIA
from bench.api.exchange.answers import DRIVE, PROBLEM, Answers, DriveName, body_of, json_object, of_known
from bench.api.guard.idempotency import REPEATABLE
from bench.service.service import Service

_ONE: Answers = DRIVE | {404: {"description": "No drive, or no experiment, of that name"} | PROBLEM}
_ASKED: Answers = {
    409: {"description": "Another writer has the drive, or the drive refused"} | PROBLEM,
    422: {"description": "Not levels that the drive could hold, or of another motor; nothing has moved"} | PROBLEM,
    503: {"description": "There is no link to the drive"} | PROBLEM,
}
_NOT_NOW: Answers = {409: {"description": "The experiment is in another state"} | PROBLEM}
ExperimentId = Annotated[str, Path(alias="id", description="id of an experiment, or latest")]
_HOLD: Final[Any] = {"speed_rpm": 1200.0, "i_d": -1.8, "i_q": 2.0, "seconds": 0.5}


@dataclass(frozen=True, slots=True)
class HoldModel(AskedHold):
    """Levels to be held."""


class ExperimentRequestModel(BaseModel):
    """What to hold, one after the other: an experiment of a diagnosis, or its holds, step and machine alone.

    A whole diagnosis, as JSON, stands for the first experiment of it that a drive can do.
    """

    model_config = ConfigDict(extra="allow", json_schema_extra={"examples": [{"holds": [_HOLD], "step": 0.6}]})

    holds: list[HoldModel] = Field(
        description="one after the other", min_length=1, max_length=MOST_HOLDS, examples=[[_HOLD]]
    )
    step: Step = Field(0.0, examples=[0.6])
    machine: Motor = Field({}, examples=[{"psi_f": 0.12, "n_p": 4}])


class ExperimentRunModel(BaseModel):
    """An experiment: under way, or ended; its drive is stopped then."""

    id: str = Field(examples=["emulated-experiment-20260131-120000-000"])
    drive: str = Field(examples=["emulated"])
    state: Literal["running", "done", "failed", "cancelled"] = Field(examples=["running"])
    phase: str = Field(description="what is being done, in words", examples=["holding 1200 rpm, i_d = 0 A, i_q = 2 A"])
    progress: float = Field(description="0 to 1", examples=[0.4])
    reason: str = Field(description="a sentence: why it failed", examples=[""])
    remarks: list[str] = Field(description="what was held otherwise than asked for", examples=[[]])
    samples: int = Field(description="in the recording", examples=[0])
    file: str | None = Field(description="the recording, on the service's machine", examples=[None])
    asked: datetime = Field(description="when it was asked for", examples=["2026-01-31T12:00:00Z"])
    holds: list[HoldModel] = Field(examples=[[_HOLD]])
    step: float = Field(description="A", examples=[0.6])


class ExperimentsModel(BaseModel):
    """Experiments of a drive."""

    experiments: list[ExperimentRunModel] = Field(description="the newest first")


def install(app: FastAPI, service: Service) -> None:
    """Add the routes to an application."""

    experiments, known = service.experiments, of_known(service)

    @app.post("/api/drives/{name}/experiments", summary="Do what a diagnosis asks for", status_code=202,
              responses=_ASKED | DRIVE, openapi_extra=body_of("ExperimentRequestModel") | REPEATABLE,
              dependencies=known)
    def ask_experiment(
        name: DriveName, request: Request, response: Response,
        given: Annotated[dict[str, Any], json_object({"holds": [_HOLD]})],
    ) -> ExperimentRunModel:
        """Holds levels of current, and of speed where the drive controls it, and records every control period.

        It has the drive's lease until it ends; however it ends, the drive is stopped then, its settings as they were.
        The recording is one of the service's, to be diagnosed.
        """
        status = service.begin_experiment(name, given, "" if request.client is None else request.client.host)
        response.headers["Location"] = f"/api/drives/{quote(name)}/experiments/{quote(status.id)}"
        return ExperimentRunModel.model_validate(as_json(status))

    @app.get("/api/drives/{name}/experiments", summary="Experiments of a drive", responses=DRIVE, dependencies=known)
    def all_experiments(name: DriveName) -> ExperimentsModel:
        """The latest 50 of all drives, the newest first, also of services before."""
        return ExperimentsModel(
            experiments=[ExperimentRunModel.model_validate(as_json(status)) for status in experiments.all(name)]
        )

    @app.get("/api/drives/{name}/experiments/{id}", summary="State of an experiment", responses=_ONE,
             dependencies=known)
    def one_experiment(name: DriveName, id_: ExperimentId) -> ExperimentRunModel:
        """How far it is, and why it failed where it did."""
        return ExperimentRunModel.model_validate(as_json(experiments.one(name, id_)))

    @app.get("/api/drives/{name}/experiments/{id}/file", summary="Download an experiment's recording",
             response_class=FileResponse, responses=FILE | _NOT_NOW | _ONE, dependencies=known)
    def experiment_file(name: DriveName, id_: ExperimentId) -> FileResponse:
        """The recording as Parquet, as `pmsm-bench diagnose` takes it."""
        path = experiments.file(name, id_)
        return FileResponse(path, media_type=MEDIA, filename=path.name)

    @app.delete("/api/drives/{name}/experiments/{id}", summary="Cancel an experiment", responses=_NOT_NOW | _ONE,
                dependencies=known)
    def cancel_experiment(name: DriveName, id_: ExperimentId) -> ExperimentRunModel:
        """Stops the drive and discards what was recorded; an experiment that has ended stays as it is."""
        return ExperimentRunModel.model_validate(as_json(experiments.cancel(name, id_)))
