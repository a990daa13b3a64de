"""Shapes of what the REST interface says. SI units; ages and durations in s."""

import math
from dataclasses import asdict, dataclass
from datetime import datetime
from typing import ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field

from bench.actions.safety.limits import RPM
from bench.api.models.captures import CaptureModel
from bench.api.models.control import ControlModel, StateModel, control_model, state_model
from bench.api.models.flashes import CutFlashModel, cut_model
from bench.expected import CLOSED
from bench.live.acquisition import Link
from bench.live.estimation import Snapshot
from bench.live.mechanics import Shaft
from bench.live.window import Ekf, Estimated, Forgetting, Held, Length, Longest, Method, Periods, Window
from bench.service.service import Service
from estimator.machine import PARAMETERS
from estimator.mechanics.mechanics import PARAMETERS as SHAFT
from estimator.online.estimate import Estimate, Status
from estimator.online.rls import SMALLEST_LAM
from estimator.online.window_ls import MAX_LENGTH, MAX_M

_TIME = "2026-01-31T12:00:00Z"


class IdentityModel(BaseModel):
    """Who the drive says it is."""

    device_name: str = Field(examples=["pmsm-bench virtual drive"])
    vendor_id: int = Field(examples=[0])
    product_code: int = Field(examples=[1347244877])
    revision: int = Field(examples=[1])
    serial: int = Field(examples=[1])
    layout_id: int = Field(description="checksum of the drive's signal dictionary", examples=[1394068101])
    T_s: float = Field(description="control period, s", examples=[1e-4])
    i_full: float = Field(description="full scale of currents, A", examples=[24.0])
    u_full: float = Field(description="full scale of voltages, V", examples=[387.5])
    omega_full: float = Field(description="full scale of electrical speed, rad/s", examples=[2982.9763])


class FailureModel(BaseModel):
    """What went wrong last."""

    sentence: str = Field(examples=["nothing serves a CAN bus at 127.0.0.1:29536: Connection refused"])
    time: datetime = Field(examples=[_TIME])


class LinkModel(BaseModel):
    """The link to a drive."""

    state: Literal["connecting", "streaming", "lost"] = Field(
        description="connecting: never had it; lost: had it, trying to get it back", examples=["streaming"]
    )
    since: datetime = Field(description="when the state was entered", examples=[_TIME])
    reconnects: int = Field(description="times the link came back", examples=[0])
    last_error: FailureModel | None = Field(description="also while all is well again", examples=[None])


class StreamModel(BaseModel):
    """The stream of a drive, since the service started."""

    rate_hz: float = Field(description="rows per second over the last 2 s", examples=[1000.1])
    nominal_rate_hz: float | None = Field(description="rows per second by the drive's own clock", examples=[1000.0])
    rows: int = Field(description="rows received", examples=[251930])
    gaps: int = Field(description="breaks between rows", examples=[0])
    rows_lost: int = Field(
        description="rows the drive made and the bench never had, by the drive's clock", examples=[0]
    )
    clock_resets: int = Field(
        description="times the drive's clock began anew: rows it made just before, if any, are not in rows_lost",
        examples=[0]
    )
    frames_late: int = Field(description="frames that came twice, or too late: passed over", examples=[0])
    frames_foreign: int = Field(
        description="frames under the stream's identifiers that are not of it: passed over", examples=[0]
    )
    note: str = Field(description="what the bench changed of the stream by itself; empty: nothing", examples=[""])
    age_s: float | None = Field(description="since the end of the latest row, by the drive's tick", examples=[0.004])
    t_drive_s: float | None = Field(description="drive's clock at the end of the latest row", examples=[251.93])


