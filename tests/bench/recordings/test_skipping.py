"""Recordings whose rows skip control periods, replayed by an equation of their own, their period known or not."""

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
from bench.recordings.replay import Replay, as_json, replay
from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.legs import Inverter
from emulator.scenario.effects import NONE
from emulator.scenario.scenarios import PAPER_RUN, Excitation
from estimator.online.estimate import Status, WindowEstimate
from estimator.witness import Witness

Columns = Mapping[str, NDArray[np.float64]]

TRUTH = {"R_s": 0.9664, "L_d": 4.24e-3, "L_q": 6.21e-3, "psi_f": 0.12}
NAMES = ("t", "u_d", "u_q", "i_d", "i_q", "omega_e", "theta_e")
LEVELS = replace(PAPER_RUN, excitation=Excitation(i_d_step=2.0, i_q_step=2.0, step_time=20e-3))


@pytest.fixture(scope="module")
def levels() -> Columns:
    return VirtualDrive(LEVELS).record(60_000)


def written(folder: Path, columns: Columns, one_in: int) -> Path:
    path = folder / "run.parquet"
    write_columns(path, {name: np.ascontiguousarray(columns[name][::one_in]) for name in NAMES}, {})
    return path


def replayed(path: Path, T_s: float | None, window: Window | None = None) -> Replay:
    with open_recording(path, T_s=T_s, skipping=True, chunk_rows=1000) as reader:
        return replay(reader, window or Window(length=1_000_000))


@pytest.mark.parametrize("T_s", [1e-4, None])
def test_one_row_in_ten_is_replayed_by_its_own_equation(levels: Columns, tmp_path: Path, T_s: float | None) -> None:
    found = replayed(written(tmp_path, levels, 10), T_s)
    assert found.verdict.status is Explained.YES
    for name, true in TRUTH.items():
        e = found.result.estimates[name]
        assert e.status is Status.OK
        assert e.value == pytest.approx(true, rel=1.5e-2 if T_s is None else 5e-3)
        assert abs((e.value or 0.0) - true) < 3.0 * (e.std or 0.0)
    (said,) = (remark for remark in found.remarks if "one row in" in remark)
    assert ("control periods of" in said and "--set T_s=" in said) is (T_s is None)
    assert as_json(found)["recording"]["periods"] == (1 if T_s is None else 10)


def test_estimates_come_on_the_way(levels: Columns, tmp_path: Path) -> None:
    heard: list[tuple[float, WindowEstimate]] = []
    with open_recording(written(tmp_path, levels, 10), T_s=1e-4, skipping=True) as reader:
        replay(reader, Window(length=1_000_000), 2000, lambda t, result: heard.append((t, result)))
    assert [t for t, _ in heard] == pytest.approx([2.0, 4.0, 6.0])
    assert heard[-1][1].estimates["L_q"].value == pytest.approx(TRUTH["L_q"], rel=5e-3)


def test_what_the_machine_does_not_explain_leaves_no_estimate_ok(tmp_path: Path) -> None:
    dead = replace(LEVELS, effects=NONE._replace(inverter=Inverter(dead_time=1.5e-6)))
    path = written(tmp_path, VirtualDrive(dead).record(60_000), 10)
    for T_s in (1e-4, None):
        found = replayed(path, T_s)
        assert found.verdict.status is Explained.NO
        assert not any(e.status is Status.OK for e in found.result.estimates.values())
    said = replayed(path, 1e-4).verdict.sentence()
    assert "pmsm-bench diagnose, of a recording of every control period" in said


def test_rows_of_every_period_are_replayed_as_ever(levels: Columns, tmp_path: Path) -> None:
    found = replayed(written(tmp_path, levels, 1), None)
    assert found.verdict.status is Explained.YES
    assert not any("one row in" in remark for remark in found.remarks)


@pytest.mark.parametrize(("window", "why"), [
    (Window(length=1000), "expected no --window"), (Window(length="auto"), "expected no --window"),
    (Window(length=1_000_000, periods_per_row=10), "expected no --periods"),
    (Window(method="rls"), "expected --method wls, got rls"),
])  # fmt: skip
def test_settings_that_do_not_go_with_it_are_refused(
    levels: Columns, tmp_path: Path, window: Window, why: str
) -> None:
    with pytest.raises(ConfigError, match=f"rows that skip control periods, here one in 10.*{why}"):
        replayed(written(tmp_path, levels, 10), 1e-4, window)


def test_a_slow_drive_that_the_model_does_not_explain_is_not_taken_for_one(tmp_path: Path) -> None:
    drive = replace(PAPER_RUN.drive, T_s=1e-3, bandwidth=300.0)
    sines = Excitation(i_d_step=2.0, i_q_step=2.0, kind="multisine", sine_frequency=20.0, sine_count=1)
    dead = NONE._replace(inverter=Inverter(dead_time=4e-6))
    slow = VirtualDrive(replace(PAPER_RUN, drive=drive, excitation=sines, effects=dead)).record(4000)
    found = replayed(written(tmp_path, slow, 1), None)
    assert found.verdict.status is Explained.NO
    assert not any(e.status is Status.OK for e in found.result.estimates.values())


def test_values_that_the_machine_file_contradicts_are_doubtful(levels: Columns, tmp_path: Path) -> None:
    milli = {name: column * (1e3 if name in ("i_d", "i_q") else 1.0) for name, column in levels.items()}
    with open_recording(written(tmp_path, milli, 10), T_s=1e-4, skipping=True) as reader:
        found = replay(reader, Window(length=1_000_000), nominal=TRUTH)
    assert found.result.estimates["R_s"].status is Status.DOUBTFUL
    assert "R_s reads" in found.result.estimates["R_s"].reason


def test_a_witness_is_told_to_have_no_part(levels: Columns, tmp_path: Path) -> None:
    with open_recording(written(tmp_path, levels, 10), T_s=1e-4, skipping=True) as reader:
        found = replay(reader, Window(length=1_000_000), witnesses={"psi_f": Witness(0.12, 1e-3)})
    assert found.result.estimates["psi_f"].status is Status.OK
    assert "psi_f: its witness has no part in this" in found.remarks[-1]


def test_the_q_axis_alone_needs_every_period(levels: Columns, tmp_path: Path) -> None:
    path = tmp_path / "q.parquet"
    write_columns(path, {name: np.ascontiguousarray(levels[name][::10]) for name in ("t", "u_q", "i_q", "theta_e")}, {})
    with (
        pytest.raises(RecordingError, match="replay takes such rows of both axes"),
        open_recording(path, T_s=1e-4, skipping=True, q_alone=True) as reader,
    ):
        list(reader)


def test_only_a_replay_takes_them(levels: Columns, tmp_path: Path) -> None:
    with (
        pytest.raises(RecordingError, match="is it one row in 10"),
        open_recording(written(tmp_path, levels, 10), T_s=1e-4) as reader,
    ):
        list(reader)
