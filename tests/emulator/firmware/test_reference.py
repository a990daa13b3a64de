"""The speed reference that the bench commands: its ramps and swings, and how the shaft follows."""

import math
from dataclasses import replace

import numpy as np
import pytest

from emulator.bounds import ScenarioError
from emulator.drive.virtual_drive import VirtualDrive
from emulator.firmware.reference import Ramp, ramped
from emulator.scenario.scenarios import PAPER, PAPER_RUN, Excitation, Run, parse

MOTOR = PAPER.motor
OFF, BY_REFERENCE, BY_PROFILE = 0.0, 1.0, 2.0


def free(**given: object) -> VirtualDrive:
    """The paper's motor on a free shaft at 600 rpm (251 rad/s), with a load."""
    run = replace(Run(shaft="free", speed_rpm=600.0, tau_L=1.0), **given)  # pyright: ignore[reportArgumentType]
    return VirtualDrive(replace(PAPER, run=run, excitation=Excitation()))


def speed(drive: VirtualDrive) -> float:
    return MOTOR.n_p * drive.plant.omega_m


def course(step: float, rate: float, hold: int, periods: int) -> list[float]:
    """The reference period by period, towards 10 rad/s from 0, at 1 ms."""
    ramp, seen = Ramp(0.0, 1, 0), list[float]()
    for _ in range(periods):
        ramp = ramped(ramp, 10.0, step, rate, hold, 1e-3)
        seen.append(ramp.omega_e)
    return seen


def test_a_reference_goes_in_a_straight_line_and_stays() -> None:
    assert course(0.0, 4000.0, 0, 5) == [4.0, 8.0, 10.0, 10.0, 10.0]
    assert course(0.0, 0.0, 0, 2) == [10.0, 10.0]  # no limit


def test_a_reference_with_a_step_swings_between_its_ends_and_stays_at_each() -> None:
    assert course(2.0, 2000.0, 3, 14) == [
        2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 12.0, 12.0, 10.0, 8.0, 8.0, 8.0, 10.0, 12.0
    ]
    assert course(2.0, 0.0, 1, 4) == [12.0, 8.0, 12.0, 8.0]
    assert course(2.0, 0.0, 2, 6) == [12.0, 12.0, 8.0, 8.0, 12.0, 12.0]


def test_the_shaft_follows_a_commanded_ramp_to_either_direction() -> None:
    drive = free(speed_control=True, speed_reference="ramp")
    for wanted in (400.0, -300.0, 0.0):
        drive.write("speed_ramp", 2000.0)
        drive.write("speed_ref", wanted)
        before = drive.read("speed_demand")
        drive.run(500)
        assert drive.read("speed_demand") == pytest.approx(before + math.copysign(100.0, wanted - before), abs=1e-6)
        drive.run(8000)
        assert drive.read("speed_demand") == wanted
        assert speed(drive) == pytest.approx(wanted, abs=1.0)


def test_speed_control_takes_over_from_a_current_without_a_jump() -> None:
    drive = free()
    i_q = 1.0 / (1.5 * MOTOR.n_p * MOTOR.psi_f)  # holds the load
    drive.write("i_q_ref", i_q)
    drive.run(1000)
    assert drive.read("speed_demand") == pytest.approx(speed(drive), rel=0.01)
    drive.write("speed_ref", drive.read("speed_demand"))
    drive.write("speed_control", BY_REFERENCE)
    r = drive.record(500)
    assert r["i_q"] == pytest.approx(i_q, abs=0.3)
    drive.write("speed_control", OFF)
    assert drive.record(500)["i_q"][100:] == pytest.approx(i_q, abs=0.1)


def test_a_drive_that_is_switched_on_goes_from_the_speed_there_is() -> None:
    drive = free(speed_control=True, speed_reference="ramp", tau_L=0.0)
    drive.write("control_word", 0x00)
    drive.run(100)
    assert drive.read("speed_demand") == pytest.approx(speed(drive), rel=0.01)
    for word in (0x06, 0x0F):
        drive.write("control_word", word)
    drive.write("speed_ramp", 500.0)
    r = drive.record(2000)
    assert np.hypot(r["i_d"], r["i_q"]).max() < 3.0
    assert speed(drive) == pytest.approx(251.3 - 0.2 * 500.0, abs=10.0)


def test_speed_ramps_as_an_excitation_lead_the_shaft_up_and_down() -> None:
    drive = free(speed_control=True, speed_reference="ramp")
    for name, value in (("speed_ref", 300.0), ("speed_step", 100.0), ("speed_ramp", 2000.0), ("speed_hold", 0.1)):
        drive.write(name, value)
    drive.run(3000)
    omega_e = drive.record(8000)["omega_e"]  # 0.1 s each: up, held, down, held
    assert omega_e.max() == pytest.approx(400.0, rel=0.1)
    assert omega_e.min() == pytest.approx(200.0, rel=0.15)
    for there in (omega_e > 370.0, omega_e < 230.0):
        assert np.count_nonzero(np.diff(there.astype(int)) == 1) == 2
        assert 0.2 < there.mean() < 0.5


def test_the_drives_own_profile_is_followed_and_left_on_command() -> None:
    drive = VirtualDrive(PAPER_RUN)
    assert drive.read("speed_control") == BY_PROFILE
    drive.run(10_000)
    assert drive.read("speed_demand") == pytest.approx(4.0 * 1200.0 * math.pi / 30.0, rel=0.06)
    drive.write("speed_ref", 200.0)
    drive.write("speed_control", BY_REFERENCE)
    drive.run(20_000)
    assert speed(drive) == pytest.approx(200.0, abs=15.0)  # amid its excitation


def test_speeds_that_the_control_cannot_follow_are_refused() -> None:
    drive = free()
    drive.write("speed_step", 100.0)
    with pytest.raises(ValueError, match=r"\(speed_ref\) takes speeds up to 10000 rad/s, 1 rad .* got up to 10001"):
        drive.write("speed_ref", -9901.0)
    text = "[motor]\nR_s = 0.5\nL_d = 2e-3\nL_q = 3e-3\npsi_f = 0.1\nn_p = 3\ni_rated = 10\n"
    ramp = text + '[run]\nshaft = "free"\nspeed_control = true\nspeed_reference = "ramp"\n[excitation]\n'
    assert parse(ramp + "speed_ref = 500\nspeed_step = 100", "x.toml").excitation.speed_ref == 500.0
    with pytest.raises(ScenarioError, match=r"x\.toml: drive\.u_dc takes at least 346\.\d V for"):
        parse(ramp + "speed_ref = 1900\nspeed_step = 100", "x.toml")
    with pytest.raises(ScenarioError, match=r"x\.toml: run\.speed_reference takes profile or ramp, got 'sine'"):
        parse(text + '[run]\nspeed_reference = "sine"', "x.toml")
