"""What is to be recorded instead: levels within the machine's limits that tell what is in doubt."""

import math
from dataclasses import replace

import numpy as np
import pytest

from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER, Excitation, Run, Scenario
from estimator.diagnosis.answer.design import DURATION, FEWEST, MOST, experiment
from estimator.diagnosis.diagnose import diagnose
from estimator.diagnosis.likelihood.noise import Noise
from estimator.diagnosis.verdict import Diagnosis, Experiment, Verdict
from estimator.machine import PARAMETERS, Machine
from estimator.physics.rows import Rows, rows_of
from estimator.twin.model import Model
from tests.support.samples import recorded

pytestmark = pytest.mark.thorough

I_RATED = 6.0  # A
NOMINAL = Machine(0.95, 4.1e-3, 6.3e-3, 0.118, 4, I_RATED)
TOLERANCE = dict.fromkeys(PARAMETERS, 0.1)
NOISE: Noise = (4.2e-3 * 0.01, 6.2e-3 * 0.01, 1.0)  # Vs, of 10 mA
U_DC = 310.0
HELD = replace(PAPER, excitation=Excitation(i_q_ref=3.0, kind="none"))
PAIR = ("angle_offset", "iron_loss")


def rows_at(scenario: Scenario = HELD, u_dc: float | None = U_DC) -> Rows:
    """A second of a drive."""
    run = recorded(VirtualDrive(scenario), 10_000)
    known = replace(run, u_dc=None if u_dc is None else np.full(len(run), u_dc))
    return rows_of([known], NOMINAL, I_RATED)


def check_within_limits(told: Experiment, fastest_rpm: float, u_most: float) -> None:
    assert FEWEST <= len(told.holds) <= MOST + 1
    assert sum(hold.seconds for hold in told.holds) == pytest.approx(DURATION)
    for hold in told.holds:
        assert abs(hold.speed_rpm) <= 1.001 * fastest_rpm
        assert math.hypot(hold.i_d, hold.i_q) + told.step <= I_RATED
        omega_e = hold.speed_rpm * NOMINAL.n_p * math.tau / 60.0
        u_d = NOMINAL.R_s * hold.i_d - omega_e * NOMINAL.L_q * hold.i_q
        u_q = NOMINAL.R_s * hold.i_q + omega_e * (NOMINAL.L_d * hold.i_d + NOMINAL.psi_f)
        assert math.hypot(u_d, u_q) <= u_most
    for name, levels in (("speed_rpm", told.speeds_rpm), ("i_d", told.i_d), ("i_q", told.i_q)):
        assert set(levels) == {getattr(hold, name) for hold in told.holds}


def test_two_effects_at_one_level_are_told_by_other_levels_at_the_same_speed() -> None:
    pair = ("voltage_offset", "iron_loss")
    told = experiment(rows_at(), Model(NOMINAL, {"voltage_offset": (0.1, 0.1)}), NOISE, NOMINAL, TOLERANCE, pair)
    check_within_limits(told, 1200.0, U_DC / math.sqrt(3.0))
    assert told.speeds_rpm == (1200.0,)
    assert len(told.i_d) + len(told.i_q) > 2
    assert told.odds is not None
    assert told.odds >= 1e6
    for said in ("level", "at the same speed", "(expected odds"):
        assert said in told.sentence


def test_an_offset_of_the_angle_asks_for_another_speed_as_a_latency_looks_like_it_at_one() -> None:
    told = experiment(rows_at(), Model(NOMINAL, {"angle_offset": (0.01,)}), NOISE, NOMINAL, TOLERANCE, PAIR)
    check_within_limits(told, 1200.0, U_DC / math.sqrt(3.0))
    assert len(told.speeds_rpm) > 1
    assert told.odds is not None
    assert told.odds >= 1e6
    assert "would tell an offset of the angle from iron loss (expected odds" in told.sentence


def test_a_rung_follows_the_periods_of_a_level() -> None:
    """They follow one another, however short a part of the experiment's time they are."""
    model, pair = Model(NOMINAL, {"ac_resistance": (0.3, 400.0)}), ("ac_resistance", "iron_loss")
    told = experiment(rows_at(), model, NOISE, NOMINAL, TOLERANCE, pair)
    assert told.odds is not None
    assert told.odds >= 1e6
    assert told.speeds_rpm == (1200.0,)


