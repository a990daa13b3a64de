"""How a search gets to what is there, from equations that are lines to begin with."""

from pathlib import Path

import pytest

from estimator.diagnosis.search.fitting import fitted
from tests.estimator.diagnosis.concealed_runs import population, rows_of


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
