"""What a drive's measuring chain does to currents and angle, beside the edge-accurate drive that has it."""

import cmath
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from emulator.plant.physics.angle_signal import AngleSignal
from emulator.plant.physics.current_filter import CurrentFilter
from emulator.plant.physics.harmonics import Harmonics
from emulator.plant.physics.saturation import Saturation
from emulator.plant.physics.sensing import CurrentSensing
from emulator.plant.physics.strangers import Stray
from estimator.physics.library import BY_NAME
from estimator.twin.model import Model
from tests.estimator.physics.equations import left_of, rows_without_noise, with_effect

MOTORS = ("servo_4nm", "mini_cheetah", "lea_52k")


def omega_n(bandwidth: float) -> float:
    return math.tau * bandwidth


def gains_of_two(g: float) -> tuple[float, float, float]:
    """Sizes of gains 1 + g of phase a, 1 - g of phase b, where phase c is what these leave."""
    c = 2.0 * g / math.sqrt(3.0) * cmath.exp(1j * math.radians(30.0))
    return 2.0 * c.real, -2.0 * c.imag, 3.0


def harmonic_sizes(h: float, phase: float, third: float, third_phase: float) -> tuple[float, ...]:
    """Sizes of a second and a third harmonic: both signals' as one, (1 - j) h cos(2 theta + phase), and conjugate."""
    forwards, back = (0.5 * h * (1.0 - 1.0j) * cmath.exp(sign * 1j * phase) for sign in (1.0, -1.0))
    once, thrice, fourth = forwards.conjugate() * -1.0, back, third * cmath.exp(-1j * third_phase)
    return once.imag, -once.real, 0.0, 0.0, thrice.imag, -thrice.real, fourth.imag, -fourth.real


Made = Callable[[float], dict[str, Any]]
CASES: dict[str, tuple[Made, Made]] = {  # of the control period (s): sections of a scenario, and the effect's sizes
    "mean over a period": (
        lambda _T: {"current_filter": CurrentFilter(periods=1)}, lambda _T: {"current_averaging": (1.0, 0.0)},
    ),
    "mean over three": (
        lambda _T: {"current_filter": CurrentFilter(periods=3)}, lambda _T: {"current_averaging": (1.0, 2.0)},
    ),
    "mean of three samples": (
        lambda _T: {"current_filter": CurrentFilter(samples=3)}, lambda _T: {"current_averaging": (1.0, 4.0)},
    ),
    "short filter": (
        lambda T: {"current_filter": CurrentFilter(tau=0.3 * T)}, lambda T: {"current_filter": (1.0, 0.3 * T)},
    ),
    "filter of a period": (
        lambda T: {"current_filter": CurrentFilter(tau=T)}, lambda T: {"current_filter": (1.0, T)},
    ),
    "long filter": (
        lambda T: {"current_filter": CurrentFilter(tau=3.0 * T)}, lambda T: {"current_filter": (1.0, 3.0 * T)},
    ),
    "latency": (
        lambda T: {"angle_signal": AngleSignal(latency=0.7 * T)}, lambda T: {"angle_latency": (0.7 * T,)},
    ),
    "tracking loop": (
        lambda _T: {"angle_signal": AngleSignal(bandwidth=40.0, damping=0.7)},
        lambda _T: {"angle_tracking": (omega_n(40.0) ** -2, 0.7)},
    ),
    "sensor's signals": (
        lambda _T: {"angle_signal": AngleSignal(gain=0.1, quadrature=-0.06, offset_sin=0.02)},
        lambda _T: {"angle_sensor_error": (0.02, 0.0, 0.03, -0.05, 0.0, 0.0, 0.0, 0.0)},
    ),
    "harmonics of its signals": (
        lambda _T: {"angle_signal": AngleSignal(second=0.05, second_phase=0.3, third=0.03, third_phase=1.1)},
        lambda _T: {"angle_sensor_error": harmonic_sizes(0.05, 0.3, 0.03, 1.1)},
    ),
    "gains of two sensors": (
        lambda _T: {"current_sensing": CurrentSensing(gain_a=1.02, gain_b=0.98)},
        lambda _T: {"current_sensor_gain": gains_of_two(0.02)},
    ),
    "one of two sensors late": (
        lambda _T: {"current_sensing": CurrentSensing(skew_b=5e-6)},
        lambda _T: {"current_sampling_skew": (5e-6, 6.0)},
    ),
    "leg": (
        lambda _T: {"stray": Stray(amplitude=0.5, frequency=0.0, along_alpha=0.8, along_beta=-0.6)},
        lambda _T: {"leg_voltage_offset": (0.4, -0.3)},
    ),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("motor", MOTORS)
@pytest.mark.parametrize("case", CASES)
def test_an_equation_misses_little_of_its_chain(case: str, motor: str) -> None:
    scenario = with_effect("none", motor)
    if "two sensors" in case:
        scenario = replace(scenario, drive=replace(scenario.drive, current_sensors=2))
    sections, effects = (make(scenario.drive.T_s) for make in CASES[case])
    rows = rows_without_noise(replace(scenario, effects=scenario.effects._replace(**sections)))
    before, after = left_of(rows, Model(rows.machine)), left_of(rows, Model(rows.machine, effects))
    print(f"{motor}, {case}: {before:.3g} per mille of rated current, {after:.3g} with the effect")
    assert after < 0.07 * before
    assert all(name in BY_NAME for name in effects)


BESIDE: dict[str, tuple[dict[str, Any], dict[str, tuple[float, ...]]]] = {
    "harmonics": (
        {"harmonics": Harmonics(d_6=0.02, q_6=-0.03)}, {"flux_harmonics": (0.02, -0.03, 0.0, 0.0)},
    ),
    "d axis": ({"saturation": Saturation(L_d_drop=0.1)}, {"d_axis_saturation": (0.1,)}),
    "q axis": ({"saturation": Saturation(L_q_drop=0.3)}, {"q_axis_saturation": (0.3,)}),
}  # fmt: skip
"""What acts on currents before they are smoothed, and is no straight line: sections, and the effect."""


@pytest.mark.slow
@pytest.mark.parametrize("motor", MOTORS)
@pytest.mark.parametrize("chain", ["mean over three", "mean of three samples", "filter of a period"])
@pytest.mark.parametrize("other", BESIDE)
def test_what_other_effects_add_is_smoothed_with_the_currents(other: str, chain: str, motor: str) -> None:
    """What is left of both is little more than what the smoothing's own equation misses."""
    scenario = with_effect("none", motor)
    sections, effects = (make(scenario.drive.T_s) for make in CASES[chain])
    more, beside = BESIDE[other]
    rows, plain = (
        rows_without_noise(replace(scenario, effects=scenario.effects._replace(**each)))
        for each in ({**sections, **more}, sections)
    )
    own, alone = left_of(plain, Model(plain.machine, effects)), left_of(rows, Model(rows.machine, effects))
    both = left_of(rows, Model(rows.machine, {**effects, **beside}))
    print(f"{motor}, {chain} beside {other}: {alone:.3g} per mille of rated current, {both:.3g} with it; own {own:.3g}")
    assert both < own + 0.15 * alone
