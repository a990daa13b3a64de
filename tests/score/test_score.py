"""The score of the diagnosis: a truthful one has full marks, a wrong one those that it deserves."""

import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emulator.conceal.files import answer_of
from emulator.conceal.populations import EFFECTS, STRANGERS
from emulator.conceal.recording import Choice, drawn
from emulator.conceal.suite import Suite, make
from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.motors import MOTORS
from emulator.scenario.scenarios import parse
from estimator.diagnosis.verdict import (
    Diagnosis,
    ErrorChange,
    Finding,
    Fit,
    Place,
    Quantity,
    Range,
    Unexplained,
    Verdict,
)
from estimator.machine import Machine
from estimator.samples import Samples
from tests.score.diagnosed import Said, diagnosed, loaded
from tests.score.rows import Row, row_of
from tests.score.score import Measure, bars, by_group, by_size, confusion
from tests.score.truth import Truth, truth_of

pytestmark = pytest.mark.thorough

SEED = 1001
NOWHERE = Place("", {}, 1.0, 1.0)


def answer(*kinds: str, number: int = 1, motor: str = "servo_4nm", length: float = 0.3) -> dict[str, Any]:
    """What a recording conceals."""
    choice = Choice(SEED, kinds, (0.5, 0.5), (motor,), length)
    return answer_of(drawn(choice, number)[0], choice, f"{number:04}")


def said(verdict: Verdict, findings: Sequence[Finding] = (), unexplained: Unexplained | None = None) -> Said:
    """A diagnosis in short."""
    machine = {name: Quantity(1.0, 0.0, "") for name in ("R_s", "L_d", "L_q", "psi_f")}
    fit = Fit(True, ErrorChange(2.0, 1.02, 1.0), ErrorChange(1.0, 0.1), 0.9, ErrorChange(5.0, 1.0))
    found = Diagnosis(verdict, "", tuple(findings), (), unexplained, {}, machine, machine, fit, (), (), None)
    return Said(found, "", 1.5)


def finding(effect: str, **parameters: tuple[float, float]) -> Finding:
    """By value and standard error."""
    told = {name: Quantity(value, std, "") for name, (value, std) in parameters.items()}
    return Finding(effect, told, NOWHERE, 1e9, (), {})


def truthful(truth: Truth) -> Said:
    """The diagnosis that is right in all."""
    findings = [
        finding(effect, **{name: (size.value, 0.0) for name, size in sizes.items()})
        for effect, sizes in truth.effects.items()
    ]
    heard = said(Verdict.EXPLAINED if findings else Verdict.NO_MISMATCH, findings)
    assert heard.diagnosis is not None
    machine = {name: Quantity(value, 0.0, "") for name, value in truth.machine.items()}
    return replace(heard, diagnosis=replace(heard.diagnosis, machine_after=machine))


def scored(told: Mapping[str, Any], heard: Said, over_limit: float = 10.0) -> Row:
    return row_of("0001", truth_of(told), dict.fromkeys(told["classes"], over_limit), heard)


@pytest.mark.parametrize("kind", ["none", *EFFECTS])
def test_the_truth_has_full_marks(kind: str) -> None:
    told = answer(kind)
    row = scored(told, truthful(truth_of(told)))
    assert row.exact
    assert not row.false_verdict
    assert all(size.right for size in row.sizes.values())
    assert any(size.true != 0.0 for size in row.sizes.values()) == (kind != "none")
    assert set(row.after.values()) == {0.0}
    assert None not in row.before.values()


def test_a_size_may_be_wrong_by_a_tenth_or_two_standard_errors() -> None:
    told = answer("demagnetisation")
    true = truth_of(told).effects["magnet_flux_step"]
    change, time = true["change"].value, true["time"].value
    assert change < 0.0

    def right(factor: float, std: float) -> bool:
        heard = said(Verdict.EXPLAINED, [finding("magnet_flux_step", change=(factor * change, std), time=(time, 0.0))])
        return scored(told, heard).sizes["magnet_flux_step.change"].right

    assert right(1.09, 0.0)
    assert not right(1.11, 0.0)
    assert right(1.3, 0.16 * abs(change))
    assert not right(-1.0, 0.5 * abs(change))


