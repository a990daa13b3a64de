"""Commissionings of all drives: asked for, watched, cancelled, and what came of them on disk.

Three kinds, each a job of its own that ends with the drive off and as before: a `first_start`, an identification of the
motor with a proposed set, and a verification of the loops after that set was flashed. Flashing is another's work, and
asked for apart. Knows nothing of HTTP.
"""

import contextlib
import json
import re
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal

from pydantic import Field, TypeAdapter

from bench.actions import experiment
from bench.actions.drive_jobs import BenchDrive, Step, id_at
from bench.actions.experiment import Plan
from bench.actions.moving_jobs import MovingJobs, Run, State
from bench.actions.safety.lease import Leases, Part
from bench.actions.safety.limits import TRIP, Limits
from bench.actions.safety.under_control import CancelledError, under_control
from bench.actions.safety.unfinished import Origin
from bench.commissioning import first_start as first_starts
from bench.commissioning.first_start import FirstStart, Forwards, first_start
from bench.commissioning.identify import Around, acceleration_of, identify, try_loops
from bench.commissioning.loops import judged
from bench.commissioning.results import first_started, identified, promises, responses
from bench.errors import BenchError, ConflictError, LimitError, RecordingError, UnavailableError, UnknownError
from bench.expected import CLOSED, Else, Number, Table, Word, taken
from bench.files import write_new
from bench.machine_file import Nominal
from bench.parameters.flash import parameters
from bench.parameters.made import DOUBTFUL
from bench.parameters.parameter_set import OK, Entry, ParameterSet, as_toml, of_toml
from bench.parameters.plan import different
from bench.parameters.tuning import check_bandwidth
from bench.recordings.capture_file import Heading, write_recording
from drivers.capture import Upload
from drivers.drive import Drive
from drivers.errors import DriveError
from drivers.lease import Lease
from estimator.machine import PARAMETERS, Machine

FOLDER: Final = "commissionings"  # in that of the recordings
TRUST: Final = 0.4  # how far off a data sheet may be, as a share
_RENEWED: Final = 30.0  # s that the lease is taken for, anew with every step
_KEPT: Final = 50
_DONE_OF: Final = re.compile(r"\d+ of (?=\d)")  # as of "uploading 2000 of 5000 samples"


class Kind(StrEnum):
    """What is to be done."""

    FIRST_START = "first_start"
    IDENTIFY = "identify"
    VERIFY = "verify"


@dataclass(frozen=True, slots=True)
class Request:
    """What is asked for."""

    __pydantic_config__: ClassVar = CLOSED

    kind: Annotated[Literal["first_start", "identify", "verify"], Word(), Field(
        description="first_start: pole pairs, phase order, direction, angle offset; identify: parameters, a proposed "
        "set; verify: its loops, after a flash", examples=["identify"],
    )]  # fmt: skip
    forwards: Annotated[Literal["encoder", "phases"], Word(), Field(
        description="first_start: whose direction is to be forwards", examples=["encoder"]
    )] = "encoder"  # fmt: skip
    current: Annotated[
        Annotated[float, Number(1e-3, 1e4)] | None, Else("expected null or a number of 0.001 to 10000"),
        Field(description="A, most for a first start; by default half of the rated current", examples=[3.0]),
    ] = None
    bandwidth: Annotated[
        Annotated[float, Number(10.0, 1e4)] | None, Else("expected null or a number of 10 to 10000"),
        Field(description="rad/s, of the current control, in a set that is proposed", examples=[2000.0]),
    ] = None
    of: Annotated[str, Field(
        description="verify: id of the identification, or latest", examples=["latest"], max_length=200
    )] = "latest"  # fmt: skip
    follows: Annotated[
        Annotated[str, Field(max_length=200)] | None, Else("expected null or the id of a commissioning"),
        Field(description="id of the commissioning that this goes on with: refused where the drive was stopped since",
              examples=["emulated-identify-20260131-120000-000"]),
    ] = None


_REQUEST: Final = TypeAdapter(Annotated[Request, Table("expected kind, and what goes with it")])


@dataclass(frozen=True, slots=True)
class Status:
    """A commissioning at one moment."""

    id: str
    drive: str
    asked: datetime
    request: Request
    state: State = State.RUNNING
    phase: str = ""  # what is being done, in words
    steps: tuple[Step, ...] = ()
    reason: str = ""  # why it failed
    result: Mapping[str, Any] = field(default_factory=dict[str, Any])  # plain values
    file: Path | None = None
    stops: int = -1  # so often had somebody asked for the drive's Stop; -1: of a service before


