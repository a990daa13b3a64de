"""`pmsm-bench params`: sets of diagnoses, of estimates and of rules, on the command line."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest

from bench.cli.main import main
from bench.diagnoses.diagnose import Diagnosed, as_json
from bench.parameters.parameter_set import read
from drivers.connect import connect
from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER
from tests.conftest import COMMAND
from tests.support.diagnoses import EXPLAINED, NOMINAL, NOTHING_TOLD, RECORDING, UNEXPLAINED
from tests.support.served_drive import served
from tests.support.transports import modbus_tcp_url

pa: Any = pyarrow  # comes without types
pq: Any = pyarrow.parquet

FILES = {"explained": EXPLAINED, "nothing": NOTHING_TOLD, "unexplained": UNEXPLAINED}
ESTIMATES = {
    "estimates": {"R_s": {"value": 1.2, "std": 1e-3, "status": "ok"}, "psi_f": {"value": 0.12, "std": 1e-5}},
    "temperatures_degC": {"temp_winding": 70.0},
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    for name, diagnosis in FILES.items():
        content = as_json(Diagnosed(RECORDING, NOMINAL, diagnosis))
        (tmp_path / f"{name}.json").write_text(json.dumps(content), encoding="utf-8")
    (tmp_path / "estimates.json").write_text(json.dumps(ESTIMATES), encoding="utf-8")
    (tmp_path / "bad.json").write_text("{", encoding="utf-8")
    (tmp_path / "list.json").write_text("[]", encoding="utf-8")
    return tmp_path


def params(monkeypatch: pytest.MonkeyPatch, *arguments: str | Path) -> int:
    """`pmsm-bench params` in this process; its exit code."""
    return pmsm_bench(monkeypatch, "params", *arguments)


def pmsm_bench(monkeypatch: pytest.MonkeyPatch, *arguments: str | Path) -> int:
    monkeypatch.setattr(sys, "argv", ["pmsm-bench", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def test_a_diagnosis_becomes_a_set_on_top_of_what_the_drive_had(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    image, out = folder / "image.toml", folder / "set.toml"
    had = "inverter_correction = 1\ndead_time = 1e-6\n"
    image.write_text(f'name = "as it was"\n[drive]\nserial = 7\n[parameters]\n{had}', encoding="utf-8")
    given = ("from-diagnosis", folder / "explained.json", "--image", image, "--out", out, "--own-gains")
    assert params(monkeypatch, *given, "--name", "servo", "--version", "4", "--bandwidth", "900") == 0
    assert capsys.readouterr().out == f"{out}: written\n"
    there = read(out)
    assert (there.name, there.version, there.serial) == ("servo", 4, 7)
    assert there.values["dead_time"] == pytest.approx(3e-6)
    assert there.values["bandwidth"] == 900.0
    assert params(monkeypatch, *given) == 2  # it is there already
    assert params(monkeypatch, "show", out) == 0
    assert "recorded" in capsys.readouterr().out


def test_on_standard_output_there_is_the_set_alone(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert params(monkeypatch, "from-diagnosis", folder / "unexplained.json") == 0
    out, err = capsys.readouterr()
    assert out.startswith('name = "diagnosis of 0007.parquet"')
    assert "what the drive made up for while it was recorded is not known" in err
    assert "4 values are not ok: a flash asks for a reason" in err
    assert params(monkeypatch, "from-diagnosis", folder / "nothing.json") == 3
    out, err = capsys.readouterr()
    assert out == ""
    assert "no value is told: there is no set to write" in err


def test_estimates_become_a_set(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = folder / "set.toml"
    given = ("from-estimates", folder / "estimates.json", "--out", out)
    assert params(monkeypatch, *given, "--temp-magnet", "60", "--magnets=-0.002") == 0
    assert capsys.readouterr().out.startswith("control_L_d is left out: L_d is not told\n")
    there = read(out).entries
    assert there["control_R_s"].at_20_degC == pytest.approx(1.2 / (1 + 0.00393 * 50))
    assert there["control_psi_f"].at_20_degC == pytest.approx(0.12 / 0.92)


def test_a_warm_motors_resistance_is_told_at_20_degrees(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drive = VirtualDrive(replace(PAPER, run=replace(PAPER.run, temperature=80.0)))
    columns = drive.record(20_000)
    file, said, out = folder / "run.parquet", folder / "run.json", folder / "set.toml"
    pq.write_table(pa.table({**columns, "temp_winding": np.full(20_000, drive.read("temp_winding"))}), file)
    assert pmsm_bench(monkeypatch, "replay", file, "--periods", "10", "--json", said) == 0
    assert params(monkeypatch, "from-estimates", said, "--out", out) == 0
    R_s = read(out).entries["control_R_s"]
    assert R_s.value > 1.15 * PAPER.motor.R_s
    assert (R_s.status, R_s.at_degC) == ("ok", pytest.approx(80.0, abs=0.01))
    at_motors = (R_s.at_20_degC or 0.0) * (1.0 + 0.00393 * 3.4)  # the motor's is told at 23.4 degC
    assert at_motors == pytest.approx(PAPER.motor.R_s, rel=0.01)


def test_a_set_is_tuned_and_the_promise_is_printed(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    first, out = folder / "set.toml", folder / "tuned.toml"
    assert params(monkeypatch, "from-diagnosis", folder / "explained.json", "--out", first) == 0
    assert params(monkeypatch, "tune", first, "--bandwidth", "1000", "--T-s", "1e-4", "--out", out) == 0
    assert "current control: 1000 rad/s, phase margin 81.4 deg" in capsys.readouterr().out
    assert read(out).values["k_p_d"] == pytest.approx(1000 * 4.238e-3)
    assert params(monkeypatch, "tune", first, "--J", "1e-3", "--T-s", "1e-4") == 2
    assert "gains need n_p, speed_filter" in capsys.readouterr().err


@pytest.mark.parametrize(("arguments", "said"), [
    (("from-diagnosis", "bad.json"), "bad.json: is not JSON"),
    (("from-diagnosis", "list.json"), "list.json: expected a JSON object"),
    (("from-diagnosis", "absent.json"), "absent.json: cannot be read: No such file or directory"),
    (("from-diagnosis", "estimates.json"), "estimates.json: expected a diagnosis, with a verdict of"),
    (("from-diagnosis", "explained.json", "--bandwidth", "9"), "--bandwidth goes with --own-gains"),
    (("from-diagnosis", "explained.json", "--drive", "uart://x", "--image", "y"), "--drive or --image, got both"),
    (("from-diagnosis", "explained.json", "--image", "absent.toml"), "absent.toml: cannot be read"),
    (("from-estimates", "explained.json"), "explained.json: expected estimates of R_s, L_d, L_q, psi_f"),
    (("tune", "absent.toml"), "absent.toml: cannot be read"),
])
def test_what_cannot_be_is_refused_in_a_sentence(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...],
    said: str,
) -> None:
    monkeypatch.chdir(folder)
    assert params(monkeypatch, *arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert said in err
    assert len(err.splitlines()) == 1


@pytest.mark.live
def test_by_the_drive_and_what_its_history_says_of_a_version(folder: Path) -> None:
    def done(*arguments: str | Path) -> str:
        ran = subprocess.run(
            [*COMMAND, "params", *map(str, arguments)], capture_output=True, text=True, timeout=120.0, check=False,
            stdin=subprocess.DEVNULL,
        )  # fmt: skip
        assert ran.returncode == 0, ran
        return ran.stdout

    with served(modbus_tcp_url(), control="lease") as bench:
        with connect(bench.url) as drive:
            serial = drive.identity.serial
        for version, file in ((2, "explained.json"), (1, "explained.json")):
            out = folder / f"{version}.toml"
            done("from-diagnosis", folder / file, "--drive", bench.url, "--out", out, "--own-gains",
                 "--version", str(version), "--name", "servo")  # fmt: skip
            assert read(out).serial == serial
        assert "flashed" in done("flash", folder / "2.toml", bench.url, "--yes")
        assert "remark: version 1 is lower than that of the latest 'servo', 2 of" in done(
            "plan", folder / "1.toml", bench.url
        )
        told = json.loads(done("plan", folder / "1.toml", bench.url, "--json"))
        assert len(told["remarks"]) == 1
        done("from-estimates", folder / "estimates.json", "--drive", bench.url, "--out", folder / "e.toml")
        warm = read(folder / "e.toml")
        assert (warm.serial, warm.entries["control_R_s"].at_degC) == (serial, 70.0)
        assert warm.entries["control_psi_f"].at_degC == pytest.approx(23.4, abs=1.0)
        tuned = done("tune", folder / "2.toml", "--drive", bench.url, "--J", "1e-3", "--out", folder / "t.toml")
        assert "speed control: " in tuned
