"""Field weakening: speeds above the base speed with it and not without, within the limits of voltage and current."""

import math
from dataclasses import replace

import numpy as np
import pytest

from emulator.bounds import ScenarioError
from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.inverter import longest
from emulator.scenario.scenarios import PAPER, Excitation, Run, Scenario, check, drive_for

MOTOR = PAPER.motor
REACH = longest(PAPER.drive.u_dc)
BASE = REACH / MOTOR.psi_f  # rad/s, electrical: where the back-EMF alone takes all voltage
LOAD = 1.0  # Nm


def spinning(field_weakening: bool, load: float = LOAD, **drive: object) -> VirtualDrive:
    """A free shaft under speed control, at a third of its base speed."""
    settings = replace(PAPER.drive, field_weakening=field_weakening, **drive)  # pyright: ignore[reportArgumentType]
    run = Run(shaft="free", speed_rpm=1000.0, speed_control=True, speed_reference="ramp", tau_L=load)
    return VirtualDrive(Scenario("x", MOTOR, settings, run, Excitation(speed_ref=400.0, speed_ramp=4000.0)))


def settled(drive: VirtualDrive, omega_e: float) -> dict[str, float]:
    """Means over the end of the run to a speed."""
    drive.write("speed_ref", omega_e)
    drive.run(15_000)
    means = {name: float(column.mean()) for name, column in drive.record(1000).items()}
    assert drive.read("error_code") == 0.0
    return means


def steady_voltage(omega_e: float, i_d: float, i_q: float) -> float:
    return math.hypot(
        MOTOR.R_s * i_d - omega_e * MOTOR.L_q * i_q, MOTOR.R_s * i_q + omega_e * (MOTOR.L_d * i_d + MOTOR.psi_f)
    )


def load_current(omega_e: float, i_d: float) -> float:
    tau = LOAD + MOTOR.B * omega_e / MOTOR.n_p
    return tau / (1.5 * MOTOR.n_p * (MOTOR.psi_f + (MOTOR.L_d - MOTOR.L_q) * i_d))


@pytest.mark.parametrize("bridge", ["averaged", "switched"])
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_motor_goes_above_its_base_speed_with_it_and_not_without(bridge: str, direction: float) -> None:
    wanted = direction * 1.15 * BASE
    without, with_it = (
        settled(spinning(on, direction * LOAD, bridge=bridge), wanted) for on in (False, True)
    )
    assert abs(without["omega_e"]) < BASE
    assert with_it["omega_e"] == pytest.approx(wanted, rel=1e-3)
    assert -6.0 < with_it["i_d"] < -4.0


def test_the_voltage_stays_at_its_share_and_the_current_is_that_of_the_voltage_equations() -> None:
    mean = settled(spinning(True, weakening_voltage=0.9), 1.05 * BASE)
    assert math.hypot(mean["u_d"], mean["u_q"]) == pytest.approx(0.9 * REACH, rel=2e-3)
    assert mean["i_q"] == pytest.approx(load_current(mean["omega_e"], mean["i_d"]), rel=0.01)
    assert steady_voltage(mean["omega_e"], mean["i_d"], mean["i_q"]) == pytest.approx(0.9 * REACH, rel=5e-3)


def test_at_its_limit_the_speed_is_the_highest_that_the_voltage_allows() -> None:
    mean = settled(spinning(True), 1.5 * BASE)
    assert mean["i_d"] == pytest.approx(-MOTOR.i_rated, abs=0.01)
    assert math.hypot(mean["u_d"], mean["u_q"]) == pytest.approx(REACH, rel=1e-3)
    speeds = np.linspace(BASE, 1.5 * BASE, 20_000)
    needed = [steady_voltage(w, -MOTOR.i_rated, load_current(w, -MOTOR.i_rated)) for w in speeds]
    highest = speeds[np.searchsorted(needed, REACH)]
    assert mean["omega_e"] == pytest.approx(highest, rel=5e-3)


def test_it_is_left_again_below_the_base_speed() -> None:
    drive = spinning(True)
    settled(drive, 1.15 * BASE)
    assert settled(drive, 0.5 * BASE)["i_d"] == pytest.approx(0.0, abs=0.01)


def test_where_there_is_voltage_enough_it_changes_nothing() -> None:
    on, off = (VirtualDrive(replace(PAPER, drive=replace(PAPER.drive, field_weakening=x))) for x in (True, False))
    recorded = off.record(2000)
    for name, column in on.record(2000).items():
        assert column.tobytes() == recorded[name].tobytes(), name


def test_it_is_commanded_while_the_drive_runs() -> None:
    drive = spinning(False)
    assert settled(drive, 1.15 * BASE)["omega_e"] < BASE
    drive.write("field_weakening", 1.0)
    assert settled(drive, 1.15 * BASE)["omega_e"] == pytest.approx(1.15 * BASE, rel=1e-3)
    drive.write("i_d_weakening", 2.0)
    assert settled(drive, 1.15 * BASE)["i_d"] == pytest.approx(-2.0, abs=0.02)
    with pytest.raises(ValueError, match=r"\(i_d_weakening\) takes at most 12 A, the drive's current limit, got 13"):
        drive.write("i_d_weakening", 13.0)


def test_what_is_left_of_the_current_circle_is_i_qs() -> None:
    drive = spinning(True, i_d_weakening=12.0)
    settled(drive, 1.1 * BASE)
    drive.write("speed_ramp", 0.0)
    drive.write("speed_ref", 1.3 * BASE)
    r = drive.record(3000)
    assert r["i_d"].min() < -8.0
    assert np.hypot(r["i_d"], r["i_q"]).max() < 12.5
    assert drive.read("error_code") == 0.0


def test_a_dynamometer_above_the_base_speed_does_not_trip_the_drive() -> None:
    weak = replace(PAPER.drive, field_weakening=True)
    run = Run(speed_rpm=1.1 * BASE / MOTOR.n_p * 30.0 / math.pi)
    drive = VirtualDrive(Scenario("x", MOTOR, weak, run, Excitation(i_q_ref=2.0)))
    r = drive.record(3000)
    assert drive.read("error_code") == 0.0
    assert np.hypot(r["i_d"], r["i_q"]).max() < 6.0
    assert r["i_q"][-100:] == pytest.approx(2.0, abs=0.05)


def test_a_scenario_is_refused_where_the_voltage_suffices_with_it_alone() -> None:
    run = Run(speed_rpm=1.1 * BASE / MOTOR.n_p * 30.0 / math.pi)
    scenario = Scenario("x", MOTOR, PAPER.drive, run)
    with pytest.raises(ScenarioError, match=r"x: drive\.u_dc takes at least 341 V for 3916\.\d+ rpm"):
        check(scenario)
    check(replace(scenario, drive=replace(PAPER.drive, field_weakening=True)))
    faster = replace(run, speed_rpm=1.3 * run.speed_rpm)
    with pytest.raises(ScenarioError, match=r"x: drive\.u_dc takes at least 349"):
        check(replace(scenario, drive=replace(PAPER.drive, field_weakening=True), run=faster))
    assert drive_for(MOTOR, i_max=3.0).i_d_weakening == 3.0
    with pytest.raises(ScenarioError, match=r"x: drive\.i_d_weakening takes at most drive\.i_max = 12 A, got 13 A"):
        check(replace(scenario, drive=replace(PAPER.drive, i_d_weakening=13.0)))
