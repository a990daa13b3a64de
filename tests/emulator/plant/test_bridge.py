"""Space-vector modulation and the switched bridge: volt-seconds, edges, ripple, energy, order, whole drives."""

import math
import re
from dataclasses import fields, replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulator.drive.virtual_drive import StreamRows, VirtualDrive
from emulator.frames import clarke, turned
from emulator.plant.bridge import moments, scratch, switched, switches
from emulator.plant.dynamics import Plant, PlantState, advanced, bridge_current, settled
from emulator.plant.inverter import longest
from emulator.plant.machine import TABLE_TEMPERATURES
from emulator.plant.mechanics import Profile, Shaft
from emulator.plant.modulation import Duties, modulated, voltage_of
from emulator.plant.physics.legs import vector
from emulator.scenario.scenarios import (
    BUILT_IN,
    PAPER,
    PAPER_RUN,
    PAPER_RUN_WARMING,
    Scenario,
    ScenarioError,
    check,
    drive_for,
)
from tests.emulator.plant.plants import (
    BEFORE,
    IDEAL,
    LOCKED,
    at_rest,
    plant_with,
    rotor_current,
    textbook_energy,
    textbook_flux,
)

MOTOR, U_DC, T = PAPER.motor, 310.0, 1e-4


def in_reach(share: float, angle: float) -> complex:
    return share * longest(U_DC) * turned(angle)


LINEAR = st.builds(in_reach, st.floats(0.0, 1.0), st.floats(-4.0, 4.0))
compiling = settings(deadline=None)  # the first example waits for the compiler


def edges_of(duties: Duties) -> list[float]:
    """Moments of a period that may change a voltage, as fractions of it."""
    room = scratch()
    count = moments(duties, 0.0, 1.0, BEFORE, room)
    return [float(x) for x in room.moments[:count]]


def stretches_of(duties: Duties) -> list[tuple[float, float, tuple[int, ...]]]:
    """Beginning and end of every stretch of constant voltage, as fractions of a period, and which legs are high."""
    room = scratch()
    moments(duties, 0.0, 1.0, BEFORE, room)
    return [
        (begin, end, tuple(switches(k, 0.5 * (begin + end), 0.0, 1.0, room) for k in range(3)))
        for begin, end in pairwise(edges_of(duties))
        if end > begin
    ]


def over_a_period(
    plant: Plant, duties: Duties, k: int, sub_steps: int, state: PlantState, T_period: float = T
) -> PlantState:
    """The state after period k of the bridge."""
    after = switched(IDEAL, plant, duties, True, k * T, T_period, sub_steps, BEFORE, state, scratch())[1]
    return settled(plant, k * T + T_period, after)


def with_bridge(bridge: str, scenario: Scenario = PAPER, *, noise: bool = False, **drive: int) -> Scenario:
    """The scenario behind another bridge, with ideal sensors unless told otherwise."""
    given = replace(scenario.drive, bridge=bridge, **drive)
    return replace(scenario, drive=given if noise else replace(given, noise_i=0.0, adc_bits=0))


@compiling
@given(LINEAR)
def test_the_duties_of_an_ideal_timer_hold_the_commanded_voltage(u: complex) -> None:
    duties = modulated(u, U_DC, 0)
    assert voltage_of(duties, U_DC) == pytest.approx(u, abs=1e-10)
    assert all(0.0 <= duty <= 1.0 for duty in duties)
    assert max(duties) + min(duties) == pytest.approx(1.0)  # 000 is as long as 111


@compiling
@given(LINEAR, st.sampled_from([50, 1000, 5000]))
def test_a_timer_sets_whole_counts_and_is_off_by_at_most_half_of_one(u: complex, counts: int) -> None:
    ideal, duties = modulated(u, U_DC, 0), modulated(u, U_DC, counts)
    for wanted, duty in zip(ideal, duties, strict=True):
        assert duty * counts == pytest.approx(round(duty * counts), abs=1e-9)
        assert abs(duty - wanted) <= 0.5 / counts + 1e-12
    assert abs(voltage_of(duties, U_DC) - u) <= U_DC * 2.0 / 3.0 / counts + 1e-9  # 1/2 (1 + 1/2 + 1/2) 2/3 counts


