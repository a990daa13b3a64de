"""`pmsm-bench replay` over recordings of the emulated drive and a real one; what it refuses, in one sentence."""

import csv
import gzip
import json
import math
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
from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER
from tests.conftest import COMMAND

pytestmark = pytest.mark.live

pa: Any = pyarrow  # comes without types
pq: Any = pyarrow.parquet

TRUTH = {"R_s": 0.9664, "L_d": 4.24e-3, "L_q": 6.21e-3, "psi_f": 0.12}  # ohm, H, H, Vs
PERIODS = 20_000  # of 1e-4 s

MACHINE = "[machine]\nR_s = 0.9664\nL_d = 4.24e-3\nL_q = 6.21e-3\npsi_f = 0.12\n[drive]\nT_s = 1e-4\n"


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one recording in every format, and a machine file."""
    folder = tmp_path_factory.mktemp("recordings")
    columns = VirtualDrive(PAPER).record(PERIODS)
    with (folder / "run.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
    (folder / "run.csv.gz").write_bytes(gzip.compress((folder / "run.csv").read_bytes()))
    pq.write_table(pa.table(dict(columns)), folder / "run.parquet")
    (folder / "machine.toml").write_text(MACHINE, encoding="utf-8")
    return folder


def pmsm_bench(*arguments: str | Path, monkeypatch: pytest.MonkeyPatch) -> int:
    """The console script in this process; its exit code."""
    monkeypatch.setattr(sys, "argv", ["pmsm-bench", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def expect_truth(content: dict[str, Any], *names: str, within: float = 5e-3) -> None:
    for name in names or TRUTH:
        estimate = content["estimates"][name]
        assert estimate["status"] == "ok"
        assert estimate["value"] == pytest.approx(TRUTH[name], rel=within), (name, estimate)
        assert 0.0 < estimate["std"] < within * TRUTH[name]


@pytest.mark.parametrize("name", ["run.csv", "run.csv.gz", "run.parquet"])
def test_a_recording_of_the_emulated_drive_tells_all_four_parameters(
    recordings: Path, tmp_path: Path, name: str
) -> None:
    out, track = tmp_path / "result.json", tmp_path / "track.csv"
    done = subprocess.run(
        [*COMMAND, "replay", recordings / name, "--json", out, "--csv", track, "--window", "15000", "--periods", "10",
         "--every", "2500"],
        capture_output=True, text=True, timeout=60, check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    content = json.loads(out.read_text(encoding="utf-8"))
    expect_truth(content)
    assert (content["samples"], content["gaps"]) == (15_000, 0)
    assert content["window"]["periods_per_row"] == 10
    assert (content["recording"]["rows"], content["recording"]["used"]) == (PERIODS, PERIODS)
    for unit in ("ohm", "mH", "mVs"):
        assert unit in done.stdout
    with track.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["t"]) for row in rows] == pytest.approx([0.25 * k for k in range(1, 9)])
    assert rows[-1]["samples"] == "15000"
    for parameter, value in TRUTH.items():
        assert float(rows[-1][parameter]) == content["estimates"][parameter]["value"]
        assert float(rows[0][parameter]) == pytest.approx(value, rel=0.03)
        assert float(rows[0][f"{parameter}_std"]) > float(rows[-1][f"{parameter}_std"])
        assert rows[0][f"{parameter}_status"] == "ok"


def test_one_period_a_row_and_the_whole_file_are_the_default(
    recordings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "result.json"
    assert pmsm_bench("replay", recordings / "run.parquet", "--json", out, monkeypatch=monkeypatch) == 0
    content = json.loads(out.read_text(encoding="utf-8"))
    expect_truth(content)
    assert content["samples"] == PERIODS - 1


def test_temperatures_of_the_rows_that_it_rests_on_stand_beside(
    recordings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    columns = VirtualDrive(PAPER).record(PERIODS)
    warm = np.linspace(20.0, 60.0, PERIODS)
    warm[::7] = math.nan  # not every row has one
    file, out = tmp_path / "warm.parquet", tmp_path / "result.json"
    pq.write_table(pa.table({**columns, "temp_winding": warm}), file)
    for options, at in (((), 40.0), (("--window", "1000"), 59.0)):
        assert pmsm_bench("replay", file, "--json", out, *options, monkeypatch=monkeypatch) == 0
        told = json.loads(out.read_text(encoding="utf-8"))
        assert told["temperatures_degC"] == {"temp_winding": pytest.approx(at, abs=0.1)}
        out.unlink()
    assert pmsm_bench("replay", recordings / "run.parquet", "--json", out, monkeypatch=monkeypatch) == 0
    assert json.loads(out.read_text(encoding="utf-8"))["temperatures_degC"] == {}


def test_a_phase_current_of_the_wrong_sign_or_none_leaves_no_value_ok(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    columns = {name: np.asarray(column) for name, column in VirtualDrive(PAPER).record(6000).items()}
    theta_e = columns["theta_e"]
    i = columns["i_d"] + 1j * columns["i_q"]
    phases = [(i * np.exp(1j * (theta_e - 2.0 * np.pi * k / 3.0))).real for k in range(3)]

    def told(*sensors: Any) -> tuple[dict[str, Any], int]:
        a, b, c = sensors
        wrong = ((2.0 * a - b - c) / 3.0 + 1j * (b - c) / math.sqrt(3.0)) * np.exp(-1j * theta_e)
        file, out = tmp_path / "phases.parquet", tmp_path / "result.json"
        made = {"i_d": wrong.real, "i_q": wrong.imag, "i_a": a, "i_b": b, "i_c": c}
        pq.write_table(pa.table({**columns, **made}), file)
        code = pmsm_bench("replay", file, "--json", out, monkeypatch=monkeypatch)
        content = json.loads(out.read_text(encoding="utf-8"))
        out.unlink()
        return content, code

    content, code = told(*phases)
    assert code == 0
    expect_truth(content)
    assert not any("i_b" in remark for remark in content["remarks"])
    for sensors, says in (
        ((phases[0], -phases[1], phases[2]), "-(i_a + i_c): i_b has the wrong sign"),
        ((phases[0], 0.0 * phases[1], phases[2]), "i_b is 0 in all rows while i_a and i_c are not"),
    ):
        content, code = told(*sensors)
        assert code != 0
        assert all(e["status"] != "ok" for e in content["estimates"].values())
        assert all(says in e["reason"] for e in content["estimates"].values() if e["status"] == "doubtful")
        (remark,) = (remark for remark in content["remarks"] if says in remark)
        assert "i_d and i_q are made of it" in remark
        assert remark.endswith("pmsm-bench diagnose corrects them")


def test_a_machine_file_of_another_convention_and_voltages_by_two_are_asked_about(
    recordings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def remarks(machine: str, *options: str) -> str:
        file, out = tmp_path / "machine.toml", tmp_path / "result.json"
        file.write_text(machine, encoding="utf-8")
        pmsm_bench("replay", recordings / "run.parquet", "--nominal", file, "--json", out, *options,
                   monkeypatch=monkeypatch)  # fmt: skip
        content = json.loads(out.read_text(encoding="utf-8"))
        out.unlink()
        return " ".join(content["remarks"])

    terminal = "[machine]\nR_s = 1.9328\nL_d = 8.48e-3\nL_q = 12.42e-3\npsi_f = 0.12\n"
    assert "R_s, L_d and L_q of the machine file are twice the recording's: are they from terminal to terminal? " \
        "Per phase is half; or the currents are twice what they are" in remarks(terminal)  # fmt: skip
    line = MACHINE.replace("psi_f = 0.12", "psi_f = 0.20785")
    assert "psi_f of the machine file is sqrt(3) times the recording's: is it a line-to-line constant?" in remarks(line)
    twice = remarks(MACHINE, "--map", "u_d=u_d*2,u_q=u_q*2")
    assert "are 2, 2, 2 and 2 times the nominal ones: the voltages are twice what they are" in twice
    assert "times the nominal ones" not in remarks(MACHINE)


TUNING = """preset = "custom"
model = "inductances"
P_0 = [1e-4, 1e-4, 0.1, 1e-6, 4e-6]
Q = [0, 0, 1e-5, 1e-11, 1e-11]
R = [1e-4, 1e-4]
"""


@pytest.mark.parametrize(
    ("options", "said", "told"),
    [
        (["--method", "rls", "--periods", "10"], "recursive least squares, 19999 samples, forgetting factor 1,", 4),
        (["--method", "rls", "--periods", "10", "--forgetting-factor", "0.999"], "forgetting factor 0.999,", 4),
        (["--method", "ekf"], "extended Kalman filter (tuned), 19999 samples,", 3),
        (["--method", "ekf", "--ekf", "{folder}/tuning.toml"], "extended Kalman filter (custom), 19999 samples,", 3),
        (["--window", "auto", "--longest", "15000", "--periods", "10"],
         "windows chosen by the data, from the last 15000 samples", 4),
    ],
    ids=["rls", "rls that forgets", "ekf", "ekf of a file", "auto"],
)
def test_each_method_tells_the_motor_from_a_recording_and_says_what_it_rests_on(
    recordings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    options: list[str], said: str, told: int,
) -> None:
    (recordings / "off.toml").write_text(MACHINE.replace("0.9664", "0.9").replace("6.21e-3", "6e-3"), encoding="utf-8")
    (recordings / "tuning.toml").write_text(TUNING, encoding="utf-8")
    out, track = tmp_path / "result.json", tmp_path / "track.csv"
    assert pmsm_bench(
        "replay", recordings / "run.parquet", "--nominal", recordings / "off.toml", "--json", out, "--csv", track,
        "--every", "5000", *(option.format(folder=recordings) for option in options), monkeypatch=monkeypatch,
    ) == 0
    content = json.loads(out.read_text(encoding="utf-8"))
    expect_truth(content, *list(TRUTH)[:told], within=0.01)
    assert content["estimates"]["psi_f"]["status"] == ("ok" if told == 4 else "held")
    assert content["method"] == content["window"]["method"]
    shown = " ".join(capsys.readouterr().out.split())
    assert said in shown
    with track.open(encoding="utf-8") as file:
        last = list(csv.DictReader(file))[-1]
    for name in TRUTH:
        chosen = content["estimates"][name]["window"]
        assert last[f"{name}_window"] == ("" if chosen is None else str(chosen))
        assert (chosen is None) == ("auto" not in options)
        assert chosen is None or f" {chosen} " in shown
    assert float(last["R_s"]) == content["estimates"]["R_s"]["value"]


def test_an_option_that_has_no_part_in_the_method_is_told(
    recordings: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    idle = ("--window", "5000", "--periods", "2", "--longest", "9000", "--forgetting-factor", "0.99")
    options = ("--method", "ekf", "--nominal", recordings / "machine.toml", *idle)
    assert pmsm_bench("replay", recordings / "run.csv", *options, monkeypatch=monkeypatch) == 0
    said = capsys.readouterr().out
    for option in ("--window", "--periods", "--longest", "--forgetting-factor"):
        assert f"{option} has no part in this: " in said


def test_the_step_of_the_encoder_goes_into_the_intervals(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An encoder that cuts its angle off is half a count behind, which reads as L_q."""
    machine, file, out = tmp_path / "machine.toml", tmp_path / "run.parquet", tmp_path / "result.json"
    coarse = replace(PAPER, drive=replace(PAPER.drive, encoder_counts=4096))
    pq.write_table(pa.table(dict(VirtualDrive(coarse).record(PERIODS))), file)
    machine.write_text(MACHINE.replace("[drive]", "n_p = 4\n[drive]\nencoder_counts = 4096"), encoding="utf-8")
    options = ("--periods", "10", "--nominal", machine, "--json", out)
    assert pmsm_bench("replay", file, *options, monkeypatch=monkeypatch) == 0
    L_q = json.loads(out.read_text(encoding="utf-8"))["estimates"]["L_q"]
    off = abs(L_q["value"] / TRUTH["L_q"] - 1.0)
    assert 0.005 < off < 1.96 * L_q["std"] / TRUTH["L_q"] < 0.05


