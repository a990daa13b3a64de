"""`pmsm-bench mechanics` over recordings of emulated shafts."""

import csv
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest

from bench.cli.main import main
from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import Scenario
from tests.estimator.mechanics import shafts

pa: Any = pyarrow  # comes without types
pq: Any = pyarrow.parquet

SWINGING = shafts.shaft()
MACHINE = "[machine]\nL_d = 4.24e-3\nL_q = 6.21e-3\npsi_f = 0.12\nn_p = 4\n[drive]\nencoder_counts = 4096\n"


def recorded(scenario: Scenario, periods: int = 40_000) -> dict[str, Any]:
    """Columns of every control period."""
    drive = VirtualDrive(scenario)
    drive.run(3000)
    return dict(drive.record(periods))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings of a shaft that swings, without its voltages, too, and of one that is held; machine files."""
    folder = tmp_path_factory.mktemp("mechanics")
    columns = recorded(SWINGING)
    pq.write_table(pa.table(columns), folder / "swings.parquet")
    with (folder / "no_voltages.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        i = columns["i_d"] + 1j * columns["i_q"]
        i_ab = i * np.exp(1j * columns["theta_e"])
        writer.writerow(["t", "theta_e", "i_alpha", "i_beta"])
        writer.writerows(zip(columns["t"], columns["theta_e"], i_ab.real, i_ab.imag, strict=True))
    pq.write_table(pa.table(recorded(shafts.on_dynamometer(SWINGING), 20_000)), folder / "held.parquet")
    pq.write_table(pa.table(recorded(shafts.compliant(shafts.shaft(counts=0), 2e-3, 12.0))), folder / "soft.parquet")
    (folder / "machine.toml").write_text(MACHINE, encoding="utf-8")
    (folder / "nameless.toml").write_text("[machine]\nR_s = 1.0\n", encoding="utf-8")
    return folder


def told(
    folder: Path, name: str, *options: str, monkeypatch: pytest.MonkeyPatch, machine: str = "machine.toml"
) -> int:
    """The exit code."""
    arguments = ["pmsm-bench", "mechanics", str(folder / name), "--machine", str(folder / machine), *options]
    monkeypatch.setattr(sys, "argv", arguments)
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


@pytest.mark.parametrize("name", ["swings.parquet", "no_voltages.csv"])
def test_a_swing_tells_all_four(
    folder: Path, name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert told(folder, name, "--json", monkeypatch=monkeypatch) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["status"] == "ok"
    truth = shafts.truth_of(SWINGING)
    for parameter, e in content["estimates"].items():
        assert e["status"] == "ok"
        assert abs(e["value"] - truth[parameter]) < 3.5 * e["std"], parameter
    assert content["estimates"]["J"]["unit"] == "kg m2"
    assert any("psi_f is taken as exact" in remark for remark in content["remarks"])


def test_the_table_has_intervals_and_units(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert told(folder, "swings.parquet", "--trust", "psi_f=2%", monkeypatch=monkeypatch) == 0
    said = capsys.readouterr().out
    row = next(line for line in said.splitlines() if "│ J " in line).split()
    assert [row[3], *row[7:10]] == ["8.00e-04", "kg", "m2", "│"]
    assert float(row[5]) == pytest.approx(0.02 * 8e-4, rel=0.05)
    assert "Nm s/rad" in said
    assert "taken as exact" not in said


def test_a_shaft_that_does_not_accelerate_is_said_to(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert told(folder, "held.parquet", monkeypatch=monkeypatch) == 3
    assert "The shaft does not accelerate" in capsys.readouterr().out


def test_a_shaft_that_gives_way_does_not_fit(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert told(folder, "soft.parquet", monkeypatch=monkeypatch) == 1
    assert "gives way" in capsys.readouterr().out


def test_a_machine_without_flux_is_refused(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert told(folder, "swings.parquet", machine="nameless.toml", monkeypatch=monkeypatch) == 2
    assert "torque needs psi_f and n_p" in capsys.readouterr().err


def test_json_has_no_number_where_there_is_none(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert told(folder, "held.parquet", "--json", monkeypatch=monkeypatch) == 3
    content = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert content["status"] == "no_acceleration"
    assert all(e["value"] is None for e in content["estimates"].values())
