"""Dead-time compensation against closed forms: its sign, what it goes by, its zone, and what is recorded of it."""

import cmath
import math

import numpy as np
import pytest

from emulator.plant.physics.compensation import BY_COMMAND, BY_SAMPLE, Compensation
from emulator.plant.physics.legs import Inverter
from tests.emulator.plant.physics.effect_runs import (
    SALIENT,
    T_S,
    at,
    phases_of,
    steady,
    switched,
    voltage_error,
    with_effects,
)

U_DC = 310.0
TIME = 2e-6  # s
CURRENT = cmath.rect(4.0, math.radians(50.0))  # A


def shares(i: complex, width: float = 0.0) -> complex:
    """Space vector of the phases' currents over a width, within -1 and 1."""
    a, b, c = (math.copysign(1.0, x) if abs(x) >= width else x / width for x in phases_of(i))
    turn = cmath.exp(2j * math.pi / 3.0)
    return 2.0 / 3.0 * (a + b * turn + c * turn**2)


@pytest.mark.parametrize("by", [0, BY_SAMPLE, BY_COMMAND])
@pytest.mark.parametrize("time", [TIME, -TIME])
@pytest.mark.parametrize("width", [0.0, 3.5])
def test_it_adds_its_share_of_the_dc_link_along_every_phases_current(by: int, time: float, width: float) -> None:
    r = steady(with_effects(i_dq=CURRENT, compensation=Compensation(time, width, by)), 0.05, 0.02)
    expected = -time / T_S * U_DC * shares(CURRENT, width)
    assert abs(complex(voltage_error(r, SALIENT).mean()) - expected) < 0.01 * abs(expected)


def test_what_is_recorded_after_it_holds_it() -> None:
    r = steady(with_effects(i_dq=CURRENT, compensation=Compensation(TIME, recorded=1)), 0.05, 0.02)
    assert abs(complex(voltage_error(r, SALIENT).mean())) < 1e-3 * TIME / T_S * U_DC


def test_as_much_as_the_dead_time_undoes_it() -> None:
    lost, undone = (
        voltage_error(steady(switched(
            with_effects(i_dq=CURRENT, inverter=Inverter(dead_time=TIME), compensation=compensation)
        ), 0.05, 0.02), SALIENT)
        for compensation in (Compensation(), Compensation(TIME))
    )  # fmt: skip
    assert abs(complex(undone.mean())) < 0.02 * abs(complex(lost.mean()))


def test_near_zero_it_jumps_with_the_noise_of_the_sample_before() -> None:
    scenario = with_effects(i_dq=0.02j, run=at(5.0), drive={"noise_i": 0.05}, compensation=Compensation(TIME))
    r = steady(scenario, 0.2, 0.5)
    theta, i = r["theta_e"], r["i_d"] + 1j * r["i_q"]
    middle = theta[:-1] + 0.5 * np.angle(np.exp(1j * np.diff(theta)))
    acting = i[:-2] * np.exp(1j * middle[1:])  # the sample before, turned on
    told = np.array([shares(complex(x)) for x in acting]) * np.exp(-1j * middle[1:])
    error = voltage_error(r, SALIENT)[1:]
    along = np.vdot(told, error[: len(told)]) / np.vdot(told, told)
    assert complex(along) == pytest.approx(-TIME / T_S * U_DC, rel=0.05)
