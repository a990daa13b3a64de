"""Loops of an emulated drive tried over a link, beside what their tuning promises; the drive is off afterwards."""

import math
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.actions.safety.limits import RPM, TRIP, Limits
from bench.actions.safety.under_control import CancelledError, Guard, under_control
from bench.commissioning.identify import try_loops
from bench.commissioning.loops import READ, Judged, Loop, Tried, fastest, judged
from bench.commissioning.proposal import turn_of
from bench.commissioning.response import Response
from bench.commissioning.trial import (
    EXCITED,
    SETTINGS,
    CurrentTrial,
    Excitation,
    SpeedTrial,
    Trials,
    largest_current_step,
    largest_speed_step,
    turned,
)
from bench.errors import LimitError
from drivers import capture
from drivers import lease as control
from drivers.capture import Capture, Setup
from drivers.connect import connect
from drivers.drive import Drive
from drivers.errors import DriveError, FaultError, GoneError
from drivers.lease import Lease
from estimator.machine import Machine
from tests.bench.commissioning.unknown import FREE, LIMITS, around, left_as_before, once, origin
from tests.support.served_drive import Served, served, virtual_url

pytestmark = pytest.mark.live

MOTOR = FREE.motor
MACHINE = Machine(MOTOR.R_s, MOTOR.L_d, MOTOR.L_q, MOTOR.psi_f, n_p=MOTOR.n_p)
K = 1.5 * MOTOR.n_p**2 * MOTOR.psi_f / MOTOR.J  # rad/(s2 A)
SLOW = SpeedTrial(20.0, 0.05, 150.0)


@pytest.fixture(scope="module")
def bench() -> Iterator[Served]:
    with served(virtual_url(), FREE, control="lease") as one:
        yield one


@pytest.fixture
def drive(bench: Served) -> Iterator[Drive]:
    with connect(bench.url) as connected, left_as_before(connected):
        yield connected


@pytest.fixture
def trials(drive: Drive, tmp_path: Path) -> Iterator[Trials]:
    with under_control(drive, lease := Lease(), origin(tmp_path), SETTINGS):
        yield Trials(drive, lease, Guard(drive, lease, LIMITS, "the trial", threading.Event()))


@pytest.mark.thorough
def test_every_loop_answers_as_its_tuning_promises(drive: Drive, tmp_path: Path) -> None:
    said = list[str]()
    one = try_loops(around(drive, tmp_path, said.append))
    assert pytest.approx(K, rel=0.05) == one.K
    assert list(one.gains) == list(READ)
    assert [loop.name for loop in one.loops] == ["speed", "d", "q"]
    for loop in judged(one, MACHINE, K, MOTOR.B / MOTOR.J):
        assert loop.sentence == ""
        assert loop.overshoot == pytest.approx(loop.promised_overshoot, abs=0.03), loop
        assert loop.settling == pytest.approx(loop.promised_settling, rel=0.08), loop
        assert loop.tracking == pytest.approx(loop.promised_tracking, rel=0.08), loop
    assert any(phase.startswith("stepping the speed by ") for phase in said)
    assert any(phase.startswith("stepping i_q by ") for phase in said)
    i = np.hypot(one.swing.columns["i_d"], one.swing.columns["i_q"])
    assert np.max(i) < MOTOR.i_rated
    speeds = turned(one.swing.columns["theta_e"], one.swing.T_s * one.swing.decimation)
    assert np.max(np.abs(speeds)) < fastest(drive, LIMITS)


def test_one_axis_steps_and_the_speed_stays(trials: Trials, drive: Drive) -> None:
    for axis, size in (("d", 1.0), ("q", 0.5)):
        i, hold = trials.current(CurrentTrial(axis, size, 3e-3, 150.0))
        assert hold == 30
        assert len(i) == 48 * hold
        low, high = np.percentile(i, [20, 80])
        assert high - low == pytest.approx(2.0 * size, rel=0.2)
        assert drive.read("omega_e") == pytest.approx(150.0, abs=40.0)


def test_the_speed_steps_around_its_level(trials: Trials) -> None:
    got, hold = trials.speed(SLOW)
    speed = turned(got.columns["theta_e"], got.T_s * got.decimation)
    assert hold * got.T_s * got.decimation == pytest.approx(SLOW.hold)
    assert len(speed) == 24 * hold - 1
    assert np.mean(speed) == pytest.approx(SLOW.speed_ref, abs=5.0)
    assert np.std(speed) > 0.4 * SLOW.size


