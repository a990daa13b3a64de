"""Shapes of what the REST interface takes and says of parameter sets, plans and flashes. SI units."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Annotated, Any, ClassVar, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from bench.actions.flashes import Status
from bench.expected import CLOSED, Else
from bench.parameters.journal import BEGINNING, Begun, Past
from bench.parameters.parameter_set import LONGEST_NAME
from bench.parameters.plan import Plan
from bench.parameters.told import as_begun, as_past, changes_of
from drivers.wire.dictionary import signal_named

_TIME = "2026-01-31T12:00:00Z"
_BITS: Final = r"^[0-9a-f]*$"
SET: Final[Mapping[str, Any]] = {"name": "slower", "version": 2, "entries": {"bandwidth": {"value": 900.0}}}
"""As one would flash."""


class EntryModel(BaseModel):
    """A value of a set, and what is known of it."""

    model_config = ConfigDict(extra="forbid")

    value: float = Field(description="SI", examples=[900.0])
    unit: str | None = Field(None, description="where it is given, it has to be the signal's own", examples=["rad/s"])
    low: float | None = Field(
        None, description="end of the 95 % interval of what it was identified as, SI; a value outside is doubtful",
        examples=[890.0],
    )  # fmt: skip
    high: float | None = Field(None, description="the other end, SI", examples=[910.0])
    status: str = Field(
        "ok", description="of the estimate or finding that it is from; any other one is doubtful", examples=["ok"]
    )
    source: str = Field("", description="what it is from, in words", examples=["tuned by rule"])
    note: str = Field("", description="what else a reader should know of it", examples=["copper, 0.393 %/K"])
    at_degC: float | None = Field(None, description="degC, temperature that it holds at", examples=[62.0])
    at_20_degC: float | None = Field(None, description="SI, what it is at 20 degC", examples=[0.85])


class ParameterSetModel(BaseModel):
    """Parameters for a drive, by signal: gains, what its control takes the motor for, corrections, tables, limits."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [SET]})

    name: str = Field(description="what the set is called", min_length=1, max_length=LONGEST_NAME, examples=["slower"])
    version: int = Field(1, ge=1, description="of the set", examples=[2])
    layout_id: int | None = Field(
        None, ge=0, lt=1 << 32, description="checksum of the signals that it is for; null: any", examples=[None]
    )
    serial: int | None = Field(
        None, ge=0, lt=1 << 32, description="of the drive that it is for; null: any", examples=[None]
    )
    entries: dict[str, EntryModel | float] = Field(
        description="values by signal, SI; a number alone stands for its value; a table's by name_1 to name_64",
        min_length=1, examples=[SET["entries"]],
    )  # fmt: skip


class PlannedChangeModel(BaseModel):
    """A value that would be another one."""

    signal: str = Field(description="its name", examples=["bandwidth"])
    unit: str = Field(examples=["rad/s"])
    old: float = Field(description="as the drive has it", examples=[1250.0])
    new: float = Field(description="as the set has it", examples=[900.0])
    held: float = Field(description="what the drive then has of it", examples=[900.0])
    rounding: float = Field(description="by how much that is off the set's", examples=[0.0])
    bits_old: str = Field(description="as it travels now, bytes in hex", pattern=_BITS, examples=["00409c44"])
    bits_new: str = Field(description="and then", pattern=_BITS, examples=["00006144"])


class PlanModel(BaseModel):
    """What a set would change in a drive, and all that forbids it; nothing has been written."""

    changes: list[PlannedChangeModel]
    same: int = Field(description="values that the drive has already", examples=[308])
    problems: list[str] = Field(description="what forbids it, a sentence each", examples=[[]])
    doubts: list[str] = Field(
        description="what forbids it unless a reason is given, a sentence each",
        examples=[["control_R_s is doubtful (estimate)"]],
    )
    remarks: list[str] = Field(
        description="what else a reader should know, a sentence each",
        examples=[["version 2 is lower than that of the latest 'servo', 3 of 2026-01-31T12:00:00Z"]],
    )


class StepModel(BaseModel):
    """Something that has begun."""

    at: datetime = Field(examples=[_TIME])
    said: str = Field(description="what, in words", examples=["storing"])


class FlashedValueModel(BaseModel):
    """A value that a flash changes."""

    name: str = Field(description="of the signal", examples=["bandwidth"])
    unit: str = Field(examples=["rad/s"])
    before: float = Field(description="as it was", examples=[1250.0])
    after: float = Field(description="as it is to be", examples=[900.0])


class CutFlashModel(BaseModel):
    """A flash that was cut, by a service or a command line that ended: it has to be finished or rolled back."""

    drive: str = Field(description="its name, or URL, as who flashed called it", examples=["emulated"])
    name: str = Field(description="of the set", examples=["slower"])
    version: int = Field(description="of the set", examples=[2])
    whom: str = Field(description="who flashed", examples=["127.0.0.1"])
    since: datetime = Field(description="when it began", examples=[_TIME])
    override: str = Field(description="why doubts did not forbid it; empty: there were none", examples=[""])
    changed: list[FlashedValueModel] = Field(description="what it was to change")