def test_a_size_that_is_not_told_is_not_right() -> None:
    row = scored(answer("skin"), said(Verdict.EXPLAINED, [finding("ac_resistance", rise=(1.0, 0.1))]))
    assert row.sizes["ac_resistance.corner"].value is None
    assert not row.sizes["ac_resistance.corner"].right


def test_what_is_wrong_is_told_apart() -> None:
    told = answer("iron_loss")
    nothing = scored(told, said(Verdict.NO_MISMATCH))
    assert (nothing.missed, nothing.false, nothing.exact, nothing.false_verdict) == (("iron_loss",), (), False, True)
    assert not scored(told, said(Verdict.NO_MISMATCH), over_limit=0.5).false_verdict
    other = scored(told, said(Verdict.EXPLAINED, [finding("angle_offset")]))
    assert (other.missed, other.false, other.false_verdict) == (("iron_loss",), ("angle_offset",), True)
    doubtful = scored(told, said(Verdict.NOT_ENOUGH_EXCITATION))
    assert (doubtful.missed, doubtful.false_verdict) == (("iron_loss",), False)
    failed = scored(told, Said(None, "expected more rows", 0.1))
    assert (failed.verdict, failed.false_verdict, failed.exact) == ("error", True, False)


def test_a_gain_of_the_dc_link_is_told_by_a_range_that_holds_it() -> None:
    told = answer("dc_link_gain")
    gain = truth_of(told).effects["dc_link_gain"]["gain"].value
    heard = said(Verdict.NO_MISMATCH)
    assert heard.diagnosis is not None
    for least, most, right in ((0.9 * gain, 1.1 * gain, True), (1.01 * gain, 1.1 * gain, False)):
        open_ = replace(heard.diagnosis, scales={"voltages": Range(least, most)})
        row = scored(told, replace(heard, diagnosis=open_))
        assert (row.gain_told, row.all_told, row.exact) == (right, right, False)
    assert (scored(told, heard).gain_told, scored(answer("none"), heard).gain_told) == (False, None)


def unexplained(**region: float | str | tuple[float, float]) -> Said:
    return said(Verdict.UNEXPLAINED, (), Unexplained(1.0, Place("", region, 0.9, 0.9), ""))


def test_a_stranger_is_right_by_its_region_and_never_by_a_name() -> None:
    told = answer("stray_voltage", length=3.0)
    true = parse(told["scenario"], "").effects.stray.frequency
    assert scored(told, unexplained(frame="stationary", frequency=1.01 * true)).stranger == "right"
    assert scored(told, unexplained(frame="rotor", frequency=true)).stranger == "elsewhere"
    assert scored(told, unexplained(frame="stationary", frequency=1.2 * true + 1.0)).stranger == "elsewhere"
    assert scored(told, said(Verdict.EXPLAINED, [finding("skin")])).stranger == "forced"
    assert scored(told, said(Verdict.NO_MISMATCH)).stranger == "missed"
    assert scored(answer("telegraph"), unexplained(time="bursts")).stranger == "right"
    told = answer("resonance")
    T_s = parse(told["scenario"], "").drive.T_s
    assert scored(told, unexplained(frequency=(0.1 / T_s, 0.2 / T_s))).stranger == "right"
    assert scored(told, unexplained(frequency=0.01 / T_s)).stranger == "elsewhere"


def test_a_voltage_that_is_recorded_early_acted_later() -> None:
    told = answer("voltage_early", motor="aalto_2k2")
    scenario = parse(told["scenario"], "")
    true = replace(scenario, effects=scenario.effects._replace(timing=scenario.effects.timing._replace(shift=0)))
    periods = 200
    shifted, applied = VirtualDrive(scenario).record(periods), VirtualDrive(true).record(periods)
    late = round(truth_of(told).effects["voltage_delay"]["periods"].value)
    assert late == 1
    np.testing.assert_allclose(shifted["u_q"][:-1], applied["u_q"][late:], atol=1e-3 * scenario.drive.u_dc)


def test_an_angle_reads_as_far_off_as_its_truth_says() -> None:
    told = answer("angle_offset")
    scenario = parse(told["scenario"], "")
    ideal = replace(scenario, drive=replace(scenario.drive, encoder_counts=0), effects=scenario.effects._replace(
        angle_sensing=scenario.effects.angle_sensing._replace(offset=0.0)))
    run = replace(scenario.run, shaft="dynamometer", speed_control=False)
    read = VirtualDrive(replace(scenario, run=run)).record(2000)["theta_e"]
    there = VirtualDrive(replace(ideal, run=run)).record(2000)["theta_e"]
    off = float(np.mean(np.angle(np.exp(1j * (read - there)))))
    assert off == pytest.approx(truth_of(told).effects["angle_offset"]["offset"].value, rel=0.02)