def test_what_cannot_be_told_apart_is_told_once_for_all_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    steady = replace(PAPER, excitation=replace(PAPER.excitation, i_d_ref=-1.0, i_d_step=0.0, i_q_step=0.0))
    file, out = tmp_path / "steady.parquet", tmp_path / "result.json"
    drive = VirtualDrive(steady)
    drive.run(2000)  # until the currents have settled
    pq.write_table(pa.table(dict(drive.record(3000))), file)
    assert pmsm_bench("replay", file, "--periods", "10", "--json", out, monkeypatch=monkeypatch) == 3
    (told,) = json.loads(out.read_text(encoding="utf-8"))["combinations"]
    assert len(told["parameters"]) > 1
    assert " ".join(capsys.readouterr().out.split()).count(told["reason"]) == 1


def test_what_is_not_estimated_is_held_at_the_nominal_value(
    recordings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "result.json"
    assert pmsm_bench(
        "replay", recordings / "run.csv", "--estimate", "R_s,L_q", "--nominal", recordings / "machine.toml",
        "--json", out, monkeypatch=monkeypatch,
    ) == 0
    content = json.loads(out.read_text(encoding="utf-8"))
    expect_truth(content, "R_s", "L_q")
    for name in ("L_d", "psi_f"):
        told = content["estimates"][name]
        assert (told["value"], told["std"], told["status"]) == (TRUTH[name], None, "held")
    assert "held" in capsys.readouterr().out


def test_a_real_servo_at_standstill_has_its_resistance_and_inductance(
    shared_recordings: Path, tmp_path: Path
) -> None:
    out = tmp_path / "result.json"
    done = subprocess.run(
        [*COMMAND, "replay", shared_recordings / "servo_standstill" / "current_steps.csv", "--map", "u_q=vqd,i_q=Iq",
         "--set", "omega_e=0,i_d=0,u_d=0", "--align", "u=0.5", "--periods", "20", "--json", out],
        capture_output=True, text=True, timeout=60, check=False,
    )
    assert (done.returncode, done.stderr) == (1, "")  # 24 mV of its voltage stay unexplained
    told = json.loads(out.read_text(encoding="utf-8"))["estimates"]
    assert {told[name]["status"] for name in ("R_s", "L_q")} == {"doubtful"}
    assert told["R_s"]["value"] == pytest.approx(0.163, abs=2e-3)
    assert told["L_q"]["value"] == pytest.approx(124e-6, abs=4e-6)
    assert 0.0 < told["R_s"]["std"] < 0.01
    assert 0.0 < told["L_q"]["std"] < 10e-6
    for name in ("L_d", "psi_f"):
        assert (told[name]["value"], told[name]["std"], told[name]["status"]) == (None, None, "not_told")
        assert told[name]["reason"]
    assert "motor stands still" in " ".join(done.stdout.split())


@pytest.fixture(scope="module")
def spoilt(recordings: Path) -> Path:
    """The folder with files added that cannot be recordings or machine files."""
    lines = SHORT.splitlines(keepends=True)
    contents = {
        "missing.csv": "t,u_d,u_q,i_d\n0,1,1,1\n1,1,1,1\n",
        "empty.csv": "",
        "backwards.csv": "".join(lines[:32] + lines[12:]),
        "text.csv": "".join([*lines[:12], lines[12].replace("0.2", "x0.2")]),
        "slow.toml": MACHINE.replace("T_s = 1e-4", "T_s = 1e-3"),
        "zero.toml": MACHINE.replace("R_s = 0.9664", "R_s = 0"),
    }
    for name, content in contents.items():
        (recordings / name).write_text(content, encoding="utf-8")
    for name in ("run.csv.gz", "run.parquet"):
        whole = (recordings / name).read_bytes()
        (recordings / name.replace("run", "cut")).write_bytes(whole[: len(whole) // 2])
    return recordings


RUN = "{folder}/run.csv"
SHORT = "t,u_d,u_q,i_d,i_q,omega_e\n" + "".join(f"{k * 1e-4:.4f},1,2,0.1,0.2,100\n" for k in range(50))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["absent.csv"], "absent.csv: cannot be read: No such file or directory"),
        ([RUN, "--window", "0"], "length must be 4 (4 parameters x 1 periods per row) to 1000000 samples, got 0"),
        ([RUN, "--window", "-5"], "to 1000000 samples, got -5"),
        ([RUN, "--window", "3"], "to 1000000 samples, got 3"),
        ([RUN, "--window", "2000000"], "to 1000000 samples, got 2000000"),
        ([RUN, "--window", "many"], "--window: expected a whole number of samples or auto, got 'many'"),
        ([RUN, "--window", "auto", "--longest", "3"], "longest: window length must be 4 (4 parameters"),
        ([RUN, "--method", "kalman"], "method: expected wls, rls or ekf, got 'kalman'"),
        ([RUN, "--method", "rls", "--forgetting-factor", "0.1"], "forgetting_factor: expected a number of 0.99 to 1"),
        ([RUN, "--method", "ekf"], "--method ekf: expected start values by --nominal MACHINE.toml, got none"),
        ([RUN, "--ekf", "good"], "--ekf: expected tuned, paper or a TOML file, got 'good'"),
        ([RUN, "--ekf", "{folder}/slow.toml"], "slow.toml: expected preset = \"tuned\", \"paper\" or \"custom\""),
        ([RUN, "--periods", "0"], "periods per row must be 1 to 1000, got 0"),
        ([RUN, "--window", "40", "--periods", "11"], "window length must be 44 (4 parameters x 11 periods per row)"),
        ([RUN, "--estimate", "R_s"], "L_d is not estimated, so a held value in H is needed, got none"),
        ([RUN, "--estimate", "R"], "estimated: expected R_s, L_d, L_q, psi_f, got 'R'"),
        ([RUN, "--estimate", ","], "estimated: expected at least one of R_s, L_d, L_q, psi_f, got none"),
        ([RUN, "--every", "0"], "--every: expected at least 1 row, got 0"),
        ([RUN, "--map", "u_q"], "--map: expected NAME=COLUMN[,...], got 'u_q'"),
        ([RUN, "--map", "u_q=u_q,u_q=i_q"], "--map: u_q is given twice"),
        ([RUN, "--map", "u_q=absent"], "no column 'absent' for u_q; present: t, u_d, u_q"),
        ([RUN, "--set", "u_q=x"], "--set: expected NAME=NUMBER[,...], got 'u_q=x'"),
        ([RUN, "--set", "u_q=nan"], "constant u_q = nan: expected a finite number"),
        ([RUN, "--align", "i=1"], "cannot align 'i', expected u (both voltages)"),
        ([RUN, "--nominal", "absent.toml"], "absent.toml: cannot be read"),
        ([RUN, "--nominal", "{folder}/slow.toml"], "expected T_s = 0.001 s, the times say 0.0001 s"),
        ([RUN, "--nominal", "{folder}/zero.toml"], "[machine] R_s = 0: expected a finite number of ohm above zero"),
        ([RUN, "--json", RUN], "run.csv: expected a file of its own, this is the recording or the other output"),
        ([RUN, "--csv", "{folder}/../{name}/run.csv"], "expected a file of its own"),
        ([RUN, "--csv", "{folder}/out", "--json", "{folder}/out"], "expected a file of its own"),
        ([RUN, "--json", "{folder}/machine.toml"], "machine.toml exists already, expected a new file"),
        ([RUN, "--csv", "{folder}/machine.toml"], "machine.toml exists already, expected a new file"),
        ([RUN, "--json", "{folder}/absent/out.json"], "cannot be written: No such file or directory"),
        ([RUN, "--json", "{folder}/" + 300 * "x"], "cannot be written: File name too long"),
        ([RUN, "--csv", "{folder}"], "cannot be written: Is a directory"),
        (["{folder}/missing.csv"], "missing columns: i_q, omega_e; present: t, u_d, u_q, i_d;"),
        (["{folder}/backwards.csv"], "time runs backwards: expected more than 0.003 s (row 31), came 0.0011 s"),
        (["{folder}/text.csv"], "column 'i_q', row 12: expected a number, came 'x0.2'"),
        (["{folder}/cut.csv.gz"], "the gzip file is cut short"),
        (["{folder}/cut.parquet"], "the Parquet file is cut short: expected a footer at its end, found none"),
        (["{folder}/empty.csv"], "the file is empty, expected a header line and rows"),
    ],
    ids=lambda value: value[:40] if isinstance(value, str) else None,
)
def test_what_cannot_be_replayed_is_one_sentence_and_exit_code_2(
    spoilt: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    before = (spoilt / "run.csv").stat()
    filled = [argument.format(folder=spoilt, name=spoilt.name) for argument in arguments]
    assert pmsm_bench("replay", *filled, monkeypatch=monkeypatch) == 2
    error = capsys.readouterr().err
    assert error.startswith("pmsm-bench: ")
    assert error.count("\n") == 1
    assert said in error
    after = (spoilt / "run.csv").stat()
    assert (after.st_size, after.st_mtime_ns) == (before.st_size, before.st_mtime_ns)


def test_a_speed_that_contradicts_the_angle_is_told(
    recordings: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert pmsm_bench("replay", recordings / "run.csv", "--set", "omega_e=100", monkeypatch=monkeypatch) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "theta_e turns at 502.7 rad/s on average, but omega_e says 100 rad/s" in said
    assert pmsm_bench("replay", recordings / "run.csv", monkeypatch=monkeypatch) == 0
    assert "omega_e says" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["--map", "t=t*0.5"], 1, "control periods of 0.0001 s, or another angle or speed would be right"),
        (["--map", "t=t*0.001"], 1, "control periods of 0.0001 s, or another angle or speed would be right"),
        (["--map", "omega_e=omega_e*9.5493"], 0, "seems to be electrical and in rpm; the estimates rest on theta_e"),
        (["--map", "omega_e=omega_e*0.25"], 1, "control periods of 0.0004 s, or another angle or speed would be right"),
        (["--map", "omega_e=omega_e*0.25", "--set", "n_p=4"], 1, "control periods of 0.0004 s, or"),
        (["--map", "omega_e=omega_e*0.25", "--set", "n_p=4", "--nominal", "{folder}/machine.toml"], 0,
         "seems to be mechanical and in rad/s; the estimates rest on theta_e"),
        (["--map", "omega_e=elsewhere"], 0, "but omega_e says"),
    ],
    ids=["half the period", "a thousandth", "rpm", "a quarter", "pole pairs", "a nominal machine", "no speed at all"],
)  # fmt: skip
@pytest.mark.parametrize("method", ["wls", "rls"])
def test_a_speed_in_step_with_the_angle_at_another_rate_leaves_no_estimate_sure_unless_it_is_a_unit(
    recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
    arguments: list[str], code: int, said: str, method: str,
) -> None:
    table = pq.read_table(recordings / "run.parquet")
    elsewhere = table["omega_e"].to_numpy() * (0.5 + 0.3 * np.sin(40.0 * table["t"].to_numpy()))
    pq.write_table(table.append_column("elsewhere", pa.array(elsewhere)), tmp_path / "run.parquet")
    filled = [argument.format(folder=recordings) for argument in arguments]
    out = tmp_path / "result.json"
    found = pmsm_bench(
        "replay", tmp_path / "run.parquet", *filled, "--method", method, "--json", out, monkeypatch=monkeypatch
    )
    statuses = {estimate["status"] for estimate in json.loads(out.read_text(encoding="utf-8"))["estimates"].values()}
    assert (found, statuses) == (code, {"doubtful"} if code else {"ok"})
    assert said in " ".join(capsys.readouterr().out.split())


