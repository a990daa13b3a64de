"""Sensors and noise: converter, statistics, reproducibility."""

import math

import numpy as np
import pytest

from emulator.frames import phases
from emulator.noise import _mixed, gauss, uniform
from emulator.plant.physics.current_hum import CurrentHum
from emulator.plant.sensors import Sensors, converted, measured_current, sampled

QUIET = Sensors(noise_i=0.0, adc_bits=12, adc_full=18.0, encoder_counts=0, seed=1)
STEP = 18.0 / 2048


def test_the_bits_are_those_of_splitmix64() -> None:
    # The published first outputs for seed 1234567
    gamma, state, outputs = 0x9E3779B97F4A7C15, 1234567, list[int]()
    for _ in range(3):
        state = (state + gamma) % 2**64
        outputs.append(int(_mixed(np.uint64(state))))
    assert outputs == [6457827717110365317, 3203168211198807973, 9817491932198370423]


def test_uniform_numbers_are_uniform_and_gauss_numbers_normal() -> None:
    u = np.array([uniform(7, 1, k) for k in range(20000)])
    assert u.min() >= 0.0
    assert u.max() < 1.0
    assert u.mean() == pytest.approx(0.5, abs=4 * math.sqrt(1 / 12 / 20000))
    g = np.array([gauss(7, 2, k) for k in range(20000)])
    assert g.mean() == pytest.approx(0.0, abs=4 / math.sqrt(20000))
    assert g.std() == pytest.approx(1.0, abs=4 / math.sqrt(2 * 20000))
    assert np.mean(np.abs(g) > 2.0) == pytest.approx(0.0455, abs=0.006)


def test_noise_of_other_seeds_sources_and_times_is_unrelated() -> None:
    columns = [
        [gauss(1, 1, k) for k in range(5000)],
        [gauss(1, 2, k) for k in range(5000)],
        [gauss(2, 1, k) for k in range(5000)],
        [gauss(1, 1, k + 1) for k in range(5000)],
    ]
    correlation = np.corrcoef(columns) - np.eye(4)
    assert np.abs(correlation).max() < 5 / math.sqrt(5000)


def test_the_converter_rounds_to_its_step_and_clips_at_its_ends() -> None:
    for i in (0.0, 1.234, -5.678, 17.99):
        value = converted(i, 12, 18.0)
        assert value / STEP == pytest.approx(round(value / STEP), abs=1e-9)
        assert abs(value - i) <= STEP / 2 + 1e-12
    assert converted(100.0, 12, 18.0) == pytest.approx(2047 * STEP)
    assert converted(-100.0, 12, 18.0) == pytest.approx(-18.0)
    assert converted(1.234, 0, 18.0) == 1.234


def test_quantisation_error_is_uniform_over_one_step() -> None:
    error = np.array([converted(i, 12, 18.0) - i for i in np.linspace(-15.0, 15.0, 9973)])
    assert error.std() == pytest.approx(STEP / math.sqrt(12), rel=0.02)
    assert error.mean() == pytest.approx(0.0, abs=STEP / 100)


def test_each_phase_has_the_stated_noise_of_its_own() -> None:
    noisy = QUIET._replace(noise_i=0.01, adc_bits=0)
    i_ab = 3.0 - 1.0j
    samples = np.array([sampled(noisy, i_ab, 0.0, k)[:3] for k in range(5000)])
    assert samples.mean(axis=0) == pytest.approx(phases(i_ab), abs=4 * 0.01 / math.sqrt(5000))
    assert samples.std(axis=0) == pytest.approx([0.01] * 3, rel=0.05)
    assert np.abs(np.corrcoef(samples.T) - np.eye(3)).max() < 0.07


def test_noise_and_converter_off_give_the_true_current() -> None:
    sample = sampled(QUIET._replace(adc_bits=0), 3.0 - 1.0j, 1.25, 0)
    assert measured_current(sample) == pytest.approx(3.0 - 1.0j, rel=1e-14)
    assert sample.theta_m == 1.25


@pytest.mark.parametrize("channels", [2, 3])
def test_a_hum_is_added_to_what_each_channel_reads(channels: int) -> None:
    hum = CurrentHum(a=0.3, b=-0.1, c=0.2, frequency=50.0, phase=0.5)
    humming = QUIET._replace(adc_bits=0, hum=hum, channels=channels)
    i_a, i_b, i_c = phases(3.0 - 1.0j)
    for tick in (0, 37, 123):
        share = math.cos(2.0 * math.pi * 50.0 * tick * 1e-4 + 0.5)
        sample = sampled(humming, 3.0 - 1.0j, 0.0, tick, 0j, tick * 1e-4)
        a, b = i_a + 0.3 * share, i_b - 0.1 * share
        assert sample[:3] == pytest.approx((a, b, i_c + 0.2 * share if channels == 3 else -a - b))


def test_an_encoder_tells_the_angle_in_its_counts() -> None:
    coarse = QUIET._replace(encoder_counts=1000)
    count = 2.0 * math.pi / 1000
    told = sampled(coarse, 0j, 1.23456, 0).theta_m
    assert told / count == pytest.approx(round(told / count), abs=1e-9)
    assert 0.0 <= 1.23456 - told < count
