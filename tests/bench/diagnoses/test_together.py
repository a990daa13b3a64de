"""Files of one machine's recordings to one diagnosis: JSON by its schema, machine file, pictures, page, refusals."""

import json
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, cast

import jsonschema
import pytest

from bench.diagnoses.diagnosis_request import Request, json_text
from bench.diagnoses.figures.figure import figures_text
from bench.diagnoses.figures.figure import schema as figures_schema
from bench.diagnoses.figures.forest import FOREST, forests
from bench.diagnoses.published import as_json as one_as_json
from bench.diagnoses.report.page import POLICY
from bench.diagnoses.together.diagnose import diagnose_recordings, result_of
from bench.diagnoses.together.machine import machine_text_of
from bench.diagnoses.together.published import as_json, schema
from bench.diagnoses.together.request import Several
from bench.errors import ConfigError, RecordingError
from bench.machine_file import load_machine
from estimator.diagnosis.together.said import Difference, Shared, SharedFinding, Together
from estimator.diagnosis.verdict import Quantity
from tests.bench.diagnoses.test_report import Page
from tests.support.diagnoses import CONVENTION, NOMINAL
from tests.support.together import ALL, BOTH, EQUATION, NAMES, diagnosed, shared

js: Any = jsonschema
validate: Any = js.Draft202012Validator(schema()).validate


@pytest.mark.parametrize("name", ALL)
def test_every_kind_of_diagnosis_is_valid_by_the_schema(name: str) -> None:
    content = json.loads(json_text(as_json(diagnosed(ALL[name]))))
    validate(content)
    assert content["verdict"] == ALL[name].verdict


def test_the_schema_is_one_and_tells_every_field() -> None:
    js.Draft202012Validator.check_schema(schema())
    parts = schema()["$defs"]
    for kind in (Shared, SharedFinding, Difference):
        asked = {field.name for field in fields(kind)} - {"equation", "equation_of"}  # which machine files have
        assert set(parts[kind.__name__]["properties"]) == set(parts[kind.__name__]["required"]) == asked
    assert set(schema()["properties"]) == {field.name for field in fields(Together)}
    for shape in (schema(), *(parts[kind.__name__] for kind in (Shared, SharedFinding, Difference))):
        for name, told in shape["properties"].items():
            assert "description" in told or "examples" in told, name


