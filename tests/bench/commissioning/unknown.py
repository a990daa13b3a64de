"""Emulated drives whose motor nobody knows yet: their encoder anywhere, their control's data anything."""

import contextlib
import math
import threading
from collections.abc import Callable, Generator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from bench.actions.safety.limits import TRIP, Limits
from bench.actions.safety.unfinished import Origin
from bench.commissioning import first_start, trial
from bench.commissioning.first_start import FirstStart
from bench.commissioning.identify import Around
from drivers import operation
from drivers.drive import Drive
from drivers.lease import held
from drivers.wire.cia402 import State
from drivers.wire.dictionary import SET_POINTS
from emulator.plant.physics.friction import Friction
from emulator.scenario.effects import NONE
from emulator.scenario.scenarios import PAPER, Excitation, Run, Scenario

MOTOR: Final = PAPER.motor._replace(B=1e-3)
STIFF: Final = 0.01  # rad/s, mechanical, of a friction that next to nothing creeps against
SLIGHT: Final = Friction(coulomb=0.01)
MOUNTED: Final = 0.9  # rad, mechanical
MOST: Final = 3.0  # A
LIMITS: Final = Limits(i_max=7.2, speed_max_rpm=2000.0)
WATCHED: Final = (*first_start.SETTINGS, *trial.SETTINGS, TRIP, *SET_POINTS)
Tell = Callable[[str], None]


def unknown(
    *, n_p: int = 4, J: float = 2e-4, friction: Friction = SLIGHT, tau_L: float = 0.0,
    settings: dict[str, float] | None = None, **drive: Any,
) -> Scenario:  # fmt: skip
    """A motor that is free to turn, on a drive that was delivered for one of two pole pairs."""
    return replace(
        PAPER, name="unknown", motor=MOTOR._replace(n_p=n_p, J=J, psi_f=0.12 * 4 / n_p),
        drive=replace(PAPER.drive, **{"encoder_offset": MOUNTED, "encoder_counts": 131_072} | drive),
        run=Run(shaft="free", speed_rpm=0.0, tau_L=tau_L), excitation=Excitation(kind="none"),
        effects=NONE._replace(friction=friction), settings={"n_p": 2.0} | (settings or {}),
    )  # fmt: skip


def origin(folder: Path) -> Origin:
    """Of what is noted while a test has a drive."""
    return Origin(folder / "control", "x", "a commissioning")


def angle_error(scenario: Scenario, found: FirstStart) -> float:
    """rad, electrical, by which the drive's angle would be off with what was found; infinite where it turns."""
    drive, values, n_p = scenario.drive, found.values, scenario.motor.n_p
    encoder = (-1 if drive.encoder_reversed else 1) * (-1 if values["angle_reversed"] else 1)
    phases = -1 if drive.phases_crossed != bool(values["phases_swapped"]) else 1
    if values["n_p"] != n_p or encoder != phases:
        return math.inf
    mounted = drive.encoder_offset * (-1 if values["angle_reversed"] else 1)
    return abs((n_p * mounted + values["angle_offset"] + math.pi) % math.tau - math.pi)


def watched(drive: Drive) -> dict[str, float]:
    """What has to be as before, whatever is done."""
    return {name: drive.read(name) for name in WATCHED}


def is_off(drive: Drive) -> bool:
    """Without current, and nobody's."""
    return operation.state(drive) in (State.SWITCH_ON_DISABLED, State.FAULT) and held(drive) is None


@contextlib.contextmanager
def left_as_before(drive: Drive) -> Generator[None]:
    """However what is done ends, the drive is off then, its settings are as before, its set points zero."""
    before = watched(drive)
    try:
        yield
    finally:
        assert is_off(drive)
        assert watched(drive) == before
        assert not any(before[name] for name in SET_POINTS)


def once(phase: str, act: Callable[[], None]) -> Tell:
    """Have something done when a phase that begins so is told, once."""
    done = threading.Event()

    def tell(said: str) -> None:
        if said.startswith(phase) and not done.is_set():
            done.set()
            act()

    return tell


FREE: Final = replace(
    PAPER, name="free", motor=PAPER.motor._replace(J=2e-3, B=1e-3),
    run=Run(shaft="free", speed_rpm=0.0, speed_control=True, speed_reference="ramp", speed_bandwidth=30.0),
    excitation=Excitation(kind="none"),
)  # fmt: skip
"""A drive that knows its motor well, whose shaft is free: its loops answer as they are tuned."""


def around(
    drive: Drive, folder: Path, tell: Tell = lambda _: None, cancelled: threading.Event | None = None,
    limits: Limits = LIMITS,
) -> Around:  # fmt: skip
    """To try loops by; what identification needs besides is not there."""

    def none(_: Any) -> Any:
        raise AssertionError("nothing is to be kept or diagnosed")

    return Around(
        lambda: drive, limits, PAPER.motor.i_rated, origin(folder), none, none, none, tell,
        cancelled or threading.Event(),
    )  # fmt: skip