Diagnose = Callable[[str, Mapping[str, Any], threading.Event, Callable[[], None]], Mapping[str, Any]]
"""Has a recording, by its id, diagnosed as asked; calls back while it waits. Raises BenchError."""


class Commissionings(MovingJobs[Status]):
    """Everything about commissionings, until `leave`."""

    kind, remembered = "commissioning", _KEPT

    def __init__(
        self, folder: Path, notes: Path, drives: Mapping[str, BenchDrive], leases: Leases, diagnose: Diagnose
    ) -> None:
        """`folder`: of recordings, which theirs go to; `notes` as of `MovingJobs`."""
        super().__init__(folder, notes, drives, leases)
        self._diagnose = diagnose

    def start(self) -> None:
        """Know those that a service before this one has kept."""
        self.remember(_read(self._folder / FOLDER))

    def ask(self, drive: str, given: Mapping[str, Any], whom: str = "") -> Status:
        """Have a drive commissioned. Raises LimitError, ConflictError, UnavailableError, UnknownError, DriveError."""
        stops, request, asked = self._stops[drive], taken(_REQUEST, given, "", LimitError), datetime.now(UTC)
        if request.follows is not None:
            before = next((one for one in self.all(drive) if one.id == request.follows), None)
            if before is None:
                raise UnknownError(f"drive {drive} has no commissioning {request.follows!r} that this could go on with")
            if before.stops < 0:
                raise ConflictError(f"{request.follows} is of a service that has ended: ask anew where that is meant")
            if before.stops != stops:
                raise ConflictError(f"drive {drive} was stopped since {request.follows}: ask anew where that is meant")
        found = self._identified(drive, request.of) if request.kind == Kind.VERIFY else None
        self._check_folder()
        _check(request, self._drives[drive])
        id_ = id_at(f"{drive}-{request.kind.replace('_', '-')}", asked)
        status = Status(id_, drive, asked, request, stops=stops)
        run = Run(f"commissioning {id_}" + (f" (asked for from {whom})" if whom else ""))
        self._leases.take(drive, run.holder, _RENEWED, *Part)
        with contextlib.ExitStack() as otherwise:
            otherwise.callback(self._leases.release, drive, run.holder)
            self._put_unless_stopped(status, run, lambda: self._work(status, run, found), stops)
            otherwise.pop_all()
        return status

    def whole(self, drive: str, id_: str) -> tuple[Status, Status | None, Status | None]:
        """An identification that is done, by its id or that of a verification of it, with the verification, else the
        latest, and with the first start that it followed. Raises UnknownError, ConflictError.
        """
        one, every = self.one(drive, id_), [other for other in self.all(drive) if other.state is State.DONE]
        checks = [other for other in every if other.request.kind == Kind.VERIFY]
        found = self.one(drive, one.result["of"]) if one in checks else one
        if found.request.kind != Kind.IDENTIFY or found.state is not State.DONE:
            raise ConflictError(
                f"expected the id of an identification that is done, or of its verification; {one.id} is {one.state}"
            )
        checked = one if one in checks else next((c for c in checks if c.result["of"] == found.id), None)
        first = next((other for other in every if other.id == found.request.follows), None)
        return found, checked, first if first and first.request.kind == Kind.FIRST_START else None

    def _identified(self, drive: str, id_: str) -> Status:
        """An identification that is done. Raises UnknownError, ConflictError."""
        every = [one for one in self.all(drive) if one.request.kind == Kind.IDENTIFY]
        told = [one for one in every if one.result.get("machine") is not None]
        one = next((one for one in (told or every if id_ == "latest" else every) if id_ in ("latest", one.id)), None)
        if one is None:
            raise UnknownError(f"drive {drive} has no identification {id_!r} that its loops could be held against")
        if one.result.get("machine") is None:
            raise ConflictError(f"{one.id} does not tell the machine: there is nothing to hold the loops against")
        return one

    def _work(self, status: Status, run: Run, of: Status | None) -> None:
        state, reason, result = State.FAILED, "", dict[str, Any]()
        try:
            result = self._result(status, run, of)
            state = State.DONE
        except CancelledError as error:
            state, reason = State.CANCELLED, str(error)
        except (BenchError, DriveError) as error:
            state = State.CANCELLED if run.cancelled.is_set() else State.FAILED
            reason = str(error)
        except Exception as error:  # noqa: BLE001 - a fault of ours must not leave one without an end
            reason = f"the bench failed on this commissioning: {type(error).__name__}: {error}"
        self._leases.release(status.drive, run.holder, str(state))
        with self._lock:
            ended = replace(self._known[status.id], phase="", state=state, reason=reason, result=result)
        file: Path | None = None
        try:
            content = json.dumps(_plain(ended), indent=1, allow_nan=False).encode()
            file = write_new(self._folder / FOLDER / f"{status.id}.json", lambda out: out.write(content))
        except (OSError, ValueError) as error:
            reason = f"{reason or 'done'}; it could not be kept on disk: {error}"
        with self._lock:
            self._end(status.id, phase="", state=state, reason=reason, result=result, file=file)

    def _result(self, status: Status, run: Run, of: Status | None) -> dict[str, Any]:
        around = self._around(status, run)
        if status.request.kind == Kind.FIRST_START:
            return _first(around, status, self._drives[status.drive].nominal)
        if of is not None:
            return _verified(around, of)
        theta_step = self._drives[status.drive].nominal.theta_step
        found = identify(around, f"{status.drive} {status.asked:%Y-%m-%d}", bandwidth=status.request.bandwidth,
                         theta_step=theta_step)
        return identified(found)

    def _step(self, id_: str, said: str) -> None:
        with self._lock:
            steps = stepped(self._known[id_].steps, Step(datetime.now(UTC), said))
            self._change(id_, phase=said, steps=steps)

    def _around(self, status: Status, run: Run) -> Around:
        one, name = self._drives[status.drive], status.drive
        numbers = iter(range(1, 100))

        def tell(said: str) -> None:
            self._leases.take(name, run.holder, _RENEWED, *Part)
            self._step(status.id, said)

        def keep(upload: Upload) -> Path:
            identity = one.link.drive().identity
            request = {"signals": list(upload.setup.channels), "length": upload.setup.length}
            heading = Heading.of(
                f"{status.id}-{next(numbers)}", name, one.url, status.asked.isoformat(), request, identity
            )
            try:
                heading = replace(heading, tick=upload.tick)
                return write_recording(self._folder / f"{heading.id}.parquet", heading, upload)
            except OSError as error:
                raise UnavailableError(f"the recording cannot be kept on disk: {error.strerror or error}") from None

        origin = Origin(self._notes, name, run.holder)

        def record(plan: Plan) -> Path:
            drive = one.link.drive()
            said = {"drive": name, "url": one.url, "asked": status.asked.isoformat()}
            part = experiment.begin(self._folder / f"{status.id}-{next(numbers)}.parquet", plan, drive, said)
            try:
                experiment.run(
                    drive, plan, lambda far: tell(far.phase), run.cancelled, part, limits=one.limits, origin=origin
                )
            finally:
                file, kept = part.settled()
            if file is None:
                raise UnavailableError(kept)
            return file

        def diagnose(path: Path) -> Mapping[str, Any]:
            drive = one.link.drive()
            return self._diagnose(
                path.stem, _asked(one.nominal, drive), run.cancelled,
                lambda: self._leases.take(name, run.holder, _RENEWED, *Part),
            )

        known = [i for i in (one.nominal.i_rated, one.limits.i_max) if i is not None]
        i_rated = min(known, default=0.5 * one.link.drive().read("current_limit"))
        return Around(
            one.link.drive, one.limits, i_rated, origin, keep, record, diagnose, tell, run.cancelled
        )


