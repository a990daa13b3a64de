"""A motor identified: loops tried, excited, diagnosed, and a set proposed for its drive; then the loops tried again."""

import threading
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from bench.actions.experiment import Plan, experiment_of
from bench.actions.safety.limits import TRIP, Limits
from bench.actions.safety.under_control import Guard, under_control
from bench.actions.safety.unfinished import Origin
from bench.commissioning.excitation import excitation
from bench.commissioning.loops import Judged, Tried, fastest, judged, tried
from bench.commissioning.proposal import (
    by_torque,
    corrected,
    from_diagnosis,
    machine_of,
    shaft_of,
    tuned,
    turn_of,
    without_losses,
)
from bench.commissioning.trial import INVERTER, SETTINGS, StalledError, Tell, Trials
from bench.errors import LimitError
from bench.parameters.flash import parameters
from bench.parameters.from_diagnosis import SETTLED
from bench.parameters.made import Made
from bench.parameters.temperature import TEMPERATURES
from drivers import capture
from drivers.capture import Capture, Upload
from drivers.drive import Drive
from drivers.errors import FaultError
from drivers.lease import Lease
from estimator.machine import Machine
from estimator.mechanics.mechanics import Mechanics

Link = Callable[[], Drive]
_ROUNDS: Final = 2  # experiments that a diagnosis may ask for
_FASTER: Final = 1.2  # times the fastest speed of a trial: beyond, it ends


@dataclass(frozen=True, slots=True)
class Around:
    """What a commissioning is done for, and by what."""

    link: Link
    limits: Limits
    i_rated: float  # A, that currents stay within
    origin: Origin
    keep: Callable[[Upload], Path]  # as a recording; its file
    record: Callable[[Plan], Path]  # does an experiment; its file
    diagnose: Callable[[Path], Mapping[str, Any]]  # a recording's diagnosis, as JSON
    tell: Tell = lambda _: None
    cancelled: threading.Event = field(default_factory=threading.Event)


@dataclass(frozen=True, slots=True, eq=False)
class Identified:
    """What is known of a motor, and what is proposed for its drive."""

    before: Tried
    recordings: Sequence[Path]
    diagnosis: Mapping[str, Any]
    machine: Machine | None  # after the diagnosis
    shaft: Mechanics | None
    made: Made
    present: Mapping[str, float]  # the drive's parameters, SI

    @property
    def loops(self) -> list[Judged]:
        """The loops as they were, against what their gains promise of this machine."""
        if self.machine is None:
            return []
        return judged(self.before, self.machine, *shaft_numbers(self.before, self.machine, self.shaft))


def try_loops(around: Around) -> Tried:
    """Steps of speed and currents, as the drive is tuned now. Raises BenchError, DriveError."""
    drive = around.link()
    with _trials(around, drive) as trials:
        return tried(drive, trials, around.limits, around.i_rated)


def identify(
    around: Around, name: str, *, bandwidth: float | None = None, theta_step: float = 0.0, version: int = 1
) -> Identified:
    """All of it; nothing is written that stays. Raises BenchError, DriveError."""
    drive = around.link()
    present, n_p = parameters(drive), int(drive.read("n_p"))
    if not drive.identity.has_memory:
        layout = f"0x{drive.identity.layout_id:08X}"
        raise LimitError(f"a drive of layout {layout} has no control loops that can be set, expected one that has")
    if around.limits.n_p not in (None, n_p):
        raise LimitError(
            f"the drive is set for {n_p} pole pairs, its machine file says {around.limits.n_p}: expected the same; a "
            "first start finds out which"
        )
    image = present | {INVERTER: 0.0}  # while it is recorded
    try:
        seen = _excited(around, drive, image)
    except FaultError as error:
        raise FaultError(f"{error}; {_ALSO}", error.code) from None
    except StalledError as error:
        raise StalledError(f"{error}; {_ALSO}") from None
    content, files = _diagnosed(around, seen)
    turn = seen.turn if content is seen.diagnosis else None
    made = from_diagnosis(content, image, drive.identity, name, version, turn, seen.temperatures)
    found, shaft = machine_of(content, n_p), None
    if found is not None:
        now = image | made.set.values
        shaft = shaft_of([by_torque(corrected(seen.capture, image, now, turn), now, found[0])], *found, theta_step)
        shaft = without_losses(shaft, [one["effect"] for one in content["findings"]])
    made = tuned(made, shaft, image, drive.identity.T_s, bandwidth)
    return Identified(seen.before, files, content, found[0] if found else None, shaft, made, present)


