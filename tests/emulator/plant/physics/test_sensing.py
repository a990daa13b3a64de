"""Sensing and timing against what was told: gains, offsets, skews, the encoder's ring, the dc link's reading, rows."""

import cmath
import math
from dataclasses import replace

import numpy as np
import pytest

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.sensing import AngleSensing, CurrentSensing, VoltageSensing
from emulator.plant.physics.timing import Timing
from tests.emulator.plant.physics.effect_runs import (
    ROUND,
    T_S,
    Column,
    Recording,
    at,
    currents,
    phases_of,
    stationary_voltages,
    steady,
    switched,
    voltage_error,
    voltages,
    with_effects,
)

CHANNELS = CurrentSensing(1.05, 0.98, 1.01, 0.2, -0.1, 0.05)


def phases_and_truth(sensing: CurrentSensing, turns_per_s: float = 50.0) -> tuple[Column, Column]:
    """Measured and true phase currents (A) of an electrical turn; the true ones from the round rotor's flux linkage."""
    drive = VirtualDrive(with_effects(motor=ROUND, i_dq=2.0 + 5j, run=at(turns_per_s), current_sensing=sensing))
    drive.run(2000)
    measured: list[tuple[float, ...]] = []
    true: list[tuple[float, ...]] = []
    for _ in range(round(1.0 / turns_per_s / T_S)):
        state = drive.plant
        rotor = complex(math.cos(ROUND.n_p * state.theta_m), math.sin(ROUND.n_p * state.theta_m))
        true.append(phases_of((state.psi - ROUND.psi_f * rotor) / ROUND.L_d))
        r = drive.record(1)
        measured.append((r["i_a"][0], r["i_b"][0], r["i_c"][0]))
    return np.array(measured), np.array(true)


def test_every_current_channel_has_its_gain_and_offset() -> None:
    measured, true = phases_and_truth(CHANNELS)
    for k, (gain, offset) in enumerate(((1.05, 0.2), (0.98, -0.1), (1.01, 0.05))):
        assert measured[:, k] == pytest.approx(gain * true[:, k] + offset, abs=1e-9)


@pytest.mark.parametrize("edges", [False, True], ids=["averaged", "switched"])
def test_a_channel_that_samples_late_tells_the_current_of_then(edges: bool) -> None:
    """L di/dt = u - R_s i - j omega psi: u is the coming period's mean voltage, or no voltage between edges."""
    skew = 1e-5
    scenario = with_effects(motor=ROUND, i_dq=2.0 + 5j, run=at(100.0), current_sensing=CurrentSensing(skew_b=skew))
    drive = VirtualDrive(switched(scenario) if edges else scenario)
    drive.run(500)
    for _ in range(100):
        state = drive.plant
        rotor = cmath.exp(1j * ROUND.n_p * state.theta_m)
        i = (state.psi - ROUND.psi_f * rotor) / ROUND.L_d
        r = drive.record(2)
        u = 0j if edges else complex(stationary_voltages(r)[0])
        omega_e = float(r["omega_e"][0])
        back_emf = 1j * omega_e * ROUND.psi_f * rotor * cmath.exp(0.5j * omega_e * skew)  # halfway
        slope = (u - ROUND.R_s * i - back_emf) / ROUND.L_d
        assert r["i_a"][0] == pytest.approx(phases_of(i)[0], abs=1e-9)
        assert r["i_b"][0] - phases_of(i)[1] == pytest.approx(skew * phases_of(slope)[1], abs=1e-3)  # of 0.03 and 0.3 A


def test_the_control_turns_an_offset_into_true_current_at_the_electrical_frequency() -> None:
    """It holds what it measures, so the true current has what the sensor has not."""
    _, true = phases_and_truth(CurrentSensing(offset_a=0.3), turns_per_s=2.0)
    assert true.mean(axis=0) == pytest.approx([-0.2, 0.1, 0.1], abs=0.01)  # an offset of a is a vector of 2/3 of it


def test_the_encoder_adds_its_offset_and_what_its_ring_does_once_and_twice_a_turn() -> None:
    sensing = AngleSensing(offset=0.02, once=0.03, once_phase=0.5, twice=0.01, twice_phase=-1.0)
    drive = VirtualDrive(with_effects(run=at(20.0), angle_sensing=sensing))
    for _ in range(300):
        theta_m = drive.plant.theta_m
        told = float(drive.record(7)["theta_e"][0])
        wrong = sensing.offset + 0.03 * math.sin(theta_m + 0.5) + 0.01 * math.sin(2.0 * theta_m - 1.0)
        n_p = drive.scenario.motor.n_p
        assert math.remainder(told - n_p * (theta_m + wrong), 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)


def test_an_eccentric_encoder_swings_the_speed_it_tells_once_a_turn() -> None:
    once, f = 0.01, 40.0
    r = steady(with_effects(run=at(f), angle_sensing=AngleSensing(once=once)), 0.1, 4.0 / f)
    omega_e = r["omega_e"]
    assert np.ptp(omega_e) / 2.0 == pytest.approx(once * 2.0 * math.pi * f, rel=0.01)


