"""Sine sweeps at standstill: what the emulator's bridge and motor conceal in them, and what a real one shows."""

import csv
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from bench.diagnoses.diagnose import as_json, diagnose_recording
from bench.diagnoses.diagnosis_request import Request
from bench.diagnoses.published import schema
from bench.errors import ConfigError, RecordingError
from bench.machine_file import Nominal
from emulator.plant.physics.iron_loss import IronLoss
from emulator.plant.physics.legs import Inverter
from emulator.plant.physics.skin import Skin
from emulator.scenario.effects import Effects
from estimator.diagnosis.standstill.sweep import diagnose_sweep
from estimator.diagnosis.standstill.tones import Tone
from estimator.diagnosis.verdict import Diagnosis, Quantity, Verdict
from tests.estimator.diagnosis.standstill.standstill_runs import SERVO, U_DC, T, sweep
from tests.support.real_data import REAL_DATA

pytestmark = pytest.mark.slow

REAL = REAL_DATA / "servo_standstill" / "sine_identification.csv"
DEAD_TIME = 1e-6  # s


def named(diagnosis: Diagnosis) -> set[str]:
    return {finding.effect for finding in diagnosis.findings}


def size(diagnosis: Diagnosis, effect: str, name: str) -> Quantity:
    return next(finding for finding in diagnosis.findings if finding.effect == effect).parameters[name]


def within(found: Quantity, true: float, least: float = 0.0) -> bool:
    """Within three standard errors, or a share of the value."""
    assert found.value is not None and found.std is not None
    return abs(found.value - true) <= max(3.0 * found.std, least * true)


@cache
def dead_time_found() -> Diagnosis:
    return diagnose_sweep(sweep(inverter=Inverter(dead_time=DEAD_TIME)))


def test_nothing_is_named_where_nothing_is_left_out() -> None:
    said = diagnose_sweep(sweep())
    assert (said.verdict, named(said), said.ambiguous) == (Verdict.NO_MISMATCH, set(), ())
    assert within(said.machine_after["R_s"], SERVO.R_s, 0.002)
    assert within(said.machine_after["L_d"], SERVO.L_d, 0.002)


def test_dead_time_is_told_from_resistance_by_the_third_harmonic() -> None:
    said = dead_time_found()
    assert named(said) == {"inverter_voltage_error"}
    assert said.verdict in (Verdict.EXPLAINED, Verdict.PARTLY_EXPLAINED)
    assert within(size(said, "inverter_voltage_error", "u_lost"), DEAD_TIME / T * U_DC, 0.05)
    assert within(said.machine_after["R_s"], SERVO.R_s)
    before = said.machine_before["R_s"].value
    assert before is not None and before > 2.0 * SERVO.R_s
    loo = said.fit.leave_one_out if said.fit else None
    assert loo is not None and loo.after < 0.1 * loo.before


@pytest.mark.slow
def test_drops_are_sized_as_what_a_leg_loses() -> None:
    said = diagnose_sweep(sweep(inverter=Inverter(u_transistor=0.4, u_diode=0.4)))
    assert named(said) == {"inverter_voltage_error"}
    assert within(size(said, "inverter_voltage_error", "u_lost"), 0.4, 0.05)


def test_skin_effect_is_sized_and_not_told_from_iron_loss() -> None:
    said = diagnose_sweep(sweep(Effects(skin=Skin(0.5, 500.0))))
    assert (named(said), said.verdict) == ({"ac_resistance"}, Verdict.AMBIGUOUS)
    assert [doubt.effects for doubt in said.ambiguous] == [("ac_resistance", "iron_loss")]
    assert within(size(said, "ac_resistance", "resistance_above_corner"), 2.0 * 0.5 * SERVO.R_s, 0.05)
    assert within(size(said, "ac_resistance", "corner"), 500.0, 0.05)
    assert within(said.machine_after["R_s"], SERVO.R_s, 0.005)


@pytest.mark.slow
def test_iron_loss_is_not_called_a_windings_without_doubt() -> None:
    said = diagnose_sweep(sweep(Effects(iron_loss=IronLoss(R_c=3.0))))
    assert said.verdict is Verdict.AMBIGUOUS
    assert ("ac_resistance", "iron_loss") in [doubt.effects for doubt in said.ambiguous]


@pytest.mark.slow
def test_dead_time_and_skin_effect_are_both_found() -> None:
    said = diagnose_sweep(sweep(Effects(skin=Skin(0.5, 500.0)), Inverter(dead_time=DEAD_TIME)))
    assert named(said) == {"inverter_voltage_error", "ac_resistance"}
    assert within(size(said, "inverter_voltage_error", "u_lost"), DEAD_TIME / T * U_DC, 0.05)
    assert within(said.machine_after["R_s"], SERVO.R_s)


def test_currents_that_dead_time_swallows_are_not_called_a_match() -> None:
    said = diagnose_sweep(sweep(inverter=Inverter(dead_time=5e-7), amperes=1.0, seed=2))
    assert said.verdict is Verdict.NOT_ENOUGH_EXCITATION
    assert "record larger currents" in said.sentence


