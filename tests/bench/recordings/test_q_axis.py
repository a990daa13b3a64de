"""Recordings of u_q, i_q and an angle or a speed alone: what the q axis tells, and what it does not."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bench.errors import ConfigError, RecordingError
from bench.live.watch import Explained
from bench.live.window import Window
from bench.recordings.capture_file import write_columns
from bench.recordings.recording import open_recording
from bench.recordings.replay import Replay, replay
from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.legs import Inverter
from emulator.scenario.effects import NONE
from emulator.scenario.scenarios import PAPER_RUN, Excitation, Scenario
from estimator.online.estimate import Status

Columns = Mapping[str, NDArray[np.float64]]

TRUTH = {"R_s": 0.9664, "L_q": 6.21e-3, "psi_f": 0.12}
Q = ("t", "u_q", "i_q", "theta_e")
STEPS = replace(PAPER_RUN, excitation=Excitation(i_q_step=2.0, step_time=5e-3))
SLOW = replace(
    PAPER_RUN, excitation=Excitation(i_q_step=2.0, kind="multisine", sine_frequency=1.0),
    run=replace(PAPER_RUN.run, speed_rpm=200.0, rise_rpm=0.0, swing_rpm=200.0, swing_frequency=0.7),
)
DEAD = NONE._replace(inverter=Inverter(dead_time=1.5e-6))


def recorded(scenario: Scenario, rows: int, *, one_in: int = 1) -> Columns:
    columns = VirtualDrive(scenario).record(rows)
    return {name: np.ascontiguousarray(column[::one_in]) for name, column in columns.items()}


def replayed(
    folder: Path, columns: Columns, *names: str, window: Window | None = None, align: Mapping[str, float] | None = None
) -> Replay:
    path = folder / "run.parquet"
    path.unlink(missing_ok=True)
    write_columns(path, {name: columns[name] for name in names}, {})
    with open_recording(path, q_alone=True, align=align) as reader:
        return replay(reader, window or Window(length=100_000))


def expect_truth(found: Replay, status: Status = Status.OK) -> None:
    for name, true in TRUTH.items():
        estimate = found.result.estimates[name]
        assert estimate.status is status, estimate
        assert estimate.value is not None
        assert estimate.std is not None
        assert abs(estimate.value - true) < 2.5 * estimate.std, estimate
        assert estimate.std < 0.06 * true


@pytest.fixture(scope="module")
def steps() -> Columns:
    return recorded(STEPS, 20_000)


def test_the_q_axis_tells_what_is_in_its_equation(steps: Columns, tmp_path: Path) -> None:
    found = replayed(tmp_path, steps, *Q)
    expect_truth(found)
    L_d = found.result.estimates["L_d"]
    assert (L_d.value, L_d.std, L_d.status) == (None, None, Status.NOT_TOLD)
    assert L_d.reason == "not asked for: no i_d, u_d"
    assert found.verdict.status is Explained.YES
    said = "the q axis alone: no u_d, no i_d, which is taken for zero, as a drive controls it to zero"
    assert said in found.remarks
    assert found.result.equations == found.result.samples
    assert found.recording.sources["u_d"] == found.recording.sources["i_d"] == "not recorded"


def test_a_speed_stands_in_for_the_angle(steps: Columns, tmp_path: Path) -> None:
    expect_truth(replayed(tmp_path, steps, "t", "u_q", "i_q", "omega_e"))


def test_an_i_d_that_is_recorded_is_used(steps: Columns, tmp_path: Path) -> None:
    found, without = replayed(tmp_path, steps, "i_d", *Q), replayed(tmp_path, steps, *Q)
    assert "the q axis alone: no u_d" in found.remarks
    psi_f, alone = (one.result.estimates["psi_f"] for one in (found, without))
    assert psi_f.value == pytest.approx(TRUTH["psi_f"], rel=1e-3)
    assert 5.0 * (psi_f.std or 1.0) < (alone.std or 0.0)


def test_an_inverters_voltage_error_is_no_resistance(tmp_path: Path) -> None:
    found = replayed(tmp_path, recorded(replace(STEPS, effects=DEAD), 20_000), *Q)
    assert found.verdict.status is Explained.NO
    assert not any(e.status is Status.OK for e in found.result.estimates.values())


def test_a_speed_that_lags_is_no_resistance(tmp_path: Path) -> None:
    drive = replace(STEPS.drive, recorded_speed="filtered", speed_filter=1.42e-3)
    columns = recorded(replace(STEPS, drive=drive), 20_000)
    found = replayed(tmp_path, columns, "t", "u_q", "i_q", "omega_e")
    assert not any(e.status is Status.OK for e in found.result.estimates.values())
    with_angle = replayed(tmp_path, columns, "omega_e", *Q)
    expect_truth(with_angle)
    assert any("omega_e lags theta_e by 1.47" in remark for remark in with_angle.remarks)


def test_values_of_an_instant_are_aligned_by_half_a_row(tmp_path: Path) -> None:
    columns = recorded(SLOW, 80_000, one_in=10)
    expect_truth(replayed(tmp_path, columns, *Q, align={"u": -0.5}), Status.DOUBTFUL)
    as_it_is = replayed(tmp_path, columns, *Q)
    assert not any(e.status is Status.OK for e in as_it_is.result.estimates.values())


def test_a_slow_current_tells_no_l_q_but_the_others_by_one_that_is_held(tmp_path: Path) -> None:
    window = Window(length=100_000, held={"L_q": 6e-3})
    estimates = replayed(tmp_path, recorded(SLOW, 40_000), *Q, window=window).result.estimates
    assert estimates["L_q"].status is Status.NOT_TOLD
    for name in ("R_s", "psi_f"):
        estimate = estimates[name]
        assert estimate.status is Status.OK
        assert abs((estimate.value or 0.0) - TRUTH[name]) < 2.5 * (estimate.std or 0.0)


@pytest.mark.parametrize(("window", "why"), [
    (Window(method="rls"), "--method rls needs u_d and i_d"),
    (Window(estimated=("L_d",), held=TRUTH), "L_d is not in the equation of u_q without i_d"),
])  # fmt: skip
def test_what_needs_the_d_axis_is_refused(steps: Columns, tmp_path: Path, window: Window, why: str) -> None:
    with pytest.raises(ConfigError, match=why):
        replayed(tmp_path, steps, *Q, window=window)


@pytest.mark.parametrize("names", [("t", "u_d", "i_q", "theta_e"), ("t", "u_q", "theta_e"), ("t", "u_d", "u_q", "i_q")])
def test_less_than_the_q_axis_is_missing_columns(steps: Columns, tmp_path: Path, names: tuple[str, ...]) -> None:
    with pytest.raises(RecordingError, match="missing columns"):
        replayed(tmp_path, steps, *names)


def test_whoever_needs_both_axes_is_told_what_is_missing(steps: Columns, tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    write_columns(path, {name: steps[name] for name in Q}, {})
    with pytest.raises(RecordingError, match="missing columns: u_d, i_d; present"), open_recording(path):
        pass
