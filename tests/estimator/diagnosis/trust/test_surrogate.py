"""Surrogates: what noise, converters and encoders lend a name, in recordings of the emulated drive."""

from pathlib import Path

import pytest

from emulator.drive.virtual_drive import VirtualDrive
from estimator.diagnosis.likelihood.evidence import Choice as Names
from estimator.diagnosis.search.fitting import fitted
from estimator.diagnosis.trust.surrogate import Surrogates, converter_step
from estimator.physics.rows import Rows
from tests.emulator.plant.physics.effect_runs import at, with_effects
from tests.estimator.diagnosis.concealed_runs import population, rows_of
from tests.support.samples import machine_of, rows_of_columns


def rows_through(bits: int, noise: float) -> Rows:
    """A second of a drive whose converters have so many bits."""
    drive = {"adc_bits": bits, "adc_full": 20.0, "noise_i": noise}
    scenario = with_effects(i_dq=1.0 + 3.0j, step=1.0, run=at(40.0), drive=drive)
    columns = VirtualDrive(scenario).record(10_000)
    return rows_of_columns(columns, machine_of(scenario.motor), scenario.drive.T_s)


@pytest.mark.parametrize("bits", [10, 12])
def test_a_converters_step_is_seen_by_the_values_it_tells(bits: int) -> None:
    assert converter_step(rows_through(bits, 0.01)) == pytest.approx(40.0 / 2**bits, rel=1e-3)


def test_no_step_is_seen_where_there_is_none() -> None:
    assert converter_step(rows_through(0, 0.01)) == 0.0


def judged(seed: int, number: int, folder: Path) -> tuple[Names, Surrogates]:
    """What a fit to a recording holds, and what surrogates show of it."""
    rows, given = rows_of(population(seed), number, folder)
    found = fitted(rows, given)
    return found.choice, Surrogates(found, given)


@pytest.mark.slow
def test_a_small_effect_stands_out_where_bounds_leave_a_doubt(tmp_path: Path) -> None:
    """A saturation along d of five detection limits, where i_d changes by ten times its noise."""
    choice, surrogates = judged(2005, 342, tmp_path)
    assert [name for name, _ in choice] == ["d_axis_saturation"]
    assert surrogates.stands_out(choice[0], choice, True)
    assert not surrogates.show_as_much(choice[0], choice)


@pytest.mark.slow
def test_what_noise_lends_a_name_does_not_stand_out(tmp_path: Path) -> None:
    """An offset of the angle in a healthy drive."""
    choice, surrogates = judged(2005, 26, tmp_path)
    assert "angle_offset" in dict(choice)
    assert not surrogates.stands_out(("angle_offset", -1), choice, True)
    assert surrogates.show_as_much(("angle_offset", -1), choice)
