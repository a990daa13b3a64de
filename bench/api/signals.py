"""The routes of a drive's signals, over a running service."""

import math
from typing import Annotated, Any

from fastapi import FastAPI, Query, Request
from pydantic import BaseModel, Field

from bench.api.exchange.answers import DRIVE, PROBLEM, Answers, DriveName, body_of, json_object, of_known
from bench.api.models.recent import PLACE, RecentModel, place_of, recent_model
from bench.errors import UnavailableError
from bench.service.service import Service
from bench.service.signals import TABLE_ENTRY, Reading, is_writable, shapes

_READ: Answers = {
    409: {"description": "The drive refused"} | PROBLEM,
    422: {"description": "No signal of that name"} | PROBLEM,
    503: {"description": "There is no link to the drive"} | PROBLEM,
}
_RECENT: Answers = {
    422: {"description": "Not the name of a bin"} | PROBLEM,
    503: {"description": "No row has come yet"} | PROBLEM,
}
_WRITE: Answers = _READ | {
    409: {"description": "Another writer has the drive, or the drive refused"} | PROBLEM,
    422: {"description": "Not a value that the signal takes; nothing was written"} | PROBLEM,
}


class SignalModel(BaseModel):
    """A signal of the drive's dictionary."""

    name: str = Field(examples=["i_q_ref"])
    value: float | None = Field(description="SI; null where the drive does not know it", examples=[2.0])
    unit: str = Field(examples=["A"])
    access: str = Field(description="const, ro or rw", examples=["rw"])
    writable: bool = Field(
        description="PUT takes it; the recorder's signals are written by captures alone", examples=[True]
    )
    minimum: float | None = Field(description="of what may be written; null: as the type", examples=[None])
    maximum: float | None = Field(description="likewise", examples=[None])
    summary: str = Field(description="what it is", examples=["q-axis current reference"])


class SignalsModel(BaseModel):
    """Signals, in the dictionary's order or as asked for."""

    signals: list[SignalModel]


class SignalValuesModel(BaseModel):
    """Values by the names of signals, SI, written in this order."""

    model_config = {"extra": "allow", "json_schema_extra": {
        "examples": [{"i_q_ref": 2.0, "bandwidth": 1250.0}], "minProperties": 1,
        "properties": shapes(), "patternProperties": {TABLE_ENTRY: {"type": "number"}}, "additionalProperties": False,
    }}


def install(app: FastAPI, service: Service) -> None:
    """Add the routes to an application."""

    known = of_known(service)

    @app.get("/api/drives/{name}/signals", summary="Read signals", responses=_READ | DRIVE,
             dependencies=known)
    def signals(
        name: DriveName,
        names: Annotated[str, Query(description="names with commas in between; left out: all")] = "",
    ) -> SignalsModel:
        """What the drive says now, over its link: settings, limits, states."""
        return _model(service.read_signals(name, [part.strip() for part in names.split(",") if part.strip()]))

    @app.get("/api/drives/{name}/signals/recent", summary="Signals over the last seconds", responses=_RECENT | DRIVE,
             dependencies=known)
    def recent(
        name: DriveName,
        since: Annotated[
            str | None, Query(description="name of a bin: from that one on; left out: all", pattern=f"^{PLACE}$")
        ] = None,
    ) -> RecentModel:
        """The stream's rows of the last half minute, in bins of 20 ms or a row, with the extremes of each.

        Asked for again since the last bin, it tells what came after; all, where the drive's clock began anew.
        """
        course = service.drive(name).recent.course(None if since is None else place_of(since))
        if course is None:
            raise UnavailableError(f"no row of drive {name} has come yet")
        return recent_model(name, course, service.link(name).age or 0.0)

    @app.put("/api/drives/{name}/signals", summary="Write signals", responses=_WRITE | DRIVE,
             openapi_extra=body_of("SignalValuesModel"), dependencies=known)
    def put_signals(
        name: DriveName, request: Request, values: Annotated[dict[str, Any], json_object({"i_q_ref": 2.0})]
    ) -> SignalsModel:
        """Currents, excitation sequences, speed, limits, commands: in the order given, and read back.

        All values are judged before the first is written. Who writes holds the drive's lease meanwhile.
        """
        before = dict[str, float]()
        request.state.before = before  # also of a write that fails half way
        read = service.write_signals(name, values, "" if request.client is None else request.client.host, before)
        request.state.after = {reading.signal.name: reading.value for reading in read}
        return _model(read)


def _model(readings: list[Reading]) -> SignalsModel:
    return SignalsModel(signals=[
        SignalModel(
            name=r.signal.name, value=None if math.isnan(r.value) else r.value, unit=r.signal.unit,
            access=r.signal.access, writable=is_writable(r.signal), minimum=r.signal.minimum,
            maximum=r.signal.maximum, summary=r.signal.summary,
        )
        for r in readings
    ])  # fmt: skip
