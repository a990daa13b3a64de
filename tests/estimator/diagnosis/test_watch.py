"""What is left of a window's voltages: only noise where the model is whole, and more where physics is missing."""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.demagnetisation import Demagnetisation
from emulator.plant.physics.iron_loss import IronLoss
from emulator.plant.physics.legs import Inverter
from emulator.plant.physics.saturation import Saturation
from emulator.plant.physics.sensing import CurrentSensing
from emulator.scenario.effects import NONE, Effects
from emulator.scenario.scenarios import PAPER, Scenario, drive_for
from estimator.diagnosis.likelihood.constant_parameters import POLE
from estimator.diagnosis.watch import (
    FEWEST_WATCHED,
    SURE_SIGMAS,
    Left,
    _rounding_variance,
    mismatch_of,
    place_in_window,
)
from estimator.machine import PARAMETERS, UNITS
from estimator.online import window_ls
from estimator.online.estimate import Estimate, Status
from estimator.samples import Samples
from tests.estimator.online.test_accuracy import SCENARIOS
from tests.support.samples import streamed

pytestmark = pytest.mark.thorough

ROWS = 1001
TURN = 2.0 * math.pi


def estimates_of(samples: Samples, **held: float) -> dict[str, Estimate]:
    """Of all four parameters; `held` stand in for what the samples do not tell."""
    state = window_ls.update(window_ls.init(len(samples)), samples)
    return window_ls.estimate(state, PARAMETERS, held).estimates


def windows(scenario: Scenario, count: int, rows: int = ROWS) -> Iterator[Samples]:
    """Windows of the stream one after the other, with the resolution that the wire has."""
    drive = VirtualDrive(scenario)
    i_step, u_step = (full / 32767 for full in (scenario.drive.i_full, scenario.drive.u_full))
    streamed(drive, 20)
    for _ in range(count):
        samples = streamed(drive, rows)
        yield replace(samples, resolution=samples.resolution._replace(i=i_step, u=u_step))


def judged(samples: Samples) -> Left:
    left = mismatch_of([samples], estimates_of(samples))
    assert left is not None
    return left


def paper(effects: Effects = NONE, speed_rpm: float = 1200.0, kind: str = "levels", **drive: float) -> Scenario:
    return replace(
        PAPER, drive=drive_for(PAPER.motor, bridge="switched", **drive), effects=effects,
        run=replace(PAPER.run, speed_rpm=speed_rpm), excitation=replace(PAPER.excitation, kind=kind),
    )


WHOLE = SCENARIOS | {
    "switched": paper(),
    "binary sequence": paper(kind="prbs"),
    "sines": paper(kind="multisine"),
    "staircase": paper(kind="staircase"),
    "no noise": paper(noise_i=0.0),
    "no noise, slow": paper(noise_i=0.0, speed_rpm=100.0),
    "every period": replace(SCENARIOS["paper, fast"], drive=replace(PAPER.drive, stream_periods=1)),
    "every 100th period": replace(PAPER, drive=replace(PAPER.drive, stream_periods=100)),
}


@pytest.mark.parametrize("name", WHOLE)
def test_where_the_model_is_whole_only_noise_is_left(name: str) -> None:
    found = [judged(samples) for samples in windows(WHOLE[name], 8)]
    assert all(left.moves and left.clear and not left.mismatch for left in found)
    assert max(left.significance for left in found) < SURE_SIGMAS - 1.0
    assert max(left.rms_V / left.least_V for left in found) < 0.2
    assert np.mean([left.ratio for left in found]) == pytest.approx(1.0, abs=0.2)


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("50 W hobby", "50 kW traction", "paper, free shaft")]


@pytest.mark.parametrize("name", ["paper", *SLOW])
def test_an_hour_of_windows_without_an_effect_gives_no_false_alarm(name: str) -> None:
    # A tail that falls like this stays below 6 for 3600 windows
    significance = np.array([judged(samples).significance for samples in windows(SCENARIOS[name], 50)])
    assert significance.max() < 4.5
    assert np.mean(significance > 3.0) < 0.05


@pytest.mark.slow
def test_ten_minutes_give_no_false_alarm() -> None:
    found = [judged(samples) for samples in windows(PAPER, 600)]
    print("ten minutes:", max(left.significance for left in found), max(left.rms_V / left.least_V for left in found))
    assert not any(left.mismatch for left in found)
    assert max(left.significance for left in found) < SURE_SIGMAS


@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize("counts", [1024, 4096, 65536])
@pytest.mark.parametrize("base", [paper(), SCENARIOS["paper, free shaft"]])
def test_the_steps_of_an_encoder_are_no_mismatch(base: Scenario, counts: int, told: bool) -> None:
    coarse = replace(base, drive=replace(base.drive, encoder_counts=counts))
    for samples in windows(coarse, 4):
        known = samples.resolution if told else samples.resolution._replace(theta_e=0.0)
        assert not judged(replace(samples, resolution=known)).mismatch


