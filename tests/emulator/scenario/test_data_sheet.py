"""What a bench is told of the motor that it is started with."""

import math
from dataclasses import replace

import pytest

from bench.config import drive_of
from bench.machine_file import nominal_of
from drivers.wire.dictionary import SET_POINTS
from emulator.scenario.data_sheet import data_sheet
from emulator.scenario.motors import MOTORS
from emulator.scenario.scenarios import BUILT_IN, PAPER, Excitation, Scenario, drive_for, overspeed_of, parse

URL = "canopen://socketcand/127.0.0.1:29536/can0/5"


@pytest.mark.parametrize("name", MOTORS)
def test_each_motor_is_told_as_a_machine_file_has_it_and_bounds_set_points(name: str) -> None:
    scenario = parse(f'[motor]\nname = "{name}"\n[run]\nspeed_rpm = 100', "x.toml")
    sheet = data_sheet(scenario)
    nominal = nominal_of({"machine": sheet["machine"], "drive": sheet["drive"]}, "x.toml")
    motor = scenario.motor
    assert nominal.machine is not None
    assert (nominal.machine.R_s, nominal.machine.psi_f, nominal.n_p) == (motor.R_s, motor.psi_f, motor.n_p)
    drive = drive_of("emulated", URL, nominal, sheet["limits"])
    assert drive.window.held == nominal.given
    assert (drive.limits.i_max, drive.limits.n_p) == (motor.i_rated, motor.n_p)
    drive.limits.check_trip(overspeed_of(scenario), motor.n_p)  # so that control lowers none


def test_a_run_that_asks_for_more_than_the_rated_current_may_have_it() -> None:
    asked = replace(PAPER, excitation=Excitation(i_d_ref=-6.0, i_q_ref=5.0, i_q_step=3.0))
    assert data_sheet(asked)["limits"]["i_max"] == 10.0
    weak = replace(asked, drive=drive_for(PAPER.motor, field_weakening=True))
    assert data_sheet(weak)["limits"]["i_max"] == pytest.approx(math.hypot(12.0, 8.0))


@pytest.mark.parametrize("scenario", BUILT_IN.values(), ids=lambda scenario: scenario.name)
def test_a_built_in_run_is_within_the_limits_that_are_told(scenario: Scenario) -> None:
    sheet = data_sheet(scenario)
    limits = drive_of("emulated", URL, nominal_of({"machine": sheet["machine"]}, "x"), sheet["limits"]).limits
    settings = {"field_weakening": 0.0, "i_d_weakening": 6.0, "n_p": 4.0}
    limits.check_set_points({**settings, **sheet.get("set_points", dict.fromkeys(SET_POINTS, 0.0))}, "set points")


def test_a_drive_that_is_not_enabled_has_no_set_points_to_be_started_with() -> None:
    assert "set_points" not in data_sheet(BUILT_IN["unknown"])


def test_the_encoder_is_told_where_it_has_counts() -> None:
    assert data_sheet(PAPER)["drive"] == {}
    counting = replace(PAPER, drive=replace(PAPER.drive, encoder_counts=4096))
    assert data_sheet(counting)["drive"] == {"encoder_counts": 4096}
