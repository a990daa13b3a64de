"""A winding that warms up within a run: the course of its parameters, and what the currents make of it."""

import re
from dataclasses import astuple, fields, replace

import numpy as np
import pytest

from emulator.drive.virtual_drive import StreamRows, Truth, VirtualDrive
from emulator.plant.course import continued, course_of, machine_at, row_at, rows_at
from emulator.plant.machine import TABLE_TEMPERATURES, at_temperature
from emulator.scenario.scenarios import PAPER, Excitation, Run, Scenario, ScenarioError, check, parse

MOTOR = PAPER.motor
IDEAL = replace(PAPER.drive, noise_i=0.0, adc_bits=0)
RISE = ((0.0, 23.4), (0.2, 80.0))


def warming(*points: tuple[float, float], scenario: Scenario = PAPER) -> Scenario:
    """The scenario with a winding that goes through points of s and degC."""
    return replace(scenario, run=replace(scenario.run, temperature_profile=points))


def test_the_course_is_the_table_at_every_temperature_it_passes() -> None:
    course = course_of(MOTOR, [(0.1, 30.0), (0.4, 75.0), (0.6, 25.0)])
    for t in (0.1 + 0.005 * k for k in range(100)):
        warm = at_temperature(MOTOR, float(np.interp(t, [0.1, 0.4, 0.6], [30.0, 75.0, 25.0])))
        assert machine_at(MOTOR, course, t) == pytest.approx(warm, rel=1e-12)


def test_through_the_tables_temperatures_the_parameters_move_in_straight_lines() -> None:
    times = np.linspace(0.0, 1.0, 7)
    course = course_of(MOTOR, list(zip(times.tolist(), TABLE_TEMPERATURES, strict=True)))
    assert len(course.t) == 7
    t = np.linspace(0.0, 1.0, 1001)
    rows = rows_at(course, t)
    for column, name in ((1, "R_s"), (2, "L_d"), (3, "L_q")):
        known = [getattr(at_temperature(MOTOR, temperature), name) for temperature in TABLE_TEMPERATURES]
        assert rows[:, column] == pytest.approx(np.interp(t, times, known), rel=1e-12)


def test_before_its_first_point_and_after_its_last_the_course_stands_still() -> None:
    course = course_of(MOTOR, [(0.5, 40.0), (0.7, 60.0)])
    assert row_at(course, 0.0)[0] == row_at(course, 0.5)[0] == 40.0
    assert row_at(course, 0.7)[0] == row_at(course, 9.0)[0] == 60.0


def test_a_course_that_is_continued_keeps_its_past() -> None:
    course = course_of(MOTOR, RISE)
    t = np.linspace(0.0, 0.3, 31)
    changed = continued(continued(course, 0.1, MOTOR, 70.0), 0.1, MOTOR, 30.0)
    assert rows_at(changed, t[t < 0.1]) == pytest.approx(rows_at(course, t[t < 0.1]), rel=1e-12)
    assert np.all(rows_at(changed, t[t >= 0.1])[:, 0] == 30.0)
    assert row_at(continued(course_of(MOTOR, [(0.0, 50.0)]), 0.0, MOTOR, 40.0), 0.0)[0] == 40.0


def test_the_drive_tells_its_truth_now_and_at_any_time() -> None:
    drive = VirtualDrive(warming(*RISE))
    seen = [drive.truth]
    for _ in range(5):
        drive.run(500)
        seen.append(drive.truth)
        assert drive.read("temp_winding") == drive.read("temp_magnet") == drive.truth.temp_winding
    told = drive.truth_at(np.arange(6) * 500 * 1e-4)
    assert list(told) == [field.name for field in fields(Truth)]
    for name, column in told.items():
        assert column.tolist() == [getattr(truth, name) for truth in seen]
    assert (seen[0].R_s, seen[0].temp_winding, seen[2].temp_winding) == (MOTOR.R_s, 23.4, pytest.approx(51.7))
    assert astuple(seen[5]) == pytest.approx((1.1751, 4.36e-3, 6.48e-3, 0.12, 80.0, 80.0), rel=1e-12)


def test_a_temperature_that_is_set_ends_the_profile_and_the_past_stays_told() -> None:
    drive = VirtualDrive(warming(*RISE))
    drive.run(1000)
    drive.set_temperature(35.0)
    assert drive.truth.temp_winding == pytest.approx(51.7)  # until the next run
    drive.run(1000)
    assert drive.truth.temp_winding == drive.read("temp_winding") == 35.0
    assert drive.truth_at(np.array([0.0, 0.05, 0.1, 0.3]))["temp_winding"] == pytest.approx([23.4, 37.55, 35.0, 35.0])


def test_a_run_with_a_profile_gives_the_same_bits_however_it_is_cut() -> None:
    def rows_of(cuts: tuple[int, ...]) -> dict[str, np.ndarray]:
        drive = VirtualDrive(warming(*RISE))
        parts = [drive.run(n) for n in cuts]
        return {f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(StreamRows)}

    whole, pieces = rows_of((2500,)), rows_of((1, 0, 9, 770, 1111, 9, 600))
    for name, column in whole.items():
        assert np.array_equal(column, pieces[name]), name


def test_a_profile_at_one_temperature_gives_the_bits_of_that_temperature() -> None:
    steady = VirtualDrive(replace(PAPER, run=replace(PAPER.run, temperature=50.0))).record(500)
    level = VirtualDrive(warming((0.0, 50.0), (0.02, 50.0))).record(500)
    assert all(np.array_equal(steady[name], level[name]) for name in steady)