def test_a_sensors_gain_shows_in_the_currents_sum() -> None:
    said = diagnose_sweep(sweep(gains=(1.1, 1.0, 1.0)))
    assert named(said) == {"current_sensor_gain"}
    # Which of the sensors, and so the current's scale, stays open
    assert within(said.machine_after["R_s"], SERVO.R_s)
    assert within(said.machine_after["L_d"], SERVO.L_d)


@pytest.mark.slow
def test_unequal_gains_do_not_hide_dead_time() -> None:
    said = diagnose_sweep(sweep(inverter=Inverter(dead_time=DEAD_TIME), gains=(1.1, 1.0, 1.0)))
    assert "inverter_voltage_error" in named(said)
    assert within(size(said, "inverter_voltage_error", "u_lost"), DEAD_TIME / T * U_DC, 0.1)
    assert within(said.machine_after["R_s"], SERVO.R_s)


@pytest.mark.parametrize(
    ("tones", "reason"),
    [
        (lambda: sweep(frequencies=(200.0, 400.0)), "at least 5 frequencies"),
        (lambda: [_turning(tone) for tone in sweep(frequencies=(200.0, 400.0))], "one axis"),
        (lambda: [_first(tone, 30) for tone in sweep(frequencies=(200.0,))], "two periods"),
    ],
)
def test_what_is_no_sweep_is_refused_with_a_reason(tones: Callable[[], list[Tone]], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        diagnose_sweep(tones())


def _first(tone: Tone, rows: int) -> Tone:
    return Tone(tone.frequency, tone.T_s, tone.t[:rows], tone.duties[:rows], tone.u_dc[:rows], tone.i[:rows])


def _turning(tone: Tone) -> Tone:
    phase = 2.0 * np.pi * tone.frequency * tone.t
    duties = 0.5 + 0.1 * np.column_stack([np.cos(phase - k * 2.0 * np.pi / 3.0) for k in range(3)])
    return Tone(tone.frequency, tone.T_s, tone.t, duties, tone.u_dc, tone.i)


# --- the file's format


def written(path: Path, tones: Sequence[Tone]) -> Path:
    """The tones as a servo's file has them."""
    with path.open("w", newline="", encoding="utf-8") as file:
        out = csv.writer(file)
        out.writerow(["F_Hz", "t_s", "Ts_s", "ia_A", "ib_A", "ic_A", "Vdc_V", "vqd_V", "va_cnt", "vb_cnt", "vc_cnt"])
        for tone in tones:
            phases = tone.duties - tone.duties.mean(axis=1, keepdims=True)
            for k in range(len(tone.t)):
                volts = phases[k, 0] * tone.u_dc[k]
                counts = 3000.0 * phases[k]
                out.writerow([tone.frequency, tone.t[k], tone.T_s, *tone.i[k], tone.u_dc[k], volts, *counts])
    return path


@pytest.mark.slow
def test_a_sweeps_file_says_the_same(tmp_path: Path) -> None:
    tones = sweep(inverter=Inverter(dead_time=DEAD_TIME))
    diagnosed = diagnose_recording(Request(written(tmp_path / "sine.csv", tones), Nominal({}), format="auto"))
    there, here = (
        size(said, "inverter_voltage_error", "u_lost").value for said in (diagnosed.diagnosis, dead_time_found())
    )
    assert there == pytest.approx(here, rel=1e-3)
    jsonschema.validate(as_json(diagnosed), schema())


def test_a_sweep_without_a_column_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "sine.csv"
    path.write_text("F_Hz,t_s\n100,0\n", encoding="utf-8")
    with pytest.raises(RecordingError, match="missing columns: Ts_s, ia_A"):
        diagnose_recording(Request(path, Nominal({}), format="servo-sine"))


def test_a_recording_of_every_period_asks_for_its_machine(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("t,u_d,u_q,i_d,i_q,omega_e,theta_e\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="needs its machine's data, expected --nominal"):
        diagnose_recording(Request(path, Nominal({}), format="auto"))


# --- a real servo


@pytest.mark.slow
@pytest.mark.skipif(not REAL.exists(), reason=f"{REAL} is not here")
def test_a_real_sweep_follows_on_frequencies_left_out() -> None:
    diagnosed = diagnose_recording(Request(REAL, Nominal({}), format="auto"))
    said = diagnosed.diagnosis
    jsonschema.validate(as_json(diagnosed), schema())
    loo = said.fit.leave_one_out if said.fit else None
    assert loo is not None
    assert loo.before > 0.07  # resistance, inductance and a delay
    assert loo.after < 0.014
    assert named(said) == {"inverter_voltage_error", "ac_resistance"}
    assert ("ac_resistance", "iron_loss") in [doubt.effects for doubt in said.ambiguous]
    assert ("current_sensor_gain", "current_sampling_skew") in [doubt.effects for doubt in said.ambiguous]
    R_s = said.machine_after["R_s"]
    assert R_s.value is not None and R_s.std is not None
    assert R_s.std > 0.2 * R_s.value  # it trades off with what the legs lose
