"""A window says what it can tell and what it cannot; it never invents a number."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER, Excitation, Scenario
from estimator.online import window_ls
from estimator.online.estimate import Status, WindowEstimate
from estimator.online.excitation import Excitation as Told
from estimator.online.excitation import combinations, condition, excitation
from estimator.samples import Resolution
from tests.support.samples import noiseless, recorded, streamed, truth_of

HELD = {"R_s": 0.9664, "L_d": 4.24e-3, "L_q": 6.21e-3, "psi_f": 0.12}


def with_excitation(scenario: Scenario, **given: float) -> Scenario:
    """The scenario under other currents."""
    return replace(scenario, excitation=replace(Excitation(), **given))


def at_speed(scenario: Scenario, rpm: float) -> Scenario:
    """The scenario at another speed."""
    return replace(scenario, run=replace(scenario.run, speed_rpm=rpm))


def window(scenario: Scenario, held: dict[str, float] | None = None) -> WindowEstimate:
    """A settled second of a scenario's stream."""
    drive = VirtualDrive(scenario)
    drive.run(2000)
    return window_ls.estimate(window_ls.update(window_ls.init(1000), streamed(drive, 1000)), held=held)


def statuses(result: WindowEstimate) -> dict[str, str]:
    """Status by parameter."""
    return {name: e.status.value for name, e in result.estimates.items()}


@pytest.mark.parametrize("noise", [True, False])
def test_at_standstill_psi_f_is_not_told_and_the_rest_is(noise: bool) -> None:
    result = window(at_speed(PAPER if noise else noiseless(), 0.0))
    assert statuses(result) == {"R_s": "ok", "L_d": "ok", "L_q": "ok", "psi_f": "not_told"}
    assert result.estimates["psi_f"].reason.endswith("the motor stands still")


@pytest.mark.parametrize("noise", [True, False])
def test_without_current_nothing_but_psi_f_is_told(noise: bool) -> None:
    result = window(with_excitation(PAPER if noise else noiseless()))
    told = statuses(result)
    assert told["psi_f"] == "ok"
    assert told["R_s"] == told["L_d"] == told["L_q"] == "not_told"
    assert all(result.estimates[name].value is None for name in ("R_s", "L_d", "L_q"))


@pytest.mark.parametrize("kind", ["levels", "prbs", "multisine", "staircase"])
def test_every_sequence_of_the_drive_lets_all_four_be_told(kind: str) -> None:
    excitation = replace(PAPER.excitation, kind=kind, level_time=0.02)
    result = window(replace(PAPER, excitation=excitation))
    for name, estimate in result.estimates.items():
        assert estimate.status is Status.OK
        assert estimate.value == pytest.approx(HELD[name], rel=3e-3)


def test_with_i_d_controlled_to_zero_the_little_that_is_known_of_L_d_comes_with_a_wide_interval() -> None:
    estimate = window(with_excitation(PAPER, i_q_ref=2.0, i_q_step=3.0)).estimates["L_d"]
    assert estimate.value is not None and estimate.std is not None
    assert estimate.std > 10e-6
    assert abs(estimate.value - HELD["L_d"]) < 3 * estimate.std


def test_a_parameter_that_is_not_told_is_held_and_leaves_the_others_alone() -> None:
    result = window(with_excitation(at_speed(PAPER, 0.0), i_q_ref=2.0, i_q_step=3.0), HELD)
    for name in ("L_d", "psi_f"):
        estimate = result.estimates[name]
        assert (estimate.status, estimate.value, estimate.std) == (Status.NOT_TOLD, HELD[name], None)
    for name in ("R_s", "L_q"):
        assert result.estimates[name].value == pytest.approx(HELD[name], rel=3e-3)


@pytest.mark.parametrize("noise", [True, False])
def test_steady_currents_at_steady_speed_tell_nothing_apart(noise: bool) -> None:
    result = window(with_excitation(PAPER if noise else noiseless(), i_d_ref=-2.0, i_q_ref=3.0))
    assert set(statuses(result).values()) == {"not_told"}
    assert result.estimates["psi_f"].reason == (
        "R_s, L_d, L_q and psi_f cannot be told apart here: i_d, i_q and speed are constant"
    )