def test_the_longest_vector_of_linear_modulation_is_reached_at_every_angle_and_fills_the_period_at_30_degrees() -> None:
    most = longest(U_DC)
    for angle in np.linspace(0.0, 2.0 * math.pi, 61):
        assert abs(voltage_of(modulated(most * turned(angle), U_DC, 0), U_DC)) == pytest.approx(most)
    duties = modulated(most * turned(math.pi / 6.0), U_DC, 0)
    assert (max(duties), min(duties)) == pytest.approx((1.0, 0.0), abs=1e-12)


@compiling
@given(LINEAR, st.sampled_from([0, 5000]))
def test_the_edges_are_in_order_symmetric_and_hold_the_duties_volt_seconds(u: complex, counts: int) -> None:
    duties = modulated(u, U_DC, counts)
    edge = edges_of(duties)
    assert all(end >= begin for begin, end in pairwise(edge))
    assert [1.0 - x for x in reversed(edge)] == pytest.approx(list(edge), abs=1e-15)
    held = sum(((end - begin) * U_DC * clarke(*high) for begin, end, high in stretches_of(duties)), 0j)
    assert held == pytest.approx(voltage_of(duties, U_DC), abs=1e-10)


def test_a_period_has_seven_stretches_and_each_edge_moves_one_leg() -> None:
    duties = Duties(0.7, 0.5, 0.2)
    high = [high for _, _, high in stretches_of(duties)]
    assert high == [(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1), (1, 1, 0), (1, 0, 0), (0, 0, 0)]


@pytest.mark.parametrize("counts", [0, 5000])
def test_the_flux_of_a_winding_without_resistance_moves_by_exactly_the_recorded_volt_seconds(counts: int) -> None:
    plant, volt_seconds = plant_with(MOTOR._replace(R_s=1e-15), LOCKED), 0j
    state = at_rest(plant)
    for k in range(50):
        duties = modulated(150.0 * turned(0.3 * k), U_DC, counts)
        state = over_a_period(plant, duties, k, 3, state)
        volt_seconds += voltage_of(duties, U_DC) * T
    assert state.psi - MOTOR.psi_f == pytest.approx(volt_seconds, abs=1e-15)


def test_a_locked_rotor_follows_the_exponentials_of_every_stretch() -> None:
    duties = modulated(80.0 + 60.0j, U_DC, 5000)
    i_d = i_q = 0.0
    for begin, end, high in stretches_of(duties):
        u = U_DC * clarke(*high)
        a, b = (math.exp(-(end - begin) * T * MOTOR.R_s / L) for L in (MOTOR.L_d, MOTOR.L_q))
        i_d, i_q = a * i_d + (1.0 - a) * u.real / MOTOR.R_s, b * i_q + (1.0 - b) * u.imag / MOTOR.R_s
    plant = plant_with(MOTOR, LOCKED)
    state = over_a_period(plant, duties, 0, 10, at_rest(plant))
    assert bridge_current(plant, state) == pytest.approx(complex(i_d, i_q), abs=1e-9)


def test_halving_the_sub_step_divides_the_error_by_sixteen() -> None:
    plant = plant_with(MOTOR, LOCKED._replace(held=False, J=1e-4, B=1e-3, tau_L=0.1))
    start = at_rest(plant, 0.2, 300.0)
    duties = Duties(0.75, 0.5, 0.25)  # every edge on a whole eighth, so that the steps really halve

    def end(sub_steps: int) -> complex:
        return over_a_period(plant, duties, 0, sub_steps, start, 2e-3).psi

    exact = end(4096)
    errors = [abs(end(n) - exact) for n in (16, 32, 64)]
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.15)
    assert errors[1] / errors[2] == pytest.approx(16.0, rel=0.08)


