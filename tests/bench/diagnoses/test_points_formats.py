"""Files of steady points by command and function: formats, mapped columns, JSON, page, and what is refused."""

import csv
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from bench.diagnoses.diagnose import diagnose_recording, work
from bench.diagnoses.diagnosis_request import Request
from bench.diagnoses.formats import FORMATS, checked_format, format_of
from bench.diagnoses.published import schema
from bench.errors import BenchError, ConfigError, RecordingError
from bench.machine_file import Nominal, load_machine
from emulator.plant.physics.legs import Inverter
from estimator.diagnosis.points.no_load import NoLoad
from estimator.diagnosis.points.table import Points
from tests.bench.cli.test_replay import pmsm_bench
from tests.estimator.diagnosis.points.steady_points import operating_points, steady_points, without_load
from tests.support.real_data import REAL_DATA

pytestmark = pytest.mark.thorough

validate: Any = jsonschema.validate  # pyright: ignore[reportUnknownMemberType]
DROP = Inverter(u_transistor=1.0, u_diode=1.0)
RPM = 30.0 / math.pi
NOTHING = Nominal({})
MACHINE = Nominal({"R_s": 1.0, "L_d": 4e-3, "L_q": 6e-3, "psi_f": 0.1}, n_p=4)


@pytest.fixture(scope="module")
def dropping() -> Points:
    return steady_points(operating_points((20.0, 60.0, 100.0)), inverter=DROP)


@pytest.fixture(scope="module")
def freely() -> NoLoad:
    return without_load(0.8, inverter=DROP)


def written(path: Path, columns: dict[str, Any]) -> Path:
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(columns)
        rows.writerows(zip(*columns.values(), strict=True))
    return path


def columns_of(points: Points) -> dict[str, Any]:
    i, u = points.i, points.u
    return {"omega_e": points.omega_e, "i_d": i.real, "i_q": i.imag, "u_d": u.real, "u_q": u.imag}


def moteus(path: Path, points: NoLoad, **params: Any) -> Path:
    raw: dict[str, list[dict[str, float]]] = {}
    for omega, y, i_d in zip(points.omega_e, points.y, points.i_d, strict=True):
        raw.setdefault(str(i_d), []).append({"omega": omega, "y": y})
    path.write_text(json.dumps({"raw": raw, "params": {"R": points.R_s, "poles": 8} | params}), encoding="utf-8")
    return path


def names(content: dict[str, Any]) -> list[str]:
    return [finding["effect"] for finding in content["findings"]]


def test_points_by_command_without_a_machine_file(
    dropping: Points, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path / "bench.csv", columns_of(dropping) | {"temp_magnet": np.full(len(dropping), 40.0)})
    outputs = [part for kind in ("json", "report", "machine") for part in (f"--{kind}", str(tmp_path / kind))]
    assert pmsm_bench("diagnose", str(path), *outputs, monkeypatch=monkeypatch) == 0
    said = capsys.readouterr().out
    assert f"{path}: explained" in said.replace("\n", "")
    assert "left out: one operating point at a time" in said
    content = json.loads((tmp_path / "json").read_text(encoding="utf-8"))
    validate(content, schema())
    assert names(content) == ["inverter_voltage_error"]
    assert content["fit"]["leave_one_out"]["groups"] == len(dropping)
    assert content["fit"]["one_step_rms_V"]["after"] == content["fit"]["leave_one_out"]["after"]
    assert content["fit"]["free_run_rms_A"] == {"before": None, "after": None}
    page = (tmp_path / "report").read_text(encoding="utf-8")
    assert "Point by point" in page and "rows used, steady points" in page and "voltage error was left out" in page
    assert load_machine(tmp_path / "machine").given.keys() == {"R_s", "L_d", "L_q", "psi_f"}


