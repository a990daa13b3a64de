"""Steady points of real motors, where their files are: what is named, what left-out points bear, what is not said."""

import csv
from pathlib import Path

import pytest

from bench.diagnoses.diagnose import diagnose_recording
from bench.diagnoses.diagnosis_request import Request
from bench.machine_file import Nominal
from estimator.diagnosis.verdict import Diagnosis, Verdict
from tests.support.real_data import REAL_DATA

pytestmark = pytest.mark.thorough

MOTEUS = {name: REAL_DATA / "moteus_ld" / f"ld_{name}.json" for name in ("be8108", "custom", "mj5208", "spindle")}
THERMAL = REAL_DATA / "lea_thermal" / "session60.csv"


def said_of(path: Path) -> Diagnosis:
    if not path.exists():
        pytest.skip(f"{path} is not here")
    return diagnose_recording(Request(path, Nominal({}), format="auto")).diagnosis


@pytest.mark.parametrize("name", MOTEUS)
def test_the_voltage_error_is_named_where_left_out_speeds_bear_it_and_only_there(name: str) -> None:
    said = said_of(MOTEUS[name])
    assert said.fit is not None and said.fit.leave_one_out is not None
    left_out = said.fit.leave_one_out
    assert {finding.effect for finding in said.findings} <= {"inverter_voltage_error"}
    if said.findings:
        assert left_out.after <= 0.5 * left_out.before
        assert left_out.after < left_out.alternatives["free_offsets"]
    else:
        assert said.verdict in (Verdict.AMBIGUOUS, Verdict.NOT_ENOUGH_EXCITATION, Verdict.NO_MISMATCH)
        assert left_out.alternatives["inverter_voltage_error"] > 0.5 * left_out.before


@pytest.mark.parametrize(("name", "volts"), [("be8108", 0.19), ("mj5208", 0.17)])
def test_two_motors_show_it_plainly(name: str, volts: float) -> None:
    said = said_of(MOTEUS[name])
    (finding,) = said.findings
    found = finding.parameters["voltage"]
    assert found.value == pytest.approx(volts, abs=0.02) and found.std is not None and found.std < 0.04
    assert finding.absorbed_as["psi_f"] > 0.0
    assert finding.odds_against_next > 1e4


def test_a_motor_whose_points_fit_no_line_gets_no_verdict_on_it() -> None:
    said = said_of(MOTEUS["spindle"])
    assert said.verdict is Verdict.NOT_ENOUGH_EXCITATION
    assert "i_d = -14.5 A, which no straight line meets" in said.sentence


def test_the_traction_motor_saturates_and_its_inverter_loses_voltage_and_no_drift_is_claimed() -> None:
    said = said_of(THERMAL)
    found = {finding.effect: finding.parameters for finding in said.findings}
    assert set(found) == {"q_axis_saturation", "inverter_voltage_error"}
    voltage = found["inverter_voltage_error"]["voltage"]
    assert voltage.value is not None and voltage.std is not None and 4.0 * voltage.std < voltage.value < 2.0
    assert said.fit is not None and said.fit.leave_one_out is not None
    assert said.fit.leave_one_out.after < 0.25 * said.fit.leave_one_out.before
    before, after = said.machine_before["R_s"].value, said.machine_after["R_s"].value
    assert before is not None and after is not None and before > 1.3 * after  # both hid as resistance
    assert said.verdict is Verdict.PARTLY_EXPLAINED and said.unexplained is not None


def test_what_is_said_of_drift_holds_against_the_thermocouples_that_were_withheld() -> None:
    said = said_of(THERMAL)
    remark = next(remark for remark in said.remarks if remark.startswith("drift of the magnets' flux is not told"))
    value, half = map(float, remark.split(" % from first")[0].rpartition(": ")[2].split(" ± "))
    with THERMAL.open(encoding="utf-8") as file:
        magnet = [float(row["pm"]) for row in csv.DictReader(file)]
    share = -0.11 * (magnet[1400] - magnet[100])  # %, NdFeB
    assert abs(value - share) < half
