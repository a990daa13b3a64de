"""Voltage pulses on a held rotor: what the emulator's legs and motor conceal in them, and what a real one shows."""

import math
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from bench.diagnoses.diagnose import as_json, diagnose_recording
from bench.diagnoses.diagnosis_request import Request
from bench.diagnoses.published import schema
from bench.errors import RecordingError
from bench.machine_file import Nominal
from emulator.plant.physics.legs import Inverter
from emulator.plant.physics.saturation import Saturation
from emulator.plant.physics.skin import Skin
from emulator.scenario.effects import Effects
from estimator.diagnosis.standstill.pulse_fit import SATURATION, Pulses
from estimator.diagnosis.standstill.pulses import PulsesTried, _left_of_pulses, diagnose_pulses
from estimator.diagnosis.verdict import Verdict
from tests.estimator.diagnosis.standstill.standstill_runs import SALIENT, U_DC, pulses
from tests.estimator.diagnosis.standstill.test_sweep import named, size, within
from tests.support.real_data import REAL_DATA

pytestmark = pytest.mark.thorough

REAL = REAL_DATA / "servo_standstill" / "voltage_pulses.csv.gz"


def test_saliency_pole_pairs_and_resistance_are_told_and_nothing_is_named() -> None:
    said = diagnose_pulses(pulses())
    assert (said.verdict, named(said)) == (Verdict.NO_MISMATCH, set())
    for name in ("R_s", "L_d", "L_q"):
        assert within(said.machine_after[name], getattr(SALIENT, name), 0.005)
    assert said.machine_after["n_p"].value == SALIENT.n_p


def test_drops_are_told_from_resistance() -> None:
    said = diagnose_pulses(pulses(inverter=Inverter(u_transistor=0.5, u_diode=0.5)))
    assert (said.verdict, named(said)) == (Verdict.EXPLAINED, {"inverter_voltage_error"})
    assert within(size(said, "inverter_voltage_error", "u_lost"), 0.5, 0.05)
    assert within(said.machine_after["R_s"], SALIENT.R_s, 0.02)


def test_skin_effect_is_sized_and_not_told_from_iron_loss() -> None:
    said = diagnose_pulses(pulses(Effects(skin=Skin(1.0, 2000.0))))
    assert (said.verdict, named(said)) == (Verdict.AMBIGUOUS, {"ac_resistance"})
    assert [doubt.effects for doubt in said.ambiguous] == [("ac_resistance", "iron_loss")]
    assert within(size(said, "ac_resistance", "resistance_above_corner"), 2.0 * SALIENT.R_s)
    assert within(size(said, "ac_resistance", "corner"), 2000.0)


def test_a_dc_link_that_reads_high_is_told_by_a_resistance_that_is_known_alone() -> None:
    trains = pulses(u_dc=1.2 * U_DC)
    blind = diagnose_pulses(trains)
    assert (blind.verdict, named(blind)) == (Verdict.NO_MISMATCH, set())
    assert any("dc_link_gain is not to be told" in remark for remark in blind.remarks)
    known = diagnose_pulses(trains, R_s=SALIENT.R_s)
    assert any("it would read 1.2" in remark and " ± " in remark for remark in known.remarks)


def test_the_currents_noise_makes_no_saturation() -> None:
    trains, noise = pulses(Effects(saturation=Saturation(0.0, 0.2))), np.random.default_rng(3)
    noisy = [replace(train, i=train.i + noise.normal(0.0, 0.3, train.i.shape)) for train in trains]
    found = [Pulses(each, SALIENT.n_p).fit((SATURATION,)).values for each in (trains, noisy)]
    assert found[1]["b"] == pytest.approx(found[0]["b"], rel=0.1)
    assert found[1]["L_0"] == pytest.approx(found[0]["L_0"], rel=0.015)


def test_what_is_left_is_told_without_the_currents_noise() -> None:
    made = Pulses(pulses(), SALIENT.n_p)
    fit = made.fit(())
    assert _left_of_pulses(made, PulsesTried(fit, (fit,), made.noise)) is None
    left = _left_of_pulses(made, PulsesTried(fit, (fit,), math.sqrt(5.0) * made.noise))
    assert left is not None
    assert left.rms_V == pytest.approx(2.0 * made.noise * fit.values["L_0"] / made.duration)


def test_pulses_at_few_angles_are_refused() -> None:
    trains = pulses()
    few = sorted({train.angle for train in trains})[:4]
    with pytest.raises(ValueError, match="no fewer than 5 angles, got 4"):
        diagnose_pulses([train for train in trains if train.angle in few])


def test_pulses_without_rows_at_rest_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "pulses.csv"
    path.write_text("angle_pu,segment,t_us,Vdc_V,ia_A,ib_A,ic_A,state\n0.1,0,0,28,0,0,0,2\n", encoding="utf-8")
    with pytest.raises(RecordingError, match="rows of state 1"):
        diagnose_recording(Request(path, Nominal({}), format="auto"))


@pytest.mark.skipif(not REAL.exists(), reason=f"{REAL} is not here")
def test_real_pulses_show_saliency_and_currents_that_bend_after_each_edge() -> None:
    diagnosed = diagnose_recording(Request(REAL, Nominal({}), format="auto"))
    said = diagnosed.diagnosis
    jsonschema.validate(as_json(diagnosed), schema())
    assert named(said) == {"ac_resistance"}
    L_d, L_q = (said.machine_before[name].value for name in ("L_d", "L_q"))
    assert L_d is not None and L_q is not None
    # By a hand analysis 487.7 uH, 17 uH more or less, of two phases in series at 28 V, which the file reads as 33.5 V
    assert (L_d + L_q) * 28.0 / 33.5 == pytest.approx(487.7e-6, rel=0.03)
    assert 12e-6 < (L_q - L_d) * 28.0 / 33.5 < 25e-6
    assert said.machine_after["n_p"].value == 14
    assert said.fit is not None and said.fit.leave_one_out is not None
    assert said.fit.leave_one_out.after < 0.75 * said.fit.leave_one_out.before