def stepped(steps: tuple[Step, ...], now: Step) -> tuple[Step, ...]:
    """With what is being done now: a step more, or how far the last one has come."""
    if steps and _DONE_OF.sub("", steps[-1].said) == _DONE_OF.sub("", now.said):
        return (*steps[:-1], replace(steps[-1], said=now.said))
    return (*steps, now)


def as_json(status: Status) -> dict[str, Any]:
    """A commissioning as plain values."""
    return _plain(status) | {"file": None if status.file is None else str(status.file)}


def _plain(status: Status) -> dict[str, Any]:
    return {
        "id": status.id, "drive": status.drive, "asked": status.asked.isoformat(), "request": asdict(status.request),
        "state": str(status.state), "phase": status.phase, "reason": status.reason, "result": dict(status.result),
        "steps": [{"at": step.at.isoformat(), "said": step.said} for step in status.steps],
    }  # fmt: skip


def _read(folder: Path) -> Iterable[Status]:
    """Those on disk, the newest of them; what cannot be read is left alone."""
    for path in sorted(folder.glob("*.json"), key=lambda path: path.stat().st_mtime)[-_KEPT:]:
        with contextlib.suppress(OSError, ValueError, LookupError, TypeError, BenchError):
            told = json.loads(path.read_bytes())
            if not (isinstance(told["result"], dict) and isinstance(told["reason"], str)):
                continue
            yield Status(
                told["id"], told["drive"], datetime.fromisoformat(told["asked"]).astimezone(UTC),
                taken(_REQUEST, told["request"], "", RecordingError), State(told["state"]), "",
                tuple(Step(datetime.fromisoformat(one["at"]), str(one["said"])) for one in told.get("steps", ())),
                told["reason"], told["result"], path,
            )  # fmt: skip