def test_the_same_points_by_other_names_and_units_give_the_same(
    dropping: Points, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path / "a.csv", columns_of(dropping))
    plain = work(Request(path, NOTHING, format="auto"), lambda share, phase: None)
    cells = columns_of(dropping)
    other = {"Speed (rpm)": cells["omega_e"] * RPM / 4, "Id": cells["i_d"], "Iq": cells["i_q"], "Ud": cells["u_d"],
             "Uq": cells["u_q"]}  # fmt: skip
    path = written(tmp_path / "b.csv", other)
    mapping = "speed_rpm=Speed (rpm),i_d=Id,i_q=Iq,u_d=Ud,u_q=Uq"
    out = tmp_path / "b.json"
    assert pmsm_bench("diagnose", str(path), "--map", mapping, "--set", "n_p=4", "--json", str(out),
                      monkeypatch=monkeypatch) == 0  # fmt: skip
    content = json.loads(out.read_text(encoding="utf-8"))
    assert names(content) == names(plain.content)
    for name, found in plain.content["machine"]["after"].items():
        assert content["machine"]["after"][name]["value"] == pytest.approx(found["value"], rel=1e-6)
    assert pmsm_bench("diagnose", str(path), "--map", mapping, monkeypatch=monkeypatch) == 2
    assert "speed_rpm is mechanical, expected the pole pairs" in capsys.readouterr().err


@pytest.mark.parametrize(("unit", "n_p", "mapped"), [
    (RPM, None, "omega_e=erpm[erpm]"), (RPM, 4, "speed_rpm=erpm[erpm]"), (RPM, 1, "speed_rpm=erpm"),
    (RPM / 4, 4, "omega_e=erpm[rpm]"), (RPM / 4, 4, "speed_rpm=erpm"),
])  # fmt: skip
def test_a_log_with_semicolons_to_the_end_of_its_lines_and_a_speed_of_another_kind(
    dropping: Points, tmp_path: Path, unit: float, n_p: int | None, mapped: str
) -> None:
    cells = columns_of(dropping)
    path = written(tmp_path / "log.csv", cells)
    plain = work(Request(path, NOTHING, format="points"), lambda share, phase: None)
    cells["erpm"] = cells.pop("omega_e") * unit
    lines = [cells, *zip(*cells.values(), strict=True)]
    path.write_text("".join(";".join(map(str, line)) + ";\n" for line in lines), encoding="utf-8")
    constants = {} if n_p is None else {"n_p": n_p}
    mapping = dict([mapped.split("=")])
    request = Request(path, NOTHING, mapping=mapping, constants=constants, format="points")
    found = work(request, lambda share, phase: None)
    assert names(found.content) == names(plain.content)
    for name, value in plain.content["machine"]["after"].items():
        assert found.content["machine"]["after"][name]["value"] == pytest.approx(value["value"], rel=1e-6)
    assert "the file has columns separated by ';'" in found.content["remarks"]


def test_points_with_units_in_their_names_are_told_by_them(dropping: Points, tmp_path: Path) -> None:
    cells = columns_of(dropping)
    other = {"speed_rpm [1/min]": cells["omega_e"] * RPM / 4, "i_d (mA)": 1e3 * cells["i_d"], "i_q [A]": cells["i_q"],
             "u_d [V]": cells["u_d"], "u_q [mV]": 1e3 * cells["u_q"]}  # fmt: skip
    request = Request(written(tmp_path / "a.csv", other), NOTHING, constants={"n_p": 4}, format="auto")
    assert format_of(request).name == "points"
    said = diagnose_recording(request)
    assert "u_q is column 'u_q [mV]', in mV: times 0.001" in said.diagnosis.remarks
    with pytest.raises(ConfigError, match=r"omega_e in rpm is mechanical, expected the pole pairs"):
        diagnose_recording(replace(request, mapping={"omega_e": "speed_rpm [1/min][rpm]"}, constants={}))


def test_a_line_of_points_that_cannot_be_read_is_left_out_where_there_are_many(
    dropping: Points, tmp_path: Path
) -> None:
    path = written(tmp_path / "a.csv", {name: np.tile(x, 3) for name, x in columns_of(dropping).items()})
    lines = path.read_text(encoding="utf-8").splitlines()
    assert len(lines) > 101
    path.write_text("\n".join([*lines[:50], "?", *lines[50:]]) + "\n", encoding="utf-8")
    (said, *_) = diagnose_recording(Request(path, NOTHING, format="points")).diagnosis.remarks
    assert said.startswith("lines left out that cannot be read: 1 of")


def test_a_recording_without_its_machine_is_one_sentence_by_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path / "a.csv", {name: [0.0, 1.0] for name in ("t", "u_d", "u_q", "i_d", "i_q", "omega_e")})
    assert pmsm_bench("diagnose", str(path), monkeypatch=monkeypatch) == 2
    said = f"pmsm-bench: {path}: a recording needs its machine's data, expected --nominal MACHINE.toml\n"
    assert capsys.readouterr().err == said


