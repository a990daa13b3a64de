"""The outside benchmark: cells as published, motors of the published ranges, and outcomes in the published terms."""

from collections import Counter
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from bench.machine_file import load_machine
from estimator.diagnosis.verdict import Diagnosis, ErrorChange, Finding, Fit, Place, Quantity, Verdict
from estimator.samples import Samples
from tests.proof.parts.benchmark import Outcome, judged, prove
from tests.proof.parts.benchmark_cells import CELLS, I_RATED, TOLERANCE, U_DC, Made, made, motor_of
from tests.proof.proof import Settings
from tests.score.diagnosed import Said
from tests.support.recordings import read_recording

SEED = 1100
LENGTH = 0.5  # s
CELL = {cell.name: cell for cell in CELLS}
NOWHERE = Place("", {}, 1.0, 1.0)


@cache
def recording(name: str) -> tuple[Made, Samples]:
    """A cell's truth and its recording, as it is read from its file."""
    with TemporaryDirectory() as scratch:
        there = made(CELL[name], motor_of(SEED, 1), Path(scratch), LENGTH)
        (run,) = read_recording(Path(scratch) / f"{there.name}.parquet").runs
        return there, run


def said(
    there: Made, verdict: Verdict, *effects: str, before: float = 0.0, after: float = 0.0, left: float = 1.0
) -> Said:
    """A diagnosis in short: R_s off by shares before and after, a residual before over the noise."""
    findings = tuple(Finding(name, {}, NOWHERE, 1e9, (), {}) for name in effects)
    true = {name: Quantity(value, 0.0, "") for name, value in there.truth.machine.items()}
    fitted, corrected = (
        true | {"R_s": Quantity(there.truth.machine["R_s"] * (1.0 + off), 0.0, "")} for off in (before, after)
    )
    fit = Fit(True, ErrorChange(left, 1.0, 1.0), ErrorChange(1.0, 0.1), 0.9, ErrorChange(5.0, 1.0))
    return Said(Diagnosis(verdict, "", findings, (), None, {}, fitted, corrected, fit, (), (), None), "", 1.0)


def test_the_matrix_is_the_published_one() -> None:
    """16 cells, of which three motors each are 30 accurate, 9 silently wrong and 9 rejected."""
    assert len(CELL) == len(CELLS) == 16
    assert Counter(cell.published for cell in CELLS) == {"accurate": 10, "silently wrong": 3, "rejected": 3}
    assert {cell.published for cell in CELLS} == set(Outcome)


def test_motors_are_of_the_published_ranges_and_their_data_sheets_within_tolerance() -> None:
    """A seed and a number give one motor, another seed another one."""
    for number in range(1, 20):
        motor = motor_of(SEED, number)
        true, nominal = motor.machine, motor.nominal
        assert 0.35 <= true.R_s <= 0.65
        assert 0.8e-3 <= true.L_d <= 1.4e-3
        assert 0.7e-3 <= true.L_q <= 1.3e-3
        assert 0.015 <= true.psi_f <= 0.028
        assert 3e-4 <= true.J <= 8e-4
        assert 0.8e-4 <= true.B <= 2.5e-4
        off = [getattr(true, name) / getattr(nominal, name) - 1.0 for name in ("R_s", "L_d", "L_q", "psi_f")]
        assert all(0.0 < abs(each) <= TOLERANCE for each in off)
        assert motor == motor_of(SEED, number)
        assert motor.machine != motor_of(SEED + 1, number).machine


def test_a_recording_stays_within_rated_current_and_the_bus_and_hides_its_motor(tmp_path: Path) -> None:
    """Its data sheet is all that stands beside it."""
    motor = motor_of(SEED, 1)
    there = made(CELL["ideal"], motor, tmp_path, LENGTH)
    (run,) = read_recording(tmp_path / f"{there.name}.parquet").runs
    assert np.max(np.hypot(run.i_d, run.i_q)) < 1.2 * I_RATED
    u = np.hypot(run.u_d, run.u_q)
    assert np.mean(u > 0.95 * U_DC / np.sqrt(3.0)) < 0.02  # in steps alone
    assert np.ptp(run.i_d) > 3.0
    assert np.ptp(run.i_q) > 6.0
    nominal = load_machine(tmp_path / f"{there.name}.toml").machine
    assert nominal is not None
    assert (nominal.R_s, nominal.L_d, nominal.psi_f) == (motor.nominal.R_s, motor.nominal.L_d, motor.nominal.psi_f)
    assert there.truth.effects == {}


