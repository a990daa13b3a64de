"""What gains promise, beside closed forms and beside the same loops computed otherwise."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from scipy.integrate import solve_ivp  # pyright: ignore[reportUnknownVariableType]
from scipy.signal import lfilter  # pyright: ignore[reportUnknownVariableType]

from bench.commissioning.promise import CurrentLoop, SpeedLoop, at_random, thinned, to_and_fro
from bench.commissioning.response import Column, averaged
from bench.parameters.tuning import current_loop, speed_loop

R_s, L, T_s, PSI_F, N_P, J = 0.9664, 6.21e-3, 1e-4, 0.12, 4, 2e-3
K = 1.5 * N_P**2 * PSI_F / J
ONE = np.ones(6000)
SOLVE = cast(Callable[..., Any], solve_ivp)  # which has no types


def by_model(alpha: float) -> CurrentLoop:
    return CurrentLoop(alpha * L, alpha * R_s, R_s, L, T_s)


@pytest.mark.parametrize("alpha", [30.0, 100.0, 300.0])
def test_a_slow_current_loop_is_a_first_order_of_its_bandwidth_a_period_and_a_half_late(alpha: float) -> None:
    y = by_model(alpha).answer(ONE)
    t = np.maximum(T_s * (np.arange(len(y)) - 1.5), 0.0)
    assert y == pytest.approx(1.0 - np.exp(-alpha * t), abs=1.5 * alpha * T_s)


@pytest.mark.parametrize("alpha", [300.0, 1250.0, 2000.0, 1.0 / (3.0 * T_s)])
def test_a_current_loop_is_that_of_its_pulse_transfer_function(alpha: float) -> None:
    a = math.exp(-R_s * T_s / L)
    b = (1.0 - a) / R_s
    k_p, k_i = alpha * L, alpha * R_s
    # open loop: b/(z - a) of the motor, 1/z of the delay, (k_p (z - 1) + k_i T_s)/(z - 1) of the control
    forward = b * np.array([k_p, k_i * T_s - k_p])
    open_loop = np.polymul(np.polymul([1.0, -a], [1.0, 0.0]), [1.0, -1.0])
    closed = np.polyadd(open_loop, forward)
    numerator = np.concatenate((np.zeros(len(closed) - len(forward)), forward))
    reference = at_random(80, 40)
    assert by_model(alpha).answer(reference) == pytest.approx(lfilter(numerator, closed, reference), abs=1e-9)


def test_the_fastest_tuning_is_the_magnitude_optimum() -> None:
    tuned = current_loop(R_s, L, L, T_s)
    loop = CurrentLoop(tuned.values["k_p_q"], tuned.values["k_i_q"], R_s, L, T_s)
    assert tuned.bandwidth == pytest.approx(1.0 / (3.0 * T_s))
    # 4.3 % where the delay of 1.5 periods is a lag; sampled, the loop is a little better damped
    assert float(np.max(loop.answer(ONE))) - 1.0 == pytest.approx(0.043, abs=0.01)


def test_back_emf_that_is_fed_forward_leaves_nothing_and_what_is_not_is_told_by_the_integral() -> None:
    emf = PSI_F * K
    loop = replace(by_model(1250.0), back_emf=emf, speed_filter=1e-3)
    k_i = loop.k_i
    assert loop.answer(ONE)[-1] == pytest.approx(1.0, abs=1e-3)
    for share in (0.0, 0.5, 0.9):
        # a constant current ramps the speed, against which an integral control has a constant deviation
        left = replace(loop, fed_share=share).answer(np.ones(30_000))[-1]
        assert left == pytest.approx(1.0 / (1.0 + emf * (1.0 - share) / k_i), rel=2e-3)


def test_without_a_reference_nothing_flows() -> None:
    assert not by_model(1250.0).answer(np.zeros(100)).any()
    assert not SpeedLoop(0.1, 1.0, K, 0.0, by_model(1250.0), 1e-3).answer(np.zeros(100)).any()


def in_continuous_time(loop: SpeedLoop, count: int) -> Column:
    """The answer to a step by the loop's differential equations."""

    def slope(_: float, x: Column) -> list[float]:
        omega, filtered, i_q, integral = x
        e = 1.0 - filtered
        return [
            loop.K * i_q - loop.damping * omega, (omega - filtered) / loop.speed_filter,
            loop.current.k_p / L * (loop.k_p * e + integral - i_q), loop.k_i * e,
        ]  # fmt: skip

    t = T_s * np.arange(count)
    return SOLVE(slope, (0.0, t[-1]), [0.0] * 4, t_eval=t, rtol=1e-8, atol=1e-10, max_step=1e-3).y[0]


@pytest.mark.parametrize("damping", [0.0, 5.0])
@pytest.mark.parametrize("a", [2.0, 4.0])
def test_a_speed_loop_is_that_of_its_differential_equations(a: float, damping: float) -> None:
    alpha, speed_filter = 1250.0, 2e-3
    gains = speed_loop(J, PSI_F, N_P, 1.0 / alpha + speed_filter + 0.5 * T_s, a=a).values
    loop = SpeedLoop(gains["k_p_speed"], gains["k_i_speed"], K, damping, by_model(alpha), speed_filter)
    y = loop.answer(ONE)
    assert y == pytest.approx(in_continuous_time(loop, len(y)), abs=0.05)
    assert y[-1] == pytest.approx(1.0, abs=1e-3)


def test_a_speed_loop_without_an_integral_is_held_back_by_its_damping() -> None:
    loop = SpeedLoop(0.05, 0.0, K, 20.0, by_model(1250.0), 1e-3)
    assert loop.answer(ONE)[-1] == pytest.approx(0.05 * K / (0.05 * K + 20.0), rel=1e-6)


def test_the_symmetrical_optimum_overshoots_as_it_is_known_to() -> None:
    fine = 1e-6  # s: delays in all are those of the filter
    quick = replace(by_model(1e5), T_s=fine)
    gains = speed_loop(J, PSI_F, N_P, 3e-3, a=2.0).values
    loop = SpeedLoop(gains["k_p_speed"], gains["k_i_speed"], K, 0.0, quick, 3e-3 - 1e-5)
    # of the shaft itself, not of the speed that is filtered: the reference's step is not filtered
    assert float(np.max(loop.answer(np.ones(60_000)))) - 1.0 > 0.43


def test_references_step_as_a_trial_does() -> None:
    assert to_and_fro(2, 4).tolist() == [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0]
    assert to_and_fro(4, 3, 3) == pytest.approx([0.0] * 4 + [0.4, 0.8, 1.0, 1.0] + [0.6, 0.2, 0.0, 0.0])
    levels = at_random(3, 40)
    assert len(levels) == 120
    assert set(levels.tolist()) == {0.0, 1.0}
    assert (levels.reshape(40, 3) == levels[::3, None]).all()
    assert (levels == at_random(3, 40)).all()
    assert 8 <= np.count_nonzero(np.diff(levels)) <= 32
    assert thinned(np.arange(7.0), 3).tolist() == [1.0, 4.0]
    assert thinned(np.arange(3.0), 1).tolist() == [0.0, 1.0, 2.0]


def test_a_promise_is_averaged_as_a_trial_is() -> None:
    alpha, hold = 1250.0, 80
    got = averaged(by_model(alpha).answer(at_random(hold, 40)), T_s, hold, 1.0)
    y = by_model(alpha).answer(np.ones(hold))
    assert got.overshoot == pytest.approx(max(0.0, float(np.max(y)) - 1.0), abs=0.01)
    assert got.settling == pytest.approx(math.log(19.0) / alpha, rel=0.35)