def test_the_smaller_the_effect_the_lower_the_odds_and_one_too_small_is_not_promised() -> None:
    odds = list[float]()
    for size in (1e-2, 1e-4, 1e-7):
        told = experiment(rows_at(), Model(NOMINAL, {"angle_offset": (size,)}), NOISE, NOMINAL, TOLERANCE, PAIR)
        assert told.odds is not None
        odds.append(told.odds)
    assert odds[0] >= odds[1] > odds[2]
    assert odds[2] < 100.0
    assert "is expected to tell" in told.sentence
    assert told.sentence.startswith("no level within 6.0 A and 1200 rpm")


def test_levels_keep_within_the_dc_link_and_where_that_is_unknown_within_what_was_recorded() -> None:
    fast = replace(HELD, run=Run(speed_rpm=2700.0))
    check_within_limits(
        experiment(rows_at(fast), Model(NOMINAL), NOISE, NOMINAL, TOLERANCE), 2700.0, U_DC / math.sqrt(3.0)
    )
    unknown = rows_at(fast, None)
    told = experiment(unknown, Model(NOMINAL), NOISE, NOMINAL, TOLERANCE)
    check_within_limits(told, 2700.0, 1.2 * float(np.max(np.abs(unknown.u))))


def test_where_the_fastest_speed_asks_for_too_much_voltage_slower_ones_are_chosen() -> None:
    strong = replace(NOMINAL, psi_f=0.5)  # Vs: 251 V at 1200 rpm
    told = experiment(rows_at(), Model(strong), NOISE, NOMINAL, TOLERANCE)
    assert 0.0 < max(told.speeds_rpm) < 700.0


def test_where_no_level_is_within_reach_none_is_proposed_and_a_sentence_says_so() -> None:
    told = experiment(rows_at(), Model(replace(NOMINAL, psi_f=10.0)), NOISE, NOMINAL, TOLERANCE)
    assert told.holds == ()
    assert told.sentence.startswith("no levels of speed and current can be chosen")


def test_a_proposal_that_cannot_be_worked_out_is_none_and_no_error() -> None:
    told = experiment(rows_at(), Model(NOMINAL), NOISE, NOMINAL, dict.fromkeys(PARAMETERS, 0.0))
    assert told.holds == ()
    assert told.sentence.startswith("no levels of speed and current can be chosen")


def test_where_encoder_counts_beat_with_the_period_the_speed_is_told_once() -> None:
    rows = replace(rows_at(), angle_step=1e-3, angle_error=1e-3)  # rad
    for machine in (NOMINAL, replace(NOMINAL, psi_f=0.3)):
        told = experiment(rows, Model(machine), NOISE, NOMINAL, TOLERANCE)
        for speed in told.speeds_rpm:
            assert told.sentence.count(f"{speed:.4g}") == 1
        assert "rpm, where encoder counts do not beat with the period, each" in told.sentence
        assert "same speed" not in told.sentence
        assert "speed of" not in told.sentence


def test_of_a_motor_that_stands_one_that_turns_is_wanted() -> None:
    told = experiment(
        rows_at(replace(HELD, run=Run(speed_rpm=0.0))), Model(NOMINAL), NOISE, NOMINAL, TOLERANCE
    )
    assert all(abs(speed) > 100.0 for speed in told.speeds_rpm)
    assert "speed" in told.sentence


def test_what_drifts_is_told_by_the_first_level_once_more() -> None:
    model = Model(NOMINAL, {"magnet_flux_drift": (-0.02, 0.6, 0.01)})
    told = experiment(rows_at(), model, NOISE, NOMINAL, TOLERANCE, ("magnet_flux_drift", "magnet_flux_step"))
    assert told.holds[0] == told.holds[-1]


def diagnosis_of(scenario: Scenario, periods: int = 20_000) -> Diagnosis:
    drive = VirtualDrive(scenario)
    drive.record(1000)
    return diagnose([recorded(drive, periods)], NOMINAL)


def test_currents_that_only_carry_noise_name_nothing_and_say_what_to_record() -> None:
    said = diagnosis_of(HELD)
    assert said.verdict in (Verdict.AMBIGUOUS, Verdict.NOT_ENOUGH_EXCITATION)
    assert said.findings == ()
    assert said.experiment is not None
    check_within_limits(said.experiment, 1200.0, U_DC / math.sqrt(3.0))
    assert said.experiment.sentence[1:] in said.sentence  # its first letter is a capital at a sentence's begin


@pytest.mark.parametrize("step", [0.05, 0.12, 0.25])
def test_steps_little_above_the_noise_name_nothing(step: float) -> None:
    scenario = replace(PAPER, excitation=Excitation(i_q_ref=2.0, i_d_step=step, i_q_step=step))
    assert diagnosis_of(scenario, 10_000).findings == ()
