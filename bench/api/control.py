"""The routes by which a drive is started, stopped and reset, over a running service, and the shape of its state."""

from collections.abc import Callable
from datetime import datetime
from typing import Annotated, Any, Literal

from fastapi import FastAPI, Request
from pydantic import BaseModel, Field

from bench.actions.control import DriveState
from bench.api.answers import DRIVE, PROBLEM, Answers, DriveName, body_of, json_object, of_known
from bench.api.guard.record import changes
from bench.service.service import Service
from drivers.errors import DriveError
from drivers.wire.cia402 import error_advice

_WRITTEN: Answers = {
    409: {"description": "Another has control of the drive, it is in fault, or refuses"} | PROBLEM,
    503: {"description": "There is no link to the drive"} | PROBLEM,
}
_STARTED: Answers = _WRITTEN | {422: {"description": "Not set points, or too far; nothing has moved"} | PROBLEM}
_SET_POINTS: dict[str, Any] = {"i_q_ref": 2.0, "i_d_step": 1.0}

StateWords = Literal[
    "not ready", "switch on disabled", "ready to switch on", "switched on", "operation enabled", "quick stop active",
    "fault reaction active", "fault",
]


class FaultModel(BaseModel):
    """Why a drive is in fault."""

    code: str = Field(description="CiA 402 error code", examples=["0x8130"])
    name: str = Field(examples=["the bench fell silent"])
    advice: str = Field(description="what to do", examples=["see whether the bench still runs, then reset the fault"])


class StateModel(BaseModel):
    """A drive's state."""

    state: StateWords | None = Field(
        description="by CiA 402, in words; the bridge is on in operation enabled alone; null while there is no link",
        examples=["operation enabled"],
    )
    fault: FaultModel | None = Field(description="null while it is in none", examples=[None])


class ControlModel(StateModel):
    """A drive's state, and who controls it."""

    holder: str | None = Field(
        description="who controls it, as the drive says: a lease's holder, or local; null for nobody",
        examples=["root@bench:4711"],
    )
    lease_left_s: float | None = Field(
        description="until the drive goes off unless its holder renews; null under local control", examples=[0.8]
    )
    ours: bool = Field(description="this service controls it")
    whom: str | None = Field(description="who asked for that, or for which experiment", examples=["127.0.0.1"])
    in_experiment: bool = Field(description="this service controls it for an experiment: `start` is refused")
    said: str = Field(description="why control ended, a clause; empty while it has not", examples=[""])
    undone: str = Field(
        description="what a bench that ended without notice had left, and this one has undone", examples=[""]
    )
    guarded: bool | None = Field(
        description="the drive has a control lease; false: a watchdog only, which anybody's request feeds, so that a "
        "second client keeps it running, and may write to it",
        examples=[True],
    )
    safe_torque_off: str | None = Field(
        description="state of its STO input, as it tells; null where it tells none", examples=[None]
    )
    seen: datetime | None = Field(description="when it was last asked", examples=[None])


class SetPointsModel(BaseModel):
    """Set points by name, SI, to start with; what is left out is zero."""

    model_config = {"extra": "allow", "json_schema_extra": {"examples": [_SET_POINTS]}}


def state_model(now: DriveState | None) -> StateModel:
    """A drive's state as REST shows it."""
    fault = now.fault if now else None
    return StateModel(
        state=str(now.state) if now else None,  # pyright: ignore[reportArgumentType]
        fault=fault and FaultModel(code=f"0x{fault.code:04X}", name=fault.text, advice=error_advice(fault.code)),
    )


def control_model(service: Service, name: str) -> ControlModel:
    """A drive's control as REST shows it."""
    control = service.control(name)
    now: DriveState | None = control.state
    held, started, experiment = now.held if now else None, control.whom, service.experiment_on(name)
    whom = experiment if started is None else started
    return ControlModel(
        **state_model(now).model_dump(),
        holder=held and held.holder, lease_left_s=held and held.left, ours=whom is not None,
        whom=whom, in_experiment=started is None and experiment is not None,
        said=control.said, undone=service.drive(name).undone,
        guarded=now.has_lease if now else None, safe_torque_off=now.safe_torque_off if now else None,
        seen=now and now.at,
    )  # fmt: skip


def install(app: FastAPI, service: Service) -> None:
    """Add the routes to an application."""

    known = of_known(service)

    @app.post("/api/drives/{name}/start", summary="Start a drive", responses=_STARTED | DRIVE,
              openapi_extra=body_of("SetPointsModel"), dependencies=known)
    def start(
        name: DriveName, request: Request, values: Annotated[dict[str, Any], json_object(_SET_POINTS, required=False)]
    ) -> ControlModel:
        """Takes the drive's control lease, gives set points, switches its bridge on, and renews the lease from then on.

        Asked again, it gives new set points; those left out are zero then. A drive in fault has to be reset before.
        """
        before = _set_points(service, name)
        model = _changed(service, name, request, lambda: service.start_drive(name, values, _whom(request)))
        gone, come = changes(before, _set_points(service, name))
        request.state.before, request.state.after = request.state.before | gone, request.state.after | come
        return model

    @app.post("/api/drives/{name}/stop", summary="Stop a drive", responses=_WRITTEN | DRIVE, dependencies=known)
    def stop(name: DriveName, request: Request) -> ControlModel:
        """Switches the bridge off, set points to zero, whoever controls the drive; an experiment on it ends."""
        return _changed(service, name, request, lambda: service.stop_drive(name, _whom(request)))

    @app.post("/api/drives/{name}/reset", summary="Reset a drive's fault", responses=_WRITTEN | DRIVE,
              openapi_extra=body_of("NothingModel"), dependencies=[*known, json_object({}, required=False)])
    def reset(name: DriveName, request: Request) -> ControlModel:
        """Leaves fault with the bridge off; a fault whose cause remains stays."""
        return _changed(service, name, request, service.control(name).reset)


def _changed(service: Service, name: str, request: Request, change: Callable[[], object]) -> ControlModel:
    """The drive after a change, which the log of writes tells with what was before."""
    before = control_model(service, name)
    change()
    after = control_model(service, name)
    request.state.before, request.state.after = changes(_told(before), _told(after))
    return after


def _set_points(service: Service, name: str) -> dict[str, Any]:
    """Empty while the drive does not tell."""
    try:
        return dict[str, Any](service.set_points(name))
    except DriveError:
        return {}


def _told(model: ControlModel) -> dict[str, Any]:
    return {"state": model.state, "fault": model.fault and model.fault.code, "holder": model.holder}


def _whom(request: Request) -> str:
    return "" if request.client is None else request.client.host
