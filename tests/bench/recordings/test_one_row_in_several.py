"""One row in several control periods, with values of an instant: what is said of it leads to what can be done."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.diagnoses.diagnose import diagnose_recording
from bench.diagnoses.diagnosis_request import Request
from bench.diagnoses.formats.recording import Read, read_bounded
from bench.live.window import Window
from bench.machine_file import Nominal
from bench.recordings.capture_file import write_columns
from bench.recordings.recording import open_recording
from bench.recordings.replay import Replay, replay
from bench.recordings.runs import OF_INSTANTS
from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER
from estimator.online.estimate import Status
from tests.support.diagnoses import EXPLAINED, UNEXPLAINED

SAID = f"rows are 1 ms apart: is that one row in several control periods? pmsm-bench replay takes such rows by \
--set T_s=SECONDS; a diagnosis needs every control period; {OF_INSTANTS}"
STEP = 200  # periods between two steps of the currents


@pytest.fixture(scope="module")
def columns() -> dict[str, np.ndarray]:
    steps = replace(PAPER.excitation, step_time=STEP * 1e-4)
    swings = replace(PAPER.run, swing_rpm=300.0, swing_frequency=0.5)
    return dict(VirtualDrive(replace(PAPER, excitation=steps, run=swings)).record(40_000))


@pytest.fixture(scope="module")
def tenth(columns: dict[str, np.ndarray], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("tenth") / "tenth.parquet"
    write_columns(path, {name: column[::10] for name, column in columns.items()}, {})
    return path


def replayed(path: Path, T_s: float | None = None) -> Replay:
    with open_recording(path, T_s=T_s) as reader:
        return replay(reader, Window(length=100_000))


def test_a_replay_says_that_they_may_be_that_and_names_what_is_left(tenth: Path) -> None:
    found = replayed(tenth)
    assert found.remarks[-1] == SAID
    assert all(one.status is not Status.OK for one in found.result.estimates.values())
    assert SAID not in replayed(tenth, 1e-3).remarks  # the drive controls as seldom


def test_a_diagnosis_that_explains_nothing_says_the_same(tenth: Path) -> None:
    nominal = Nominal({"R_s": 0.9664, "L_d": 4.24e-3, "L_q": 6.21e-3, "psi_f": 0.12}, n_p=4)
    read = read_bounded(Request(tenth, nominal))
    assert read.diagnosed(UNEXPLAINED).diagnosis.remarks[-1] == SAID
    assert SAID not in read.diagnosed(EXPLAINED).diagnosis.remarks
    known = Read(Request(tenth, replace(nominal, T_s=1e-3)), read.recording, ())
    assert SAID not in known.diagnosed(UNEXPLAINED).diagnosis.remarks


def test_rows_well_after_each_step_tell_the_motor(columns: dict[str, np.ndarray], tmp_path: Path) -> None:
    path = tmp_path / "settled.parquet"
    rows = np.arange(0, 40_000, 10)
    rows = rows[rows % STEP >= STEP // 2]
    write_columns(path, {name: column[rows] for name, column in columns.items()}, {})
    said = diagnose_recording(Request(path, Nominal({}, n_p=4), format="points")).diagnosis
    for name, truth in (("R_s", 0.9664), ("L_d", 4.24e-3), ("L_q", 6.21e-3), ("psi_f", 0.12)):
        assert said.machine_after[name].value == pytest.approx(truth, rel=0.01)
