"""Speed lag: a filtered speed beside its own angle is told with the filter's time; one that is the angle's is not."""

from dataclasses import replace

import numpy as np
import pytest

from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER_RUN, Scenario
from estimator.diagnosis.intake.input_check import checked
from estimator.diagnosis.intake.speed_lag import SpeedLag, SpeedLags
from estimator.samples import Samples
from tests.support.samples import machine_of

T_S = 1e-4
COLUMNS = ("theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q")
SWINGS = replace(PAPER_RUN, drive=replace(PAPER_RUN.drive, bridge="averaged", speed_filter=1.42e-3))


def run_of(scenario: Scenario, *, recorded: str = "filtered", counts: int = 0) -> Samples:
    drive = replace(scenario.drive, recorded_speed=recorded, encoder_counts=counts)
    columns = VirtualDrive(replace(scenario, drive=drive)).record(10_000)
    theta_e, omega_e, i_d, i_q, u_d, u_q = (columns[name] for name in COLUMNS)
    return Samples(theta_e, omega_e, i_d, i_q, u_d, u_q, T_S)


def lag_of(*runs: Samples) -> SpeedLag:
    lags = SpeedLags()
    for run in runs:
        lags.take(run)
    found = lags.found()
    assert found is not None
    return found


def one_row_in(count: int, run: Samples) -> Samples:
    return replace(run, **{name: getattr(run, name)[::count].copy() for name in COLUMNS}, T_s=count * run.T_s)


@pytest.mark.parametrize("counts", [0, 65_536, 4096])
def test_a_filtered_speed_lags_by_its_time_constant_and_half_a_period(counts: int) -> None:
    run = run_of(SWINGS, counts=counts)
    found = lag_of(run)
    assert found.lags
    assert not found.off
    assert found.lag == pytest.approx(1.42e-3 + 0.5 * T_S, rel=0.01)
    assert found.sentence() == "omega_e lags theta_e by 1.4700 ± 0.0020 ms: the speed of the angle is used"
    assert checked([run], machine_of(PAPER_RUN.motor)).remarks == (found.sentence(),)


@pytest.mark.parametrize("counts", [0, 4096])
def test_a_row_in_ten_tells_it_as_well(counts: int) -> None:
    found = lag_of(one_row_in(10, run_of(SWINGS, counts=counts)))
    assert found.lags
    assert abs(found.lag - 1.47e-3) < 3.0 * found.lag_std


@pytest.mark.parametrize("counts", [0, 65_536, 4096])
@pytest.mark.parametrize("rows", [1, 10])
def test_nothing_is_said_of_a_speed_that_is_the_angles(rows: int, counts: int) -> None:
    found = lag_of(one_row_in(rows, run_of(SWINGS, recorded="angle", counts=counts)))
    assert found.sentence() == ""


def test_nothing_is_said_where_the_speed_stays() -> None:
    steady = replace(SWINGS, run=replace(SWINGS.run, rise_rpm=0.0, swing_rpm=0.0, shaft="dynamometer",
                                         speed_control=False))  # fmt: skip
    lags = SpeedLags()
    lags.take(run_of(steady))
    found = lags.found()
    assert found is None or not found.sentence()


def test_scale_and_sign_are_told_with_it() -> None:
    run = run_of(SWINGS)
    found = lag_of(replace(run, omega_e=-1.05 * run.omega_e))
    assert found.scale == pytest.approx(-1.05, rel=1e-3)
    assert found.sentence().startswith("omega_e is -1.05")
    assert "times the rate of theta_e, and lags theta_e by 1.4700 ± 0.0020 ms" in found.sentence()


def test_parts_of_a_run_tell_what_the_run_does() -> None:
    run = run_of(SWINGS, counts=65_536)
    parts = lag_of(*(run[k : k + 2_000] for k in range(0, len(run), 2_000)))
    assert parts.lag == pytest.approx(lag_of(run).lag, abs=5e-6)


def test_the_speed_that_is_recorded_changes_nothing_else() -> None:
    usual, filtered = run_of(SWINGS, recorded="angle"), run_of(SWINGS)
    for name in ("theta_e", "i_d", "i_q", "u_d", "u_q"):
        assert np.array_equal(getattr(usual, name), getattr(filtered, name)), name
    assert not np.array_equal(usual.omega_e, filtered.omega_e)
