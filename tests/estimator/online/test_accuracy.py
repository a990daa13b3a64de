"""Accuracy on the emulated drive, which shares no line with the estimator."""

from dataclasses import replace

import numpy as np
import pytest

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.machine import Machine
from emulator.scenario.scenarios import PAPER, Excitation, Run, Scenario, drive_for
from estimator.arrays import stretches
from estimator.machine import PARAMETERS
from estimator.online import window_ls
from estimator.online.estimate import Status, WindowEstimate
from estimator.samples import Samples
from tests.conftest import Figures
from tests.support.samples import noiseless, recorded, streamed, truth_of

pytestmark = pytest.mark.slow

HOBBY = Machine(R_s=0.045, L_d=22e-6, L_q=28e-6, psi_f=1.9e-3, n_p=7, i_rated=20.0)
TRACTION = Machine(R_s=9e-3, L_d=0.25e-3, L_q=0.62e-3, psi_f=0.072, n_p=4, i_rated=350.0)


def scenario(motor: Machine, u_dc: float, rpm: float, **drive: float) -> Scenario:
    """A motor on a dynamometer, excited by half its rated current on both axes."""
    i = motor.i_rated
    excitation = Excitation(-0.2 * i, 0.3 * i, 0.4 * i, 0.5 * i, 5e-3)
    return Scenario("test", motor, drive_for(motor, u_dc, **drive), Run(speed_rpm=rpm), excitation)


SCENARIOS = {
    "50 W hobby": scenario(HOBBY, 24.0, 3000.0, noise_i=0.03, T_s=5e-5),
    "paper": PAPER,
    "paper, slow": replace(PAPER, run=replace(PAPER.run, speed_rpm=150.0)),
    "paper, fast": replace(PAPER, run=replace(PAPER.run, speed_rpm=1500.0)),
    "paper, backwards": replace(PAPER, run=replace(PAPER.run, speed_rpm=-1200.0)),
    "paper, swinging": replace(PAPER, run=replace(PAPER.run, swing_rpm=200.0, swing_frequency=3.0)),
    "paper, free shaft": replace(PAPER, run=replace(PAPER.run, shaft="free", speed_control=True)),
    "50 kW traction": scenario(TRACTION, 400.0, 1500.0, noise_i=0.6),
}


def found(samples: Samples, m: int = 1) -> WindowEstimate:
    """What all samples together say."""
    return window_ls.estimate(window_ls.update(window_ls.init(len(samples), m), samples))


def errors(result: WindowEstimate, drive: VirtualDrive) -> dict[str, float]:
    """Relative errors; NaN where there is no value."""
    truth = truth_of(drive)
    return {name: (result.estimates[name].value or np.nan) / truth[name] - 1 for name in PARAMETERS}


@pytest.mark.parametrize("name", SCENARIOS)
def test_the_stream_gives_every_parameter_within_a_third_of_a_per_cent_at_default_noise(name: str) -> None:
    drive = VirtualDrive(SCENARIOS[name])
    result = found(streamed(drive, 3000))
    assert errors(result, drive) == pytest.approx(dict.fromkeys(PARAMETERS, 0.0), abs=3e-3)


@pytest.mark.parametrize("name", SCENARIOS)
def test_without_noise_the_stream_gives_every_parameter_within_a_fiftieth_of_a_per_cent(name: str) -> None:
    drive = VirtualDrive(noiseless(SCENARIOS[name]))
    result = found(streamed(drive, 3000))
    assert errors(result, drive) == pytest.approx(dict.fromkeys(PARAMETERS, 0.0), abs=2e-4)


@pytest.mark.parametrize("name", ["paper", "paper, fast", "50 kW traction"])
def test_rows_of_the_stream_are_as_unbiased_as_rows_of_every_control_period(name: str) -> None:
    by_period, by_stream = VirtualDrive(noiseless(SCENARIOS[name])), VirtualDrive(noiseless(SCENARIOS[name]))
    every_period = errors(found(recorded(by_period, 20_000), m=10), by_period)
    stream = errors(found(streamed(by_stream, 2000)), by_stream)
    assert stream == pytest.approx(every_period, abs=2e-5)


