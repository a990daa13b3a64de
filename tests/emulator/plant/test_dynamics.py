"""The plant against closed forms: time constants, power balance, order of the method, mechanics."""

import math

import numpy as np
import pytest

from emulator.frames import turned
from emulator.plant.dynamics import AT_REST, Plant, PlantState, advanced, settled
from emulator.plant.inverter import limited, longest
from emulator.plant.mechanics import Profile, Shaft, profile_speed
from emulator.plant.physics.legs import vector
from emulator.scenario.scenarios import PAPER
from tests.emulator.plant.plants import LOCKED, STILL, U_DC, at_rest, plant_with, rotor_current, textbook_energy

MOTOR = PAPER.motor


def free(J: float, B: float, tau_L: float) -> Shaft:
    return Shaft(False, STILL, J, B, tau_L)


def fed(plant: Plant, u: complex, t: float, T: float, sub_steps: int, state: PlantState) -> PlantState:
    return settled(plant, t + T, advanced(plant, vector(u, U_DC), t, T, sub_steps, state))


@pytest.mark.parametrize("theta_m", [0.0, 0.3, 4.0])
def test_a_locked_rotor_shows_the_two_electrical_time_constants(theta_m: float) -> None:
    u_dq = 3.0 + 2.0j
    t = 3e-3
    plant = plant_with(MOTOR, LOCKED)
    state = fed(plant, u_dq * turned(MOTOR.n_p * theta_m), 0.0, t, 300, at_rest(plant, theta_m))
    i = rotor_current(plant, state)
    assert i.real == pytest.approx(3.0 / MOTOR.R_s * (1.0 - math.exp(-t * MOTOR.R_s / MOTOR.L_d)), rel=1e-9)
    assert i.imag == pytest.approx(2.0 / MOTOR.R_s * (1.0 - math.exp(-t * MOTOR.R_s / MOTOR.L_q)), rel=1e-9)


def test_halving_the_sub_step_divides_the_error_by_sixteen() -> None:
    plant = plant_with(MOTOR, free(1e-4, 1e-3, 0.1))
    start = at_rest(plant, 0.2, 300.0)

    def end(sub_steps: int) -> complex:
        return fed(plant, 60.0 + 90.0j, 0.0, 2e-3, sub_steps, start).psi

    exact = end(4096)
    errors = [abs(end(n) - exact) for n in (20, 40, 80)]
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.15)
    assert errors[1] / errors[2] == pytest.approx(16.0, rel=0.08)


def test_ten_sub_steps_a_period_leave_an_error_far_below_any_noise() -> None:
    plant = plant_with(MOTOR, LOCKED._replace(profile=Profile(125.0, 125.0, 0.0, 0.0, 0.0)))
    start = at_rest(plant, 0.0, 125.0)
    coarse = fed(plant, 20.0 + 60.0j, 0.0, 1e-4, 10, start)
    fine = fed(plant, 20.0 + 60.0j, 0.0, 1e-4, 1000, start)
    assert abs(rotor_current(plant, coarse) - rotor_current(plant, fine)) < 1e-9  # A


DYNAMOMETER = LOCKED._replace(profile=Profile(80.0, 200.0, 0.05, 20.0, 9.0))


@pytest.mark.parametrize("shaft", [free(2e-4, 1e-3, 0.3), DYNAMOMETER])
def test_power_in_is_copper_loss_plus_stored_plus_mechanical(shaft: Shaft) -> None:
    plant = plant_with(MOTOR, shaft)
    state = at_rest(plant, 0.0, 80.0)
    T, periods = 1e-4, 400
    theta = 0.0
    for k in range(periods):
        theta += 4 * 100.0 * T
        state = fed(plant, 45.0 * turned(theta + 1.5), k * T, T, 10, state)
    i = rotor_current(plant, state)
    assert abs(i) > 0.5
    assert state.W_dc == pytest.approx(
        state.W_copper + textbook_energy(MOTOR, i) + state.W_shaft, abs=1e-6 * (abs(state.W_dc) + state.W_copper)
    )


def test_energy_given_to_a_free_shaft_is_its_kinetic_energy() -> None:
    J = 2e-4
    plant = plant_with(MOTOR, free(J, 0.0, 0.0))
    state = fed(plant, 5.0 + 25.0j, 0.0, 5e-3, 500, at_rest(plant))
    assert abs(state.omega_m) > 1.0
    assert state.W_shaft == pytest.approx(0.5 * J * state.omega_m**2, rel=1e-6)


def test_a_free_shaft_coasts_down_with_its_mechanical_time_constant() -> None:
    # A machine whose magnets are too weak to brake it
    weak = MOTOR._replace(psi_f=1e-9)
    J, B = 1e-3, 0.05
    state = fed(plant_with(weak, free(J, B, 0.0)), 0j, 0.0, 0.02, 200, AT_REST._replace(omega_m=100.0))
    assert state.omega_m == pytest.approx(100.0 * math.exp(-0.02 * B / J), rel=1e-6)


def test_a_load_torque_alone_turns_the_shaft_backwards() -> None:
    weak = MOTOR._replace(psi_f=1e-9)
    state = fed(plant_with(weak, free(1e-3, 0.0, 0.5)), 0j, 0.0, 0.01, 10, AT_REST)
    assert state.omega_m == pytest.approx(-0.5 / 1e-3 * 0.01, rel=1e-6)
    assert 0.0 <= state.theta_m <= 2.0 * math.pi


def test_a_dynamometer_follows_its_profile_and_the_angle_is_its_integral() -> None:
    profile = Profile(50.0, 150.0, 0.1, 10.0, 7.0)
    shaft = Shaft(True, profile, 1.0, 0.0, 99.0)  # whatever the load
    plant = plant_with(MOTOR, shaft)
    state = fed(plant, 0j, 0.0, 0.05, 500, at_rest(plant, 0.0, 50.0))
    swing = 10.0 / (2.0 * math.pi * 7.0) * (1.0 - math.cos(2.0 * math.pi * 7.0 * 0.05))
    angle = 50.0 * 0.05 + 0.5 * 1000.0 * 0.05**2 + swing
    assert state.omega_m == pytest.approx(profile_speed(profile, 0.05), rel=1e-12)
    assert state.theta_m == pytest.approx(angle, rel=1e-9)
    assert profile_speed(profile, 0.3) == pytest.approx(150.0 + 10.0 * math.sin(2.0 * math.pi * 7.0 * 0.3))


def test_the_inverter_shortens_a_vector_that_is_too_long_and_keeps_its_angle() -> None:
    assert longest(310.0) == pytest.approx(310.0 / math.sqrt(3.0))
    u = 300.0 * turned(2.0)
    assert abs(limited(u, 310.0)) == pytest.approx(longest(310.0))
    assert np.angle(limited(u, 310.0)) == pytest.approx(2.0)
    assert limited(100.0 + 20.0j, 310.0) == 100.0 + 20.0j
