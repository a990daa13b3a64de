"""Shapes of what the REST interface says of a drive's state and control. SI units."""

from datetime import datetime
from typing import Any, Final, Literal

from pydantic import BaseModel, Field

from bench.actions.control import DriveState
from bench.service.service import Service
from drivers.wire.cia402 import error_advice

SET_POINTS: Final[dict[str, Any]] = {"i_q_ref": 2.0, "i_d_step": 1.0}
"""As one would start a drive with."""

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
    ours: bool = Field(description="this service controls it", examples=[True])
    whom: str | None = Field(description="who asked for that, or for which experiment or flash", examples=["127.0.0.1"])
    in_experiment: bool = Field(
        description="this service controls it for an experiment: `start` is refused", examples=[False]
    )
    in_flash: bool = Field(
        description="this service controls it for a flash of its parameters: `start` is refused", examples=[False]
    )
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

    model_config = {"extra": "allow", "json_schema_extra": {"examples": [SET_POINTS]}}


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
    held, started = now.held if now else None, control.whom
    experiment, flash = service.experiment_on(name), service.flash_on(name)
    whom = (experiment or flash) if started is None else started
    return ControlModel(
        **state_model(now).model_dump(),
        holder=held and held.holder, lease_left_s=held and held.left, ours=whom is not None,
        whom=whom, in_experiment=started is None and experiment is not None,
        in_flash=started is None and flash is not None,
        said=control.said, undone=service.drive(name).undone,
        guarded=now.has_lease if now else None, safe_torque_off=now.safe_torque_off if now else None,
        seen=now and now.at,
    )  # fmt: skip
