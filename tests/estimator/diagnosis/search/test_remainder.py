"""What explains a recording of the emulated drive alone, before effects are sought, and what does not."""

from dataclasses import replace
from pathlib import Path

import pytest

from emulator.conceal.recording import Choice
from estimator.diagnosis.likelihood.given import Given
from estimator.diagnosis.likelihood.identifiability import unidentified_inductances
from estimator.diagnosis.search.exchange import all_saturations_at_once
from estimator.diagnosis.search.fitting import at_nominal, fitted, of_model
from estimator.diagnosis.search.remainder import alone, leaves_some, unexplained_by, without_spurious
from estimator.physics.rows import Rows
from estimator.twin.model import Model
from tests.estimator.diagnosis.concealed_runs import population, rows_of

pytestmark = pytest.mark.thorough

THREE = "beckhoff_am8141", "servo_4nm", "aalto_2k2"


def of_kind(kind: str, folder: Path) -> tuple[Rows, Given]:
    return rows_of(Choice(1907, (kind,), (0.7, 1.0), THREE, 3.0), 1, folder)


@pytest.mark.parametrize("kind", ["stray_voltage", "telegraph", "resonance"])
def test_what_has_no_name_and_explains_all_is_seen_at_once(kind: str, tmp_path: Path) -> None:
    found = alone(*of_kind(kind, tmp_path))
    assert found is not None
    machine, left = found
    assert machine.choice == ()
    assert left.where.region["frame"] == "stationary"
    assert left.where.energy_share > 0.9


@pytest.mark.parametrize("kind", ["none", "dead_time", "iron_loss", "imbalance", "turn_short"])
def test_effects_are_sought_where_there_are_any(kind: str, tmp_path: Path) -> None:
    assert alone(*of_kind(kind, tmp_path)) is None


def test_a_branch_beside_a_machine_that_is_none_is_not_taken_for_all(tmp_path: Path) -> None:
    """A saturation and an angle offset, which a resonance explains to a part in 5000 beside a turned rotor."""
    assert alone(*rows_of(population(2007), 205, tmp_path)) is None


def test_a_voltage_that_comes_once_is_not_taken_for_all(tmp_path: Path) -> None:
    """Offsets of current sensors beside a small R_s, which a voltage of some seconds explains nearly as well."""
    assert alone(*rows_of(population(2009), 139, tmp_path)) is None


@pytest.mark.parametrize("number", [123, 160, 303])
def test_a_faint_resonance_is_told(number: int, tmp_path: Path) -> None:
    """Of 230 to 1500 of chi square, where noise alone leaves 120,000 give or take 500."""
    rows, given = rows_of(population(2013), number, tmp_path)
    found = of_model(rows, Model(given.machine), given)
    assert not leaves_some(found)
    left = unexplained_by(rows, found)
    assert left is not None
    assert "a resonance" in left.description


@pytest.mark.slow
def test_an_effect_that_takes_a_parameter_off_its_data_sheet_is_dropped(tmp_path: Path) -> None:
    """A saturation beside a short and an angle offset, where L_q is too high, by no more than an encoder's rounding."""
    rows, given = rows_of(population(2013), 95, tmp_path)
    rows = replace(rows, angle_error=20.0 * rows.angle_error)  # of a coarser one
    given = replace(given, tolerance={**given.tolerance, "L_q": 0.07})
    found = all_saturations_at_once(rows, fitted(rows, given), given)
    assert "q_axis_saturation" in found.model.effects
    assert not given.within("L_q", found.model.machine.L_q, 1.5)
    upheld, left, _ = without_spurious(rows, found, unexplained_by(rows, found), given)
    assert left is None
    assert set(upheld.model.effects) == {"interturn_short"}
    assert given.within("L_q", upheld.model.machine.L_q)


def test_an_inductance_is_not_told_by_a_current_that_moves_less_than_its_noise(tmp_path: Path) -> None:
    rows, given = rows_of(population(2008), 308, tmp_path)
    assert unidentified_inductances(at_nominal(rows, given)) == {"L_d"}
    (tmp_path / "healthy").mkdir()
    assert unidentified_inductances(at_nominal(*of_kind("none", tmp_path / "healthy"))) == frozenset()
