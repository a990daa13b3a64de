"""An experiment on a drive: levels held one after the other, recorded at full rate, and the drive stopped at the end.

What a diagnosis asks for is read from its JSON. All set points are judged before anything moves: by what the drive
tells of its limits, then by the drive itself while its bridge is off. It holds the drive's control lease, which it
renews where it acts. However it ends - done, cancelled, refused, a fault, an error - the references go to zero, the
bridge off, and all settings back to what they were; where no link is left for that, the lease runs out, and what was
noted on disk before is undone later. Knows nothing of services, HTTP and terminals.
"""

import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, cast

import numpy as np
from pydantic import Field, TypeAdapter

from bench.actions.capture_request import NEEDED
from bench.actions.experiment_part import ExperimentPart, Heading
from bench.actions.safety.limits import RPM, TRIP, Limits
from bench.actions.safety.under_control import Guard, under_control
from bench.actions.safety.unfinished import Origin
from bench.errors import LimitError, UnavailableError, shown
from bench.expected import CLOSED, Number, Table, taken
from bench.files import check_room
from bench.recordings.capture_file import device_of
from drivers import capture, operation
from drivers.capture import DONE, Capture, Setup
from drivers.drive import Drive
from drivers.errors import FaultError, GoneError, NoReplyError
from drivers.lease import Lease
from drivers.wire.dictionary import CAPTURE_SAMPLES
from estimator.diagnosis.verdict import Hold
from estimator.machine import UNITS

SIGNALS: Final = (*NEEDED, "u_dc")
MOST_HOLDS: Final = 100
LONGEST: Final = 60.0  # s, a hold
_FASTER: Final = 1.25  # times the fastest speed there is to be: beyond, the experiment ends
_SLACK: Final = 0.02  # of the full scale of speed, that the speed may be beyond that
PATIENCE: Final = 20.0  # s for a speed to be reached
_SETTLED: Final = 0.05  # of the speed wanted, or of a twentieth of the full scale
_REACH: Final = 0.95  # of the voltage and of the trip currents
_STANDSTILL: Final = 10.0  # s without another sample
_POLL: Final = 0.02  # s
_LEVELS: Final = 1.0  # excitation_kind: random steps
_STEP_TIME: Final = 5e-3  # s
_OFF, _REFERENCE = 0, 1  # speed control: none, after the reference
_SETTINGS: Final = ("excitation_kind", "step_time", "speed_control", "field_weakening")
_NO_STEPS: Final[Mapping[str, float]] = dict.fromkeys(("i_d_step", "i_q_step", "speed_step", "i_d_ref", "i_q_ref"), 0.0)
_ALIKE: Final = 2.0  # times a parameter of one motor, by two data sheets, cold or hot
_OVERLOAD: Final = 1.1  # of rated current
_MOTOR: Final = {**UNITS, "n_p": "pole pairs", "i_rated": "A"}
_Level = Annotated[float, Number(-1e6, 1e6)]


@dataclass(frozen=True, slots=True)
class AskedHold(Hold):
    """Levels to be held."""

    __pydantic_config__: ClassVar = CLOSED

    speed_rpm: Annotated[_Level, Field(
        description="rpm, mechanical; the drive holds it where it controls its speed", examples=[1200.0]
    )]
    i_d: Annotated[_Level, Field(description="A", examples=[-1.8])]
    i_q: Annotated[_Level, Field(description="A; under speed control it follows from the load instead", examples=[2.0])]
    seconds: Annotated[float, Number(0.01, LONGEST), Field(description="s", examples=[0.5])]