def test_ten_sub_steps_a_period_leave_an_error_far_below_any_noise() -> None:
    plant = plant_with(MOTOR, LOCKED._replace(profile=Profile(125.0, 125.0, 0.0, 0.0, 0.0)))
    start, duties = at_rest(plant, 0.0, 125.0), modulated(20.0 + 60.0j, U_DC, 0)
    coarse, fine = (over_a_period(plant, duties, 0, n, start) for n in (10, 1000))
    assert abs(bridge_current(plant, coarse) - bridge_current(plant, fine)) < 1e-9  # A


@pytest.mark.parametrize("held", [True, False])
def test_power_in_is_copper_loss_plus_stored_plus_mechanical(held: bool) -> None:
    shaft = Shaft(held, Profile(80.0, 200.0, 0.05, 20.0, 9.0), 2e-4, 1e-3, 0.3)
    plant = plant_with(MOTOR, shaft)
    state = at_rest(plant, 0.0, 80.0)
    for k in range(400):
        duties = modulated(45.0 * turned(4 * 100.0 * (k + 1) * T + 1.5), U_DC, 5000)
        state = over_a_period(plant, duties, k, 10, state)
    i = rotor_current(plant, state)
    assert abs(i) > 0.5
    assert state.W_dc == pytest.approx(
        state.W_copper + textbook_energy(MOTOR, i) + state.W_shaft, abs=1e-6 * (abs(state.W_dc) + state.W_copper)
    )


def test_the_current_ripples_within_a_period_and_is_sampled_where_the_ripple_is_zero() -> None:
    # A voltage across the inductances only: the rotor stands, and the mean current rises in a straight line
    plant = plant_with(MOTOR._replace(R_s=1e-15), LOCKED)
    duties = modulated(90.0 + 40.0j, U_DC, 0)
    u, ripple = voltage_of(duties, U_DC), list[float]()
    for part in np.linspace(0.0, 1.0, 41):
        state = at_rest(plant)
        for begin, end, high in stretches_of(duties):
            h = (min(end, part) - begin) * T
            if h > 0.0:
                state = advanced(plant, vector(U_DC * clarke(*high), U_DC), 0.0, h, 1, state)
        ripple.append(bridge_current(plant, state).real - u.real * part * T / MOTOR.L_d)
    assert max(ripple) > 0.1  # A
    assert ripple[0] == pytest.approx(0.0, abs=1e-12)
    assert ripple[-1] == pytest.approx(0.0, abs=1e-12)
    assert ripple == pytest.approx([-x for x in reversed(ripple)], abs=1e-9)  # and so is its mean over the period


def test_the_samples_of_a_drive_hardly_tell_whether_its_bridge_switches() -> None:
    averaged = VirtualDrive(with_bridge("averaged")).record(3000)
    ideal = VirtualDrive(with_bridge("switched", timer_counts=0)).record(3000)
    timed = VirtualDrive(with_bridge("switched", timer_counts=5000)).record(3000)
    for name in ("i_d", "i_q"):
        assert ideal[name] == pytest.approx(averaged[name], abs=1e-3)
        assert timed[name] == pytest.approx(averaged[name], abs=10e-3)
    assert not np.array_equal(ideal["i_d"], averaged["i_d"])


def test_the_recorded_voltage_is_what_the_timer_holds_and_the_flux_balance_is_its() -> None:
    drive = VirtualDrive(with_bridge("switched", timer_counts=200))
    drive.run(500)
    r = drive.record(2000)
    i, u = r["i_d"] + 1j * r["i_q"], r["u_d"] + 1j * r["u_q"]
    theta, D = np.unwrap(r["theta_e"])[:-1], np.diff(np.unwrap(r["theta_e"]))
    u_ab = u[:-1] * np.exp(1j * (theta + D / 2.0))
    counts = u_ab.imag * math.sqrt(3.0) / U_DC * 200  # d_b - d_c
    assert counts == pytest.approx(np.round(counts), abs=1e-6)
    psi = np.array([textbook_flux(MOTOR, complex(x)) for x in i])
    moved = (np.exp(0.5j * D) * psi[1:] - np.exp(-0.5j * D) * psi[:-1]) / T
    rest = u[:-1] - MOTOR.R_s * (i[1:] + i[:-1]) / 2.0 - moved
    assert np.abs(rest).max() < 0.05  # V; one count of this timer is 1 V


