"""The q axis alone: emulated recordings without u_d and i_d, and points by the closed form."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.legs import Inverter
from emulator.scenario.effects import NONE
from emulator.scenario.scenarios import PAPER_RUN, Excitation, Scenario
from estimator.diagnosis.points.q_axis_diagnosis import diagnose_q_log, diagnose_q_points
from estimator.diagnosis.points.table import Points
from estimator.diagnosis.verdict import Diagnosis, Verdict
from estimator.samples import Samples

TRUTH = {"R_s": 0.9664, "L_q": 6.21e-3, "psi_f": 0.12}
T_S, U_DC = 1e-4, 310.0
STEPS = replace(PAPER_RUN, excitation=Excitation(i_q_step=2.0, step_time=5e-3))
SLOW = replace(
    PAPER_RUN, excitation=Excitation(i_q_step=2.0, kind="multisine", sine_frequency=1.0),
    run=replace(PAPER_RUN.run, speed_rpm=200.0, rise_rpm=0.0, swing_rpm=200.0, swing_frequency=0.7),
)
DEAD = NONE._replace(inverter=Inverter(dead_time=1.5e-6))


def recorded(scenario: Scenario, rows: int, one_in: int = 1, *, by_speed: bool = False) -> Samples:
    c = {name: np.ascontiguousarray(x[::one_in]) for name, x in VirtualDrive(scenario).record(rows).items()}
    T, none = T_S * one_in, np.zeros(len(c["t"]))
    theta_e = c["theta_e"]
    if by_speed:
        theta_e = np.cumsum(np.r_[0.0, 0.5 * T * (c["omega_e"][1:] + c["omega_e"][:-1])])
    return Samples(theta_e, c["omega_e"], none, c["i_q"], none, c["u_q"], T, q_only=True)


def expect_truth(found: Diagnosis, names: Sequence[str] = tuple(TRUTH)) -> None:
    for name in names:
        size = found.machine_after[name]
        assert size.value is not None
        assert size.std is not None
        assert abs(size.value - TRUTH[name]) < 3.0 * size.std, (name, size)
        assert size.std < 0.2 * TRUTH[name], (name, size)


def named(found: Diagnosis) -> list[str]:
    return [finding.effect for finding in found.findings]


def test_nothing_is_named_where_nothing_is_and_the_answer_says_what_was_not_looked_for() -> None:
    found = diagnose_q_log([recorded(STEPS, 20_000)])
    assert found.verdict is Verdict.NO_MISMATCH
    assert found.sentence.startswith("Of the q axis alone: ")
    expect_truth(found)
    assert "L_d" not in found.machine_after
    said = " ".join(found.remarks)
    assert "whether any other effect is there cannot be told, and L_d is not asked for" in said
    assert "i_d is taken for zero to within 1% of i_q" in said
    assert set(found.detectable) <= {
        "inverter_voltage_error", "voltage_offset", "winding_resistance_drift", "magnet_flux_drift",
    }


def test_an_inverters_error_is_named_with_its_size() -> None:
    found = diagnose_q_log([recorded(replace(STEPS, effects=DEAD), 20_000)])
    assert named(found) == ["inverter_voltage_error"]
    voltage = found.findings[0].parameters["voltage"]
    assert voltage.value == pytest.approx(4.0 / np.pi * 1.5e-6 * U_DC / T_S, rel=0.05)
    assert found.findings[0].absorbed_as["R_s"] > 0.3
    expect_truth(found)


def test_a_lag_of_the_only_speed_is_named_and_no_resistance() -> None:
    drive = replace(STEPS.drive, recorded_speed="filtered", speed_filter=1.42e-3)
    found = diagnose_q_log([recorded(replace(STEPS, drive=drive), 20_000, by_speed=True)])
    assert named(found) == ["speed_lag"]
    assert found.findings[0].parameters["lag"].value == pytest.approx(1.47e-3, rel=0.12)
    assert found.machine_before["R_s"].value == pytest.approx(1.47, abs=0.1)
    expect_truth(found)


def test_values_of_an_instant_on_a_free_shaft_are_told_from_an_offset_by_nothing() -> None:
    found = diagnose_q_log([recorded(SLOW, 80_000, 10)])
    assert found.verdict is Verdict.AMBIGUOUS
    assert not found.findings
    assert "voltage_delay" in found.ambiguous[0].effects
    assert "--align u=-0.4" in found.ambiguous[0].reason
    R_s = found.machine_after["R_s"]
    assert abs((R_s.value or 0.0) - TRUTH["R_s"]) < 3.0 * (R_s.std or 0.0)


def test_an_inverters_error_at_one_sign_of_the_current_leaves_the_resistance_wide() -> None:
    found = diagnose_q_log([recorded(replace(SLOW, effects=DEAD), 80_000, 10)])
    assert set(named(found)) <= {"inverter_voltage_error"}
    R_s = found.machine_after["R_s"]
    assert abs((R_s.value or 0.0) - TRUTH["R_s"]) < 3.0 * (R_s.std or 0.0)


def test_a_current_of_the_other_axis_that_was_not_recorded_is_no_noise() -> None:
    found = diagnose_q_log([recorded(PAPER_RUN, 20_000)])
    assert found.verdict is Verdict.UNEXPLAINED
    assert "V above noise" in found.sentence


def test_too_few_rows_are_no_verdict() -> None:
    run = recorded(STEPS, 20_000)
    for rows in (5, 15):
        assert diagnose_q_log([run[:rows]]).verdict is Verdict.NOT_ENOUGH_EXCITATION


# --- Steady points


def points(lost: float = 0.0, i_d: float = 0.0, noise: float = 2e-3) -> Points:
    """By the closed form; noise in V."""
    chance = np.random.default_rng(5)
    speeds, currents = [-400.0, -150.0, 60.0, 150.0, 400.0], [-5.0, -3.0, -1.0, 1.0, 3.0, 5.0]
    omega, i_q = (x.ravel() for x in np.meshgrid(speeds, currents))
    u_q = 0.5 * i_q + omega * (0.02 + 1e-3 * i_d) + lost * np.sign(i_q) + noise * chance.normal(size=len(i_q))
    i, u = np.zeros((2, len(i_q)), np.complex128)
    i.real, i.imag, u.imag = i_d, i_q, u_q
    return Points(omega, i, u)


def test_points_tell_r_s_and_psi_f_and_no_l_q() -> None:
    found = diagnose_q_points(points(), i_d=False)
    assert found.verdict is Verdict.NO_MISMATCH
    assert set(found.machine_after) == {"R_s", "psi_f"}
    assert found.machine_after["R_s"].value == pytest.approx(0.5, rel=2e-3)
    assert found.machine_after["psi_f"].value == pytest.approx(0.02, rel=1e-3)


def test_points_tell_an_inverters_error() -> None:
    found = diagnose_q_points(points(lost=0.4), i_d=False)
    assert named(found) == ["inverter_voltage_error"]
    assert found.findings[0].parameters["voltage"].value == pytest.approx(0.4, rel=0.05)
    assert found.machine_after["R_s"].value == pytest.approx(0.5, rel=0.02)