Step = Annotated[
    float, Number(0.0, 1e6), Field(description="A, random steps of i_d and i_q within +- this around each")
]
Motor = Annotated[
    Mapping[str, float],
    Table(f"expected an object of {', '.join(_MOTOR)}", "expected {all}, got {key}",
          dict.fromkeys(_MOTOR, Annotated[float, Number(1e-9, 1e9)])),
    Field(description=f"the motor it is meant for: any of {', '.join(_MOTOR)}, SI; another one is refused"),
]
_HOLD: Final = TypeAdapter(Annotated[AskedHold, Table("expected speed_rpm, i_d, i_q and seconds", whole=True)])
_STEP: Final = TypeAdapter[float](Step)
_MACHINE: Final = TypeAdapter[Mapping[str, float]](Motor)


@dataclass(frozen=True, slots=True)
class Plan:
    """An experiment that a drive could do."""

    holds: tuple[Hold, ...]
    step: float = 0.0  # A, random steps of i_d and i_q within +- this around each level
    machine: Mapping[str, float] = field(default_factory=dict[str, float])  # the motor it is for, as `Nominal.told`

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> "Plan":
        """From an experiment of a diagnosis, or `holds`, `step`, `machine` alone. Raises LimitError, in a sentence."""
        holds = given.get("holds")
        if not isinstance(holds, list) or not holds:
            sentence = given.get("sentence")
            told = f": {sentence}" if isinstance(sentence, str) else ""
            raise LimitError(f"expected an experiment with levels that a drive can hold, got none{told}")
        if len(asked := cast(list[object], holds)) > MOST_HOLDS:
            raise LimitError(f"expected at most {MOST_HOLDS} holds, got {len(asked)}")
        return cls(
            tuple(taken(_HOLD, hold, f"hold {k}:", LimitError) for k, hold in enumerate(asked, start=1)),
            taken(_STEP, given.get("step", 0.0), "step", LimitError),
            taken(_MACHINE, {} if (machine := given.get("machine")) is None else machine, "machine:", LimitError),
        )

    @property
    def seconds(self) -> float:
        """Time that is recorded."""
        return sum(hold.seconds for hold in self.holds)


@dataclass(frozen=True, slots=True)
class Progress:
    """How far it is."""

    phase: str  # in words
    share: float  # 0 to 1


Tell = Callable[[Progress], None]


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """What was recorded, and what was held otherwise than planned."""

    captures: tuple[Capture, ...]
    remarks: tuple[str, ...]

    @property
    def samples(self) -> int:
        """All of them."""
        return sum(len(part.t) for part in self.captures)


def experiment_of(diagnosis: Mapping[str, Any], number_: int | None = None) -> Mapping[str, Any]:
    """The experiment that a diagnosis (as JSON) asks for, with its `machine`. Raises LimitError.

    By the number of the ambiguity, from 1; without one: the first that a drive can do, or what to record instead.
    """
    machine = diagnosis.get("machine")
    nominal = cast(dict[str, Any], machine).get("nominal") if isinstance(machine, dict) else None
    return _asked(diagnosis, number_) | ({"machine": nominal} if nominal else {})


def _asked(diagnosis: Mapping[str, Any], number_: int | None) -> dict[str, Any]:
    doubts = diagnosis.get("ambiguous")
    if not isinstance(doubts, list):
        raise LimitError(f"ambiguous: expected a list, got {shown(doubts)}")
    asked = [doubt["experiment"] for doubt in cast(list[Any], doubts) if _has_experiment(doubt)]
    if number_ is not None:
        if not 1 <= number_ <= len(asked):
            raise LimitError(f"expected an ambiguity from 1 to {len(asked)}, which the diagnosis has, got {number_}")
        return asked[number_ - 1]
    instead = diagnosis.get("experiment")
    asked += [instead] if isinstance(instead, dict) else []
    for one in asked:
        if one.get("holds"):
            return one
    if asked:
        raise LimitError(f"no drive can do what the diagnosis asks for: {asked[0].get('sentence')}")
    said = f": it is {shown(diagnosis['verdict'])[1:-1]}" if isinstance(diagnosis.get("verdict"), str) else ""
    raise LimitError(f"expected a diagnosis that asks for an experiment, got one that does not{said}")