def _paths(content: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    if isinstance(content, dict):
        for key, value in cast(dict[str, Any], content).items():
            if path[-1:] not in (("machine",), ("parameters",)):
                yield (*path, key)
            yield from _paths(value, (*path, key))
    elif isinstance(content, list) and content:
        yield from _paths(content[0], (*path, 0))


def test_a_field_by_another_name_is_refused_wherever_it_is() -> None:
    content = as_json(diagnosed(BOTH))
    ours = [path for path in _paths({**content, "diagnoses": []}) if path]
    assert len(ours) > 30
    for path in ours:
        changed = json.loads(json.dumps(content))
        part: Any = changed
        for key in path[:-1]:
            part = part[key]
        part[f"{path[-1]}_"] = part.pop(path[-1])
        with pytest.raises(js.ValidationError):
            validate(changed)


def test_odds_have_an_end_and_each_recordings_own_diagnosis_is_there_whole() -> None:
    told = diagnosed(BOTH)
    content = as_json(told)
    assert [one["odds"] for one in content["findings"]] == [1e12, 250.0]
    assert "equation" not in content["findings"][0]
    assert content["diagnoses"] == [one_as_json(one) for one in told.each.values()]
    assert content["machine"]["L_q"]["each"] == [{"value": 6.212e-3, "std": 3e-6, "unit": "H"}, None]


# --- the machine file


def test_the_machine_file_has_joint_numbers_and_of_what_differs_the_last_recordings(tmp_path: Path) -> None:
    text = machine_text_of(BOTH, NOMINAL)
    assert text is not None
    (tmp_path / "m.toml").write_text(text, encoding="utf-8")
    machine = load_machine(tmp_path / "m.toml")
    assert machine.given == {"R_s": 1.0248, "L_d": 4.2385e-3, "L_q": 6.212e-3, "psi_f": 0.119985}
    lines = {line.partition(" = ")[0]: line for line in text.splitlines()}
    note = "not the same in all recordings: this is that of warm"
    assert lines["R_s"].endswith(f"; {note}")
    assert note not in lines["L_d"]
    assert f"[effects.inverter_voltage_error]  # {note}" in text
    assert text.startswith("# as diagnosed from cold and warm: explained\n")
    assert machine.effects["inverter_voltage_error"]["dead_time"] == 2e-6
    assert machine.effects["d_axis_saturation"] == {"L_d_drop": 0.1205, "L_d_drop_std": 0.0028}
    assert machine.equations["inverter_voltage_error"] == EQUATION


def test_a_state_that_the_last_recording_does_not_tell_is_that_of_the_one_before() -> None:
    number = shared("ohm", (0.96, 1e-3), (1.02, 1e-3), None)
    said = replace(
        BOTH, recordings=(*NAMES, "mute"), machine={**BOTH.machine, "R_s": number}, findings=(),
        diagnoses=(*BOTH.diagnoses, BOTH.diagnoses[0]),
    )  # fmt: skip
    text = machine_text_of(said, NOMINAL)
    assert text is not None
    assert "R_s = 1.02  # ohm, std 0.001; not the same in all recordings: this is that of warm" in text


def test_a_control_period_that_the_recordings_contradict_is_put_right() -> None:
    rows = replace(CONVENTION.findings[0], parameters={"T_s_scale": Quantity(2.0, None, "1")})
    last = replace(BOTH.diagnoses[1], findings=(rows, *BOTH.diagnoses[1].findings))
    text = machine_text_of(replace(BOTH, diagnoses=(BOTH.diagnoses[0], last)), NOMINAL)
    assert text is not None
    assert "T_s = 5e-05  # s\n" in text


def test_there_is_no_machine_file_where_nothing_could_be_fitted() -> None:
    assert machine_text_of(ALL["nothing_told"], NOMINAL) is None


# --- pictures and the page


@pytest.mark.parametrize("name", ALL)
def test_pictures_follow_the_published_schema(name: str) -> None:
    told = json.loads(figures_text(forests(ALL[name])))
    js.validate(told, figures_schema())
    assert all(figure["part"] == FOREST for figure in told["figures"])


def test_each_recording_has_an_interval_and_all_as_one_where_they_are_alike() -> None:
    machine, inverter, saturation = forests(BOTH)
    R_s, L_d, L_q, _ = machine.panels
    assert R_s.y.names == ("all as one", "warm", "cold")
    (differs,) = R_s.traces
    assert (differs.role, differs.y) == ("differs", (1.0, 2.0))
    assert differs.x[2:] == pytest.approx((0.9668 - 1.96 * 4e-4, 0.9668 + 1.96 * 4e-4), rel=1e-5)
    each, joint, line = L_d.traces
    assert [each.role, joint.role, line.kind] == ["each", "joint", "line"]
    assert L_d.x.low < min(x for x in (*each.x, *joint.x) if x is not None)
    assert L_q.traces[0].x[:2] == (None, None)
    assert [panel.title for panel in inverter.panels] == ["dead time", "knee"]
    assert (saturation.panels[0].x.unit, saturation.panels[0].traces[1].x[0]) == ("%", pytest.approx(11.5, abs=0.01))


def test_a_recording_that_hardly_tells_a_number_does_not_stretch_the_picture() -> None:
    wide = shared("H", (4.2e-3, 1e-6), (4.2e-3, 1e-3), joint=(4.2e-3, 1e-6))
    panel = forests(replace(BOTH, machine={"L_d": wide}, findings=()))[0].panels[0]
    assert panel.x.high - panel.x.low < 60e-6


def test_long_names_are_cut_and_stay_unlike_each_other() -> None:
    long = replace(BOTH, recordings=("a" * 40, "b" + "a" * 40), findings=())
    assert forests(long)[0].panels[0].y.names == ("all as one", "2: …" + 15 * "a", "1: …" + 15 * "a")


@pytest.mark.parametrize("name", ALL)
def test_the_page_needs_nothing_else_and_says_all_there_is(name: str) -> None:
    said = ALL[name]
    text = result_of(diagnosed(said), report_too=True).report
    assert text is not None
    page = Page(text)
    assert page.addresses == []
    assert page.policy == POLICY
    assert not page.tags & {"script", "link", "img", "iframe", "object", "base"}
    assert page.figures == [figure.name for figure in forests(said)]
    told = [said.sentence, *said.remarks, *(one.sentence for one in said.diagnoses), *(f"{x}.parquet" for x in NAMES)]
    assert all(one in page.words for one in told)
    assert all(one.sentence[1:] in page.words for one in said.differences)
    assert all(one.reason in page.words for one in said.ambiguous)


def test_the_page_has_a_row_of_numbers_for_each_recording_and_one_of_all() -> None:
    text = result_of(diagnosed(BOTH), report_too=True).report
    assert text is not None
    words = " ".join(Page(text).words.split())
    for told in (
        "cold966.80 ± 0.78 mohm", "warm1024.80 ± 0.98 mohm", "4.2385 ± 0.0041 mH", "all as onediffers",
        "dead time 0.0000 ± 0.0059 us", "dead time 2.000 ± 0.059 us", "all as onedead time differs",
        "L_d drop 12.05 ± 0.55 %", "name it by themselves: warm. Odds of having it: over 1e12",
    ):
        assert told in words, words
    assert result_of(diagnosed(BOTH), report_too=False).report is None


# --- files


def several(*files: Path, **options: Any) -> Several:
    return Several({file.stem: Request(file, NOMINAL, **options) for file in files})


def table(path: Path, columns: str, *rows: str) -> Path:
    path.write_text("\n".join((columns, *rows)) + "\n", encoding="utf-8")
    return path


def test_what_is_no_recording_of_every_control_period_is_refused_in_a_sentence(tmp_path: Path) -> None:
    rows = [f"{1e-4 * k},1.0,2.0,100.0,{0.01 * k}" for k in range(300)]
    whole = table(tmp_path / "whole.csv", "t,u_d,u_q,i_d,i_q,omega_e,theta_e", "0,1,2,3,4,5,6")
    q = table(tmp_path / "q.csv", "t,u_q,i_q,omega_e,theta_e", *rows)
    points = table(tmp_path / "points.csv", "u_d,u_q,i_d,i_q,speed_rpm", *["1,2,3,4,1000"] * 20)
    wanted = "one diagnosis of several files takes recordings of every control period"
    with pytest.raises(ConfigError, match=f"q.csv: {wanted} of both axes, got one of the q axis alone"):
        diagnose_recordings(several(whole, q))
    with pytest.raises(ConfigError, match=f"points.csv: {wanted}, got the format points"):
        diagnose_recordings(several(whole, points, format="auto"))
    with pytest.raises(RecordingError, match=r"absent.csv: cannot be read"):
        diagnose_recordings(several(tmp_path / "absent.csv", whole))