class LatestModel(BaseModel):
    """What the drive does now: means over the last 0.1 s of its rows; null where it tells none."""

    i_d: float | None = Field(description="A", examples=[-1.02])
    i_q: float | None = Field(description="A", examples=[2.98])
    u_d: float | None = Field(description="V; null while the bridge is off", examples=[-10.4])
    u_q: float | None = Field(description="V", examples=[63.1])
    u_dc: float | None = Field(description="V", examples=[310.0])
    omega_e: float | None = Field(description="rad/s, electrical", examples=[502.7])
    speed_rpm: float | None = Field(
        description="rpm, mechanical; null where the machine's pole pairs are not configured", examples=[1200.1]
    )
    temp_winding: float | None = Field(description="degC", examples=[24.6])
    temp_magnet: float | None = Field(description="degC", examples=[22.1])


class LimitsModel(BaseModel):
    """How far set points may go here; null: not known, so nothing but the drive's own limits holds."""

    i_max: float | None = Field(description="A, peak, of the current vector with its steps", examples=[6.0])
    speed_max_rpm: float | None = Field(description="rpm, mechanical", examples=[3000.0])
    n_p: int | None = Field(description="pole pairs of the machine", examples=[4])


class WriterModel(BaseModel):
    """Who writes to a drive; a second writer is refused until it has ended."""

    holder: str = Field(examples=["capture emulated-20260131-120000-000 (asked for from 127.0.0.1)"])
    until: datetime = Field(description="when its lease ends at the latest", examples=[_TIME])


class DriveModel(BaseModel):
    """One drive."""

    name: str = Field(examples=["emulated"])
    url: str = Field(description="its bus address", examples=["canopen://socketcand/127.0.0.1:29536/can0/5"])
    identity: IdentityModel | None = Field(description="null before the first connection")
    link: LinkModel
    stream: StreamModel
    latest: LatestModel | None = Field(description="null while no rows come")
    limits: LimitsModel
    writer: WriterModel | None = Field(description="null while nobody writes to it", examples=[None])
    control: ControlModel
    cut_flash: CutFlashModel | None = Field(
        description="a flash of its parameters that was cut; null: none was", examples=[None]
    )


class DrivesModel(BaseModel):
    """All drives."""

    drives: list[DriveModel]


class EstimateModel(BaseModel):
    """One parameter; null where there is nothing honest to say."""

    value: float | None = Field(description="in its unit", examples=[0.9665106])
    std: float | None = Field(
        description="standard error; null unless status is ok, doubtful or stale", examples=[1.9e-4]
    )
    unit: str = Field(examples=["ohm"])
    status: Literal["ok", "doubtful", "stale", "held", "not_told", "no_data"] = Field(
        description="doubtful: estimated, but the equations do not fit; stale: estimated, but from rows that are over "
        "0.8 s old; held: at the given value; not_told: the window cannot tell it", examples=["ok"]
    )
    since: datetime | None = Field(description="stale: since when; null otherwise", examples=[None])
    reason: str = Field(description="a sentence where status is not ok", examples=[""])
    window: int | None = Field(description="samples it rests on; null unless the data chose them", examples=[None])


class CombinationModel(BaseModel):
    """Parameters that cannot be told apart, or one that cannot be told at all."""

    parameters: list[str] = Field(examples=[["psi_f"]])
    reason: str = Field(description="a sentence", examples=["psi_f cannot be told here: the motor stands still"])


class MismatchModel(BaseModel):
    """Whether constant parameters explain the drive's voltages, or more is left of them than noise."""

    status: Literal["explained", "unexplained", "not_told"] = Field(
        description="by the windows so far, two in a row for a change; not_told: none has said it yet",
        examples=["unexplained"],
    )
    since: datetime | None = Field(
        description="first window of the latest episode of not being explained; null: there was none", examples=[_TIME]
    )
    until: datetime | None = Field(description="first window after that episode; null while it lasts", examples=[None])
    where: str = Field(
        description="that episode acts, as seen where it was largest: axis, speed, current, drive's clock, change of "
        "sign; and parameters that no longer are those of the nominal machine; empty: there was none",
        examples=["mostly on q where a phase current is within 0.41 A of changing sign (74 % of the energy in 31 % of "
                  "the time); R_s reads 2.07 ohm, nominal 0.966 ohm"],
    )
    reason: str = Field(description="a sentence where the latest window cannot say it", examples=[""])
    significance: float | None = Field(
        description="of what is left, in standard deviations of noise; of the latest window that could say it, as the "
        "three below", examples=[41.7],
    )
    ratio: float | None = Field(description="energy of what is left over that of noise, a ratio", examples=[18.2])
    rms_V: float | None = Field(description="of what stands above noise, V", examples=[0.31])
    least_V: float | None = Field(description="of that, from which it matters, V", examples=[0.06])