def check_motor(plan: Plan, known: Mapping[str, float], whose: str) -> None:
    """Raise LimitError where the plan is meant for another motor than the one that is `known`, see `Nominal.told`."""
    for name, meant in plan.machine.items():
        there = known.get(name, 0.0)
        if there <= 0.0:  # not known
            continue
        most = 1.0 if name == "n_p" else _OVERLOAD if name == "i_rated" else _ALIKE
        least = 0.0 if name == "i_rated" else 1.0 / most
        if not least <= meant / there <= most:
            unit = _MOTOR[name]
            raise LimitError(
                f"the diagnosis is of a motor with {name} = {meant:.4g} {unit}, {whose} has {there:.4g} {unit}: "
                "expected the same motor"
            )


def check(drive: Drive, plan: Plan, limits: Limits) -> None:
    """Raise LimitError where the limits or the drive's own do not allow a hold, FaultError where it is in fault."""
    _UnderWay(drive, plan, limits, Lease(), lambda _: None, threading.Event()).check()


def run(
    drive: Drive, plan: Plan, tell: Tell = lambda _: None, cancelled: threading.Event | None = None,
    part: ExperimentPart | None = None, *, limits: Limits, origin: Origin,
) -> Recorded:  # fmt: skip
    """Do it, noted on disk as `origin` says until it is undone; the drive is stopped in any case.

    `part` keeps on disk what is uploaded; where it cannot, an OSError is raised. Raises LimitError before anything
    moves; CancelledError, DriveError.
    """
    cancelled, lease = cancelled or threading.Event(), Lease()
    under_way = _UnderWay(drive, plan, limits, lease, tell, cancelled, part)
    under_way.check()
    under_way.guard.check_cancelled()
    trip = (TRIP,) if drive.identity.has_lease else ()
    with under_control(drive, lease, origin, (*_SETTINGS, *trip)):
        under_way.rehearse()
        return under_way.recorded()


def begin(recording: Path, plan: Plan, drive: Drive, origin: Mapping[str, Any]) -> ExperimentPart:
    """The part file of an experiment, before anything moves. Raises UnavailableError where there is no room for it."""
    identity = drive.identity
    expected = sum(_length(holds, identity.T_s) for holds in _groups(plan, identity.T_s))
    heading = Heading(origin, device_of(identity), asdict(plan), identity.T_s, dict(identity.full), expected)
    try:
        check_room(recording.parent, expected, len(SIGNALS))
        return ExperimentPart.begun(recording, heading)
    except OSError as error:
        raise UnavailableError(f"the experiment cannot be kept on disk: {error.strerror or error}") from None


