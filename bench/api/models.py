"""Shapes of what the REST interface says. SI units; ages and durations in s."""

from datetime import datetime
from typing import Literal

from pydantic import BaseModel, Field

from bench.acquisition import Link
from bench.estimation import Snapshot
from bench.service import STALE, Service
from bench.window import Window
from estimator.window_ls import MAX_LENGTH, MAX_M


class IdentityModel(BaseModel):
    """Who the drive says it is."""

    device_name: str
    vendor_id: int
    product_code: int
    revision: int
    serial: int
    layout_id: int = Field(description="checksum of the drive's signal dictionary")
    T_s: float = Field(description="control period, s")
    i_full: float = Field(description="full scale of currents, A")
    u_full: float = Field(description="full scale of voltages, V")
    omega_full: float = Field(description="full scale of electrical speed, rad/s")


class FailureModel(BaseModel):
    """What went wrong last."""

    sentence: str
    time: datetime


class LinkModel(BaseModel):
    """The link to a drive."""

    state: Literal["connecting", "streaming", "lost"]
    since: datetime
    reconnects: int
    last_error: FailureModel | None


class StreamModel(BaseModel):
    """The stream of a drive, since the service started."""

    rate_hz: float = Field(description="rows per second over the last 2 s")
    nominal_rate_hz: float | None = Field(description="rows per second by the drive's own clock")
    rows: int
    gaps: int
    rows_lost: int
    age_s: float | None = Field(description="since the latest row arrived")


class DriveModel(BaseModel):
    """One drive."""

    name: str
    url: str
    identity: IdentityModel | None
    link: LinkModel
    stream: StreamModel


class DrivesModel(BaseModel):
    """All drives."""

    drives: list[DriveModel]


class EstimateModel(BaseModel):
    """One parameter; null where there is nothing honest to say."""

    value: float | None
    std: float | None = Field(description="standard error; null unless status is ok")
    unit: str
    status: Literal["ok", "held", "not_told", "no_data"]
    reason: str


class Bounds(BaseModel):
    """Least and largest value."""

    minimum: int
    maximum: int


class WindowLimits(BaseModel):
    """What the settings may be."""

    length: Bounds
    periods_per_row: Bounds


class WindowModel(BaseModel):
    """Settings of the estimation window."""

    length: int = Field(description="samples")
    periods_per_row: int = Field(description="stream rows summed to one regression row")
    estimated: list[str]
    held: dict[str, float] = Field(description="values, SI, used for parameters that are not estimated")
    limits: WindowLimits


class EstimatesModel(BaseModel):
    """What the window says now."""

    drive: str
    status: Literal["ok", "filling", "stale", "no_data"]
    estimates: dict[str, EstimateModel]
    window: WindowModel
    samples: int
    gaps: int = Field(description="breaks in the stream inside the window")
    rows_dropped: int = Field(description="rows that came too fast for the estimator, since the start")
    age_s: float | None
    t_drive_s: float | None = Field(description="drive's clock at the newest sample")
    condition: float | None = Field(description="condition number of the column-scaled regressors")
    residual_rms_V: float | None


class SnapshotModel(BaseModel):
    """One event of the live stream."""

    drive: DriveModel
    estimates: EstimatesModel


class ThreadModel(BaseModel):
    """One thread of the service."""

    name: str
    alive: bool
    failure: str | None


class HealthModel(BaseModel):
    """State of every thread and link."""

    status: Literal["ok", "degraded"]
    version: str
    uptime_s: float
    threads: list[ThreadModel]
    links: dict[str, LinkModel]


def drive_model(service: Service, name: str) -> DriveModel:
    """A drive as REST shows it."""
    link = service.link(name)
    identity = link.identity
    return DriveModel(
        name=name,
        url=service.url(name),
        identity=None if identity is None else IdentityModel.model_validate(identity, from_attributes=True),
        link=link_model(link),
        stream=StreamModel(
            rate_hz=round(link.rate, 1), nominal_rate_hz=None if link.row_time is None else round(1 / link.row_time, 6),
            rows=link.rows, gaps=link.gaps, rows_lost=link.rows_lost, age_s=link.age,
        ),
    )


def link_model(link: Link) -> LinkModel:
    """A link as REST shows it."""
    return LinkModel.model_validate(link, from_attributes=True)


def window_model(window: Window) -> WindowModel:
    """A window's settings as REST shows them."""
    m = window.periods_per_row
    limits = WindowLimits(
        length=Bounds(minimum=len(window.estimated) * m, maximum=MAX_LENGTH),
        periods_per_row=Bounds(minimum=1, maximum=min(MAX_M, window.length // len(window.estimated))),
    )
    return WindowModel(
        length=window.length, periods_per_row=m, estimated=list(window.estimated), held=dict(window.held), limits=limits
    )


def estimates_model(service: Service, name: str) -> EstimatesModel:
    """A drive's estimates as REST shows them."""
    snapshot = service.estimates(name)
    result, age = snapshot.result, service.link(name).age
    return EstimatesModel(
        drive=name,
        status=_status(snapshot, age),
        estimates={
            key: EstimateModel(value=e.value, std=e.std, unit=e.unit, status=e.status.value, reason=e.reason)
            for key, e in result.estimates.items()
        },
        window=window_model(snapshot.window),
        samples=result.samples, gaps=result.gaps, rows_dropped=snapshot.rows_dropped, age_s=age,
        t_drive_s=snapshot.t_drive, condition=result.condition, residual_rms_V=result.residual_rms,
    )


def _status(snapshot: Snapshot, age: float | None) -> Literal["ok", "filling", "stale", "no_data"]:
    if age is None or snapshot.result.samples == 0:
        return "no_data"
    if age > STALE:
        return "stale"
    return "ok" if snapshot.result.filled else "filling"
