"""The machine alone: temperature table, flux and current, torque."""

import math

import pytest

from emulator.bounds import ScenarioError
from emulator.frames import clarke, nearest, phases, turned, wrapped
from emulator.plant.machine import Machine, at_temperature
from emulator.plant.magnetics import current_and_pull, field_energy, flux_of
from emulator.scenario.scenarios import PAPER
from tests.emulator.plant.plants import LOCKED, plant_with, textbook_energy, textbook_flux, textbook_torque

MOTOR = PAPER.motor


@pytest.mark.parametrize(
    ("temperature", "R_s", "L_d", "L_q"),
    [
        (23.4, 0.9664, 4.24e-3, 6.21e-3),
        (30.0, 1.0008, 4.26e-3, 6.26e-3),
        (50.0, 1.0770, 4.30e-3, 6.34e-3),
        (80.0, 1.1751, 4.36e-3, 6.48e-3),
        (55.0, (1.0770 + 1.1245) / 2, 4.305e-3, 6.37e-3),
    ],
)
def test_the_papers_motor_follows_the_papers_table(temperature: float, R_s: float, L_d: float, L_q: float) -> None:
    warm = at_temperature(MOTOR, temperature)
    assert warm.R_s == pytest.approx(R_s, rel=1e-12)
    assert warm.L_d == pytest.approx(L_d, rel=1e-12)
    assert warm.L_q == pytest.approx(L_q, rel=1e-12)
    assert warm.psi_f == MOTOR.psi_f


def test_another_motor_warms_by_the_same_ratios() -> None:
    other = Machine(R_s=0.1, L_d=20e-6, L_q=30e-6, psi_f=0.005, n_p=10, i_rated=30.0)
    assert at_temperature(other, 80.0).R_s == pytest.approx(0.1 * 1.1751 / 0.9664)
    assert at_temperature(other, 23.4) == other


@pytest.mark.parametrize("temperature", [20.0, 80.1, math.nan])
def test_a_temperature_outside_the_table_is_refused(temperature: float) -> None:
    with pytest.raises(ValueError, match=r"the winding takes 23\.4 to 80\.0 degC, got"):
        at_temperature(MOTOR, temperature)


def test_flux_linkage_current_torque_and_energy_are_the_textbooks() -> None:
    plant, i, rotor = plant_with(MOTOR, LOCKED), 3.0 - 4.5j, turned(0.4)
    psi = flux_of(plant.magnetics, plant.flux_map, i, rotor)
    assert psi == pytest.approx(textbook_flux(MOTOR, i), rel=1e-12)
    again, pull = current_and_pull(plant.magnetics, plant.flux_map, psi, rotor)
    assert again == pytest.approx(i, rel=1e-12)
    assert 1.5 * MOTOR.n_p * pull == pytest.approx(textbook_torque(MOTOR, i), rel=1e-12)
    none = field_energy(plant.magnetics, plant.flux_map, complex(MOTOR.psi_f), rotor)
    some = field_energy(plant.magnetics, plant.flux_map, psi, rotor)
    assert some - none == pytest.approx(textbook_energy(MOTOR, i), rel=1e-12)


def test_phase_values_and_space_vector_are_one() -> None:
    x = 5.0 * turned(0.7)
    a, b, c = phases(x)
    assert a == pytest.approx(5.0 * math.cos(0.7))
    assert b == pytest.approx(5.0 * math.cos(0.7 - 2.0 * math.pi / 3.0))
    assert c == pytest.approx(5.0 * math.cos(0.7 + 2.0 * math.pi / 3.0))
    assert clarke(a, b, c) == pytest.approx(x)
    assert clarke(a + 3.0, b + 3.0, c + 3.0) == pytest.approx(x)  # a common component is not seen


@pytest.mark.parametrize("angle", [-7.0, -0.1, 0.0, 3.0, 3.2, 6.2, 100.0])
def test_wrapped_and_nearest_angles_are_the_same_angle(angle: float) -> None:
    assert 0.0 <= wrapped(angle) < 2.0 * math.pi
    assert -math.pi <= nearest(angle) <= math.pi
    assert turned(wrapped(angle)) == pytest.approx(turned(angle), abs=1e-12)
    assert turned(nearest(angle)) == pytest.approx(turned(angle), abs=1e-12)


def test_a_scenario_error_is_a_value_error() -> None:
    assert issubclass(ScenarioError, ValueError)
