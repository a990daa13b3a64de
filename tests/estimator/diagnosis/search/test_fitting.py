"""How a search gets to what is there, from equations that are lines to begin with."""

from dataclasses import replace
from pathlib import Path

import pytest

from emulator.conceal.recording import Choice, drawn, recorded
from emulator.plant.physics.current_filter import CurrentFilter
from emulator.scenario.motors import MOTORS
from estimator.diagnosis.diagnose import diagnose
from estimator.diagnosis.search.fitting import fitted
from estimator.diagnosis.verdict import Verdict
from tests.estimator.diagnosis.concealed_runs import population, rows_of, written


@pytest.mark.slow
def test_a_step_of_the_flux_between_blocks_of_rows_is_found_at_its_moment(tmp_path: Path) -> None:
    """A bridge's voltage error is polished on blocks: between them a step may be anywhere."""
    rows, given = rows_of(population(2015), 310, tmp_path)
    effects = fitted(rows, given).model.effects
    assert set(effects) == {"inverter_voltage_error", "magnet_flux_step", "phase_resistance_imbalance"}
    assert effects["magnet_flux_step"][:2] == pytest.approx((-0.110, 0.3716), rel=0.01)


@pytest.mark.slow
def test_a_drift_is_followed_to_its_size_though_its_equation_bends(tmp_path: Path) -> None:
    """Heating and cooling that nearly make up for each other, as lines, are far from what they are together."""
    rows, given = rows_of(population(2015), 323, tmp_path)
    effects = fitted(rows, given).model.effects
    assert set(effects) == {"winding_resistance_drift", "magnet_flux_step", "flux_harmonics"}
    assert effects["winding_resistance_drift"] == pytest.approx((0.19, 1.13, 0.0), rel=0.05, abs=0.01)
    assert effects["magnet_flux_step"][0] == pytest.approx(-0.0475, rel=0.01)


CHAINED = Choice(1014, ("none",), (0.0, 1.0), tuple(MOTORS), 6.0, chain=True)


@pytest.mark.slow
@pytest.mark.parametrize(("number", "form"), [(57, 1), (44, 4)])
def test_a_mean_of_currents_is_found_in_its_form(number: int, form: int, tmp_path: Path) -> None:
    """Over two periods, and of three samples, whose noise is no white one. Lines of no mean do not tell which."""
    effects = fitted(*rows_of(CHAINED, number, tmp_path)).model.effects
    assert set(effects) - {"angle_latency"} == {"current_averaging"}
    assert effects["current_averaging"] == pytest.approx((1.0, form), rel=0.005)


@pytest.mark.slow
@pytest.mark.parametrize("way", [CurrentFilter(tau=7e-5, periods=2), CurrentFilter(periods=2, samples=3)])
def test_a_way_of_the_currents_that_has_no_form_lends_to_no_other_name(way: CurrentFilter, tmp_path: Path) -> None:
    """A filter before a mean, a mean of means: what such a form stands in for is off by as much as its share is."""
    choice = Choice(1200, ("none",), (0.0, 1.0), ("servo_4nm",), 4.0)
    healthy, _ = drawn(choice, 1)
    scenario = healthy.scenario
    scenario = replace(scenario, effects=scenario.effects._replace(current_filter=way))
    there = replace(healthy, scenario=scenario)
    _, runs, nominal = written(there, recorded(scenario, healthy.periods), choice, tmp_path)
    said = diagnose(runs, nominal)
    assert {one.effect for one in said.findings} <= {"current_averaging", "current_filter"}
    assert said.verdict is Verdict.AMBIGUOUS
    for name in ("R_s", "L_d", "L_q", "psi_f"):
        size = said.machine_after[name]
        assert abs((size.value or 0.0) - getattr(scenario.motor, name)) < 3.0 * (size.std or 0.0)
