"""The way of currents and angle to the drive, beside closed forms."""

import cmath
import math

import numpy as np
import pytest

from emulator.drive.virtual_drive import VirtualDrive
from emulator.frames import phases
from emulator.plant.physics.angle_signal import AngleSignal, sensed
from emulator.plant.physics.current_filter import CurrentFilter
from emulator.plant.physics.sensing import CurrentSensing
from emulator.plant.sensors import Sensors, sampled
from emulator.scenario.scenarios import Run
from tests.emulator.plant.physics.effect_runs import ROUND, T_S, at, steady, with_effects

F = 100.0  # Hz, electrical
OMEGA = math.tau * F


@pytest.mark.parametrize(("filtered", "gain"), [
    (CurrentFilter(tau=2e-4), 1.0 / (1.0 + 2e-4j * OMEGA)),
    (CurrentFilter(periods=2), cmath.exp(-1j * OMEGA * T_S) * math.sin(OMEGA * T_S) / (OMEGA * T_S)),
    (CurrentFilter(samples=3), (1.0 + cmath.exp(-1j * OMEGA * T_S) + cmath.exp(-2j * OMEGA * T_S)) / 3.0),
])  # fmt: skip
def test_a_current_that_turns_comes_through_as_it_does_by_the_filters_frequency_response(
    filtered: CurrentFilter, gain: complex
) -> None:
    """The control holds what it measures: the true current is that over the filter's gain."""
    drive = VirtualDrive(with_effects(motor=ROUND, i_dq=4j, run=at(F, ROUND), current_filter=filtered))
    drive.run(4000)
    state, rotor = drive.plant, cmath.exp(1j * ROUND.n_p * drive.plant.theta_m)
    true = (state.psi * rotor.conjugate() - ROUND.psi_f) / ROUND.L_d
    assert true * gain == pytest.approx(4j, abs=0.02)  # the voltage stands for a period, as the rotor turns


def test_a_latency_is_an_angle_in_proportion_to_speed() -> None:
    drive = VirtualDrive(with_effects(run=at(F), angle_signal=AngleSignal(latency=3e-4)))
    drive.run(100)
    n_p, theta_m = drive.scenario.motor.n_p, drive.plant.theta_m
    told = float(drive.record(1)["theta_e"][0])
    assert math.remainder(told - n_p * theta_m, math.tau) == pytest.approx(-OMEGA * 3e-4, abs=1e-9)


def test_a_tracking_loop_lags_by_the_acceleration_over_its_frequency_squared() -> None:
    bandwidth, rises = 60.0, 3000.0
    run = Run(speed_rpm=100.0, rise_rpm=rises, ramp_time=1.0)
    drive = VirtualDrive(with_effects(run=run, angle_signal=AngleSignal(bandwidth=bandwidth, damping=0.7)))
    drive.run(4000)
    n_p, theta_m = drive.scenario.motor.n_p, drive.plant.theta_m
    told = float(drive.record(1)["theta_e"][0])
    lag = n_p * rises * math.tau / 60.0 / (math.tau * bandwidth) ** 2
    assert math.remainder(told - n_p * theta_m, math.tau) == pytest.approx(-lag, rel=0.02)


def test_signals_of_a_sensor_show_once_and_twice_an_electrical_turn() -> None:
    theta = np.linspace(0.0, math.tau, 720, endpoint=False)
    for signal, order, size in (
        (AngleSignal(quadrature=0.02), 2, 0.01), (AngleSignal(gain=0.02), 2, 0.01),
        (AngleSignal(offset_sin=0.01), 1, 0.01), (AngleSignal(offset_cos=0.01), 1, 0.01),
    ):  # fmt: skip
        wrong = np.array([4.0 * (sensed(signal, 4, x / 4.0) - x / 4.0) for x in theta])
        found = 2.0 * abs(np.mean(wrong * np.exp(-1j * order * theta)))
        assert found == pytest.approx(size, rel=0.02)
        assert 2.0 * abs(np.mean(wrong * np.exp(-1j * (3 - order) * theta))) < 0.02 * size


def test_harmonics_of_a_sensors_signals_show_one_three_and_four_times_an_electrical_turn() -> None:
    theta = np.linspace(0.0, math.tau, 720, endpoint=False)
    for signal, sizes in (
        (AngleSignal(second=0.02, second_phase=0.7),
         {1: 0.02 / math.sqrt(2.0), 2: 0.0, 3: 0.02 / math.sqrt(2.0), 4: 0.0}),
        (AngleSignal(third=0.02, third_phase=-0.4), {1: 0.0, 2: 0.0, 3: 0.0, 4: 0.02}),
    ):
        wrong = np.array([4.0 * (sensed(signal, 4, x / 4.0) - x / 4.0) for x in theta])
        for order, size in sizes.items():
            found = 2.0 * abs(np.mean(wrong * np.exp(-1j * order * theta)))
            assert found == pytest.approx(size, rel=0.02, abs=3e-4)


def test_what_is_not_there_changes_nothing() -> None:
    plain = steady(with_effects(i_dq=3j, step=1.0, run=at(F)), 0.05, 0.02)
    none = with_effects(
        i_dq=3j, step=1.0, run=at(F), current_filter=CurrentFilter(), angle_signal=AngleSignal(),
        drive={"current_sensors": 3},
    )
    chain = steady(none, 0.05, 0.02)
    assert all(np.array_equal(plain[name], chain[name]) for name in plain)


def test_of_two_sensors_the_third_phase_is_what_they_leave() -> None:
    r = steady(with_effects(i_dq=3j, run=at(F), drive={"current_sensors": 2, "noise_i": 0.05}), 0.05, 0.1)
    assert np.array_equal(r["i_c"], -r["i_a"] - r["i_b"])
    noise = (r["i_d"] + 1j * (r["i_q"] - 3.0)) * np.exp(1j * r["theta_e"])
    noise = noise - np.convolve(noise, np.ones(5) / 5.0, "same")
    axes = np.linalg.eigvalsh(np.cov(noise.real, noise.imag))
    assert axes[1] / axes[0] == pytest.approx(3.0, rel=0.25)


def test_a_shunt_in_the_dc_link_sees_two_phases_and_its_offset_goes_round_in_six_steps() -> None:
    shunt = Sensors(0.0, 0, 10.0, 0, 1, CurrentSensing(offset_a=0.1), channels=1)
    turn = np.exp(1j * np.linspace(0.0, math.tau, 600, endpoint=False))
    seen = [sampled(shunt, 3.0 * x, 0.0, 0, 0j, 0.0, 50.0 * x * cmath.exp(1j)) for x in turn]
    found = np.array([one[:3] for one in seen])
    assert np.allclose(found.sum(axis=1), 0.0, atol=1e-12)
    off = found - np.array([phases(3.0 * x) for x in turn])
    highest = np.array([phases(x * cmath.exp(1j)) for x in turn])
    assert np.allclose(np.take_along_axis(off, np.argmax(highest, axis=1)[:, None], 1), 0.1)
    assert np.allclose(np.take_along_axis(off, np.argmin(highest, axis=1)[:, None], 1), -0.1)


def test_noise_of_a_shunt_is_greatest_in_the_phase_between() -> None:
    shunt = Sensors(0.05, 0, 10.0, 0, 1, channels=1)
    found = np.array([sampled(shunt, 0j, 0.0, k, 0j, 0.0, 50.0 + 1j)[:3] for k in range(4000)])
    assert found.std(axis=0) == pytest.approx([0.05, 0.05 * math.sqrt(2.0), 0.05], rel=0.05)
