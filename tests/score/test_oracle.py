"""The oracle of detection limits: its machine lacks nothing, its noise is white, its test is as powerful as it says."""

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emulator.conceal.files import answer_of
from emulator.conceal.recording import Choice, drawn, recorded
from emulator.drive.virtual_drive import Column
from emulator.scenario.effects import effects_from_table
from emulator.scenario.motors import TOLERANCE
from emulator.scenario.scenarios import Scenario
from tests.score.oracle import NEEDED, Array, Oracle, weights, whitened

pytestmark = pytest.mark.thorough

SEED = 1000
LENGTH = 1.0  # s


def answer(kind: str, motor: str, number: int = 1) -> dict[str, Any]:
    """What a recording of a class conceals; its columns are left."""
    choice = Choice(SEED, (kind,), (0.5, 0.5), (motor,), LENGTH)
    return answer_of(drawn(choice, number)[0], choice, f"{number:04}")


def in_mid_count(columns: Mapping[str, Column], scenario: Scenario) -> dict[str, Column]:
    """A recording with the half count put back that an encoder reads low on average."""
    low = math.pi / scenario.drive.encoder_counts * scenario.motor.n_p
    turned = dict(columns, theta_e=columns["theta_e"] + low)
    for d, q in (("i_d", "i_q"), ("u_d", "u_q")):
        vector = (columns[d] + 1j * columns[q]) * np.exp(-1j * low)
        turned |= {d: vector.real, q: vector.imag}
    return turned


def noisy(oracle: Oracle, kind: str | None, size: float, seed: int) -> Array:
    """White innovations of a recording by the real sensors, with an effect of a size or without one."""
    scenario = oracle.scenario
    effects = effects_from_table(oracle.sections(kind, size) if kind else {}, "", Path())
    run = replace(scenario.run, seed=seed)
    columns = recorded(replace(scenario, effects=effects, run=run), round(LENGTH / scenario.drive.T_s))
    return whitened(in_mid_count(columns, scenario), scenario)[0]


def two_sensors_run(told: Mapping[str, Any]) -> dict[str, Column]:
    """A recording without an effect by its own sensors."""
    scenario = Oracle(told).scenario
    return recorded(replace(scenario, effects=effects_from_table({}, "", Path())), round(LENGTH / scenario.drive.T_s))


def louder(scenario: str, factor: float) -> str:
    """A scenario's text with more noise in its currents."""
    return re.sub(r"noise_i = (\S+)", lambda found: f"noise_i = {factor * float(found[1])}", scenario)


@pytest.mark.parametrize("motor", ["mini_cheetah", "amk_dd5", "pmsynrm_15k", "teknic_m2310p"])
def test_without_an_effect_the_true_machine_foresees_all(motor: str) -> None:
    # The mean voltage of each period, without its ripple, would leave hundreds in two of these motors
    told = answer("none", motor, 3)
    assert '"dynamometer"' in told["scenario"]
    assert Oracle(told).lack < 0.05 * NEEDED


@pytest.mark.parametrize("motor", ["servo_4nm", "beckhoff_am8141", "mini_cheetah"])
def test_innovations_of_real_sensors_are_white_and_of_variance_one(motor: str) -> None:
    # Rounding is white where steps are small against noise and motion
    told = answer("none", motor, 120)
    assert "encoder_counts = 1048576" in told["scenario"]
    assert "adc_bits = 16" in told["scenario"]
    errors = noisy(Oracle(told), None, 0.0, 5)
    n = len(errors)
    assert np.mean(errors**2) == pytest.approx(1.0, abs=5.0 * math.sqrt(2.0 / n))
    for lag in (1, 2, 3, 4, 20):
        assert abs(np.mean(errors[lag:] * errors[:-lag])) < 5.0 / math.sqrt(n)


