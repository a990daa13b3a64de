"""A diagnosis of a file in Python: its JSON against the published schema, trust, the machine file it leaves."""

import copy
import json
import math
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, cast

import jsonschema
import numpy as np
import pyarrow
import pyarrow.parquet
import pytest

from bench.diagnoses.diagnose import Diagnosed, as_json, diagnose_recording, onwards
from bench.diagnoses.diagnosed_machine import machine_text
from bench.diagnoses.diagnosis_request import Request, json_text, trust_of
from bench.diagnoses.published import schema
from bench.engineering import odds, quantity, words
from bench.errors import ConfigError, RecordingError
from bench.machine_file import Nominal, load_machine
from bench.recordings.capture_file import write_columns
from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.timing import Timing
from emulator.scenario.effects import NONE
from emulator.scenario.scenarios import PAPER, PAPER_RUN, Excitation
from estimator.diagnosis.verdict import (
    Ambiguity,
    Candidate,
    Change,
    Diagnosis,
    ErrorChange,
    Experiment,
    Finding,
    Fit,
    FluxTable,
    Hold,
    LeaveOneOut,
    Place,
    Quantity,
    Range,
    Rival,
    Unexplained,
    Verdict,
)
from tests.support.diagnoses import ALL, AMBIGUOUS, EXPLAINED, NOMINAL, NOTHING_TOLD, RECORDING

pa: Any = pyarrow  # comes without types
pq: Any = pyarrow.parquet
js: Any = jsonschema
validate: Any = js.Draft202012Validator(schema()).validate
FREE = ("parameters", "absorbed_as", "region", "detectable", "before", "after")  # their keys are names of things


def told(diagnosis: Diagnosis) -> dict[str, Any]:
    """The JSON of a diagnosis, read back from its text."""
    return json.loads(json_text(as_json(Diagnosed(RECORDING, NOMINAL, diagnosis))))


@pytest.mark.parametrize("name", ALL)
def test_every_kind_of_diagnosis_is_valid_by_the_schema(name: str) -> None:
    validate(told(ALL[name]))


def test_the_schema_itself_is_one() -> None:
    js.Draft202012Validator.check_schema(schema())