def test_a_switched_run_gives_the_same_bits_however_it_is_cut() -> None:
    def rows_of(cuts: tuple[int, ...]) -> dict[str, np.ndarray]:
        drive = VirtualDrive(PAPER_RUN_WARMING)
        parts = [drive.run(n) for n in cuts]
        return {f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(StreamRows)}

    whole, pieces = rows_of((2000,)), rows_of((1, 0, 7, 13, 100, 3, 999, 2, 875))
    for name, column in whole.items():
        assert np.array_equal(column, pieces[name]), name


def test_energy_is_balanced_for_a_whole_switched_drive() -> None:
    drive = VirtualDrive(with_bridge("switched", noise=True))
    drive.run(20000)
    state = drive.plant
    i = rotor_current(drive.plant_now(), state)
    stored = state.W_dc - state.W_copper - state.W_shaft
    assert state.W_dc > 100.0  # J
    assert stored == pytest.approx(textbook_energy(MOTOR, i), abs=1e-6 * state.W_dc)


def test_the_averaged_bridge_is_the_default_and_any_other_word_is_refused() -> None:
    assert PAPER.drive.bridge == "averaged"
    assert drive_for(MOTOR, bridge="switched").timer_counts == 5000
    for drive, sentence in (
        (replace(PAPER.drive, bridge="fast"), "paper: drive.bridge takes averaged or switched, got 'fast'"),
        (replace(PAPER.drive, recorded_speed="slow"),
         "paper: drive.recorded_speed takes angle or filtered, got 'slow'"),
        (replace(PAPER.drive, timer_counts=49), "paper: drive.timer_counts takes 0 or at least 50, got 49"),
        (replace(PAPER.drive, timer_counts=-1), "paper: drive.timer_counts takes at least 0 and at most "),
    ):
        with pytest.raises(ScenarioError, match="^" + re.escape(sentence)):
            check(replace(PAPER, drive=drive))


@pytest.mark.parametrize("scenario", [PAPER_RUN, PAPER_RUN_WARMING])
def test_the_papers_run_stays_within_its_limits_and_reaches_its_speed(scenario: Scenario) -> None:
    assert BUILT_IN[scenario.name] is scenario
    check(scenario)
    drive = VirtualDrive(scenario)
    r = drive.record(10_000)
    rpm = r["omega_e"] / MOTOR.n_p * 60.0 / (2.0 * math.pi)
    assert rpm[5000:].mean() == pytest.approx(1200.0, abs=30.0)
    assert np.hypot(r["u_d"], r["u_q"]).max() < 0.8 * longest(U_DC)  # no voltage limit in sight
    assert np.hypot(r["i_d"], r["i_q"]).max() < scenario.drive.i_max
    assert r["i_d"].std() > 1.0
    assert r["i_q"].std() > 1.0


def test_the_warming_run_passes_the_papers_temperatures_evenly() -> None:
    drive = VirtualDrive(PAPER_RUN_WARMING)
    told = drive.truth_at(np.linspace(0.0, 1.0, 7))
    assert told["temp_winding"] == pytest.approx(TABLE_TEMPERATURES)
    assert told["R_s"] == pytest.approx([0.9664, 1.0008, 1.0373, 1.0770, 1.1245, 1.1592, 1.1751])
    assert told["L_d"] * 1e3 == pytest.approx([4.24, 4.26, 4.28, 4.30, 4.31, 4.34, 4.36])
    assert told["L_q"] * 1e3 == pytest.approx([6.21, 6.26, 6.30, 6.34, 6.40, 6.44, 6.48])