EFFECTS = {
    "dead time": Effects(inverter=Inverter(dead_time=2e-7)),
    "iron loss": Effects(iron_loss=IronLoss(R_c=500.0)),
    "saturation": Effects(saturation=Saturation(0.1, 0.1)),
    "offset": Effects(current_sensing=CurrentSensing(offset_a=0.1)),
}


@pytest.mark.parametrize("name", EFFECTS)
def test_missing_physics_is_told_in_every_window_and_somewhere(name: str) -> None:
    for samples in windows(paper(EFFECTS[name]), 3):
        left = judged(samples)
        assert left.mismatch
        assert left.significance > 3.0 * SURE_SIGMAS
        assert left.ratio > 3.0
        place = place_in_window(left)
        assert place.sentence.startswith(("mostly on d", "mostly on q", "on both axes"))
        assert 0.0 < place.energy_share <= 1.0


def test_a_step_of_the_magnets_flux_is_told_while_it_is_in_the_window() -> None:
    scenario = paper(Effects(demagnetisation=Demagnetisation(0.02, 1.5)))
    before, meanwhile, after = (judged(samples) for samples in windows(scenario, 3))
    assert before.clear
    assert after.clear
    assert meanwhile.mismatch
    # 2 % of 60 V on one half and none on the other: half of that beside the mean
    assert meanwhile.rms_V == pytest.approx(0.6, rel=0.3)
    assert place_in_window(meanwhile).sentence == "mostly on q, at all speeds, currents and times"


def test_a_burst_is_placed_in_time_and_on_its_axis() -> None:
    (samples,) = windows(PAPER, 1)
    t = samples.t0 + samples.T * np.arange(len(samples))
    burst = (t > t[600]) & (t < t[700])
    place = place_in_window(judged(replace(samples, u_q=samples.u_q + burst * np.sin(TURN * 30.0 * t))))
    assert place.region["axis"] == "q"
    assert place.region["time"] == pytest.approx((t[600], t[700]), abs=0.05)
    assert place.sentence.startswith("mostly on q where the time is between ")


def test_a_held_value_that_is_wrong_is_a_mismatch_and_the_right_one_is_none() -> None:
    (samples,) = windows(PAPER, 1)
    for psi_f, wrong in ((0.12, False), (0.118, True)):
        held = Estimate("psi_f", psi_f, None, UNITS["psi_f"], Status.HELD)
        left = mismatch_of([samples], estimates_of(samples) | {"psi_f": held})
        assert left is not None
        assert left.mismatch is wrong


def test_a_window_in_which_nothing_moves_says_nothing() -> None:
    for scenario in (paper(kind="none"), paper(Effects(inverter=Inverter(dead_time=2e-6)), 0.0, "none")):
        for samples in windows(scenario, 2):
            estimates = estimates_of(samples)
            left = mismatch_of([samples], estimates)
            assert left is None or not (left.mismatch or left.clear)
    still = replace(PAPER.excitation, kind="none", i_q_ref=0.0)
    (samples,) = windows(replace(PAPER, run=replace(PAPER.run, speed_rpm=0.0), excitation=still), 1)
    assert mismatch_of([samples], estimates_of(samples)) is None
    assert mismatch_of([], estimates_of(samples)) is None
    (samples,) = windows(PAPER, 1)
    assert mismatch_of([samples[:FEWEST_WATCHED]], estimates_of(samples)) is None


def test_gaps_are_no_mismatch_and_hide_none() -> None:
    for effects, there in ((NONE, False), (EFFECTS["dead time"], True)):
        (samples,) = windows(paper(effects), 1)
        cuts = (0, 90, 91, 200, 433, 1000)
        runs = [samples[a + 3 : b] for a, b in pairwise(cuts)]
        left = mismatch_of(runs, estimates_of(samples))
        assert left is not None
        assert left.mismatch is there
        assert left.clear is not there


def test_a_rounded_angle_errs_the_flux_by_magnets_and_saliency() -> None:
    """dpsi = -J d(theta) applied to psi - L i: along d by (L_d - L_q) i_q, along q by psi_f + (L_d - L_q) i_d."""
    n, step = 50, 0.01
    columns = np.zeros((7, n), np.complex128)
    columns[0] = 2.0 + 3.0j  # A; the rotor stands

    def variance(L_d: float, L_q: float) -> tuple[float, float]:
        return _rounding_variance(np.array([0.5, L_d, L_q, 0.1]), columns, step, 1e-4, (POLE, POLE))

    assert variance(2e-3, 2e-3)[0] == 0.0
    d, q = variance(1e-3, 5e-3)
    assert d / q == pytest.approx((4e-3 * 3.0) ** 2 / (0.1 - 4e-3 * 2.0) ** 2)


def test_the_q_axis_alone_is_judged_by_its_own_rows() -> None:
    """Voltages in steps, and no rows of the d axis whose noise they could be held against."""
    (both,) = windows(PAPER, 1, 3000)
    samples = replace(both, i_d=np.zeros_like(both.i_d), u_d=np.zeros_like(both.u_d), q_only=True)
    assert samples.resolution.u > 0.0
    left = mismatch_of([samples], estimates_of(samples))
    assert left is not None and math.isfinite(left.rms_V)