def places(content: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Paths to all keys that are fields, not names of effects and parameters."""
    if isinstance(content, dict):
        for key, value in cast(dict[str, Any], content).items():
            if not (path and path[-1] in FREE):
                yield (*path, key)
            yield from places(value, (*path, key))
    elif isinstance(content, list) and content:
        yield from places(content[0], (*path, 0))


def test_a_field_by_another_name_is_refused_wherever_it_is() -> None:
    content = told(replace(AMBIGUOUS, findings=EXPLAINED.findings))
    seen = 0
    for path in places(content):
        changed = copy.deepcopy(content)
        part: Any = changed
        for key in path[:-1]:
            part = part[key]
        part[f"{path[-1]}_"] = part.pop(path[-1])
        with pytest.raises(js.ValidationError):
            validate(changed)
        seen += 1
    assert seen > 60


def test_the_schema_tells_every_field_of_a_diagnosis() -> None:
    definitions = schema()["$defs"]
    for name, kind in {
        "Finding": Finding, "Place": Place, "Quantity": Quantity, "Range": Range, "Ambiguity": Ambiguity, "Fit": Fit,
        "Candidate": Candidate, "Unexplained": Unexplained, "Experiment": Experiment, "Hold": Hold,
        "Rival": Rival, "LeaveOneOut": LeaveOneOut, "FluxTable": FluxTable,
        "ErrorChange": ErrorChange, "Change": Change,
    }.items():  # fmt: skip
        asked = {field.name for field in fields(kind)} - {"equation"}  # which machine files have
        told = definitions[name]
        assert set(told["properties"]) == asked
        assert set(told["required"]) == asked - {"leave_one_out"}
    assert definitions["Verdict"]["enum"] == [str(verdict) for verdict in Verdict]


def test_what_is_not_finite_is_null_and_odds_have_an_end() -> None:
    content = told(EXPLAINED)
    (first, _) = content["findings"]
    assert first["odds_against_next"] == 1e12
    assert [rival["odds"] for rival in first["rivals"]] == [3.4e11, 1e12]
    assert content["candidates"][-1] == {
        "effect": "angle_offset", "log10_odds_alone": None, "log10_odds_after": None, "chosen": False,
    }  # fmt: skip
    assert content["findings"][0]["where"]["region"] == {"distance": [-0.4, 0.4], "axis": "q", "order": 6.0}
    assert content["fit"]["free_run_rms_A"] == {"before": 0.31, "after": 0.012}
    assert content["machine"]["after"]["R_s"] == {"value": 0.9668, "std": 4e-4, "unit": "ohm"}
    assert content["recording"] == {
        "path": "runs/0007.parquet", "rows": 60_000, "duration": 6.0, "T_s": 1e-4, "u_dc": None, "currents": {},
    }


# --- a recording


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One of the emulated drive."""
    path = tmp_path_factory.mktemp("diagnose") / "run.parquet"
    pq.write_table(pa.table(dict(VirtualDrive(PAPER).record(12_000))), path)
    return path


def test_the_same_recording_gives_the_same_bytes_and_tells_how_far_it_is(recording: Path) -> None:
    heard = list[tuple[float, str]]()
    request = Request(recording, NOMINAL)
    one = json_text(as_json(diagnose_recording(request, lambda share, phase: heard.append((share, phase)))))
    assert one == json_text(as_json(diagnose_recording(request)))
    validate(json.loads(one))
    told = json.loads(one)["recording"]
    currents = told.pop("currents")
    assert told == {
        "path": str(recording), "rows": 12_000, "duration": pytest.approx(1.2), "T_s": 1e-4, "u_dc": 310.0,
    }
    assert currents["i_d"] == pytest.approx([-3.15, 3.15], abs=0.1)
    shares = [share for share, _ in heard]
    assert heard[0] == (0.0, "reading")
    assert shares == sorted(shares)
    assert 0.5 < shares[-1] <= 1.0
    phases = list(dict.fromkeys(phase for _, phase in heard))
    assert phases[1] == "fitting"
    assert phases[2].startswith("fitting, effects so far: ")
    assert phases[-2:] == ["simulating before and after", "weighing the answer"]


def test_rows_of_several_control_periods_are_refused_before_they_are_read(tmp_path: Path) -> None:
    rows = VirtualDrive(PAPER).record(100)
    whole = dict(rows) | {"i_d_mean": rows["i_d"], "i_q_mean": rows["i_q"], "periods": [10.0] * 100}
    pq.write_table(pa.table(whole), path := tmp_path / "run.parquet")
    with pytest.raises(RecordingError) as caught:
        diagnose_recording(Request(path, replace(NOMINAL, T_s=None)))
    assert str(caught.value) == (
        f"{path}: a stream's rows cover several control periods, here 10 each: capture to diagnose"
    )


def test_a_share_that_was_told_is_not_taken_back() -> None:
    heard = list[tuple[float, str]]()
    tell = onwards(lambda share, phase: heard.append((share, phase)))
    for share in (0.1, 0.7, 0.0, 0.9):  # what was suspected is taken back, and all begins anew
        tell(share, "fitting")
    assert heard == [(share, "fitting") for share in (0.1, 0.7, 0.7, 0.9)]


def test_what_the_reader_noticed_is_among_the_remarks(recording: Path, tmp_path: Path) -> None:
    columns = VirtualDrive(PAPER).record(4000)
    columns["i_d"][50] = math.nan
    pq.write_table(pa.table(dict(columns)), tmp_path / "holed.parquet")
    said = diagnose_recording(Request(tmp_path / "holed.parquet", NOMINAL)).diagnosis
    assert "rows left out for want of a value: 1 of 4000 (i_d in 1)" in said.remarks


@pytest.mark.parametrize(("shift", "says"), [(1, "later"), (-1, "earlier")])
def test_voltages_that_surely_stand_a_row_off_are_taken_as_they_act_and_how_is_said(
    shift: int, says: str, tmp_path: Path
) -> None:
    scenario = replace(PAPER, effects=NONE._replace(timing=Timing(shift=shift)))
    pq.write_table(pa.table(dict(VirtualDrive(scenario).record(20_000))), path := tmp_path / "shifted.parquet")
    found = diagnose_recording(Request(path, NOMINAL)).diagnosis
    moved = diagnose_recording(Request(path, NOMINAL, align={"u": float(shift)})).diagnosis
    assert found.remarks == (
        f"the voltages are taken as they act, a row {says} than they stand: with --align u={shift} replay and "
        "mechanics take them so, too",
    )
    assert moved.verdict is Verdict.NO_MISMATCH
    assert not any("--align" in remark for remark in moved.remarks)
    for name, told in moved.machine_after.items():
        assert found.machine_after[name].value == pytest.approx(told.value, rel=1e-3)


def test_effects_of_the_nominal_machine_are_not_used_and_a_remark_says_so(recording: Path) -> None:
    plain = diagnose_recording(Request(recording, NOMINAL)).diagnosis
    with_effects = replace(NOMINAL, effects={"iron_loss": {"conductance": 1e-3}}, source="found.toml")
    said = diagnose_recording(Request(recording, with_effects)).diagnosis
    assert said.sentence == plain.sentence
    assert said.remarks == (*plain.remarks, (
        "the effects in found.toml's [effects] are not used by a diagnosis: it looks for them anew"
    ))  # fmt: skip


def test_a_machine_that_is_not_whole_is_refused_and_too_few_rows_give_no_verdict(
    recording: Path, tmp_path: Path
) -> None:
    lacking = replace(NOMINAL, given={"R_s": 1.0, "L_q": 6e-3}, n_p=None)
    with pytest.raises(ConfigError, match=r"the nominal machine whole, missing in \[machine\]: L_d, psi_f, n_p$"):
        diagnose_recording(Request(recording, lacking))
    short = tmp_path / "short.parquet"
    pq.write_table(pa.table(dict(VirtualDrive(PAPER).record(20))), short)
    said = diagnose_recording(Request(short, NOMINAL)).diagnosis
    assert said.verdict is Verdict.NOT_ENOUGH_EXCITATION
    assert "20" in said.sentence


@pytest.mark.parametrize(
    ("items", "shares"),
    [
        ([], {}),
        (["R_s=20%,L_d=0.1"], {"R_s": 0.2, "L_d": 0.1}),
        (["R_s = 5 %", "psi_f=2e-2,"], {"R_s": 0.05, "psi_f": 0.02}),
    ],
)
def test_trust_is_a_share_by_parameter(items: list[str], shares: dict[str, float]) -> None:
    assert trust_of(items) == pytest.approx(shares)


@pytest.mark.parametrize(
    ("item", "said"),
    [
        ("R=20%", "trust: expected R_s, L_d, L_q, psi_f, got 'R'"),
        ("R_s", "trust: R_s: expected a share above 0 and at most 10 (1000 %), such as 0.2 for 20 %, got ''"),
        ("R_s=5", "trust: R_s: expected per cent, such as 20%, or a share up to 1, got 5"),
        ("R_s=2000%", "expected a share above 0 and at most 10 (1000 %), such as 0.2 for 20 %, got 20.0"),
        ("R_s=0", "got 0.0"),
        ("R_s=-5%", "got -0.05"),
        ("R_s=nan", "got nan"),
        ("R_s=1%,R_s=2%", "trust: R_s is given twice"),
    ],
)
def test_a_trust_that_cannot_be_is_refused(item: str, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        trust_of([item])
    assert said in str(caught.value)


# --- the machine file


def loaded(text: str, folder: Path) -> Nominal:
    """What a machine file of that text says."""
    path = folder / "out.toml"
    path.write_text(text, encoding="utf-8")
    return load_machine(path)


def test_the_machine_after_is_a_machine_file_with_its_effects(tmp_path: Path) -> None:
    text = machine_text(EXPLAINED, NOMINAL, "0007.parquet")
    machine = loaded(text, tmp_path)
    assert machine.given == pytest.approx({"R_s": 0.9668, "L_d": 4.238e-3, "L_q": 6.212e-3, "psi_f": 0.11999})
    assert replace(machine, given={}, effects={}) == replace(NOMINAL, given={})
    assert machine.effects["inverter_voltage_error"] == pytest.approx(
        {"dead_time": 2e-6, "dead_time_std": 3e-8, "u_drop": 0.85, "u_drop_std": 0.02, "zero_crossing_width": 0.04}
    )
    assert machine.effects["d_axis_saturation"] == pytest.approx({"L_d_drop": 0.12, "L_d_drop_std": 0.004})
    assert "R_s = 0.9668  # ohm, std 0.0004\n" in text
    assert "dead_time = 2e-06  # s\n" in text
    assert "# The inverter's voltage error was left out: 2.0 us of dead time" in text


def test_a_parameter_that_was_not_told_stays_nominal_and_says_so(tmp_path: Path) -> None:
    after = {**EXPLAINED.machine_after, "R_s": Quantity(-0.3, 1.0, "ohm"), "L_d": Quantity(None, None, "H")}
    odd = replace(EXPLAINED, machine_after=after, sentence="line\nfeed \x07 and\r bell")
    text = machine_text(odd, replace(NOMINAL, T_s=None, u_dc=None, encoder_counts=None, i_rated=None), "0007")
    machine = loaded(text, tmp_path)
    assert machine.given["R_s"] == NOMINAL.given["R_s"]
    assert machine.given["L_d"] == NOMINAL.given["L_d"]
    assert machine.T_s is None
    assert "R_s = 0.97  # ohm, nominal: the fit says -0.3\n" in text
    assert "L_d = 0.0042  # H, nominal: it could not be told\n" in text
    assert "[drive]" not in text
    assert loaded(machine_text(NOTHING_TOLD, NOMINAL, "x"), tmp_path) == NOMINAL


def test_a_convention_that_was_undone_is_undone_in_the_machine_file(tmp_path: Path) -> None:
    """Pole pairs and the control period are those that the parameters were found with."""
    assert NOMINAL.n_p is not None
    assert NOMINAL.T_s is not None
    scale = {"T_s_scale": Quantity(2.0, None, "")}
    halved = replace(EXPLAINED.findings[0], effect="convention_error", parameters=scale)
    said = replace(EXPLAINED, findings=(halved,), pole_pairs=2 * NOMINAL.n_p)
    text = machine_text(said, NOMINAL, "x")
    machine = loaded(text, tmp_path)
    assert (machine.n_p, machine.T_s) == (2 * NOMINAL.n_p, pytest.approx(0.5 * NOMINAL.T_s))
    assert f"# {NOMINAL.n_p} were given" in text


# --- numbers for people


@pytest.mark.parametrize(
    ("value", "unit", "std", "shown"),
    [
        (2.0e-6, "s", 3e-8, "2.000 ± 0.059 us"), (0.9668, "ohm", 4e-4, "966.80 ± 0.78 mohm"),
        (1.46, "ohm", None, "1.46 ohm"), (1e-15, "S", None, "0.00100 pS"),
        (2400.0, "ohm", None, "2.40 kohm"), (0.12, "1", 0.004, "12.00 ± 0.78 %"), (0.0, "V", None, "0 V"),
        (2.0, "1", None, "2.00"), (math.pi / 180, "rad", None, "1.00 deg"), (None, "V", 1.0, "–"),
        (math.nan, "V", None, "–"),
        (-0.5, "V", math.inf, "-500 mV"), (1234.5, "rpm", 0.5, "1234.50 ± 0.98 rpm"), (5.0, "A", 300.0, "5 ± 590 A"),
    ],
)  # fmt: skip
def test_a_quantity_is_shown_to_what_its_error_leaves(value: float, unit: str, std: float, shown: str) -> None:
    assert quantity(value, unit, std) == shown


def test_names_are_words_and_symbols_keep_their_index() -> None:
    assert words("d_axis_saturation") == "d-axis saturation"
    symbols = ("L_d_drop", "psi_f", "dead_time", "R_c")
    assert [words(name) for name in symbols] == ["L_d drop", "psi_f", "dead time", "R_c"]
    assert [odds(value) for value in (1.23, 250.4, 3e9, 1e40, math.inf, math.nan, None)] == [
        "1.2", "250", "3e9", "over 1e12", "over 1e12", "–", "–",
    ]  # fmt: skip


def test_the_q_axis_alone_needs_no_machine_and_an_alignment_that_is_given_is_kept(tmp_path: Path) -> None:
    slow = replace(
        PAPER_RUN, excitation=Excitation(i_q_step=2.0, kind="multisine", sine_frequency=1.0),
        run=replace(PAPER_RUN.run, speed_rpm=200.0, rise_rpm=0.0, swing_rpm=200.0, swing_frequency=0.7),
    )
    columns = VirtualDrive(slow).record(80_000)
    path = tmp_path / "run.parquet"
    names = ("t", "u_q", "i_q", "theta_e")
    write_columns(path, {name: np.ascontiguousarray(columns[name][::10]) for name in names}, {})
    as_it_is = diagnose_recording(Request(path, Nominal({}))).diagnosis
    assert as_it_is.verdict is Verdict.AMBIGUOUS
    found = diagnose_recording(Request(path, Nominal({}), align={"u": -0.45})).diagnosis
    assert found.verdict is Verdict.NO_MISMATCH
    R_s, psi_f = (found.machine_after[name] for name in ("R_s", "psi_f"))
    assert R_s.value == pytest.approx(0.9664, rel=0.01)
    assert psi_f.value == pytest.approx(0.12, rel=0.01)
    assert (R_s.std or 1.0) < 0.02
    off = diagnose_recording(Request(path, Nominal({"psi_f": 0.09}), align={"u": -0.45})).diagnosis
    assert any("psi_f is 120" in remark and "the nominal machine says" in remark for remark in off.remarks)