@pytest.mark.parametrize("noise", [True, False])
def test_at_standstill_with_current_on_one_axis_only_that_axis_is_told(noise: bool) -> None:
    scenario = with_excitation(at_speed(PAPER if noise else noiseless(), 0.0), i_q_ref=2.0, i_q_step=3.0)
    assert statuses(window(scenario)) == {"R_s": "ok", "L_d": "not_told", "L_q": "ok", "psi_f": "not_told"}


SWINGING = replace(PAPER, run=replace(PAPER.run, swing_rpm=200.0))
STEPS, LEVEL = {"i_q_ref": 2.0, "i_q_step": 3.0}, {"i_d_ref": -2.0, "i_q_ref": 3.0}
RUNS: dict[str, tuple[Scenario, list[str]]] = {  # and what each cannot tell, with noise
    "standstill": (at_speed(PAPER, 0.0), ["psi_f cannot be told here: the motor stands still"]),
    "standstill, steady currents": (with_excitation(at_speed(PAPER, 0.0), **LEVEL), [
        "L_d cannot be told here: i_d is constant and the motor stands still",
        "L_q cannot be told here: i_q is constant and the motor stands still",
        "psi_f cannot be told here: the motor stands still",
    ]),
    "i_d zero": (with_excitation(PAPER, **STEPS), []),
    "one level of i_d": (with_excitation(PAPER, i_d_ref=-2.0, **STEPS), []),
    "one level of i_q": (with_excitation(PAPER, i_d_step=2.0, **LEVEL), []),
    "all steady": (with_excitation(PAPER, **LEVEL), [
        "R_s, L_d, L_q and psi_f cannot be told apart here: i_d, i_q and speed are constant",
    ]),
    "all steady, i_d zero": (with_excitation(PAPER, i_q_ref=3.0), [
        "R_s and psi_f cannot be told apart here: i_d, i_q and speed are constant",
        "L_d cannot be told here: i_d is zero or does not stand out of its noise",
    ]),
    "no current": (with_excitation(PAPER), [
        "R_s cannot be told here: its currents, # A rms, do not stand out of their noise, # A",
        "L_d cannot be told here: i_d is zero or does not stand out of its noise",
        "L_q cannot be told here: i_q is zero or does not stand out of its noise",
    ]),
    "steady currents, speed swings": (with_excitation(SWINGING, **LEVEL), [
        "L_d and psi_f cannot be told apart here: i_d is constant",
    ]),
    "i_d zero, speed swings": (with_excitation(SWINGING, i_q_ref=3.0), [
        "L_d cannot be told here: i_d is zero or does not stand out of its noise",
    ]),
    "no current, speed swings": (with_excitation(SWINGING), [
        "R_s cannot be told here: its currents, # A rms, do not stand out of their noise, # A",
        "L_d cannot be told here: i_d is zero or does not stand out of its noise",
        "L_q cannot be told here: i_q is zero or does not stand out of its noise",
    ]),
}


@pytest.mark.parametrize("name", RUNS)
def test_what_cannot_be_told_is_named_with_its_reason(name: str) -> None:
    run, reasons = RUNS[name]
    result = window(run)
    assert [re.sub(r"\d\S*(?= A)", "#", combination.reason) for combination in result.combinations] == reasons
    for combination in result.combinations:
        for parameter in combination.parameters:
            estimate = result.estimates[parameter]
            assert (estimate.status, estimate.reason) == (Status.NOT_TOLD, combination.reason)


@pytest.mark.parametrize("noise", [True, False])
@pytest.mark.parametrize("every_period", [False, True])
@pytest.mark.parametrize("name", RUNS)
def test_no_value_is_far_outside_its_own_interval(name: str, every_period: bool, noise: bool) -> None:
    drive = VirtualDrive(RUNS[name][0] if noise else noiseless(RUNS[name][0]))
    drive.run(2000)
    samples = recorded(drive, 10_000) if every_period else streamed(drive, 1000)
    m = 10 if every_period else 1
    estimates = window_ls.estimate(window_ls.update(window_ls.init(len(samples), m), samples)).estimates
    for parameter, truth in truth_of(drive).items():
        e = estimates[parameter]
        if e.status is Status.OK:
            assert e.value is not None and e.std is not None
            assert abs(e.value - truth) < 3.5 * e.std, (parameter, e.value, e.std)


