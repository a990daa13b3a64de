"""First starts of emulated drives over a link: what is found, what is refused, and that the drive is left as it was."""

import contextlib
import math
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from bench.actions.safety.under_control import CancelledError, under_control
from bench.actions.safety.unfinished import undo
from bench.commissioning.first_start import SETTINGS, FirstStart, Forwards, Tell, UnclearError, first_start
from drivers import operation
from drivers.connect import connect
from drivers.drive import Drive
from drivers.errors import DriveError, FaultError
from drivers.lease import HeldError, Lease
from drivers.wire.cia402 import State
from emulator.plant.physics.friction import Friction
from emulator.scenario.scenarios import Scenario
from tests.bench.commissioning.unknown import (
    MOST,
    STIFF,
    angle_error,
    is_off,
    left_as_before,
    once,
    origin,
    unknown,
    watched,
)
from tests.support.served_drive import Served, served, tcp_url, until, virtual_url

pytestmark = pytest.mark.live

CLOSE = math.radians(2.0)  # rad, electrical
FURTHEST = 0.6  # turns that a rotor is moved by at most


def started(
    drive: Drive, folder: Path, forwards: Forwards = Forwards.ENCODER, tell: Tell = lambda _: None,
    cancelled: threading.Event | None = None, most: float = MOST,
) -> FirstStart:  # fmt: skip
    """A first start under control, as a service does it."""
    lease = Lease()
    with under_control(drive, lease, origin(folder), SETTINGS):
        return first_start(drive, lease, most, forwards, tell, cancelled)


@contextlib.contextmanager
def linked(scenario: Scenario) -> Generator[tuple[Served, Drive]]:
    """A drive over a link, which is left as it was."""
    with served(virtual_url(), scenario, control="lease") as bench, connect(bench.url) as drive, left_as_before(drive):
        yield bench, drive


@dataclass(frozen=True)
class Mounted:
    """How a motor is connected, and what is to be found of it."""

    scenario: Scenario
    forwards: Forwards = Forwards.ENCODER
    swapped: int = 0
    reversed: int = 0


CROSSED: dict[str, Any] = {"phases_crossed": True}
BACKWARDS: dict[str, Any] = {"encoder_reversed": True}
CONNECTED = {
    "plain": Mounted(unknown()),
    "phases crossed": Mounted(unknown(**CROSSED), swapped=1),
    "encoder reversed": Mounted(unknown(**BACKWARDS), swapped=1),
    "both": Mounted(unknown(**CROSSED, **BACKWARDS)),
    "crossed, as connected": Mounted(unknown(**CROSSED), Forwards.PHASES, reversed=1),
    "1 pole pair": Mounted(unknown(n_p=1, **BACKWARDS), swapped=1),
    "14 pole pairs": Mounted(unknown(n_p=14, **BACKWARDS, settings={"phases_swapped": 1.0}), swapped=1),
    "36 pole pairs": Mounted(unknown(n_p=36)),
    "the second current": Mounted(unknown(J=2e-3, friction=Friction(coulomb=0.4, omega_0=STIFF))),
    "a load": Mounted(unknown(tau_L=0.15, **CROSSED), swapped=1),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", [
    pytest.param(name, marks=() if name == "encoder reversed" else pytest.mark.slow)
    for name in CONNECTED
])  # fmt: skip
def test_pole_pairs_phase_order_direction_and_offset_are_found(name: str, tmp_path: Path) -> None:
    mounted, said = CONNECTED[name], list[str]()
    scenario = mounted.scenario
    with linked(scenario) as (_, drive):
        found = started(drive, tmp_path, mounted.forwards, said.append)
    assert (found.values["phases_swapped"], found.values["angle_reversed"]) == (mounted.swapped, mounted.reversed)
    assert found.n_p == scenario.motor.n_p
    assert angle_error(scenario, found) < max(CLOSE, found.offset_error)
    assert 0.0 <= found.offset_error < math.radians(10.0)
    assert 0.0 < found.moved < FURTHEST
    assert found.current <= 0.9 * MOST + 1e-9
    if scenario.run.tau_L:
        motor, i = scenario.motor, found.current
        holds = 1.5 * motor.n_p * (motor.psi_f * i - (motor.L_q - motor.L_d) * i**2)
        assert found.load == pytest.approx(scenario.run.tau_L / holds, rel=0.15)
    else:
        assert found.load < math.radians(3.0)
    assert f"{found.n_p} pole pairs; the encoder counts " in found.said
    assert said[0] == f"aligning the rotor by {0.2 * MOST:.3g} A"
    assert "turning the field" in said
    assert list((tmp_path / "control").iterdir()) == []


