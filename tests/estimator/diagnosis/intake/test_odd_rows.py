"""Odd rows are told from all others by what constant parameters leave of them, whatever the column."""

from dataclasses import replace

import numpy as np
import pytest

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.legs import Inverter
from emulator.scenario.effects import Effects
from emulator.scenario.scenarios import PAPER
from estimator.diagnosis.intake.odd_rows import FEWEST_ODD_ROWS, odd_rows, odd_samples
from estimator.samples import Samples
from tests.estimator.diagnosis.test_watch import paper
from tests.support.samples import recorded, streamed

ROWS = 6000


@pytest.fixture(scope="module")
def run() -> Samples:
    return recorded(VirtualDrive(PAPER), ROWS)


def changed(run: Samples, column: str, row: int, value: float) -> Samples:
    cells = getattr(run, column).copy()
    cells[row] = value
    return replace(run, **{column: cells})


def found(*runs: Samples) -> list[list[int]]:
    return [np.flatnonzero(bad).tolist() for bad in odd_rows(runs).bad]


def test_a_sound_recording_has_none(run: Samples) -> None:
    assert found(run) == [[]]
    assert found(streamed(VirtualDrive(PAPER), 2000)) == [[]]


@pytest.mark.parametrize("row", [0, 1, 2500, ROWS - 2])
@pytest.mark.parametrize(
    ("column", "value"),
    [("i_d", 12.0), ("i_q", -3e5), ("u_d", 1e3), ("u_q", -150.0), ("theta_e", 0.123), ("i_q", 1e12)],
)
def test_one_wrong_cell_is_found_in_its_row(run: Samples, column: str, value: float, row: int) -> None:
    assert found(changed(run, column, row, value)) == [[row]]


def test_some_are_found_together_and_the_fit_is_that_of_the_others(run: Samples) -> None:
    spoilt = changed(changed(changed(run, "i_q", 700, 900.0), "u_q", 3000, 1e6), "theta_e", 5000, 9.9)
    odd = odd_rows([spoilt])
    assert np.flatnonzero(odd.bad[0]).tolist() == [700, 3000, 5000]
    assert odd.fitted is not None
    assert odd.fitted.beta == pytest.approx([0.9664, 4.24e-3, 6.21e-3, 0.12], rel=0.02)


def test_many_are_no_accident_and_what_lasts_is_none(run: Samples) -> None:
    noisy = run.u_q.copy()
    noisy[::50] += 100.0
    assert found(replace(run, u_q=noisy)) == [[]]
    assert found(recorded(VirtualDrive(paper(Effects(inverter=Inverter(dead_time=1e-6)))), ROWS)) == [[]]


def test_too_few_rows_for_a_fit_are_judged_by_the_fit_before_them(run: Samples) -> None:
    short = changed(run, "u_d", 5050, 500.0)[5000 : 5000 + FEWEST_ODD_ROWS // 2]
    assert found(short) == [[]]
    before = odd_rows([run[:3000]]).fitted
    assert np.flatnonzero(odd_rows([short], before).bad[0]).tolist() == [50]


def returning(*runs: Samples) -> list[list[int]]:
    return [np.flatnonzero(bad).tolist() for bad in odd_samples(runs, [np.zeros(len(run), np.bool_) for run in runs])]


@pytest.mark.parametrize(
    ("column", "by"), [("i_d", 0.3), ("i_q", -0.3), ("u_d", 12.0), ("u_q", -12.0), ("theta_e", 0.02)]
)
def test_a_row_that_leaves_those_around_it_and_returns_is_found_though_it_is_not_far(
    run: Samples, column: str, by: float
) -> None:
    """Some 20 standard deviations: but for rows beside which noise or a step is large."""
    assert returning(run) == [[]]
    rows = range(1003, ROWS, 100)
    hits = [returning(changed(run, column, row, getattr(run, column)[row] + by)) == [[row]] for row in rows]
    assert sum(hits) >= 0.95 * len(rows)


def test_a_row_of_physics_that_parameters_leave_out_is_not_taken_for_one(run: Samples) -> None:
    stepped = replace(run, i_q=np.where(np.arange(ROWS) < 3000, run.i_q, run.i_q + 1.0))  # odd, and it stays
    assert (3000 - 1 in found(stepped)[0], returning(stepped)) == (True, [[]])
    drops = recorded(VirtualDrive(paper(Effects(inverter=Inverter(dead_time=1e-6)))), ROWS)
    assert returning(drops) == [[]]