_ALSO: Final = "wrong pole pairs or a wrong angle do that as well: a first start tells"


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """A motor excited, and what its recording says."""

    before: Tried
    file: Path
    capture: Capture
    turn: int | None  # see `turn_of`
    temperatures: Mapping[str, float]  # degC, by signal
    diagnosis: Mapping[str, Any]


def _excited(around: Around, drive: Drive, image: Mapping[str, float]) -> _Seen:
    """Loops tried, the motor excited, its recording diagnosed."""
    identity = drive.identity
    with _trials(around, drive) as trials:
        before = tried(drive, trials, around.limits, around.i_rated)
        plan = excitation(fastest(drive, around.limits), around.i_rated, before.K, identity.T_s)
        excited, readings = trials.excited(plan)
        temperatures = {name: drive.read(name) for name in TEMPERATURES.values()}
    file, recorded = around.keep(excited), capture.decoded(excited, identity.T_s, identity.full)
    around.tell("diagnosing")
    turn = turn_of(recorded, readings, image)
    return _Seen(before, file, recorded, turn, temperatures, around.diagnose(file))


def _diagnosed(around: Around, seen: _Seen) -> tuple[Mapping[str, Any], list[Path]]:
    """A diagnosis, after the experiments that it asks for, where one settles more; all recordings."""
    content = latest = seen.diagnosis
    files = [seen.file]
    for _ in range(_ROUNDS):
        if (asked := _asked_for(latest)) is None:
            break
        around.tell(f"doing the experiment that the diagnosis asks for, {asked.seconds:.2g} s")
        file = around.record(asked)
        files.append(file)
        around.tell("diagnosing that")
        latest = around.diagnose(file)
        content = latest if latest["verdict"] in SETTLED else content
    return content, files


def _asked_for(diagnosis: Mapping[str, Any]) -> Plan | None:
    """The experiment that a diagnosis asks for; None where it asks for none that a drive could do."""
    if diagnosis["verdict"] in SETTLED:
        return None
    try:
        return Plan.of(experiment_of(diagnosis))
    except LimitError:
        return None


@contextmanager
def _trials(around: Around, drive: Drive) -> Generator[Trials]:
    """The drive under control, to be tried; it is stopped and as before afterwards."""
    lease, most = Lease(), _FASTER * fastest(drive, around.limits)
    with under_control(drive, lease, around.origin, (*SETTINGS, *_trip(drive))):
        lease.stop(drive)
        limits = {"current_limit": min(around.i_rated, drive.read("current_limit"))}
        if drive.identity.has_lease:
            limits[TRIP] = min(most, drive.read(TRIP))
        lease.write(drive, limits)
        yield Trials(drive, lease, Guard(drive, lease, around.limits, "the trial", around.cancelled, most), around.tell)


def shaft_numbers(one: Tried, machine: Machine, shaft: Mechanics | None) -> tuple[float, float]:
    """Electrical acceleration by i_q, rad/(s2 A), and damping B/J, 1/s; by the trial itself where J is not told."""
    J, B = (None, None) if shaft is None else (shaft.estimates[name].value for name in ("J", "B"))
    return acceleration_of(machine, J, B) or (one.K, 0.0)


def acceleration_of(machine: Machine, J: float | None, B: float | None) -> tuple[float, float] | None:
    """As `shaft_numbers`, of a shaft's J (kg m2) and B (Nm s/rad); None where J is not told."""
    return (1.5 * machine.n_p**2 * machine.psi_f / J, (B or 0.0) / J) if J else None


def _trip(drive: Drive) -> tuple[str, ...]:
    return (TRIP,) if drive.identity.has_lease else ()