class MechanicsModel(BaseModel):
    """What the drive's last seconds say of its shaft: J domega_m/dt = tau_e - tau_L - B omega_m - T_C sign(omega_m)."""

    status: Literal["ok", "doubtful", "no_acceleration", "not_told", "no_data", "stale"] = Field(
        description="doubtful: that equation does not fit; no_acceleration: the shaft does not accelerate; not_told: "
        "it does, by another machine or too little; stale: told before, not now", examples=["ok"],
    )
    since: datetime | None = Field(description="stale: since when; null otherwise", examples=[None])
    sentence: str = Field(description="why, where the status is not ok", examples=[""])
    estimates: dict[str, EstimateModel] = Field(
        description="J (kg m2), B (Nm s/rad), T_C (Nm), tau_L (Nm)",
        json_schema_extra={"propertyNames": {"enum": list(SHAFT)}},
        examples=[{"J": {"value": 8.001e-4, "std": 1.5e-7, "unit": "kg m2", "status": "ok", "since": None, "reason": "",
                         "window": None}}],
    )
    sum: EstimateModel | None = Field(
        description="of tau_L and T_C, Nm, where the shaft turns in one direction only, and they cannot be told apart",
        examples=[None],
    )
    direction: Literal[-1, 0, 1] = Field(
        description="of the speed where that sum is told: 1, tau_L + T_C; -1, tau_L - T_C; 0: both directions",
        examples=[0],
    )
    stretch_s: float | None = Field(description="length of a stretch, over which accelerations are told, s",
                                    examples=[0.064])
    stretches: int = Field(description="that it rests on", examples=[184])
    torque_rms_Nm: float | None = Field(description="of the torque that accelerates the shaft, Nm", examples=[0.271])
    residual_rms_Nm: float | None = Field(description="of what the equation leaves of it, Nm", examples=[3.7e-4])


class Bounds(BaseModel):
    """Least and largest whole number."""

    minimum: int = Field(description="least", examples=[4])
    maximum: int = Field(description="largest", examples=[1_000_000])


class Range(BaseModel):
    """Least and largest number."""

    minimum: float = Field(description="least, a share", examples=[0.99])
    maximum: float = Field(description="largest, a share", examples=[1.0])


class WindowLimits(BaseModel):
    """What the settings may be."""

    length: Bounds
    longest: Bounds
    periods_per_row: Bounds
    forgetting_factor: Range


class WindowModel(BaseModel):
    """Settings of the estimation. Those that the method does not use are kept, and apply again when it does."""

    method: Method
    length: Length
    longest: Longest
    periods_per_row: Periods
    estimated: Estimated
    held: Held
    forgetting_factor: Forgetting
    ekf: Ekf
    limits: WindowLimits = Field(
        description="what these may be while the other settings stay",
        examples=[{
            "length": {"minimum": 3, "maximum": 1000000}, "longest": {"minimum": 3, "maximum": 1000000},
            "periods_per_row": {"minimum": 1, "maximum": 333}, "forgetting_factor": {"minimum": 0.99, "maximum": 1.0},
        }],
    )


@dataclass(frozen=True, slots=True)
class WindowChangeModel(Window):
    """Settings to change; what is left out stays."""

    __pydantic_config__: ClassVar = CLOSED | ConfigDict(json_schema_extra={"examples": [
        {"length": 2000}, {"length": "auto"}, {"method": "rls", "forgetting_factor": 0.999}, {"ekf": {"noise_i": 0.02}},
    ]})


