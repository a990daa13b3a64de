"""The plant against closed forms: time constants, power balance, order of the method, mechanics."""

import math

import numpy as np
import pytest

from emulator.frames import turned
from emulator.inverter import limited, longest
from emulator.machine import flux, stored_energy
from emulator.mechanics import Profile, Shaft, profile_speed
from emulator.plant import PlantState, advanced, stator_current
from emulator.scenarios import PAPER

MOTOR = PAPER.motor
STILL = Profile(0.0, 0.0, 0.0, 0.0, 0.0)


def locked() -> Shaft:
    return Shaft(True, STILL, MOTOR.J, MOTOR.B, 0.0)


def free(J: float, B: float, tau_L: float) -> Shaft:
    return Shaft(False, STILL, J, B, tau_L)


def at_rest(theta_m: float = 0.0, omega_m: float = 0.0) -> PlantState:
    return PlantState(flux(MOTOR, 0j) * turned(MOTOR.n_p * theta_m), omega_m, theta_m, 0.0, 0.0, 0.0)


def rotor_current(state: PlantState) -> complex:
    return stator_current(MOTOR, state) * turned(-MOTOR.n_p * state.theta_m)


@pytest.mark.parametrize("theta_m", [0.0, 0.3, 4.0])
def test_a_locked_rotor_shows_the_two_electrical_time_constants(theta_m: float) -> None:
    u_dq = 3.0 + 2.0j
    t = 3e-3
    state = advanced(MOTOR, locked(), u_dq * turned(MOTOR.n_p * theta_m), 0.0, t, 300, at_rest(theta_m))
    i = rotor_current(state)
    assert i.real == pytest.approx(3.0 / MOTOR.R_s * (1.0 - math.exp(-t * MOTOR.R_s / MOTOR.L_d)), rel=1e-9)
    assert i.imag == pytest.approx(2.0 / MOTOR.R_s * (1.0 - math.exp(-t * MOTOR.R_s / MOTOR.L_q)), rel=1e-9)


def test_halving_the_sub_step_divides_the_error_by_sixteen() -> None:
    shaft, start = free(1e-4, 1e-3, 0.1), at_rest(0.2, 300.0)

    def end(sub_steps: int) -> complex:
        return advanced(MOTOR, shaft, 60.0 + 90.0j, 0.0, 2e-3, sub_steps, start).psi

    exact = end(4096)
    errors = [abs(end(n) - exact) for n in (20, 40, 80)]
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.15)
    assert errors[1] / errors[2] == pytest.approx(16.0, rel=0.08)


def test_ten_sub_steps_a_period_leave_an_error_far_below_any_noise() -> None:
    shaft, start = locked()._replace(profile=Profile(125.0, 125.0, 0.0, 0.0, 0.0)), at_rest(0.0, 125.0)
    coarse = advanced(MOTOR, shaft, 20.0 + 60.0j, 0.0, 1e-4, 10, start)
    fine = advanced(MOTOR, shaft, 20.0 + 60.0j, 0.0, 1e-4, 1000, start)
    assert abs(rotor_current(coarse) - rotor_current(fine)) < 1e-9  # A


@pytest.mark.parametrize("shaft", [free(2e-4, 1e-3, 0.3), locked()._replace(profile=Profile(80, 200, 0.05, 20, 9))])
def test_power_in_is_copper_loss_plus_stored_plus_mechanical(shaft: Shaft) -> None:
    state = at_rest(0.0, 80.0)
    T, periods = 1e-4, 400
    theta = 0.0
    for k in range(periods):
        theta += 4 * 100.0 * T
        state = advanced(MOTOR, shaft, 45.0 * turned(theta + 1.5), k * T, T, 10, state)
    i = rotor_current(state)
    assert abs(i) > 0.5
    assert state.W_in == pytest.approx(
        state.W_copper + stored_energy(MOTOR, i) + state.W_shaft, abs=1e-6 * (abs(state.W_in) + state.W_copper)
    )


def test_energy_given_to_a_free_shaft_is_its_kinetic_energy() -> None:
    J = 2e-4
    state = advanced(MOTOR, free(J, 0.0, 0.0), 5.0 + 25.0j, 0.0, 5e-3, 500, at_rest())
    assert abs(state.omega_m) > 1.0
    assert state.W_shaft == pytest.approx(0.5 * J * state.omega_m**2, rel=1e-6)


def test_a_free_shaft_coasts_down_with_its_mechanical_time_constant() -> None:
    # A machine whose magnets are too weak to brake it
    weak = MOTOR._replace(psi_f=1e-9)
    J, B = 1e-3, 0.05
    start = PlantState(0j, 100.0, 0.0, 0.0, 0.0, 0.0)
    state = advanced(weak, free(J, B, 0.0), 0j, 0.0, 0.02, 200, start)
    assert state.omega_m == pytest.approx(100.0 * math.exp(-0.02 * B / J), rel=1e-6)


def test_a_load_torque_alone_turns_the_shaft_backwards() -> None:
    weak = MOTOR._replace(psi_f=1e-9)
    state = advanced(weak, free(1e-3, 0.0, 0.5), 0j, 0.0, 0.01, 10, PlantState(0j, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert state.omega_m == pytest.approx(-0.5 / 1e-3 * 0.01, rel=1e-6)
    assert 0.0 <= state.theta_m <= 2.0 * math.pi


def test_a_dynamometer_follows_its_profile_and_the_angle_is_its_integral() -> None:
    profile = Profile(50.0, 150.0, 0.1, 10.0, 7.0)
    shaft = Shaft(True, profile, 1.0, 0.0, 99.0)  # whatever the load
    state = advanced(MOTOR, shaft, 0j, 0.0, 0.05, 500, at_rest(0.0, 50.0))
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
