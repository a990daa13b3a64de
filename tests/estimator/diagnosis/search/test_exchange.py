"""Other sets of effects where steps that add one at a time lead astray."""

from dataclasses import replace
from pathlib import Path

import pytest

from emulator.conceal.recording import Choice
from emulator.scenario.motors import MOTORS
from estimator.diagnosis.search.exchange import all_saturations_at_once, begun_without_freer, replaced_by_one
from estimator.diagnosis.search.fitting import fitted, without
from estimator.diagnosis.search.remainder import excess_of
from estimator.physics.library import BY_NAME, LIBRARY
from tests.estimator.diagnosis.concealed_runs import population, rows_as_diagnosed, rows_of, written
from tests.proof.parts.near_suite import near, near_population

pytestmark = pytest.mark.slow


def test_one_effect_takes_the_place_of_three_that_stand_for_it(tmp_path: Path) -> None:
    """Of iron loss an angle's offset, a resistance that rises and an offset of the voltage; saturation shows then."""
    rows, given = rows_of(population(2009), 275, tmp_path)
    three = "angle_offset", "ac_resistance", "voltage_offset"
    found = without(fitted(rows, given, library=[BY_NAME[name] for name in three]), [], given)
    assert {name for name, _ in found.choice} == set(three)
    other = replaced_by_one(rows, found, given).found
    assert {name for name, _ in other.choice} == {"iron_loss", "q_axis_saturation"}
    assert excess_of(other) < 0.5 * excess_of(found)
    assert replaced_by_one(rows, other, given).found is other


def test_saturations_and_an_angle_that_is_off_show_together(tmp_path: Path) -> None:
    rows, given = rows_of(population(2009), 183, tmp_path)
    found = fitted(rows, given)
    other = all_saturations_at_once(rows, found, given)
    there = {"cross_saturation", "q_axis_saturation", "angle_offset"}
    assert {name for name, _ in found.choice} < there == {name for name, _ in other.choice}
    assert excess_of(other) < 0.5 * excess_of(found)
    assert set(all_saturations_at_once(rows, other, given).choice) == set(other.choice)


def test_a_saturation_is_found_to_its_size_step_by_step(tmp_path: Path) -> None:
    """One that once left an inductance beyond its tolerance, until all that bend were tried at once."""
    rows, given = rows_of(population(2009), 76, tmp_path)
    found = fitted(rows, given)
    assert {name for name, _ in found.choice} == {"encoder_eccentricity", "flux_harmonics", "d_axis_saturation"}
    assert set(all_saturations_at_once(rows, found, given).choice) == set(found.choice)


def test_an_effect_shows_for_which_others_had_stood(tmp_path: Path) -> None:
    """Of the nominal machine, far off the true one, the first round took a wrong way."""
    choice = near_population(2015, 6.0)
    there, columns, _ = near(choice, 16)
    rows, given = rows_as_diagnosed(*written(there, columns, choice, tmp_path)[1:])
    found = fitted(rows, given)
    assert "phase_resistance_imbalance" in dict(found.choice)
    assert set(all_saturations_at_once(rows, found, given).choice) == set(found.choice)


def test_a_drift_takes_the_place_of_an_offset_that_looks_like_it_at_the_wrong_time_constant(tmp_path: Path) -> None:
    rows, given = rows_of(population(2010), 261, tmp_path)
    found = fitted(rows, given, library=[effect for effect in LIBRARY if effect.name != "magnet_temperature"])
    other = replaced_by_one(rows, found, given).found
    assert {name for name, _ in found.choice} - {name for name, _ in other.choice} == {"voltage_offset"}
    assert {name for name, _ in other.choice} == {"cross_saturation", "magnet_flux_drift", "voltage_delay"}
    assert excess_of(other) < 0.9 * excess_of(found)


def test_a_loss_takes_the_place_of_two_effects_that_leave_as_little(tmp_path: Path) -> None:
    rows, given = rows_of(population(2010), 221, tmp_path)
    found = fitted(rows, given)
    other = replaced_by_one(rows, found, given).found
    assert {name for name, _ in other.choice} == {"current_sensor_offset", "iron_loss"}
    assert len(other.choice) < len(found.choice)
    assert excess_of(other) < 1.01 * excess_of(found)


def test_of_two_that_look_like_the_machine_none_wins_by_an_angles_rounding(tmp_path: Path) -> None:
    """An offset of the angle beside a short; a saturation that is not there leaves half as much, with L_q too high."""
    rows, given = rows_of(population(2013), 95, tmp_path)
    found = fitted(rows, given)
    assert "q_axis_saturation" in found.model.effects
    assert not given.within("L_q", found.model.machine.L_q)
    other, _ = replaced_by_one(rows, found, given)
    assert set(other.model.effects) == {"interturn_short", "angle_offset"}
    assert other.model.effects["angle_offset"][0] == pytest.approx(0.0265, rel=0.1)
    within = replace(given, tolerance={**given.tolerance, "L_q": 0.15})
    still, at_best = replaced_by_one(rows, found, within)
    assert still is found
    assert at_best["q_axis_saturation", "angle_offset"] == 0.0


def test_a_winding_warmed_by_its_own_losses_is_named_so_though_a_course_from_outside_explains_as_much(
    tmp_path: Path,
) -> None:
    rows, given = rows_of(Choice(7004, ("winding_heat",), (0.0, 1.0), tuple(MOTORS), 3.0), 3, tmp_path)
    found = fitted(rows, given)
    assert set(found.model.effects) == {"winding_temperature"}
    assert set(replaced_by_one(rows, found, given).found.model.effects) == {"winding_resistance_drift"}


def test_a_drift_and_a_step_show_where_one_course_had_taken_the_place_of_both(tmp_path: Path) -> None:
    rows, given = rows_of(Choice(7031, ("two",), (0.0, 1.0), tuple(MOTORS), 3.0), 11, tmp_path)
    found = fitted(rows, given)
    assert set(found.model.effects) == {"magnet_temperature"}
    other = begun_without_freer(rows, found, given)
    assert set(other.model.effects) == {"magnet_flux_drift", "magnet_flux_step"}
    assert excess_of(other) < 0.05 * excess_of(found)
