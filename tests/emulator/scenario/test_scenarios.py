"""Scenarios from TOML, and the sentences for those that cannot be."""

import math
import re
from dataclasses import replace
from pathlib import Path

import pytest

from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import BUILT_IN, PAPER, ScenarioError, check, drive_for, load, parse

MOTOR = """
[motor]
R_s = 0.5
L_d = 2e-3
L_q = 3e-3
psi_f = 0.1
n_p = 3
i_rated = 10
"""


def test_the_papers_motor_is_built_in() -> None:
    motor, drive = PAPER.motor, PAPER.drive
    assert (motor.R_s, motor.L_d, motor.L_q, motor.psi_f, motor.n_p) == (0.9664, 4.24e-3, 6.21e-3, 0.12, 4)
    assert (motor.i_rated, drive.u_dc, drive.T_s, drive.noise_i, drive.adc_bits) == (6.0, 310.0, 1e-4, 0.01, 12)
    assert PAPER.run.temperature == 23.4
    assert BUILT_IN["paper"] is PAPER
    check(PAPER)


def test_a_file_gives_a_scenario_and_what_it_leaves_out_suits_the_motor(tmp_path: Path) -> None:
    file = tmp_path / "small.toml"
    file.write_text(MOTOR + "[run]\nspeed_rpm = 600\ntemperature = 40\n[excitation]\ni_q_ref = 5\n")
    scenario = load(file)
    assert scenario.name == "small.toml"
    assert scenario.motor.i_rated == 10.0
    assert isinstance(scenario.motor.i_rated, float)
    assert (scenario.drive.i_max, scenario.drive.adc_full, scenario.drive.i_full) == (20.0, 30.0, 40.0)
    assert scenario.drive == drive_for(scenario.motor)
    assert scenario.excitation.i_q_ref == 5.0
    assert scenario.profile.omega_1 == pytest.approx(20.0 * math.pi)
    assert VirtualDrive(scenario).truth.temp_winding == 40.0


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (MOTOR.replace("0.5", "-0.5"), "x.toml: motor.R_s takes above 0 ohm, got -0.5"),
        (MOTOR.replace("0.5", "nan"), "x.toml: motor.R_s takes above 0 ohm, got nan"),
        (MOTOR.replace("0.5", '"low"'), "x.toml: motor.R_s takes a number, got 'low'"),
        (MOTOR.replace("n_p = 3", "n_p = 3.5"), "x.toml: motor.n_p takes a whole number, got 3.5"),
        (MOTOR.replace("n_p = 3", "n_p = true"), "x.toml: motor.n_p takes a number, got True"),
        (MOTOR.replace("n_p = 3", "n_p = 0"), "x.toml: motor.n_p takes at least 1 and at most 100, got 0"),
        (MOTOR.replace("psi_f = 0.1\n", ""), "x.toml: motor.psi_f is missing; it has no default"),
        (MOTOR + "colour = 1", "x.toml: motor.colour is no key here; the keys are R_s, L_d, L_q, psi_f, n_p, "),
        (MOTOR + "[gear]\n", "x.toml: 'gear' is no section; the sections are motor, drive, run, excitation"),
        ("motor = 3", "x.toml: motor takes a section, got 3"),
        ("[drive]\n", "x.toml: the section motor is missing; it has no default"),
        ("[motor\n", "x.toml: is not TOML: "),
        (MOTOR + "[drive]\nu_dc = 0", "x.toml: drive.u_dc takes above 0 V, got 0"),
        (MOTOR + "[drive]\nu_dc = 20", "x.toml: drive.u_dc takes at least 65.3 V for 1200 rpm and these currents, "),
        (MOTOR + "[drive]\nT_s = 1.0", "x.toml: drive.T_s takes at least 1e-06 s and at most 0.01 s, got 1.0"),
        (MOTOR + "[drive]\nbandwidth = 8e3", "x.toml: drive.bandwidth takes at most 5000 rad/s at T_s = 0.0001 s, "),
        (MOTOR + "[run]\nspeed_rpm = inf", "x.toml: run.speed_rpm takes a finite number rpm, got inf"),
        (MOTOR + "[run]\nspeed_rpm = 40000", "x.toml: run.speed_rpm takes at most 31831 rpm at T_s = 0.0001 s, "),
        (MOTOR + "[run]\ntemperature = 90", "x.toml: run.temperature takes at least 23.4 degC and at most 80 degC, "),
        (MOTOR + '[run]\nshaft = "loose"', "x.toml: run.shaft takes dynamometer or free, got 'loose'"),
        (MOTOR + "[run]\nshaft = 1", "x.toml: run.shaft takes a text, got 1"),
        (MOTOR + "[run]\nspeed_control = 1", "x.toml: run.speed_control takes true or false, got 1"),
        (MOTOR + "[effects.hall]\nrate = 2\n[effects.angle_signal]\ngain = 0.1",
         "x.toml: expected one way of the angle, effects.hall or effects.angle_signal, got both"),
        (MOTOR + "[run]\nspeed_control = true", "x.toml: run.speed_control takes a free shaft, got shaft 'dyn"),
        (MOTOR + "[run]\nseed = -1", "x.toml: run.seed takes at least 0 and at most "),
        (MOTOR + "[excitation]\ni_q_ref = 15\ni_q_step = 6", "x.toml: excitation takes references up to drive.i_max "),
        (MOTOR + "[excitation]\nstep_time = 0", "x.toml: excitation.step_time takes at least 0.001 s and at most 10"),
        (MOTOR.replace("2e-3", "2e-8"), "x.toml: drive.sub_steps takes steps of at most half the motor's time "),
    ],
)
def test_a_scenario_that_cannot_be_is_refused_with_a_sentence(text: str, sentence: str) -> None:
    with pytest.raises(ScenarioError, match="^" + re.escape(sentence)) as refusal:
        parse(text, "x.toml")
    assert "\n" not in str(refusal.value)


def test_a_file_that_is_not_there_or_not_text_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"missing\.toml: no such file"):
        load(tmp_path / "missing.toml")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ScenarioError, match=r"binary\.toml: cannot be read as text"):
        load(binary)
    with pytest.raises(ScenarioError, match="cannot be read as text"):
        load(tmp_path)


def test_a_drive_refuses_a_scenario_that_was_put_together_wrongly() -> None:
    with pytest.raises(ScenarioError, match=r"paper: motor\.R_s takes above 0 ohm, got -1"):
        VirtualDrive(replace(PAPER, motor=PAPER.motor._replace(R_s=-1.0)))