def test_a_rotor_that_is_locked_is_refused(tmp_path: Path) -> None:
    scenario = unknown(J=0.02, friction=Friction(coulomb=4.0, omega_0=STIFF))
    said = r"^the rotor does not follow 1\.8 A: expected a shaft that is free to turn"
    with linked(scenario) as (_, drive), pytest.raises(UnclearError, match=said):
        started(drive, tmp_path)
    assert list((tmp_path / "control").iterdir()) == []


def test_a_current_that_is_too_small_is_refused(tmp_path: Path) -> None:
    scenario = unknown(friction=Friction(coulomb=0.1, omega_0=STIFF))
    with linked(scenario) as (_, drive), pytest.raises(UnclearError, match="a larger current may be allowed by i_max"):
        started(drive, tmp_path, most=0.1)


def test_safe_torque_off_is_told(tmp_path: Path) -> None:
    scenario = unknown(safe_torque_off="active")
    with linked(scenario) as (_, drive), pytest.raises(FaultError, match=r"^safe torque off is active"):
        started(drive, tmp_path)
    assert not (tmp_path / "control").exists()


def test_cancelled_in_the_middle_it_ends_with_the_drive_off(tmp_path: Path) -> None:
    cancelled = threading.Event()
    with linked(unknown()) as (_, drive):
        with pytest.raises(CancelledError, match="the first start was cancelled"):
            started(drive, tmp_path, tell=once("turning the field", cancelled.set), cancelled=cancelled)
        begun = time.monotonic()
        with pytest.raises(CancelledError):
            started(drive, tmp_path, cancelled=cancelled)
        assert time.monotonic() - begun < 5.0
    assert list((tmp_path / "control").iterdir()) == []


def test_a_drive_that_goes_off_in_the_middle_ends_it(tmp_path: Path) -> None:
    with linked(unknown(temperature_trip=60.0)) as (bench, drive):
        hot = once("turning the field", lambda: bench.drive.set_temperature(70.0))
        with pytest.raises(FaultError, match="the drive went off during the first start: motor"):
            started(drive, tmp_path, tell=hot)


def test_a_drive_that_somebody_controls_is_left_alone(tmp_path: Path) -> None:
    with served(virtual_url(), unknown(), control="lease") as bench, connect(bench.url) as drive:
        other = Lease(holder="another")
        other.take(drive)
        before = watched(drive)
        with pytest.raises(HeldError, match="'another' controls the drive"):
            started(drive, tmp_path)
        assert watched(drive) == before
        other.release(drive)


def test_a_drive_without_a_forced_angle_is_told_so(tmp_path: Path) -> None:
    with served(virtual_url(), unknown(), control="watchdog") as bench, connect(bench.url) as drive:
        lease = Lease()
        with pytest.raises(UnclearError, match="has no forced angle, which this needs"):
            first_start(drive, lease, MOST)


def test_a_link_that_is_lost_in_the_middle_leaves_a_drive_that_goes_off_and_the_next_start_restores(
    tmp_path: Path
) -> None:
    with served(tcp_url(), unknown(), control="lease") as bench:
        with connect(bench.url) as drive:
            before = watched(drive)
            with pytest.raises(DriveError):
                started(drive, tmp_path, tell=once("turning the field", drive.close))
        _restored(bench, tmp_path, before)


CHILD = """
import sys, pathlib
from drivers.connect import connect
from tests.bench.commissioning.test_first_start import started
with connect(sys.argv[1]) as drive:
    started(drive, pathlib.Path(sys.argv[2]), tell=lambda said: print(said, flush=True))
"""


@pytest.mark.thorough
def test_killed_in_the_middle_the_next_start_restores(tmp_path: Path) -> None:
    with served(tcp_url(), unknown(), control="lease") as bench:
        with connect(bench.url) as drive:
            before = watched(drive)
        process = subprocess.Popen(
            [sys.executable, "-c", CHILD, bench.url, str(tmp_path)], stdout=subprocess.PIPE, text=True
        )
        assert process.stdout is not None
        with process, process.stdout:
            while (line := process.stdout.readline()) and "turning" not in line:
                pass
            assert "turning" in line
            process.send_signal(signal.SIGKILL)
        _restored(bench, tmp_path, before)


def _restored(bench: Served, folder: Path, before: dict[str, float]) -> None:
    """By the next start, of what the one that has died has left."""
    (note,) = (folder / "control").iterdir()
    with connect(bench.url) as drive:
        until(lambda: operation.state(drive) is not State.OPERATION_ENABLED, "the lease to run out", 10.0)
        assert "a bench ended without notice in a commissioning" in undo(folder / "control", drive)
        assert is_off(drive)
        assert watched(drive) == before
    assert not note.exists()