def test_a_speed_in_another_unit_without_an_angle_is_asked_for_and_read_right_as_the_remark_says(
    recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    table = pq.read_table(recordings / "run.parquet").drop_columns(["theta_e"])
    of_speed = table.column_names.index("omega_e")
    rpm = table["omega_e"].to_numpy() * 60.0 / (2.0 * math.pi * 4)
    file = tmp_path / "rpm.parquet"
    pq.write_table(table.set_column(of_speed, "omega_e", pa.array(rpm)), file)
    assert pmsm_bench("replay", file, monkeypatch=monkeypatch) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert "is omega_e mechanical and in rpm, of 4 pole pairs? --map omega_e=COLUMN*0.418879" in said
    assert pmsm_bench("replay", file, "--set", "n_p=4", monkeypatch=monkeypatch) == 1
    assert "is omega_e mechanical and in rpm? --map" in " ".join(capsys.readouterr().out.split())
    out = tmp_path / "result.json"
    right = ["--map", "omega_e=omega_e*0.418879", "--json", out]
    assert pmsm_bench("replay", file, *right, monkeypatch=monkeypatch) == 0
    assert "another speed" not in capsys.readouterr().out
    expect_truth(json.loads(out.read_text(encoding="utf-8")))


def test_a_window_as_short_as_its_parameters_is_taken_and_tells_nothing(
    recordings: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = ("--window", "3", "--estimate", "R_s,L_d,L_q", "--nominal", recordings / "machine.toml")
    assert pmsm_bench("replay", recordings / "run.csv", *options, monkeypatch=monkeypatch) == 3


@pytest.mark.parametrize("method", ["wls", "rls", "ekf"])
def test_values_of_equations_that_do_not_fit_are_doubtful_by_every_method_and_the_exit_code_says_so(
    recordings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], method: str
) -> None:
    off, out, track = tmp_path / "off.parquet", tmp_path / "result.json", tmp_path / "track.csv"
    columns = dict(VirtualDrive(PAPER).record(PERIODS))
    turn = np.exp(0.5j)  # an angle that is read 0.5 rad high
    for d, q in (("i_d", "i_q"), ("u_d", "u_q")):
        x = (columns[d] + 1j * columns[q]) * turn
        columns[d], columns[q] = x.real, x.imag
    pq.write_table(pa.table(columns), off)
    options = ("--method", method, "--nominal", recordings / "machine.toml", "--json", out, "--csv", track)
    assert pmsm_bench("replay", off, *options, monkeypatch=monkeypatch) == 1
    content = json.loads(out.read_text(encoding="utf-8"))
    assert content["mismatch"]["status"] == "unexplained"
    assert content["mismatch"]["rms_V"] > content["mismatch"]["least_V"]
    estimates = content["estimates"].values()
    assert "ok" not in {e["status"] for e in estimates}
    assert all(e["reason"] for e in estimates if e["status"] == "doubtful")
    assert "The model does not explain the recording, from 0 to 2 s" in capsys.readouterr().out
    with track.open(encoding="utf-8") as file:
        assert not {row[f"{name}_status"] for row in csv.DictReader(file) for name in TRUTH} & {"ok"}


@pytest.mark.parametrize("method", ["wls", "rls", "ekf"])
@pytest.mark.parametrize(
    ("column", "value"), [("i_q", 3.0e5), ("i_d", 2.5), ("u_q", -40.0), ("u_d", 1e4), ("theta_e", 0.3), ("i_q", -3.1)]
)
def test_one_cell_that_was_changed_is_left_out_with_a_remark_and_moves_nothing(
    recordings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    method: str, column: str, value: float,
) -> None:
    told: list[dict[str, Any]] = []
    columns = VirtualDrive(PAPER).record(6000)
    for k in range(2):
        file, out = tmp_path / f"{k}.parquet", tmp_path / f"{k}.json"
        if k == 1:
            columns[column][4321] += value
        pq.write_table(pa.table(dict(columns)), file)
        options = ("--method", method, "--nominal", recordings / "machine.toml", "--json", out)
        assert pmsm_bench("replay", file, *options, monkeypatch=monkeypatch) == 0
        told.append(json.loads(out.read_text(encoding="utf-8")))
    for name, e in told[1]["estimates"].items():
        before = told[0]["estimates"][name]
        assert e["status"] == before["status"]
        assert e["std"] is None or abs(e["value"] - before["value"]) < e["std"], name
    (remark,) = set(told[1]["remarks"]) - set(told[0]["remarks"]) - {"runs without a gap: 2"}
    assert remark.startswith("the row at 0.4321 s does not go with those around it")
    assert remark.endswith(": 1 row left out")
    assert remark in capsys.readouterr().out


def test_a_table_as_other_tools_write_it_is_read_and_what_was_made_of_it_told(
    recordings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with (recordings / "run.csv").open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    at = {name: k for k, name in enumerate(header)}
    lines = ["Bench run 12", "n;u_d;u_q;i_d;i_q;angle (deg)"]
    for k, row in enumerate(rows):
        cells = [k, *(row[at[name]] for name in ("u_d", "u_q", "i_d", "i_q")), math.degrees(float(row[at["theta_e"]]))]
        lines.append(";".join(map(str, cells)).replace(".", ","))
    path = tmp_path / "other.csv"
    path.write_text("\ufeff" + "\r\n".join(lines), encoding="utf-8")
    out = tmp_path / "other.json"
    for given in (["--map", "t=n*1e-4"], ["--set", "T_s=1e-4"]):
        arguments = [path, "--map", "theta_e=angle (deg)", *given, "--json", out]
        assert pmsm_bench("replay", *arguments, monkeypatch=monkeypatch) == 0
        said = capsys.readouterr().out
        assert "the file has columns separated by ';', decimal commas, lines before the header: 1" in said
        assert "theta_e is column 'angle (deg)', in deg: times 0.0174533" in said
        assert "omega_e is the derivative of theta_e" in said
        expect_truth(json.loads(out.read_text(encoding="utf-8")))
        out.unlink()


def test_cells_without_a_value_are_left_out_and_counted(
    recordings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    columns = VirtualDrive(PAPER).record(6000)
    columns["i_q"][1000], columns["u_d"][2000:2003] = math.nan, math.nan
    holed = recordings / "holed.parquet"
    pq.write_table(pa.table(dict(columns)), holed)
    out = tmp_path / "result.json"
    assert pmsm_bench("replay", holed, "--json", out, monkeypatch=monkeypatch) == 0
    content = json.loads(out.read_text(encoding="utf-8"))
    expect_truth(content, within=0.02)
    assert content["gaps"] == 2
    assert "rows left out for want of a value: 4 of 6000 (u_d in 3, i_q in 1)\n" in capsys.readouterr().out
