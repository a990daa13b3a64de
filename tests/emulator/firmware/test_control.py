"""Current control, speed control and excitation, seen from the recording of a whole virtual drive."""

import math
from dataclasses import replace

import numpy as np
import pytest

from emulator.drive.virtual_drive import VirtualDrive
from emulator.firmware.excitation import AXIS_AT_REST, LEVELS, LONGEST_HOLD, fraction, stepped
from emulator.plant.inverter import longest
from emulator.scenario.scenarios import PAPER, Excitation, Run, Scenario
from tests.emulator.plant.plants import textbook_flux

MOTOR = PAPER.motor
IDEAL = replace(PAPER.drive, noise_i=0.0, adc_bits=0)


def quiet(run: Run = PAPER.run, **drive: float) -> Scenario:
    """The paper's motor without noise and without excitation."""
    return replace(PAPER, drive=replace(IDEAL, **drive), run=run, excitation=Excitation())


@pytest.mark.parametrize("speed_rpm", [1200.0, -1200.0, 300.0, 0.0])
def test_the_steady_state_is_that_of_the_voltage_equations(speed_rpm: float) -> None:
    drive = VirtualDrive(quiet(Run(speed_rpm=speed_rpm)))
    drive.write("i_d_ref", -1.0)
    drive.write("i_q_ref", 4.0)
    drive.run(3000)
    row = {name: float(column[0]) for name, column in drive.record(1).items()}
    omega_e = MOTOR.n_p * speed_rpm * 2.0 * math.pi / 60.0
    assert row["omega_e"] == pytest.approx(omega_e, rel=1e-9)
    assert row["i_d"] == pytest.approx(-1.0, abs=1e-6)
    assert row["i_q"] == pytest.approx(4.0, abs=1e-6)
    # The voltage stands still during a period while the rotor turns by D: over it the flux moves along the chord
    D = omega_e * 1e-4
    omega_chord = 2.0 * math.sin(D / 2.0) / 1e-4
    u_d = MOTOR.R_s * -1.0 - omega_chord * MOTOR.L_q * 4.0
    u_q = MOTOR.R_s * 4.0 + omega_chord * (MOTOR.L_d * -1.0 + MOTOR.psi_f)
    # and the current between two samples bends away from them by some milliampere
    assert row["u_d"] == pytest.approx(u_d, abs=0.01)
    assert row["u_q"] == pytest.approx(u_q, abs=0.01)


def test_the_flux_balance_holds_over_every_period() -> None:
    drive = VirtualDrive(replace(PAPER, drive=IDEAL))
    drive.run(500)
    r = drive.record(2000)
    i, u = r["i_d"] + 1j * r["i_q"], r["u_d"] + 1j * r["u_q"]
    psi = np.array([textbook_flux(MOTOR, complex(x)) for x in i])
    D = np.diff(np.unwrap(r["theta_e"]))
    i_mean = (i[1:] + i[:-1]) / 2.0
    balance = MOTOR.R_s * i_mean + (np.exp(0.5j * D) * psi[1:] - np.exp(-0.5j * D) * psi[:-1]) / 1e-4
    # What is left is R_s times what the mean current differs from the trapezoid, about |u| omega T_s^2 / (12 L)
    assert np.abs(u[:-1] - balance).max() < 0.03


def test_what_is_computed_in_one_period_is_applied_in_the_next() -> None:
    drive = VirtualDrive(quiet())
    drive.run(3000)
    drive.write("i_d_ref", 1.0)
    u_d = drive.record(3)["u_d"]
    before = u_d[0]
    drive_2 = VirtualDrive(quiet())
    drive_2.run(3000)
    assert drive_2.record(1)["u_d"][0] == before  # the period that computes still has the old voltage
    # and the next has the proportional answer, at the angle the rotor has at its middle
    assert u_d[1] - before == pytest.approx(IDEAL.bandwidth * MOTOR.L_d * 1.0, rel=1e-6)


def test_a_reference_step_is_followed_with_the_stated_bandwidth_and_without_coupling() -> None:
    drive = VirtualDrive(quiet())
    drive.run(3000)
    drive.write("i_q_ref", 2.0)
    r = drive.record(200)
    reached = np.argmax(r["i_q"] > 2.0 * (1.0 - math.exp(-1.0))) * 1e-4
    assert reached == pytest.approx(1.0 / IDEAL.bandwidth + 1.5e-4, abs=1.5e-4)
    assert r["i_q"].max() < 2.2
    assert r["i_q"][100:] == pytest.approx(2.0, abs=0.02)
    assert np.abs(r["i_d"]).max() < 0.15


