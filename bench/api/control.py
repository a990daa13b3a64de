"""The routes by which a drive is started, stopped and reset, over a running service."""

from collections.abc import Callable
from typing import Annotated, Any

from fastapi import FastAPI, Request

from bench.api.exchange.answers import DRIVE, PROBLEM, Answers, DriveName, body_of, json_object, of_known
from bench.api.guard.record import changes
from bench.api.models.control import SET_POINTS, ControlModel, control_model
from bench.service.service import Service
from drivers.errors import DriveError

_WRITTEN: Answers = {
    409: {"description": "Another has control of the drive, it is in fault, or refuses"} | PROBLEM,
    503: {"description": "There is no link to the drive"} | PROBLEM,
}
_STARTED: Answers = _WRITTEN | {422: {"description": "Not set points, or too far; nothing has moved"} | PROBLEM}

def install(app: FastAPI, service: Service) -> None:
    """Add the routes to an application."""

    known = of_known(service)

    @app.post("/api/drives/{name}/start", summary="Start a drive", responses=_STARTED | DRIVE,
              openapi_extra=body_of("SetPointsModel"), dependencies=known)
    def start(
        name: DriveName, request: Request, values: Annotated[dict[str, Any], json_object(SET_POINTS, required=False)]
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
