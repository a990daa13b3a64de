"""`pmsm-bench diagnose --together`: what it says, writes and refuses of several recordings of one machine."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import jsonschema
import pyarrow
import pyarrow.parquet
import pytest

from bench.cli.commands.files.diagnose_together import names_of
from bench.diagnoses.together.published import schema
from bench.machine_file import load_machine
from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.legs import Inverter
from emulator.scenario.effects import NONE, Effects
from emulator.scenario.scenarios import PAPER, Excitation, Run, Scenario, drive_for
from tests.bench.cli.test_replay import pmsm_bench
from tests.bench.diagnoses.test_worker import alive, children
from tests.conftest import COMMAND
from tests.support.together import BOTH

pa: Any = pyarrow  # comes without types
pq: Any = pyarrow.parquet
validate: Any = jsonschema.validate  # pyright: ignore[reportUnknownMemberType]

MACHINE = """[machine]
R_s = 1.0
L_d = 4.1e-3
L_q = 6.4e-3
psi_f = 0.118
n_p = 4
"""
DEAD_TIME = 6e-7  # s
BY_NAME = [sys.executable, "-c", "import bench.cli.commands.files.diagnose_together as d\n"
           "d.WORK = 'tests.support.together:work'\nfrom bench.cli.main import main; main()"]  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to be in, with a machine file, where diagnoses go by the name of the first file."""
    monkeypatch.setattr("bench.cli.commands.files.diagnose_together.WORK", "tests.support.together:work")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "140")
    (tmp_path / "m.toml").write_text(MACHINE, encoding="utf-8")
    return tmp_path


def together(*arguments: str | Path, monkeypatch: pytest.MonkeyPatch) -> int:
    return pmsm_bench("diagnose", "--together", *arguments, "--nominal", "m.toml", monkeypatch=monkeypatch)


@pytest.mark.parametrize(
    ("name", "code"),
    [("explained", 0), ("no_mismatch", 0), ("ambiguous", 3), ("unexplained", 1), ("nothing_told", 3), ("refused", 2),
     ("broken", 70)],
)  # fmt: skip
def test_the_exit_code_is_the_verdict(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str, code: int
) -> None:
    options = ("--json", "o.json", "--report", "o.html", "--machine", "o.toml")
    assert together(f"{name}.csv", "warm.csv", *options, monkeypatch=monkeypatch) == code
    said = capsys.readouterr()
    assert said.err.count("\n") == (code in (2, 70))
    there = {path.suffix for path in folder.glob("o.*")}
    if code in (2, 70):
        assert (said.out, there) == ("", set())
        if code == 70:
            Path(said.err.rpartition(" the details are in ")[2].strip()).unlink()
        return
    validate(json.loads((folder / "o.json").read_text(encoding="utf-8")), schema())
    assert said.out.startswith(f"{name}, warm: ")
    assert there == ({".json", ".html"} if name == "nothing_told" else {".json", ".html", ".toml"})
    assert ("no machine file: nothing could be fitted" in said.out) == (name == "nothing_told")