def test_the_voltage_stays_within_its_limit_and_the_integral_does_not_wind_up() -> None:
    drive = VirtualDrive(quiet(bandwidth=4000.0))
    drive.run(1000)
    drive.write("i_q_ref", 12.0)
    r = drive.record(400)
    u = np.hypot(r["u_d"], r["u_q"])
    assert u.max() == pytest.approx(longest(310.0), rel=1e-9)
    assert r["i_q"].max() < 12.0 * 1.1
    assert r["i_q"][200:] == pytest.approx(12.0, abs=0.05)


def test_excitation_reaches_all_levels_holds_them_and_moves_at_every_step() -> None:
    hold, axis, levels, holds = 20, AXIS_AT_REST, list[float](), list[int]()
    for _ in range(20000):
        before, axis = axis, stepped(axis, hold, 3, 11)
        if axis.drawn != before.drawn:
            levels.append(fraction(axis))
            holds.append(axis.left)
    assert sorted(set(levels)) == pytest.approx(np.linspace(-1.0, 1.0, LEVELS))
    assert set(holds) == {hold * k for k in range(1, LONGEST_HOLD + 1)}
    assert np.all(np.diff(levels) != 0.0)
    assert abs(np.mean(levels)) < 0.15


def test_the_excitation_of_the_axes_is_independent_and_around_the_references() -> None:
    drive = VirtualDrive(PAPER)
    drive.run(1000)
    r = drive.record(20000)
    given = PAPER.excitation
    assert abs(np.corrcoef(r["i_d"], r["i_q"])[0, 1]) < 0.15
    for axis, centre, step in (("i_d", given.i_d_ref, given.i_d_step), ("i_q", given.i_q_ref, given.i_q_step)):
        low, high = np.percentile(r[axis], [2, 98])
        assert low == pytest.approx(centre - step, abs=0.3)
        assert high == pytest.approx(centre + step, abs=0.3)
        assert r[axis].mean() == pytest.approx(centre, abs=0.5)


def test_references_beyond_the_limit_are_shortened() -> None:
    drive = VirtualDrive(quiet())
    drive.write("i_d_ref", -12.0)
    drive.write("i_q_ref", 12.0)
    drive.run(1000)
    r = drive.record(10)
    assert np.hypot(r["i_d"], r["i_q"]) == pytest.approx(12.0, abs=0.02)
    assert r["i_q"] == pytest.approx(-r["i_d"], abs=0.02)


def test_a_free_shaft_under_constant_current_follows_the_closed_form() -> None:
    motor = MOTOR._replace(J=2e-3, B=0.02)
    scenario = replace(quiet(Run(shaft="free", speed_rpm=300.0, tau_L=0.5)), motor=motor)
    drive = VirtualDrive(scenario)
    drive.write("i_q_ref", 2.0)
    drive.run(500)
    start, t = drive.plant.omega_m, 0.1
    drive.run(1000)
    tau_e = 1.5 * motor.n_p * motor.psi_f * 2.0
    final = (tau_e - 0.5) / motor.B
    expected = final + (start - final) * math.exp(-t * motor.B / motor.J)
    assert drive.plant.omega_m == pytest.approx(expected, rel=1e-3)


def test_speed_control_holds_a_loaded_free_shaft_at_its_reference() -> None:
    run = Run(shaft="free", speed_rpm=500.0, rise_rpm=500.0, ramp_time=0.1, speed_control=True, tau_L=2.0)
    drive = VirtualDrive(replace(PAPER, run=run, excitation=Excitation()))
    drive.run(10000)
    r = drive.record(1000)
    rpm = r["omega_e"] / MOTOR.n_p * 60.0 / (2.0 * math.pi)
    assert rpm == pytest.approx(1000.0, abs=2.0)
    tau_e = 2.0 + MOTOR.B * 1000.0 * 2.0 * math.pi / 60.0
    assert r["i_q"].mean() == pytest.approx(tau_e / (1.5 * MOTOR.n_p * MOTOR.psi_f), rel=0.01)


def test_energy_is_balanced_for_a_whole_drive_with_noise_and_excitation() -> None:
    drive = VirtualDrive(PAPER)
    drive.run(20000)
    plant = drive.plant
    stored = plant.W_dc - plant.W_copper - plant.W_shaft
    assert plant.W_dc > 100.0  # J
    assert 0.0 <= stored < 1.0  # what is stored in a few millihenry at a few ampere


def test_a_wrong_number_of_pole_pairs_spoils_the_control_but_not_the_numbers() -> None:
    drive = VirtualDrive(PAPER)
    drive.write("n_p", 5.0)
    rows = drive.run(5000)
    assert all(np.all(np.isfinite(getattr(rows, name))) for name in ("i_d", "i_q", "u_d", "u_q", "theta_e"))
    assert np.hypot(rows.u_d, rows.u_q).max() <= longest(310.0) * 1.0001