def test_single_period_rows_would_read_inductances_low_and_the_noise_aware_solution_does_not() -> None:
    drive = VirtualDrive(PAPER)
    state = window_ls.update(window_ls.init(100_000, 1), recorded(drive, 100_000))
    plain = errors(window_ls.estimate(state, noise_aware=False), drive)
    aware = errors(window_ls.estimate(state), drive)
    assert plain["L_d"] < -0.005
    assert plain["L_q"] < -0.002
    assert abs(aware["L_d"]) < 1e-3
    assert abs(aware["L_q"]) < 1e-3


@pytest.mark.parametrize("m", [1, 4])
def test_95_per_cent_intervals_hold_the_truth_in_about_95_per_cent_of_windows(m: int) -> None:
    drive = VirtualDrive(PAPER)
    truth = truth_of(drive)
    runs = 300
    inside = dict.fromkeys(PARAMETERS, 0)
    for _ in range(runs):
        for name, e in found(streamed(drive, 400), m).estimates.items():
            assert e.value is not None and e.std is not None
            inside[name] += abs(e.value - truth[name]) < 1.96 * e.std
    # 300 draws of 0.95: standard deviation 1.3 %
    assert all(0.91 < count / runs < 0.99 for count in inside.values()), inside


@pytest.mark.slow
@pytest.mark.parametrize("name", ["50 W hobby", "paper", "paper, slow", "50 kW traction"])
def test_intervals_are_honest_over_a_thousand_windows(name: str, figure: Figures) -> None:
    drive = VirtualDrive(SCENARIOS[name])
    truth = truth_of(drive)
    runs = 1000
    inside = dict.fromkeys(PARAMETERS, 0)
    for _ in range(runs):
        for parameter, e in found(streamed(drive, 1001)).estimates.items():
            assert e.value is not None and e.std is not None
            inside[parameter] += abs(e.value - truth[parameter]) < 1.96 * e.std
    for count in inside.values():
        figure("estimates.coverage", "{least_held:.0%} to {held:.0%}", held=count / runs)
    assert all(0.93 <= count / runs <= 0.97 for count in inside.values()), inside


@pytest.mark.slow
@pytest.mark.parametrize("lost", [3, 4, 0], ids=["every third row", "every fourth row", "nine rows in ten"])
@pytest.mark.parametrize("by_stream", [False, True], ids=["periods", "stream"])
def test_intervals_hold_the_truth_where_rows_are_lost_in_a_pattern(lost: int, by_stream: bool) -> None:
    far, said, biased = 0, 0, 0
    for seed in range(25):
        drive = VirtualDrive(replace(PAPER, run=replace(PAPER.run, seed=seed)))
        samples = streamed(drive, 3000) if by_stream else recorded(drive, 3000)
        row = np.arange(len(samples))
        kept = row % lost != seed % lost if lost else np.random.default_rng(seed).random(len(row)) < 0.1
        state = window_ls.init(len(samples))
        for a, b in stretches(kept):
            state = window_ls.update(state, samples[a:b], joined=False)
        for name, e in window_ls.estimate(state).estimates.items():
            if e.status is Status.OK and e.value is not None and e.std is not None:
                off = (e.value - truth_of(drive)[name]) / e.std
                far, said, biased = far + (abs(off) > 1.96), said + 1, biased + (abs(off) > 4.0)
    assert said >= 50
    assert far <= 0.1 * said
    assert biased == 0


def test_the_spread_falls_as_one_over_the_root_of_the_window_length() -> None:
    drive = VirtualDrive(PAPER)
    spread: dict[int, np.ndarray] = {}
    for length in (250, 4000):
        values = [
            [e.value for e in found(streamed(drive, length)).estimates.values()] for _ in range(60)
        ]
        spread[length] = np.std(np.array(values, dtype=np.float64), axis=0)
    ratio = spread[250] / spread[4000]
    assert np.all((ratio > 2.6) & (ratio < 6.2)), ratio  # 4 expected; 60 draws each


def test_temperature_moves_the_estimates_as_it_moves_the_machine() -> None:
    drive = VirtualDrive(PAPER)
    drive.set_temperature(70.0)
    drive.run(10)
    result = found(streamed(drive, 3000))
    assert drive.truth.R_s == pytest.approx(1.1592)
    assert errors(result, drive) == pytest.approx(dict.fromkeys(PARAMETERS, 0.0), abs=3e-3)