class PastFlashModel(CutFlashModel):
    """A flash that has ended, as the history has it."""

    ended: datetime = Field(description="when it ended", examples=[_TIME])
    state: Literal["flashed", "rolled back"] = Field(description="how it ended")
    said: str = Field(
        description="the same in a sentence", examples=["1 value changed, stored, and read back after a reset"]
    )


class FlashModel(BaseModel):
    """A flash: under way, or ended."""

    id: str = Field(examples=["emulated-flash-20260131-120000-000"])
    drive: str = Field(examples=["emulated"])
    kind: Literal["flash", "finish", "roll back"] = Field(
        description="finish, roll back: of one that was cut", examples=["flash"]
    )
    state: Literal["running", "flashed", "rolled back", "cut"] = Field(
        description="flashed: the drive has the new values in its memory, read back after a reset; rolled back: those "
        "before; cut: either, and it has to be finished or rolled back", examples=["running"],
    )  # fmt: skip
    name: str = Field(description="of the set", examples=["slower"])
    version: int = Field(description="of the set", examples=[2])
    whom: str = Field(description="who asked for it", examples=["127.0.0.1"])
    override: str = Field(description="why doubts did not forbid it; empty: there were none", examples=[""])
    asked: datetime = Field(description="when it was asked for", examples=[_TIME])
    ended: datetime | None = Field(description="null: it has not", examples=[None])
    phase: str = Field(description="what is being done, in words; empty once it has ended", examples=["storing"])
    progress: float = Field(description="0 to 1", examples=[0.4])
    steps: list[StepModel] = Field(description="so far")
    said: str = Field(description="how it ended, a sentence; empty while it has not", examples=[""])
    changed: list[FlashedValueModel] = Field(description="what it changes")


class FlashesModel(BaseModel):
    """Flashes of a drive."""

    flashes: list[FlashModel] = Field(description="of this service, the newest first")
    past: list[PastFlashModel] = Field(description="all that have ended, also of command lines, the newest first")
    total: int = Field(description="that have ended", examples=[1])
    cut: CutFlashModel | None = Field(description="null: none was cut, or one is under way", examples=[None])


@dataclass(frozen=True, slots=True)
class RollbackRequestModel:
    """Before which flash to go back to; no body at all means the latest, too."""

    __pydantic_config__: ClassVar = CLOSED | ConfigDict(json_schema_extra={"examples": [{}, {"before": _TIME}]})

    before: Annotated[
        Annotated[str, Field(pattern=BEGINNING)] | None,
        Field(
            description="`since` of a past flash whose state is flashed; a beginning is enough, the day at least, that "
            "no other one has; null: of the latest", examples=[_TIME],
        ),
        Else(f"expected null or the time of a flash, such as {_TIME}, or its beginning"),
    ] = None  # fmt: skip


@dataclass(frozen=True, slots=True)
class ResumeRequestModel:
    """What to do with a flash that was cut."""

    __pydantic_config__: ClassVar = CLOSED | ConfigDict(json_schema_extra={"examples": [{"finish": False}]})

    finish: Annotated[
        bool,
        Field(strict=True, description="true: on to the new values; false: back to those before", examples=[False]),
        Else("expected true or false"),
    ]


def plan_model(one: Plan) -> PlanModel:
    """A plan as REST shows it."""
    changes = [
        PlannedChangeModel(
            signal=change.signal.name, unit=change.signal.unit, old=change.old, new=change.new, held=change.held,
            rounding=change.rounding, bits_old=change.counts[0], bits_new=change.counts[1],
        ) for change in one.changes
    ]  # fmt: skip
    said = {name: list(getattr(one, name)) for name in ("problems", "doubts", "remarks")}
    return PlanModel(changes=changes, same=one.same, **said)


def flash_model(one: Status) -> FlashModel:
    """A flash as REST shows it."""
    begun = one.begun
    return FlashModel(
        id=one.id, drive=one.drive, kind=one.kind.value, state=one.state.value, name=begun.name, version=begun.version,
        whom=one.whom, override=begun.override, asked=one.asked, ended=one.ended, phase=one.phase,
        progress=one.progress, steps=[StepModel(at=step.at, said=step.said) for step in one.steps], said=one.said,
        changed=cut_model(begun).changed,
    )


def cut_model(begun: Begun) -> CutFlashModel:
    """A flash that was cut as REST shows it."""
    return CutFlashModel.model_validate(as_begun(begun))


def past_model(one: Past) -> PastFlashModel:
    """A flash that has ended as REST shows it."""
    return PastFlashModel.model_validate(as_past(one))


def written(one: Status) -> tuple[dict[str, Any], dict[str, Any]]:
    """What a flash changes, before and then, as the log of writes tells it: each table in one."""
    before, after = dict[str, Any](), dict[str, Any]()
    for name, (old, new) in changes_of(one.begun).items():
        table = signal_named(name).table
        before[table or name], after[table or name] = ("as it was", "new entries") if table else (old, new)
    said = {"set": f"{one.begun.name}, version {one.begun.version}", "override": one.begun.override}
    return before, after | {key: text for key, text in said.items() if text}