def test_noise_of_two_sensors_is_known_by_its_direction() -> None:
    told = answer("none", "servo_4nm", 120)
    two = told | {"scenario": told["scenario"].replace("current_sensors = 3", "current_sensors = 2")}
    errors = noisy(Oracle(two), None, 0.0, 5)
    pairs = errors.reshape(-1, 2)
    n = len(pairs)
    for each in pairs.T:
        assert np.mean(each**2) == pytest.approx(1.0, abs=5.0 * math.sqrt(2.0 / n))
    assert abs(np.mean(pairs[:, 0] * pairs[:, 1])) < 5.0 / math.sqrt(n)
    by_three = whitened(in_mid_count(two_sensors_run(two), Oracle(two).scenario), Oracle(told).scenario)[0]
    assert np.var(by_three) > 1.5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "motor"),
    [("current_offset", "servo_4nm"), ("iron_loss", "beckhoff_am8141"), ("eccentric_once", "aalto_2k2")],
)
def test_an_effect_at_its_limit_is_seen_in_99_of_100_recordings(kind: str, motor: str) -> None:
    # On a dynamometer and by sines its course does not depend on its noise
    told = answer(kind, motor, 44)
    assert '"dynamometer"' in told["scenario"]
    assert '"multisine"' in told["scenario"]
    oracle = Oracle(told)
    limit = oracle.limit(kind, told["sizes"][kind]["value"])
    signal, change = oracle.signal(kind, limit)
    weighed = weights(signal, change)
    deviation = float(np.linalg.norm(weighed))  # of the correlation with noise; the parameters are the true ones
    assert float(signal @ weighed) == pytest.approx(NEEDED, rel=0.1)
    runs = 60
    with_it = np.array([noisy(oracle, kind, limit, seed) @ weighed for seed in range(runs)]) / deviation
    without = np.array([noisy(oracle, None, 0.0, 1000 + seed) @ weighed for seed in range(runs)]) / deviation
    threshold = 0.5 * NEEDED / deviation
    assert np.mean(with_it > threshold) >= 0.95
    assert np.mean(without > threshold) <= 0.05
    error = 4.0 / math.sqrt(runs)
    assert np.mean(with_it) == pytest.approx(NEEDED / deviation, rel=0.1, abs=error)
    assert np.mean(without) == pytest.approx(0.0, abs=error)
    assert np.std(with_it) == pytest.approx(1.0, abs=0.35)
    assert np.std(without) == pytest.approx(1.0, abs=0.35)


@pytest.mark.parametrize(
    "kind",
    ["dead_time", "saturation_q", "iron_loss", "skin", "current_gain", "winding_heat", "currents_averaged",
     "currents_filtered", "angle_late", "angle_signals", "leg_voltages"],
)  # fmt: skip
def test_the_limit_does_not_depend_on_the_size_that_it_is_sought_from(kind: str) -> None:
    told = answer(kind, "servo_4nm")
    oracle, size = Oracle(told), told["sizes"][kind]["value"]
    assert oracle.limit(kind, 0.5 * size) == pytest.approx(oracle.limit(kind, size), rel=0.02)


def test_a_fit_of_the_machine_that_goes_astray_is_taken_back() -> None:
    # The rotor runs free; so long a dead time takes it elsewhere, and the fit to a machine that is none
    oracle = Oracle(answer("dead_time", "mini_cheetah"))
    assert oracle.limit("dead_time", 0.1) == pytest.approx(oracle.limit("dead_time", 0.02), rel=0.02)


def test_a_gain_of_the_voltage_is_seen_no_better_than_the_data_sheet_allows() -> None:
    # It looks like a motor whose R_s, L_d, L_q and psi_f are all larger by as much
    told = answer("dc_link_gain", "servo_4nm")
    oracle = Oracle(told)
    limit = oracle.limit("dc_link_gain", told["sizes"]["dc_link_gain"]["value"])
    assert limit == pytest.approx(TOLERANCE / math.sqrt(3.0) * math.sqrt(NEEDED / 4.0), rel=0.05)


def test_twice_the_noise_doubles_the_limit() -> None:
    told = answer("current_offset", "servo_4nm")
    size = told["sizes"]["current_offset"]["value"]
    limits = [Oracle(told | {"scenario": louder(told["scenario"], factor)}).limit("current_offset", size)
              for factor in (30.0, 60.0)]
    assert limits[1] / limits[0] == pytest.approx(2.0, rel=0.05)