@pytest.mark.parametrize("edges", [False, True], ids=["averaged", "switched"])
def test_a_drive_that_reads_its_dc_link_high_gives_less_voltage_than_it_records(edges: bool) -> None:
    gain, offset = 1.05, 2.0
    scenario = with_effects(motor=ROUND, i_dq=5j, run=at(50.0), voltage_sensing=VoltageSensing(gain, offset))
    r = steady(switched(scenario) if edges else scenario, 0.2, 0.02)
    assert r["u_dc"] == pytest.approx(np.full(200, gain * 310.0 + offset))
    error, u = voltage_error(r, ROUND).mean(), voltages(r)[:-1].mean()
    assert error / u == pytest.approx(1.0 - 310.0 / (gain * 310.0 + offset), rel=0.02)


def shifted(shift: int, edges: bool) -> Recording:
    scenario = with_effects(motor=ROUND, i_dq=2j, step=3.0, run=at(50.0), timing=Timing(shift=shift))
    return VirtualDrive(switched(scenario) if edges else scenario).record(500)


@pytest.mark.parametrize("edges", [False, True], ids=["averaged", "switched"])
def test_a_voltage_recorded_late_or_early_is_that_of_the_row_before_or_after(edges: bool) -> None:
    plain, early, late = (voltages(shifted(shift, edges)) for shift in (0, 1, -1))
    assert np.abs(early[:-1] - plain[1:]).max() < 1e-9
    assert np.abs(late[1:] - plain[:-1]).max() < 1e-9
    assert np.abs(plain[1:] - plain[:-1]).max() > 5.0
    assert shifted(1, edges)["i_q"] == pytest.approx(shifted(0, edges)["i_q"], abs=0.0)


def test_a_delay_lets_one_more_period_pass_and_the_recording_knows() -> None:
    """Standstill, a reference from the start: the voltage comes in period 1, with the delay in period 2."""
    plain, delayed = (
        VirtualDrive(with_effects(motor=ROUND, i_dq=3.0 + 0j, timing=Timing(delay=d))).record(200) for d in (0, 1)
    )
    assert np.flatnonzero(plain["u_d"])[0] == 1
    assert np.flatnonzero(delayed["u_d"])[0] == 2
    assert delayed["u_d"][2] == plain["u_d"][1]
    assert np.abs(voltage_error(delayed, ROUND)).max() < 0.02  # of 26 V: the mean of a current along its exponential


def test_a_voltage_that_is_applied_at_once_comes_in_the_period_of_its_sample() -> None:
    plain, at_once = (
        VirtualDrive(with_effects(motor=ROUND, i_dq=3.0 + 0j, timing=Timing(delay=d))).record(200) for d in (0, -1)
    )
    assert at_once["u_d"][0] == pytest.approx(plain["u_d"][1], rel=1e-12)
    assert np.abs(voltage_error(at_once, ROUND)).max() < 0.02


@pytest.mark.parametrize("timing", [Timing(delay=-1), Timing(shift=1)], ids=["at once", "early"])
@pytest.mark.parametrize("edges", [False, True], ids=["averaged", "switched"])
def test_a_row_may_hold_the_answer_to_its_own_noise(timing: Timing, edges: bool) -> None:
    """At one operating point hardly anything else; a drive that records what it applies answers the row before."""
    K = 6.0
    gains = {"own_gains": 1.0, "k_p_d": K, "k_p_q": K, "k_i_d": 200.0 * K, "k_i_q": 200.0 * K}

    def answer(timing: Timing) -> tuple[float, float]:
        scenario = with_effects(motor=ROUND, i_dq=2j, run=at(50.0), timing=timing)
        noisy = replace(scenario, drive=replace(scenario.drive, noise_i=0.02), settings=gains)
        r = steady(switched(noisy) if edges else noisy, 0.2, 0.4)
        i, u = (r[name] - r[name].mean() for name in ("i_q", "u_q"))
        return float(u @ i / (i @ i)), float((u @ i) ** 2 / (i @ i) / (u @ u))

    gain, share = answer(timing)
    assert gain == pytest.approx(-K, rel=0.02)
    assert share > 0.98
    assert answer(Timing())[1] < 0.2


def test_the_share_of_rows_that_is_told_is_lost_and_the_rest_is_as_it_was() -> None:
    share, rows = 0.2, 5000
    full, lossy = (
        VirtualDrive(with_effects(i_dq=2j, step=1.0, run=at(50.0), timing=Timing(lost=lost))).record(rows)
        for lost in (0.0, share)
    )
    kept = len(lossy["t"])
    assert abs(kept - (1.0 - share) * rows) < 4.0 * math.sqrt(share * (1.0 - share) * rows)
    there = np.rint(lossy["t"] / T_S).astype(int)
    assert np.all(np.diff(there) > 0)
    assert stationary_voltages(lossy)[0] == stationary_voltages(full)[there[0]]
    for name, column in lossy.items():
        assert np.array_equal(column, full[name][there])
    assert np.abs(currents(full)).max() > 1.0