def test_a_named_effect_fails_where_that_is_asked_for(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert together("explained.csv", "b.csv", "--fail-on", "explained", monkeypatch=monkeypatch) == 1


def test_it_says_the_machine_effects_and_differences_with_a_row_for_each_recording(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert together("cold.csv", "warm.csv", "--trust", "R_s=20%", monkeypatch=monkeypatch) == 0
    said = capsys.readouterr().out
    assert said.startswith(f"cold, warm: explained\n{BOTH.sentence}\n")
    rows = [" ".join(line.replace("│", " ").split()) for line in said.splitlines()]
    for row in (
        "cold 0.96680 ± 0.00078 ohm 4.2380 ± 0.0059 mH 6.2120 ± 0.0059 mH 119.990 ± 0.020 mVs",
        "warm 1.02480 ± 0.00098 ohm 4.2390 ± 0.0059 mH – 119.980 ± 0.020 mVs",
        "all as one differs 4.2385 ± 0.0041 mH 6.2120 ± 0.0059 mH 119.985 ± 0.014 mVs",
        "inverter voltage error cold dead time 0.0000 ± 0.0059 us", "warm dead time 2.000 ± 0.059 us",
        "all as one dead time differs over 1e12", "all as one L_d drop 12.05 ± 0.55 % 250",
        "R_s cold warm 58.0 ± 1.3 mohm 6.00 ± 0.13 %", "inverter voltage error dead time cold warm 2.000 ± 0.059 us",
        "warm: rows lost, by the times: 3", "cold: trust {'R_s': 0.2}",
    ):
        assert row in rows, said


def test_what_cannot_be_told_is_said_with_what_would_tell(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert together("ambiguous.csv", "warm.csv", monkeypatch=monkeypatch) == 3
    said = capsys.readouterr().out
    assert "iron loss or winding resistance drift? they are collinear to 0.99 here" in said
    assert "to tell: record 500 and 2000 rpm at the same currents" in said


def test_json_may_stand_in_place_of_words(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert together("explained.csv", "b.csv", "--json", "-", monkeypatch=monkeypatch) == 0
    content = json.loads(capsys.readouterr().out)
    validate(content, schema())
    assert content["recordings"] == ["explained", "b"]


def test_recordings_are_called_by_stem_or_as_much_of_their_path_as_tells_them_apart() -> None:
    def names(*files: str) -> list[str]:
        return names_of([Path(file) for file in files])

    assert names("a/run.csv.gz", "b/rest.parquet") == ["run", "rest"]
    assert names("run.csv", "run.parquet", "x.csv") == ["run.csv", "run.parquet", "x"]
    assert names("m/a/run.csv", "m/b/run.csv", "n/b/run.csv") == ["a/run.csv", "m/b/run.csv", "n/b/run.csv"]
    assert names("run.csv", "b/run.csv.csv", "b/run.csv") == names("run.csv", "b/run.csv.csv", "b/run.csv")
    assert len(set(names("run.csv", "b/run.csv.csv", "b/run.csv"))) == 3


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["a.csv", "--nominal", "m.toml"], "--together: expected two recordings or more, got 1"),
        (["a.csv", "./a.csv", "--nominal", "m.toml"], "--together: a.csv: expected each recording once"),
        (["a.csv", "b.csv"], "--together: recordings of one machine need its data, expected --nominal MACHINE.toml"),
        (["a.csv", "b.csv", "--nominal", "."], "--nominal: expected one machine file for all recordings with "
                                               "--together, got a folder"),
        (["a.csv", "b.csv", "--nominal", "{stem}.toml"], "--nominal: expected one machine file for all recordings "
                                                         "with --together, got a name with {stem}"),
        (["a.csv", "b.csv", "--nominal", "absent.toml"], "absent.toml: cannot be read: No such file or directory"),
        (["a.csv", "b.csv", "--nominal", "m.toml", "--json", "out/"], "--json: expected one file for all recordings "
                                                                      "with --together, got a folder"),
        (["a.csv", "b.csv", "--nominal", "m.toml", "--report", "{stem}.html"], "--report: expected one file for all"),
        (["a.csv", "b.csv", "--nominal", "m.toml", "--json", "b.csv"], "--json: b.csv: expected a file of its own, "
                                                                       "this is a recording"),
        (["a.csv", "b.csv", "--nominal", "m.toml", "--machine", "m.toml", "--force"], "this is the machine file"),
        (["a.csv", "b.csv", "--nominal", "m.toml", "--json", "there.json"], "--json: there.json exists already"),
        (["a.csv", "b.csv", "--nominal", "m.toml", "--json", "x/y.json"], "x/y.json: cannot be written: No such file"),
        (["a.csv", "b.csv", "--nominal", "m.toml", "--jobs", "2"], "--jobs: one diagnosis has one process, expected"),
        (["a.csv", "b.csv", "--nominal", "m.toml", "--fail-on", "rain"], "--fail-on: expected unexplained or"),
    ],
    ids=str,
)
def test_what_cannot_be_is_one_sentence_before_any_work(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    (folder / "there.json").write_text("mine", encoding="utf-8")
    assert pmsm_bench("diagnose", "--together", *arguments, monkeypatch=monkeypatch) == 2
    error = capsys.readouterr().err
    assert error.startswith("pmsm-bench: ")
    assert error.count("\n") == 1
    assert said in error
    assert (folder / "there.json").read_text(encoding="utf-8") == "mine"


def test_a_verdict_is_told_also_where_its_output_cannot_be_written_after_all(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ("--json", "/dev/full", "--report", "r.html")
    assert together("explained.csv", "b.csv", *options, monkeypatch=monkeypatch) == 2
    said = capsys.readouterr()
    assert said.out.startswith(f"explained, b: explained\n{BOTH.sentence}\n")
    assert said.err == "pmsm-bench: /dev/full: cannot be written: No space left on device\n"
    assert (folder / "r.html").is_file()


def test_ctrl_c_ends_it_with_its_process(folder: Path) -> None:
    with subprocess.Popen(
        [*BY_NAME, "diagnose", "--together", "endless.csv", "b.csv", "--nominal", "m.toml", "--json", "o.json"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    ) as process:
        while not (workers := children(process.pid)):
            assert process.poll() is None
        process.send_signal(signal.SIGINT)
        out, error = process.communicate(timeout=20)
    assert (process.returncode, out, error) == (130, "", "")
    assert not any(map(alive, workers))
    assert not (folder / "o.json").exists()


# --- recordings of the emulated drive


def record(path: Path, effects: Effects = NONE, warmer: float = 0.0, seed: int = 1) -> None:
    """A recording; `warmer`: share by which R_s is higher, a quarter of that by which psi_f is lower."""
    motor = PAPER.motor._replace(R_s=PAPER.motor.R_s * (1.0 + warmer), psi_f=PAPER.motor.psi_f * (1.0 - 0.25 * warmer))
    drive = drive_for(PAPER.motor, noise_i=0.02, bridge="switched", encoder_counts=0)
    run = Run(speed_rpm=1200.0, swing_rpm=600.0, seed=seed)
    around = Excitation(i_q_ref=3.0, i_d_step=1.5, i_q_step=1.5)
    emulated = VirtualDrive(Scenario("one of several", motor, drive, run, around, effects))
    emulated.run(2000)
    pq.write_table(pa.table(dict(emulated.record(12_000))), path)


@pytest.mark.thorough
def test_two_recordings_of_the_emulated_drive_are_one_diagnosis(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("m.toml").write_text(MACHINE, encoding="utf-8")
    record(Path("cold.parquet"))
    record(Path("warm.parquet"), NONE._replace(inverter=Inverter(dead_time=DEAD_TIME)), warmer=0.06, seed=2)
    done = subprocess.run(
        [*COMMAND, "diagnose", "--together", "cold.parquet", "warm.parquet", "--nominal", "m.toml", "--json", "o.json",
         "--report", "o.html", "--machine", "o.toml"],
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stderr.replace("pmsm-bench: compiling, once: most of a minute\n", "") == ""
    assert done.stdout.startswith("cold, warm: explained\n")
    content = json.loads(Path("o.json").read_text(encoding="utf-8"))
    validate(content, schema())
    assert [one["verdict"] for one in content["diagnoses"]] == ["no_mismatch", "explained"]
    assert {(one["what"], one["parameter"]) for one in content["differences"]} == {
        ("R_s", ""), ("psi_f", ""), ("inverter_voltage_error", "dead_time"),
    }  # fmt: skip
    found = load_machine(Path("o.toml"))
    motor = PAPER.motor
    assert found.given["R_s"] == pytest.approx(1.06 * motor.R_s, rel=2e-3)
    for name in ("L_d", "L_q"):
        assert found.given[name] == pytest.approx(getattr(motor, name), rel=2e-3)
    assert found.effects["inverter_voltage_error"]["dead_time"] == pytest.approx(DEAD_TIME, rel=0.05)
    assert found.equations["inverter_voltage_error"][0] == pytest.approx(DEAD_TIME, rel=0.05)
    simulated = subprocess.run(
        [*COMMAND, "simulate", "warm.parquet", "--machine", "o.toml"], capture_output=True, text=True, timeout=120,
        check=False,
    )
    assert "with inverter voltage error" in simulated.stdout


def test_a_copy_of_a_recording_is_no_second_one(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("a.csv", "copy.csv"):
        (folder / name).write_text("t,i_d\n0,1\n", encoding="utf-8")
    assert together("a.csv", "copy.csv", monkeypatch=monkeypatch) == 2
    said = capsys.readouterr().err
    assert said == "pmsm-bench: --together: copy.csv has all bytes of a.csv: expected each recording once\n"