def silent(runs: Sequence[Samples], nominal: Machine) -> Diagnosis:
    """A diagnosis that sees nothing, but looks at what it gets."""
    for run in runs:
        columns = (run.u_dc, run.i_a, run.i_b, run.i_c)
        if any(column is None or len(column) != len(run) for column in columns):
            raise ValueError("expected dc link and phase currents of every row")
    heard = said(Verdict.NO_MISMATCH).diagnosis
    assert heard is not None
    return replace(heard, sentence=f"{nominal.n_p} pole pairs, {sum(map(len, runs))} rows")


@pytest.fixture(scope="module")
def suite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A few short recordings in `out`, their answers in `answers`."""
    folder = tmp_path_factory.mktemp("suite")
    choice = Choice(SEED, ("none", "iron_loss", "dead_time", "telegraph"), (0.5, 0.5), tuple(MOTORS), 0.2)
    make(Suite(choice, 8, folder / "out", folder / "answers", workers=1), lambda _done: None)
    return folder


def test_loaded_runs_have_the_rows_of_the_file(suite: Path) -> None:
    for path in sorted((suite / "out").glob("*.parquet")):
        runs, machine = loaded(suite / "out", path.stem)
        assert machine.n_p >= 1
        for run in runs:
            assert run.i_a is not None
            assert run.i_b is not None
            assert run.i_c is not None
            assert machine.i_rated is not None
            of_phases = (2.0 * run.i_a - run.i_b - run.i_c) / 3.0
            of_vector = run.i_d * np.cos(run.theta_e) - run.i_q * np.sin(run.theta_e)
            np.testing.assert_allclose(of_phases, of_vector, atol=1e-3 * machine.i_rated)


def test_a_suite_is_scored_by_a_command(suite: Path, tmp_path: Path) -> None:
    scored = subprocess.run(
        [
            sys.executable, "-m", "tests.score.score", "--out", suite / "out", "--answers", suite / "answers",
            "--json", tmp_path / "rows.json", "--jobs", "1", "--function", "tests.score.test_score:silent",
        ],
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert scored.returncode == 0, scored.stderr
    assert "one effect of 3 limits or more" in scored.stdout
    assert (tmp_path / "rows.json").read_text().count('"verdict": "no_mismatch"') == 8
    assert "(error)" not in scored.stdout


def broken(_runs: Sequence[Samples], _nominal: Machine) -> Diagnosis:
    """A diagnosis with a defect."""
    raise ZeroDivisionError


def test_a_defect_costs_its_recording_only(suite: Path) -> None:
    ((_, heard),) = diagnosed([(suite / "out", "0001")], "tests.score.test_score:broken", 1)
    assert heard.diagnosis is None
    assert "ZeroDivisionError" in heard.error


def test_a_bar_is_held_missed_or_not_judged() -> None:
    assert [Measure("", hits, 100, at_least=0.97).held for hits in (97, 96)] == [True, False]
    assert [Measure("", hits, 100, at_most=0.01).held for hits in (1, 2)] == [True, False]
    assert Measure("", 0, 0, at_least=0.97).held is None
    assert Measure("", 1, 1).held is None


def test_tables_count_what_the_rows_say() -> None:
    told, other = answer("iron_loss"), answer("dead_time")
    rows = [
        scored(told, truthful(truth_of(told))),
        scored(other, said(Verdict.NO_MISMATCH)),
        scored(answer("none"), said(Verdict.EXPLAINED, [finding("skin")])),
    ]
    asked = bars(rows)
    assert [asked[1][2:], asked[8][2:]] == [("50.0%", "2"), ("100.0%", "1")]
    assert ("iron_loss", "1 right") in confusion(rows)
    assert ("dead_time", "1 (no_mismatch)") in confusion(rows)
    assert ("dead_time", "1", "0.0%", "100.0%") in [row[:4] for row in by_group(rows)]
    assert by_size(rows)[-1] == ("above 10", "2", "50.0%", "2", "50.0%")
    assert {*STRANGERS}.isdisjoint(row.kind for row in rows)