@pytest.mark.parametrize(
    ("cell", "gain", "offset", "quantum"),
    [("voltage mild", 1.02, 0.005, 0.005), ("voltage strong", 1.12, 0.020, 0.020)],
)
def test_recorded_voltages_have_gain_offset_and_quantum(cell: str, gain: float, offset: float, quantum: float) -> None:
    """Beside those of the ideal cell: the drive's control does not see them."""
    _, ideal = recording("ideal")
    there, run = recording(cell)
    for told, true, off in ((run.u_d, ideal.u_d, offset), (run.u_q, ideal.u_q, -offset)):
        np.testing.assert_allclose(told, gain * true + off, atol=0.5 * quantum + 1e-9)
        np.testing.assert_allclose(told / quantum, np.round(told / quantum), atol=1e-6)
    np.testing.assert_array_equal(run.i_d, ideal.i_d)
    assert there.truth.effects["dc_link_gain"]["gain"].value == gain
    assert run.resolution.u == quantum


@pytest.mark.parametrize(("cell", "quantum"), [("current mild", 0.002), ("current strong", 0.010)])
def test_phase_currents_have_their_quantum(cell: str, quantum: float) -> None:
    """But for the counts of the wire, which are finer."""
    there, run = recording(cell)
    assert run.i_a is not None
    np.testing.assert_allclose(run.i_a / quantum, np.round(run.i_a / quantum), atol=0.5 * run.resolution.i / quantum)
    assert there.truth.effects.keys() == {"current_sensor_gain", "current_sensor_offset"}


def test_all_families_are_in_the_last_cells() -> None:
    """With their sizes, by the names of the diagnosis."""
    there, run = recording("all strong")
    effects = there.truth.effects
    assert effects["angle_offset"]["offset"].value == pytest.approx(np.radians(6.0))
    assert effects["inverter_voltage_error"]["u_drop"].value == 0.15
    assert effects["voltage_delay"]["periods"].value == 1.0
    assert effects["winding_resistance_drift"]["rise"].value == pytest.approx(0.5, rel=0.02)
    assert effects["dc_link_gain"]["gain"].value == pytest.approx(1.12)
    assert effects["voltage_offset"]["offset_d"].value == pytest.approx(0.020)
    assert {"current_sensor_gain", "current_sensor_offset"} < effects.keys()
    assert run.u_dc is not None
    np.testing.assert_allclose(run.u_dc, 0.9 * U_DC, rtol=1e-3)


def test_a_wrong_name_or_parameter_that_is_vouched_for_is_silently_wrong() -> None:
    """A doubt is none, and is not accepted."""
    there, _ = recording("angle strong")
    right = judged(there, said(there, Verdict.EXPLAINED, "angle_offset", before=0.2, after=0.02))
    assert (right.outcome, right.conventional, right.recovered) == (Outcome.ACCURATE, Outcome.WRONG, True)
    for wrong in (
        said(there, Verdict.EXPLAINED, "iron_loss"),
        said(there, Verdict.PARTLY_EXPLAINED, "angle_offset", "iron_loss"),
        said(there, Verdict.EXPLAINED, "angle_offset", after=-0.11),
        said(there, Verdict.NO_MISMATCH, before=0.11, after=0.11),
    ):
        assert judged(there, wrong).outcome is Outcome.WRONG
    for verdict in (Verdict.AMBIGUOUS, Verdict.NOT_ENOUGH_EXCITATION, Verdict.UNEXPLAINED, Verdict.PARTLY_EXPLAINED):
        assert judged(there, said(there, verdict, after=0.3)).outcome is Outcome.REJECTED
    assert judged(there, Said(None, "no", 1.0)).outcome is Outcome.REJECTED


def test_recovered_is_what_a_conventional_fit_would_not_have() -> None:
    """Accurate without an effect, or with one that nobody needed to name, is not recovered."""
    there, _ = recording("angle strong")
    plain = judged(there, said(there, Verdict.EXPLAINED, "angle_offset", before=0.05))
    assert (plain.conventional, plain.recovered) == (Outcome.ACCURATE, False)
    left = judged(there, said(there, Verdict.EXPLAINED, "angle_offset", before=0.05, left=1.5))
    assert (left.conventional, left.recovered) == (Outcome.REJECTED, True)
    unnamed = judged(there, said(there, Verdict.NO_MISMATCH, before=0.3))
    assert (unnamed.conventional, unnamed.recovered) == (Outcome.WRONG, False)


@pytest.mark.slow
def test_the_quick_benchmark_is_never_silently_wrong(tmp_path: Path) -> None:
    """And its tables have a row for every cell."""
    proof = prove(Settings(SEED, True, 2, tmp_path))
    bars = {bar.what: bar for bar in proof.bars}
    assert bars["silently wrong"].figure == "0 of 5"
    outcomes, by_cell, each = proof.tables
    assert [len(table.rows) for table in (outcomes, by_cell, each)] == [3, 5, 5]
    assert all(len(row) == len(table.heads) for table in proof.tables for row in table.rows)
    assert (tmp_path / "benchmark.json").stat().st_size > 0