class _UnderWay:
    """An experiment while it is done."""

    def __init__(
        self, drive: Drive, plan: Plan, limits: Limits, lease: Lease, tell: Tell, cancelled: threading.Event,
        part: ExperimentPart | None = None,
    ) -> None:  # fmt: skip
        self._drive, self._plan, self._tell, self._part = drive, plan, tell, part
        self._limits, self._lease = limits, lease
        self.guard = Guard(drive, lease, limits, "the experiment", cancelled)
        self._T_s = drive.identity.T_s
        self._n_p = drive.read("n_p")
        self._speed_controlled = int(drive.read("speed_control")) != _OFF
        self._remarks: list[str] = []
        self._done = 0.0  # s recorded

    def check(self) -> None:
        """Raise LimitError where the drive's own limits do not allow a hold, FaultError where it is in fault."""
        drive, step = self._drive, self._plan.step
        found = operation.fault(drive)
        if found is not None:
            raise FaultError(f"the drive is in fault: {found.text} (0x{found.code:04X}); reset it first", found.code)
        R_s, L_d, L_q, psi_f = (drive.read(f"control_{name}") for name in ("R_s", "L_d", "L_q", "psi_f"))
        own = {"R_s": R_s, "L_d": L_d, "L_q": L_q, "psi_f": psi_f, "n_p": self._n_p}
        check_motor(self._plan, own, "the drive's current control")
        if self._limits.n_p not in (None, self._n_p):
            raise LimitError(
                f"the drive is set for {self._n_p:g} pole pairs, its machine file says {self._limits.n_p}: its speeds "
                "would be others than were planned"
            )
        trip, omega_full = drive.read("overcurrent_trip"), drive.identity.omega_full
        most_current = _REACH * (trip if trip > 0.0 else drive.identity.i_full)
        u_most = _REACH * drive.read("u_dc") / math.sqrt(3.0)
        for k, hold in enumerate(self._plan.holds, start=1):
            most = math.hypot(abs(hold.i_d) + step, abs(hold.i_q) + step)
            self._limits.check_current(most, f"hold {k}")
            self._limits.check_speed(hold.speed_rpm, f"hold {k}")
            if most > most_current:
                raise LimitError(
                    f"hold {k}: the drive takes currents up to {most_current:.4g} A, below its overcurrent trip, got "
                    f"{most:.4g} A with the steps"
                )
            omega_e = abs(self._omega_e(hold))
            if omega_e > omega_full:
                most_rpm = omega_full / (self._n_p * RPM)
                raise LimitError(f"hold {k}: the drive's speeds go to {most_rpm:.5g} rpm, got {hold.speed_rpm:g}")
            u = abs(R_s * complex(hold.i_d, hold.i_q) + 1j * omega_e * complex(L_d * hold.i_d + psi_f, L_q * hold.i_q))
            if u > u_most > 0.0:
                raise LimitError(
                    f"hold {k}: {hold.speed_rpm:g} rpm with i_d = {hold.i_d:g} A, i_q = {hold.i_q:g} A asks for "
                    f"{u:.4g} V, expected at most {u_most:.4g} V, which the dc link allows"
                )

    def rehearse(self) -> None:
        """Have the drive judge all set points while its bridge is off. Raises RefusedError."""
        self._still()
        for hold in self._plan.holds:
            self._set(hold)
        self._still()

    def recorded(self) -> Recorded:
        """All holds, recorded."""
        settings = {"field_weakening": 0.0, "excitation_kind": _LEVELS, "step_time": max(_STEP_TIME, self._T_s)}
        if self._speed_controlled:
            settings["speed_control"] = float(_REFERENCE)
            self._remarks.append("the drive controls its speed: i_q follows from the load, not from the experiment")
        fastest = max(abs(self._drive.read("omega_e")), *(abs(self._omega_e(hold)) for hold in self._plan.holds))
        self.guard.most_speed = _FASTER * fastest + _SLACK * self._drive.identity.omega_full
        if self._drive.identity.has_lease:
            settings[TRIP] = min(self.guard.most_speed, self._drive.read(TRIP))
        parts: list[Capture] = []
        self.guard.check_cancelled()  # a stop after this ends the lease by which it starts
        self._lease.start(self._drive, settings)
        self.guard.check_cancelled()
        for holds in _groups(self._plan, self._T_s):
            self._set(holds[0])
            self._await_speed(holds[0])
            parts.append(self._recorded_group(holds))
        return Recorded(tuple(parts), tuple(dict.fromkeys(self._remarks)))

    def _recorded_group(self, holds: Sequence[Hold]) -> Capture:
        drive, setup = self._drive, Setup(SIGNALS, _length(holds, self._T_s))
        number_ = capture.arm(drive, setup)
        ends = np.cumsum([hold.seconds for hold in holds]) / self._T_s
        count, grown = -1, time.monotonic()
        at = 0
        while True:
            self.guard.check(loaded=self._speed_controlled)
            seen = capture.seen(drive, number_)
            if seen.count != count:
                count, grown = seen.count, time.monotonic()
            elif time.monotonic() - grown > _STANDSTILL:
                raise NoReplyError(f"the recording stands still at {count} samples for {_STANDSTILL:g} s")
            if seen.state == DONE:
                break
            if at + 1 < len(holds) and count >= ends[at]:
                at += 1
                self._set(holds[at])
            self._say(f"holding {_words(holds[at])}", self._done + count * self._T_s)
            self.guard.pause(_POLL)
        self._still()
        found = capture.found(drive, setup)
        if found.number != number_ or found.count < setup.length:
            raise GoneError("another client has armed or stopped the recorder before the recording was complete")
        self._done += setup.length * self._T_s
        if self._part is not None:
            self._part.group(found, self._remarks, operation.off(drive))

        def uploaded(done: int) -> None:
            self._lease.keep(drive)
            if self._part is not None:
                self._part.keep(found.data, done * 2 * len(SIGNALS))
            self.guard.check_cancelled()
            self._say(f"uploading {done} of {found.count} samples", self._done)

        return capture.upload(drive, found, uploaded)

    def _omega_e(self, hold: Hold) -> float:
        return hold.speed_rpm * RPM * self._n_p

    def _set(self, hold: Hold) -> None:
        step = self._plan.step
        turning = {"speed_ref": self._omega_e(hold)} if self._speed_controlled else {"i_q_ref": hold.i_q}
        self._lease.write(self._drive, turning | {"i_d_ref": hold.i_d, "i_d_step": step, "i_q_step": step})

    def _still(self) -> None:
        """No current; under speed control the speed stays where it is."""
        self._lease.write(self._drive, _NO_STEPS)

    def _await_speed(self, hold: Hold) -> None:
        wanted = self._omega_e(hold)
        near = _SETTLED * max(abs(wanted), 0.05 * self._drive.identity.omega_full)
        deadline = time.monotonic() + PATIENCE
        while abs((now := self._drive.read("omega_e")) - wanted) > near:
            rpm = now / (self._n_p * RPM)
            if not self._speed_controlled:
                self._remarks.append(
                    f"{hold.speed_rpm:g} rpm was wanted and {rpm:.4g} rpm recorded: the load machine sets the speed of "
                    "this drive, which controls its currents alone"
                )
                return
            if time.monotonic() > deadline:
                raise NoReplyError(
                    f"the drive did not come to {hold.speed_rpm:g} rpm within {PATIENCE:g} s, it turns at {rpm:.4g} rpm"
                )
            self.guard.check(loaded=self._speed_controlled)
            self._say(f"going to {hold.speed_rpm:g} rpm", self._done)
            self.guard.pause(_POLL)

    def _say(self, phase: str, seconds: float) -> None:
        self._tell(Progress(phase, min(1.0, seconds / self._plan.seconds)))


def _groups(plan: Plan, T_s: float) -> list[list[Hold]]:
    """Holds that one recording takes: of one speed, and no more than the recorder holds."""
    groups: list[list[Hold]] = []
    most = CAPTURE_SAMPLES * T_s
    for _, same in groupby(plan.holds, key=lambda hold: hold.speed_rpm):
        groups.append([])
        for hold in same:
            pieces = math.ceil(hold.seconds / most)
            piece = Hold(hold.speed_rpm, hold.i_d, hold.i_q, hold.seconds / pieces)
            for _ in range(pieces):
                if groups[-1] and sum(h.seconds for h in groups[-1]) + piece.seconds > most:
                    groups.append([])
                groups[-1].append(piece)
    return groups


def _length(holds: Sequence[Hold], T_s: float) -> int:
    return min(max(round(sum(hold.seconds for hold in holds) / T_s), 1), CAPTURE_SAMPLES)


def _has_experiment(doubt: object) -> bool:
    return isinstance(doubt, dict) and isinstance(cast(dict[str, object], doubt).get("experiment"), dict)


def _words(hold: Hold) -> str:
    return f"{hold.speed_rpm:g} rpm, i_d = {hold.i_d:g} A, i_q = {hold.i_q:g} A"