def test_a_resolution_that_no_noise_dithers_is_in_the_interval() -> None:
    drive = VirtualDrive(noiseless(with_excitation(PAPER, i_q_ref=3.0)))
    drive.run(2000)
    fine, step = streamed(drive, 1000), 0.05  # V
    u_d, u_q = (step * np.round(u / step) for u in (fine.u_d, fine.u_q))
    coarse = replace(fine, u_d=u_d, u_q=u_q, resolution=Resolution(u=step))
    for samples, doubt in ((fine, 0.0), (coarse, step / np.sqrt(12.0) / (503.0 * 3.0))):
        state = window_ls.update(window_ls.init(1000), samples)
        e = window_ls.estimate(state, ("L_q",), HELD).estimates["L_q"]
        assert e.value is not None and e.std is not None
        assert abs(e.value - HELD["L_q"]) < 2.0 * e.std
        assert e.std > 0.5 * doubt


def test_a_window_of_zeros_says_so_of_every_parameter() -> None:
    zeros = np.zeros(100)
    samples = window_ls.Samples(zeros, zeros, zeros, zeros, zeros, zeros, T_s=1e-4)
    result = window_ls.estimate(window_ls.update(window_ls.init(99), samples))
    assert set(statuses(result).values()) == {"not_told"}
    assert result.condition is None


def share(ex: Told) -> np.ndarray:
    """Of each parameter in what the first window cannot tell."""
    return np.sum(ex.weak[0] ** 2, axis=1)


def test_a_combination_is_named_by_its_members() -> None:
    rng = np.random.default_rng(1)
    a = rng.normal(size=(500, 3))
    A = np.column_stack([a[:, 0], 2.0 * a[:, 0], a[:, 1], a[:, 2]])
    ex = excitation((A.T @ A)[None], np.zeros((1, 4)))
    assert combinations(ex.weak[0], range(2)) == [(0, 1)]
    assert share(ex) == pytest.approx([0.5, 0.5, 0.0, 0.0], abs=1e-9)


@given(st.permutations(range(6)), st.integers(0, 2**32 - 1))
def test_combinations_that_have_nothing_to_do_with_each_other_are_not_mixed(order: list[int], seed: int) -> None:
    a, b, c = np.random.default_rng(seed).normal(size=(3, 500))
    columns = np.column_stack([a, 2.0 * a, b, b + 1e-9 * c, 3.0 * b, c])  # {0, 1} and {2, 3, 4}, and one that is told
    A = columns[:, order]
    ex = excitation((A.T @ A)[None], np.zeros((1, 6)))
    untold = [place for place in range(6) if order[place] != 5]
    groups = {frozenset(order[j] for j in group) for group in combinations(ex.weak[0], untold)}
    assert groups == {frozenset({0, 1}), frozenset({2, 3, 4})}


def test_a_column_of_pure_noise_is_not_excitation() -> None:
    rng = np.random.default_rng(1)
    A = np.column_stack([rng.normal(size=500), 0.01 * rng.normal(size=500)])
    G = np.array([A.T @ A, A.T @ A])
    ex = excitation(G, np.array([[0.0, 500 * 0.01**2], [0.0, 0.0]]))
    assert np.sum(ex.weak**2, axis=2) == pytest.approx(np.array([[0.0, 1.0], [0.0, 0.0]]), abs=1e-2)


def test_told_directions_are_inverted_like_the_normal_matrix() -> None:
    rng = np.random.default_rng(2)
    A = rng.normal(size=(200, 4)) * [1.0, 1e-3, 1e3, 1.0]
    G = A.T @ A
    ex = excitation(G[None], np.zeros((1, 4)))
    assert ex.inverse[0] == pytest.approx(np.linalg.inv(G), rel=1e-9)
    assert condition(G[None])[0] == pytest.approx(np.linalg.cond(A / np.linalg.norm(A, axis=0)), rel=1e-6)