class EstimatesModel(BaseModel):
    """What the method says now."""

    drive: str = Field(examples=["emulated"])
    method: Method
    status: Literal["ok", "filling", "doubtful", "stale", "no_data"] = Field(
        description="filling: fewer samples than asked for; doubtful, stale: as the parameters"
    )
    estimates: dict[str, EstimateModel] = Field(
        description="by parameter", json_schema_extra={"propertyNames": {"enum": list(PARAMETERS)}}
    )
    combinations: list[CombinationModel] = Field(
        description="what cannot be told; no parameter is in two of them", examples=[[]]
    )
    mismatch: MismatchModel
    mechanics: MechanicsModel
    drive_state: StateModel
    window: WindowModel
    samples: int = Field(description="in the window; rls, ekf: since the method began", examples=[1000])
    gaps: int = Field(description="breaks in the stream among these samples", examples=[0])
    left_out: int = Field(description="rows with a value that is no number, since the estimation began", examples=[0])
    rows_dropped: int = Field(description="rows that came too fast for the estimator, since the start", examples=[0])
    age_s: float | None = Field(description="age of the newest row that these estimates rest on", examples=[0.021])
    t_drive_s: float | None = Field(description="drive's clock at the end of that row", examples=[251.93])
    condition: float | None = Field(description="of the column-scaled regressors, a ratio", examples=[1.84])
    residual_rms_V: float | None = Field(description="of the regression, V", examples=[0.064])


class SnapshotModel(BaseModel):
    """One event of the live stream."""

    drive: DriveModel
    estimates: EstimatesModel
    capture: CaptureModel | None = Field(description="the latest; null where there was none", examples=[None])


class ThreadModel(BaseModel):
    """One thread of the service."""

    name: str = Field(examples=["estimation"])
    alive: bool = Field(examples=[True])
    failure: str | None = Field(description="its last unexpected failure", examples=[None])


class HealthModel(BaseModel):
    """State of every thread and link."""

    status: Literal["ok", "degraded"] = Field(description="ok: all threads run and all drives stream")
    version: str = Field(examples=["0.1.0"])
    uptime_s: float = Field(description="s, since the start", examples=[251.4])
    threads: list[ThreadModel]
    links: dict[str, LinkModel] = Field(
        description="by drive", json_schema_extra={"propertyNames": {"examples": ["emulated"]}}
    )
    drives: dict[str, StateModel] = Field(
        description="by name", json_schema_extra={"propertyNames": {"examples": ["emulated"]}}
    )


class NothingModel(BaseModel):
    """An object with nothing in it; no body at all means the same."""


class ProblemModel(BaseModel):
    """A refusal or failure, by RFC 9457."""

    type: str = Field(examples=["about:blank"])
    title: str = Field(examples=["Not Found"])
    status: int = Field(description="the HTTP status", examples=[404])
    detail: str = Field(description="a sentence: what was expected and what came", examples=["no drive 'x'"])
    problems: list[str] = Field([], description="where there are several: all of them, a sentence each", examples=[[]])


def drive_model(service: Service, name: str) -> DriveModel:
    """A drive as REST shows it."""
    link = service.link(name)
    identity, writer = link.identity, service.writer(name)
    return DriveModel(
        name=name,
        url=service.drive(name).url,
        identity=None if identity is None else IdentityModel.model_validate(identity, from_attributes=True),
        link=link_model(link),
        stream=StreamModel(
            rate_hz=round(link.rate, 1), nominal_rate_hz=None if link.row_time is None else round(1 / link.row_time, 6),
            rows=link.rows, gaps=link.gaps, rows_lost=link.rows_lost, clock_resets=link.clock_resets,
            frames_late=link.frames_late, frames_foreign=link.frames_foreign, note=link.note, age_s=link.age,
            t_drive_s=link.t_drive,
        ),
        latest=_latest_model(service, name),
        limits=LimitsModel.model_validate(service.drive(name).limits, from_attributes=True),
        writer=None if writer is None else WriterModel.model_validate(writer, from_attributes=True),
        control=control_model(service, name),
        cut_flash=None if (left := service.flashes.cut(name)) is None else cut_model(left),
    )