def test_what_is_neither_a_recording_nor_a_table_of_points_is_told_what_both_need(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path / "a.csv", {name: [0.0, 1.0] for name in ("u_d", "u_q", "i_d", "omega_e")})
    assert pmsm_bench("diagnose", str(path), monkeypatch=monkeypatch) == 2
    assert "a table of steady points, which needs none, has u_d, u_q, i_d, i_q and" in capsys.readouterr().err


def test_a_nominal_machine_far_from_the_points_is_remarked(dropping: Points, tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", columns_of(dropping))
    nominal = Nominal({"R_s": 0.97, "L_d": 4.24e-3, "L_q": 6.21e-3, "psi_f": 0.2}, n_p=4, i_rated=6.0)
    remarks = diagnose_recording(Request(path, nominal, format="points")).diagnosis.remarks
    assert [remark for remark in remarks if "the nominal machine says" in remark] == [
        "psi_f is 120 mVs, the nominal machine says 200 mVs"
    ]


def test_a_calibration_without_load_by_its_own_format(freely: NoLoad, tmp_path: Path) -> None:
    path = moteus(tmp_path / "ld.json", freely, v_per_hz=0.12 * 2.0 * math.pi * 4, cal_inductance_d_H=4e-3)
    done = work(Request(path, NOTHING, report=True, format="auto"), lambda share, phase: None)
    validate(done.content, schema())
    assert names(done.content) == ["inverter_voltage_error"]
    left_out = done.content["fit"]["leave_one_out"]
    assert left_out["left_out"] == "speed within a level of i_d"
    assert set(left_out["alternatives"]) == {"one_offset", "no_offset", "free_offsets", "inverter_voltage_error"}
    assert left_out["alternatives"]["inverter_voltage_error"] == left_out["after"] < 0.5 * left_out["before"]
    assert done.report is not None and "with free offsets" in done.report
    assert done.machine is not None and "[effects.inverter_voltage_error]" in done.machine
    assert "n_p = 4" in done.machine and "R_s = " in done.machine


def test_formats_are_told_by_what_is_in_the_file(dropping: Points, freely: NoLoad, tmp_path: Path) -> None:
    cells = columns_of(dropping)
    t = np.arange(len(dropping)) * 1e-4
    slow = cells | {"motor_speed": cells["omega_e"], "pm": t, "stator_winding": t}
    del slow["omega_e"]
    mapped = {"n": t, "a": t, "b": t, "c": t, "d": t}
    for name, columns, mapping in (
        ("points", cells, {}), ("recording", cells | {"t": t}, {}), ("lea-thermal", slow, {}),
        ("recording", cells | {"theta_e": t}, {}), ("recording", cells | {"i_a": t, "i_b": t, "i_c": t}, {}),
        ("points", mapped, {"speed_rpm": "n", "i_d": "a", "i_q": "b", "u_d": "c", "u_q": "d"}),
    ):
        path = written(tmp_path / "file.csv", columns)
        assert format_of(Request(path, NOTHING, mapping=mapping, format="auto")).name == name
    assert format_of(Request(moteus(tmp_path / "x.json", freely), NOTHING, format="auto")).name == "moteus-ld"
    assert format_of(Request(tmp_path / "none.csv", NOTHING, format="auto")).name == "recording"
    assert set(FORMATS) >= {"recording", "points", "moteus-ld", "lea-thermal"}


def test_a_log_whose_times_are_too_far_apart_for_control_periods_is_one_of_points(
    dropping: Points, tmp_path: Path
) -> None:
    cells = columns_of(dropping)
    logged = {"ms": 100.0 * np.arange(len(dropping)), "erpm": cells.pop("omega_e") * RPM, **cells}
    path = written(tmp_path / "log.csv", logged)
    speed = {"omega_e": "erpm[erpm]"}
    plain = Request(path, NOTHING, mapping=speed, format="auto")
    assert format_of(plain).name == "points"
    for t in ("ms[ms]", "ms*1e-3"):
        log = replace(plain, mapping=speed | {"t": t})
        assert format_of(log).name == "points"
        assert diagnose_recording(log).diagnosis.machine_after.keys() == {"R_s", "L_d", "L_q", "psi_f"}
    for t in ("ms", "ms[us]", "ms*1e-6"):  # no unit is told, or one that makes control periods of rows
        assert format_of(replace(plain, mapping=speed | {"t": t})).name == "recording"
    with pytest.raises(RecordingError, match=r"t steps by 100 s, .*; a log of steady states is diagnosed by --for"):
        diagnose_recording(replace(plain, nominal=MACHINE, mapping=speed | {"t": "ms"}))


@pytest.mark.parametrize(("name", "text", "expected"), [
    ("points", "i_d,i_q,u_d\n1,2,3\n", "missing columns: u_q, omega_e or speed_rpm; present: i_d, i_q, u_d"),
    ("points", "i_d,i_q,u_d,u_q,omega_e\n", "expected rows below the header, came none"),
    ("points", "i_d,i_q,u_d,u_q,omega_e\n1,2,x,4,5\n", "column 'u_d', row 1: expected a number, came 'x'"),
    ("points", "i_d,i_q,u_d,u_q,omega_e\n1,2,,4,5\n", "expected rows with a number in every column, came none of 1"),
    ("moteus-ld", "no json", "expected JSON"),
    ("moteus-ld", "[1]", "the file: expected a JSON object, came [1]"),
    ("moteus-ld", '{"raw": {}, "params": {"R": 0.1}}', "expected points of omega and y, came none"),
    ("moteus-ld", '{"raw": {"a": []}, "params": {"R": 0.1}}', "expected levels of i_d in A, came 'a'"),
    ("moteus-ld", '{"raw": {"0": [{"omega": 1}]}, "params": {"R": 0.1}}', "raw 0 y: expected a finite number, came"),
    ("moteus-ld", '{"raw": {"0": [{"omega": 1, "y": 1}]}, "params": {"R": 1e6}}', "expected 0.0001 to 1000 ohm"),
    ("lea-thermal", "u_d,u_q,i_d,i_q\n1,2,3,4\n", "no column 'motor_speed' for speed_rpm"),
    ("recording", "t,u_d,u_q,i_d,i_q,omega_e\n", "expected --nominal MACHINE.toml"),
])  # fmt: skip
def test_what_is_wrong_with_a_file_is_one_sentence(name: str, text: str, expected: str, tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(BenchError) as raised:
        diagnose_recording(Request(path, NOTHING, format=name))
    assert expected in str(raised.value) and "\n" not in str(raised.value)
    assert str(raised.value).startswith(str(path))


def test_a_recording_without_times_is_no_steady_points_and_says_so(dropping: Points, tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", columns_of(dropping) | {"theta_e": np.zeros(len(dropping))})
    with pytest.raises(RecordingError, match=r"missing columns: t; present: .* expected the time of every row"):
        diagnose_recording(Request(path, MACHINE, format="auto"))


def test_more_rows_than_operating_points_are_are_refused_unless_they_are_a_log(tmp_path: Path) -> None:
    many = {name: np.zeros(3001) for name in ("u_d", "u_q", "i_d", "i_q", "omega_e")}
    with pytest.raises(RecordingError, match="expected at most 3000 steady points, one operating point a row"):
        diagnose_recording(Request(written(tmp_path / "a.csv", many), NOTHING, format="points"))
    log = written(tmp_path / "b.csv", many | {"t": np.arange(3001.0)})
    assert diagnose_recording(Request(log, NOTHING, format="points")).recording.rows == 3001


def test_options_that_no_format_takes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="expected one of auto, moteus-ld"):
        checked_format("excel")
    path = written(tmp_path / "a.csv", {name: [1.0] for name in ("i_d", "i_q", "u_d", "u_q", "omega_e")})
    one = Request(path, NOTHING, format="points")
    for request in (
        replace(one, mapping={"theta_e": "x"}), replace(one, constants={"u_dc": 1.0}),
        replace(one, constants={"n_p": 2.5}), replace(one, align={"u": 1.0}),
    ):  # fmt: skip
        with pytest.raises(ConfigError):
            diagnose_recording(request)


def test_real_files_go_by_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    files = sorted((REAL_DATA / "moteus_ld").glob("*.json"))
    if not files:
        pytest.skip(f"{REAL_DATA} is not here")
    code = pmsm_bench("diagnose", *map(str, files), "--json", str(tmp_path), monkeypatch=monkeypatch)
    assert code == 3  # some cannot be told
    assert f"{len(files)} recordings:" in capsys.readouterr().out
    for file in files:
        validate(json.loads((tmp_path / f"{file.stem}.json").read_text(encoding="utf-8")), schema())