def test_the_flux_balance_holds_with_the_parameters_of_each_moment() -> None:
    drive = VirtualDrive(warming((0.0, 23.4), (0.05, 80.0), scenario=replace(PAPER, drive=IDEAL)))
    r = drive.record(500)
    truth = drive.truth_at(r["t"])
    i, u = r["i_d"] + 1j * r["i_q"], r["u_d"] + 1j * r["u_q"]
    psi = truth["L_d"] * i.real + truth["psi_f"] + 1j * truth["L_q"] * i.imag
    D = np.diff(np.unwrap(r["theta_e"]))
    moved = (np.exp(0.5j * D) * psi[1:] - np.exp(-0.5j * D) * psi[:-1]) / 1e-4
    rest = u[:-1] - truth["R_s"][:-1] * (i[1:] + i[:-1]) / 2.0 - moved
    assert np.abs(rest).max() < 0.03  # as with constant parameters: what the mean current differs from the trapezoid
    late = r["t"][:-1] > 0.04
    held = u[:-1] - MOTOR.R_s * (i[1:] + i[:-1]) / 2.0 - moved  # a cold winding would not explain it
    assert np.abs(held[late]).max() > 0.5


def test_an_inductance_that_rises_takes_the_current_down_at_constant_flux() -> None:
    # No resistance to speak of, no speed, no voltage: nothing holds the flux but the machine itself
    motor = MOTOR._replace(R_s=1e-9)
    scenario = replace(PAPER, motor=motor, drive=IDEAL, run=Run(speed_rpm=0.0), excitation=Excitation())
    drive = VirtualDrive(warming((0.1, 23.4), (0.101, 80.0), scenario=scenario))
    drive.write("i_d_ref", 4.0)
    drive.write("i_q_ref", 2.0)
    drive.run(1000)
    drive.write("bandwidth", 10.0)
    r = drive.record(11)
    assert (r["i_d"][0], r["i_q"][0]) == pytest.approx((4.0, 2.0), abs=1e-6)
    assert r["i_d"][-1] == pytest.approx(4.0 * 4.24 / 4.36, rel=2e-3)
    assert r["i_q"][-1] == pytest.approx(2.0 * 6.21 / 6.48, rel=2e-3)


def test_what_a_moving_inductance_takes_is_missing_from_the_energy() -> None:
    steady = replace(PAPER, drive=IDEAL, excitation=Excitation(i_d_ref=-6.0, i_q_ref=8.0))
    scenario = warming((0.0, 80.0), (0.5, 80.0), (0.51, 23.4), scenario=steady)
    drive = VirtualDrive(scenario)
    drive.run(4900)
    before = drive.plant
    r = drive.record(301)
    truth, after = drive.truth_at(r["t"]), drive.plant

    def stored(k: int) -> float:
        return 0.75 * (truth["L_d"][k] * r["i_d"][k] ** 2 + truth["L_q"][k] * r["i_q"][k] ** 2)

    # At constant flux the energy of a coil goes as 1/L: dW = -i^2/2 dL, and three half of it in peak values
    i_d, i_q = (r["i_d"][1:] + r["i_d"][:-1]) / 2.0, (r["i_q"][1:] + r["i_q"][:-1]) / 2.0
    gained = -0.75 * float(np.sum(i_d**2 * np.diff(truth["L_d"]) + i_q**2 * np.diff(truth["L_q"])))
    given = (after.W_dc - before.W_dc) - (after.W_copper - before.W_copper) - (after.W_shaft - before.W_shaft)
    assert gained > 0.01  # J
    assert stored(-1) - stored(0) - given == pytest.approx(gained, rel=0.01)


def test_a_file_can_have_a_profile() -> None:
    text = "[motor]\nR_s = 0.5\nL_d = 2e-3\nL_q = 3e-3\npsi_f = 0.1\nn_p = 3\ni_rated = 10\n[run]\nspeed_rpm = 100\n"
    scenario = parse(text + "temperature_profile = [[0, 30], [0.5, 60.5]]", "x.toml")
    assert scenario.run.temperature_profile == ((0.0, 30.0), (0.5, 60.5))
    assert VirtualDrive(scenario).truth.temp_winding == 30.0
    for given, sentence in (
        ("3", "x.toml: run.temperature_profile takes a list of points [s, degC], got 3"),
        ("[3]", "x.toml: run.temperature_profile[0] takes a point [s, degC], got 3"),
        ("[[0, 30, 1]]", "x.toml: run.temperature_profile[0] takes a point [s, degC], got [0, 30, 1]"),
        ("[[0, 30], [-1, 40]]", "x.toml: run.temperature_profile[1][0] takes at least 0 s, got -1"),
        ("[[0, 30], [0, 40]]", "x.toml: run.temperature_profile[1][0] takes above 0, the one before, got 0"),
        ("[[0, 90]]", "x.toml: run.temperature_profile[0][1] takes at least 23.4 degC and at most 80 degC, got 90"),
        ('[[0, "hot"]]', "x.toml: run.temperature_profile[0][1] takes a number, got 'hot'"),
        ("[[0, 30]]\ntemperature = 40", "x.toml: run.temperature takes no value beside run.temperature_profile, got"),
    ):
        with pytest.raises(ScenarioError, match="^" + re.escape(sentence)):
            parse(text + f"temperature_profile = {given}", "x.toml")


def test_a_voltage_that_suffices_cold_but_not_at_the_hottest_point_is_refused() -> None:
    loaded = replace(PAPER, run=Run(speed_rpm=0.0), excitation=Excitation(i_q_ref=10.0))
    cold = replace(loaded, drive=replace(loaded.drive, u_dc=17.5))
    check(cold)
    with pytest.raises(ScenarioError, match=r"paper: drive\.u_dc takes at least 20\.35 V for 0 rpm"):
        check(warming((0.0, 23.4), (0.1, 80.0), (0.2, 30.0), scenario=cold))