def _latest_model(service: Service, name: str) -> LatestModel | None:
    latest, n_p = service.latest(name), service.drive(name).limits.n_p
    if latest is None:
        return None
    speed = math.nan if n_p is None else latest.values["omega_e"] / n_p / RPM
    told = latest.values | {
        "speed_rpm": speed, "temp_winding": latest.temp_winding, "temp_magnet": latest.temp_magnet,
    }
    return LatestModel.model_validate({key: value if math.isfinite(value) else None for key, value in told.items()})


def link_model(link: Link) -> LinkModel:
    """A link as REST shows it."""
    return LinkModel.model_validate(link, from_attributes=True)


def window_model(window: Window) -> WindowModel:
    """A window's settings as REST shows them."""
    m, parameters = window.periods_per_row, len(window.estimated)
    samples = Bounds(minimum=parameters * m, maximum=MAX_LENGTH)
    limits = WindowLimits(
        length=samples, longest=samples,
        periods_per_row=Bounds(minimum=1, maximum=min(MAX_M, window.samples // parameters)),
        forgetting_factor=Range(minimum=SMALLEST_LAM, maximum=1.0),
    )
    return WindowModel.model_validate({**asdict(window), "limits": limits})


def estimates_model(service: Service, name: str) -> EstimatesModel:
    """A drive's estimates as REST shows them."""
    snapshot = service.estimates(name)
    result = snapshot.result
    return EstimatesModel(
        drive=name,
        method=snapshot.window.method,
        status=_status(snapshot),
        estimates={key: _estimate_model(estimate, snapshot) for key, estimate in result.estimates.items()},
        combinations=[CombinationModel.model_validate(c, from_attributes=True) for c in result.combinations],
        mismatch=MismatchModel.model_validate(snapshot.mismatch, from_attributes=True),
        mechanics=_mechanics_model(snapshot.shaft),
        drive_state=state_model(service.control(name).state),
        window=window_model(snapshot.window),
        samples=result.samples, gaps=result.gaps, left_out=result.left_out, rows_dropped=snapshot.rows_dropped,
        age_s=snapshot.age,
        t_drive_s=snapshot.t_drive, condition=result.condition, residual_rms_V=result.residual_rms,
    )


def _estimate_model(estimate: Estimate, snapshot: Snapshot) -> EstimateModel:
    stale = snapshot.stale if estimate.status is Status.STALE else None
    return EstimateModel.model_validate({**asdict(estimate), "since": None if stale is None else stale.since})


def _mechanics_model(shaft: Shaft) -> MechanicsModel:
    said, old = shaft.said, shaft.since is not None
    stale = old and said.estimates["J"].value is not None
    status: dict[str, object] = {"status": Status.STALE, "reason": shaft.now, "since": shaft.since} if stale else {}

    def shown(e: Estimate) -> EstimateModel:
        return EstimateModel.model_validate({"since": None, **asdict(e), **({} if e.value is None else status)})

    return MechanicsModel.model_validate({
        "status": "stale" if stale else said.status, "since": shaft.since if stale else None,
        "sentence": shaft.now if old else said.sentence,
        "estimates": {name: shown(e) for name, e in said.estimates.items()},
        "sum": None if said.sum is None else shown(said.sum), "direction": said.direction,
        "stretch_s": said.stretch, "stretches": said.stretches,
        "torque_rms_Nm": said.torque_rms, "residual_rms_Nm": said.residual_rms,
    })


def _status(snapshot: Snapshot) -> Literal["ok", "filling", "doubtful", "stale", "no_data"]:
    if snapshot.age is None or snapshot.result.samples == 0:
        return "no_data"
    if snapshot.stale is not None:
        return "stale"
    if any(estimate.status is Status.DOUBTFUL for estimate in snapshot.result.estimates.values()):
        return "doubtful"
    return "ok" if snapshot.result.filled else "filling"