def test_steps_of_the_speed_are_as_far_apart_as_said_and_rise_as_slowly(trials: Trials) -> None:
    largest = list[float]()
    for rise in (0.0, 0.06):
        got, hold = trials.speed(replace(SLOW, hold=0.1, rise=rise))
        speed = turned(got.columns["theta_e"], got.T_s * got.decimation) - SLOW.speed_ref
        swings = [np.convolve(part, np.ones(25), "same") for part in np.split(speed[: 23 * hold], 23)]
        at = [int(np.argmax(part[25:-25] * part[-50] > 0.0)) for part in swings[1:]]  # where it goes through the middle
        assert max(at) - min(at) <= 12
        assert abs(np.mean(at[:8]) - np.mean(at[-8:])) <= 4.0
        largest.append(float(np.max(np.abs(got.columns["i_q"]))))
    assert largest[1] < 0.7 * largest[0]


def test_an_excitation_is_all_that_a_diagnosis_reads(trials: Trials, drive: Drive) -> None:
    got, readings = trials.excited(Excitation(100.0, 5000.0, 0.02, -0.5, 1.0, 1.0, 2e-3, 0.3))
    one = capture.decoded(got, drive.identity.T_s, drive.identity.full)
    columns = one.columns
    assert readings
    assert turn_of(one, readings, {"n_p": 4.0}) in range(4)
    assert set(columns) == set(EXCITED)
    assert len(columns["i_d"]) == 3000
    assert np.std(columns["i_d"]) > 0.3
    assert np.ptp(columns["omega_e"]) > 100.0


def test_cancelled_in_the_middle_it_ends_with_the_drive_off(drive: Drive, tmp_path: Path) -> None:
    cancelled = threading.Event()
    with pytest.raises(CancelledError, match="the trial was cancelled; the drive is stopped"):
        try_loops(around(drive, tmp_path, once("stepping the speed", cancelled.set), cancelled))
    assert list((tmp_path / "control").iterdir()) == []


def test_a_stop_by_whoever_it_is_ends_it(drive: Drive, tmp_path: Path) -> None:
    with pytest.raises(DriveError) as ended:
        try_loops(around(drive, tmp_path, once("stepping the speed", lambda: control.stop(drive))))
    assert "\n" not in str(ended.value)


def test_another_who_takes_the_recorder_ends_it(drive: Drive, tmp_path: Path) -> None:
    def taken() -> None:
        threading.Timer(0.2, lambda: capture.arm(drive, Setup(("i_d",), 100))).start()

    with pytest.raises(GoneError, match=r"another client has armed |the drive no longer has recording"):
        try_loops(around(drive, tmp_path, once("stepping the speed", taken)))


def test_a_shaft_that_turns_too_fast_is_stopped(drive: Drive, tmp_path: Path) -> None:
    said = r"^the shaft turned at .* rpm, expected at most 143\.24: the drive is stopped$"
    lease = Lease()
    with pytest.raises(FaultError, match=said), under_control(drive, lease, origin(tmp_path), SETTINGS):
        guard = Guard(drive, lease, LIMITS, "the trial", threading.Event(), 60.0)
        Trials(drive, lease, guard).speed(SLOW)


def test_the_drive_itself_trips_a_little_above_the_trials_speeds(drive: Drive, tmp_path: Path) -> None:
    trips = list[float]()
    with pytest.raises(CancelledError):
        cancelled = threading.Event()

        def look(_: str) -> None:
            trips.append(drive.read(TRIP))
            cancelled.set()

        try_loops(around(drive, tmp_path, look, cancelled))
    assert trips[0] == pytest.approx(min(1.2 * 2000.0 * RPM * MOTOR.n_p, 1.2 * fastest(drive, LIMITS)), rel=1e-3)


def test_speeds_stay_within_voltage_limit_and_trip(drive: Drive) -> None:
    by_voltage = 0.7 * drive.read("u_dc") / math.sqrt(3.0) / MOTOR.psi_f
    assert fastest(drive, Limits()) == pytest.approx(min(by_voltage, drive.read(TRIP) / 1.25), rel=1e-6)
    assert fastest(drive, Limits(speed_max_rpm=100.0)) == pytest.approx(100.0 * RPM * MOTOR.n_p)


def test_a_drive_without_a_gain_of_the_speed_control_is_refused_before_it_moves(drive: Drive, tmp_path: Path) -> None:
    before = drive.read("k_p_speed")
    drive.write("k_p_speed", 0.0)
    said = list[str]()
    try:
        with pytest.raises(LimitError, match="expected a speed control with a gain above zero, k_p_speed is 0"):
            try_loops(around(drive, tmp_path, said.append))
    finally:
        drive.write("k_p_speed", before)
    assert said == []


