"""The catalogue of motors: its numbers against its ratings, and each motor on a drive."""

import math
import re

import numpy as np
import pytest

from emulator.bounds import ScenarioError
from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.machine import Machine
from emulator.scenario.motors import MOTORS, Motor, drive_table, motor_from_table
from emulator.scenario.scenarios import Excitation, Run, Scenario, check, drive_for

each = pytest.mark.parametrize("motor", MOTORS.values(), ids=list(MOTORS))


def most_torque(machine: Machine, i: float) -> complex:
    """Current vector of length i (A) with the most torque: maximum torque per ampere."""
    saliency = machine.L_q - machine.L_d
    if saliency == 0.0:
        return complex(0.0, i)
    i_d = (machine.psi_f - math.sqrt(machine.psi_f**2 + 8.0 * saliency**2 * i**2)) / (4.0 * saliency)
    return complex(i_d, math.sqrt(i**2 - i_d**2))


def torque(machine: Machine, i: complex) -> float:
    """Of constant inductances, Nm."""
    return 1.5 * machine.n_p * (machine.psi_f + (machine.L_d - machine.L_q) * i.real) * i.imag


def at_work(name: str, motor: Motor) -> Scenario:
    """Half the rated current at rated speed."""
    i = most_torque(motor.machine, 0.5 * motor.machine.i_rated)
    drive = drive_for(motor.machine, motor.u_dc, T_s=motor.T_s)
    return Scenario(name, motor.machine, drive, Run(speed_rpm=motor.speed_rpm), Excitation(i.real, i.imag))


def test_there_are_twelve_from_50_watts_to_50_kilowatts_each_with_its_source() -> None:
    powers = [motor.P_rated for motor in MOTORS.values()]
    assert len(MOTORS) == 12
    assert powers == sorted(powers)
    assert 50.0 <= powers[0] < 60.0
    assert 45e3 < powers[-1] < 55e3
    assert len({motor.source for motor in MOTORS.values()}) == 12
    assert any(motor.machine.n_p >= 10 and motor.machine.L_d == 20e-6 for motor in MOTORS.values())


@each
def test_the_rated_current_gives_the_rated_power_at_rated_speed(motor: Motor) -> None:
    """A factor of 2, sqrt(2) or sqrt(3) in a conversion would show."""
    machine, omega_m = motor.machine, motor.speed_rpm * 2.0 * math.pi / 60.0
    P = torque(machine, most_torque(machine, machine.i_rated)) * omega_m
    assert 0.88 < P / motor.P_rated < 1.35


@each
def test_copper_loss_and_voltage_at_rated_load_are_a_motors(motor: Motor) -> None:
    machine = motor.machine
    assert 0.005 < 1.5 * machine.R_s * machine.i_rated**2 / motor.P_rated < 0.35
    no_load = machine.psi_f * machine.n_p * motor.speed_rpm * 2.0 * math.pi / 60.0
    assert 0.2 < no_load / (motor.u_dc / math.sqrt(3.0)) < 0.95
    assert 5e-5 < min(machine.L_d, machine.L_q) / machine.R_s < 0.05


@pytest.mark.parametrize("name", MOTORS)
def test_each_runs_on_a_drive_that_suits_it_and_reaches_its_currents(name: str) -> None:
    scenario = at_work(name, MOTORS[name])
    check(scenario)
    recording = VirtualDrive(scenario).record(2000)
    settled, wanted = slice(1500, None), scenario.excitation
    within = 0.01 * scenario.motor.i_rated
    assert np.mean(recording["i_d"][settled]) == pytest.approx(wanted.i_d_ref, abs=within)
    assert np.mean(recording["i_q"][settled]) == pytest.approx(wanted.i_q_ref, abs=within)


def test_a_name_gives_the_catalogues_numbers_and_what_else_is_given_counts() -> None:
    catalogue = MOTORS["teknic_m2310p"].machine
    assert motor_from_table({"name": "teknic_m2310p"}, "x.toml: motor.") == catalogue
    changed = motor_from_table({"name": "teknic_m2310p", "R_s": 0.5, "n_p": 7}, "x.toml: motor.")
    assert changed == catalogue._replace(R_s=0.5, n_p=7)
    table = {"R_s": 0.5, "L_d": 2e-3, "L_q": 3e-3, "psi_f": 0.1, "n_p": 3, "i_rated": 10}
    assert motor_from_table(table, "x.toml: motor.") == Machine(0.5, 2e-3, 3e-3, 0.1, 3, 10.0)


def test_a_named_motor_brings_its_dc_link_and_control_period() -> None:
    named = {"name": "mini_cheetah"}
    assert drive_table(named, {}) == {"u_dc": 24.0, "T_s": 5e-5}
    assert drive_table(named, {"u_dc": 30, "adc_bits": 14}) == {"u_dc": 30, "T_s": 5e-5, "adc_bits": 14}
    assert drive_table({"R_s": 1.0}, {"adc_bits": 14}) == {"adc_bits": 14}


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        ({"name": "tesla"}, "x.toml: motor.name takes a motor of the catalogue, anaheim_bly172s, teknic_m2310p, "),
        ({"name": 3}, "x.toml: motor.name takes a text, got 3"),
        ({"name": "lea_52k", "R_s": -1}, "x.toml: motor.R_s takes above 0 ohm, got -1"),
        ({"name": "lea_52k", "colour": 1}, "x.toml: motor.colour is no key here; the keys are R_s, "),
        ({"R_s": 1.0}, "x.toml: motor.L_d is missing; it has no default"),
    ],
)
def test_a_motor_that_is_not_there_is_refused_with_a_sentence(table: dict[str, object], sentence: str) -> None:
    with pytest.raises(ScenarioError, match="^" + re.escape(sentence)) as refusal:
        motor_from_table(table, "x.toml: motor.")
    assert "\n" not in str(refusal.value)
