"""Turned: a speed column that is late is told beside a replay, and the estimates are those of the angle."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.live.window import Window
from bench.recordings.capture_file import write_columns
from bench.recordings.recording import open_recording
from bench.recordings.replay import Replay, replay
from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER_RUN

LATE = replace(PAPER_RUN, drive=replace(PAPER_RUN.drive, bridge="averaged", speed_filter=1.42e-3,
                                        recorded_speed="filtered"))  # fmt: skip


def replayed(path: Path, *, late: bool) -> Replay:
    drive = replace(LATE.drive, recorded_speed="filtered" if late else "angle")
    write_columns(path, VirtualDrive(replace(LATE, drive=drive)).record(10_000), {})
    with open_recording(path) as reader:
        return replay(reader, Window(length=10_000))


def test_a_late_speed_is_told_and_changes_no_estimate(tmp_path: Path) -> None:
    usual, late = replayed(tmp_path / "usual.parquet", late=False), replayed(tmp_path / "late.parquet", late=True)
    said = "omega_e lags theta_e by 1.4700 ± 0.0020 ms: the speed of the angle is used"
    assert said in late.remarks
    assert not any("lags" in remark for remark in usual.remarks)
    for name, estimate in late.result.estimates.items():
        assert estimate.value == pytest.approx(usual.result.estimates[name].value, rel=1e-7), name
        assert np.isfinite(estimate.value or 0.0)