def test_steps_are_as_large_as_they_may_be() -> None:
    assert largest_speed_step(0.1, 6.0) == pytest.approx(21.0)
    assert largest_current_step(K, 8e-3, 50.0) * 2.0 * math.sqrt(48) * K * 8e-3 == pytest.approx(50.0)
    assert largest_current_step(-K, 8e-3, 50.0) == largest_current_step(K, 8e-3, 50.0)
    assert math.isfinite(largest_current_step(0.0, 8e-3, 50.0))
    with pytest.raises(LimitError):
        largest_speed_step(-0.1, 6.0)


GAINS = dict.fromkeys(READ, 0.0) | {
    "n_p": 4.0, "control_R_s": MOTOR.R_s, "control_L_d": MOTOR.L_d, "control_L_q": MOTOR.L_q,
    "control_psi_f": MOTOR.psi_f, "bandwidth": 1250.0, "k_p_speed": 0.05, "k_i_speed": 0.4, "speed_filter": 1e-3,
    "decoupling": 1.0,
}  # fmt: skip


def made_up(gains: dict[str, float], response: Response | None = None) -> Tried:
    swing = Capture({}, 0, 1e-4, 5)
    loops = [Loop("speed", response, "why", 400, 5e-4, 0.0), *(Loop(axis, None, "", 80, 1e-4, 0.0) for axis in "dq")]
    return Tried(loops, GAINS | gains, K, swing)


def by_name(one: Tried, machine: Machine = MACHINE) -> dict[str, Judged]:
    return {loop.name: loop for loop in judged(one, machine, K, 0.0)}


def test_what_was_not_told_has_none_and_its_promise_all_the_same() -> None:
    loop = by_name(made_up({}))["speed"]
    assert (loop.overshoot, loop.settling, loop.tracking, loop.sentence) == (None, None, None, "why")
    assert loop.promised_settling > 0.0
    t = np.array([0.0, 1.0])
    endless = by_name(made_up({}, Response(t, np.array([0.0, 0.5]), 4, 0.0)))["speed"]
    assert endless.settling == math.inf
    assert endless.as_json()["settling"] is None
    assert endless.as_json()["tracking"] == pytest.approx(1.5)


def test_a_promise_is_by_the_gains_that_act() -> None:
    by_bandwidth = by_name(made_up({}))
    own = {"own_gains": 1.0, "k_p_d": 1250.0 * MOTOR.L_d, "k_i_d": 1250.0 * MOTOR.R_s, "k_p_q": 2500.0 * MOTOR.L_q,
           "k_i_q": 2500.0 * MOTOR.R_s, "bandwidth": 10.0}  # fmt: skip
    by_own = by_name(made_up(own))
    assert by_own["d"] == by_bandwidth["d"]
    assert by_own["q"].promised_settling < by_bandwidth["q"].promised_settling
    assert by_own["speed"] == by_name(made_up({"bandwidth": 2500.0}))["speed"]
    wrong = by_name(made_up({"control_L_d": 2.0 * MOTOR.L_d}))
    assert wrong["d"].promised_settling < 0.6 * by_bandwidth["d"].promised_settling
    corrected = by_name(made_up({"control_L_d": 2.0 * MOTOR.L_d, "saturation_correction": 1.0}))
    assert corrected["d"] == by_bandwidth["d"]


def test_a_level_of_i_d_makes_reluctance_torque() -> None:
    one = made_up({})
    i_d = -3.0
    level = replace(one, loops=[replace(loop, i_d=i_d) for loop in one.loops])
    factor = 1.0 + (MOTOR.L_d - MOTOR.L_q) * i_d / MOTOR.psi_f
    assert factor > 1.04
    (speed, *_), (expected, *_) = judged(level, MACHINE, K, 0.0), judged(one, MACHINE, factor * K, 0.0)
    assert speed.promised_overshoot == pytest.approx(expected.promised_overshoot, rel=5e-3)
    assert speed.promised_settling == pytest.approx(expected.promised_settling, rel=5e-3)


def test_a_weak_magnet_promises_a_slower_shaft() -> None:
    weak = replace(MACHINE, psi_f=0.5 * MOTOR.psi_f)
    (strong, _, _), (slow, _, _) = judged(made_up({}), MACHINE, K, 0.0), judged(made_up({}), weak, 0.5 * K, 0.0)
    assert slow.promised_tracking > strong.promised_tracking