def _check(request: Request, one: BenchDrive) -> None:
    """Raise LimitError where it asks for more than a drive may do, DriveError where that is not there."""
    T_s = one.link.drive().identity.T_s
    if request.current is not None:
        one.limits.check_current(request.current, "current", "")
    if request.bandwidth is not None:
        check_bandwidth(request.bandwidth, T_s)


def _asked(nominal: Nominal, drive: Drive) -> dict[str, Any]:
    """What a diagnosis is asked: the machine file's values, or the drive's own, and how far off they may be."""
    machine = {name: nominal.given.get(name, drive.read(f"control_{name}")) for name in PARAMETERS}
    known = nominal.tables
    tables = {**known, "machine": {**known["machine"], **machine, "n_p": int(drive.read("n_p"))}}
    return {"nominal": tables, "trust": dict.fromkeys(PARAMETERS, TRUST)}


def _first(around: Around, status: Status, nominal: Nominal) -> dict[str, Any]:
    """Pole pairs and so on, and the set for it."""
    drive, lease, request = around.link(), Lease(), status.request
    most = request.current or 0.5 * around.i_rated
    around.limits.check_current(most, "first start")
    settings = tuple(name for name in first_starts.SETTINGS if any(s.name == name for s in drive.identity.signals))
    with under_control(drive, lease, around.origin, settings):
        found = first_start(drive, lease, most, Forwards(request.forwards), around.tell, around.cancelled)
    given = _first_set(found, drive, nominal, around.limits)
    present = {name: drive.read(name) for name in given.entries}
    return {**first_started(found), "set": as_toml(given), "present": present, "remarks": []}


def _first_set(found: FirstStart, drive: Drive, nominal: Nominal, limits: Limits) -> ParameterSet:
    entries = {name: Entry(value, source="first start") for name, value in found.values.items()}
    offset, error = found.angle_offset, found.offset_error
    entries["angle_offset"] = Entry(offset, offset - error, offset + error, OK, "first start")
    if nominal.n_p not in (None, found.n_p):
        said = f"first start; the machine file says {nominal.n_p} pole pairs"
        entries["n_p"] = Entry(float(found.n_p), status=DOUBTFUL, source=said)
    most = limits.trip(found.n_p)
    if most is not None and drive.read(TRIP) > most:
        entries[TRIP] = Entry(most, source="by the largest speed, and pole pairs of the first start")
    identity = drive.identity
    return ParameterSet("first start", entries, 1, identity.layout_id, identity.serial)


def _verified(around: Around, of: Status) -> dict[str, Any]:
    """The loops as they are now, beside those before and what is promised."""
    told, present = of.result, parameters(around.link())
    lacks = different(of_toml(told["set"], "the set").values, present)
    now = try_loops(around)
    machine = Machine(**{name: told["machine"][name]["value"] for name in PARAMETERS}, n_p=told["machine"]["n_p"])
    J, B = (told["shaft"]["estimates"][name]["value"] if told["shaft"] else None for name in ("J", "B"))
    K, damping = acceleration_of(machine, J, B) or (now.K, 0.0)
    loops = judged(now, machine, K, damping)
    return {
        "of": of.id, "lacks": lacks, "loops": [one.as_json() for one in loops], "before": told["loops"],
        "responses": responses(now.loops), "responses_before": told["responses"], "promises": promises(loops),
    }
