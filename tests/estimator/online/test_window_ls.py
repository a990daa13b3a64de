"""The window is exact: its estimate is the least-squares solution of the rows in it, whatever came before."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER
from estimator.machine import PARAMETERS
from estimator.online import window_ls
from estimator.online.estimate import Status, WindowEstimate
from estimator.online.flux_balance import COLUMNS, Balance, flux_balance, mean_of
from estimator.online.window_ls import CHUNK, MAX_LENGTH, WindowState
from estimator.samples import Samples
from tests.support.samples import streamed

ROWS = 6000
SAMPLES = streamed(VirtualDrive(PAPER), ROWS)
BALANCE = flux_balance(SAMPLES)
COLUMN = {name: k for k, name in enumerate(COLUMNS)}


def groups(balance: Balance, length: int, m: int) -> Balance:
    """The regression rows of a window over one run: complete groups of m, counted from the run's start."""
    first = max(0, len(balance) - length)
    return mean_of(balance[first + -first % m :], m)


def regression(g: Balance, result: WindowEstimate) -> tuple[np.ndarray, np.ndarray]:
    """Equations of all groups, written down here anew, the small terms taken from the result itself."""
    R_s, L_d, L_q, psi_f = (result.estimates[name].value or 0.0 for name in PARAMETERS)
    i_d, i_q, x_d, x_q, y_d, y_q, s, h, u_d, u_q = g.T
    b = (R_s * SAMPLES.T_s) ** 2 / 12
    A_d = np.stack([i_d, x_d, -y_q, 0 * s], axis=1)
    A_q = np.stack([i_q, y_d, x_q, s], axis=1)
    y = [u_d + R_s * psi_f / L_d * h - b / L_d * (x_d - y_q), u_q - b / L_q * (x_q + y_d)]
    return np.concatenate([A_d, A_q]), np.concatenate(y)


def values(result: WindowEstimate) -> np.ndarray:
    """Estimated values in the order of PARAMETERS."""
    return np.array([result.estimates[name].value for name in PARAMETERS], dtype=np.float64)


def fed(state: WindowState, samples: Samples, cuts: list[int]) -> WindowState:
    """Update with samples cut at some places."""
    for a, b in zip([0, *cuts], [*cuts, len(samples)], strict=True):
        state = window_ls.update(state, samples[a:b])
    return state


def assert_is_lstsq(state: WindowState, balance: Balance, length: int, m: int) -> None:
    """The window's plain solution equals numpy's on the same rows."""
    result = window_ls.estimate(state, noise_aware=False)
    A, b = regression(groups(balance, length, m), result)
    assert result.equations == len(b)
    assert values(result) == pytest.approx(np.linalg.lstsq(A, b)[0], rel=1e-9)


@settings(max_examples=60, deadline=None)
@given(
    length=st.integers(60, 3000),
    m=st.integers(1, 12),
    cuts=st.lists(st.integers(1, ROWS - 1), max_size=20, unique=True),
)
def test_any_window_over_any_split_of_the_stream_is_the_least_squares_solution_of_its_rows(
    length: int, m: int, cuts: list[int]
) -> None:
    state = fed(window_ls.init(length, m), SAMPLES, sorted(cuts))
    assert_is_lstsq(state, BALANCE, length, m)


def test_one_sample_at_a_time_is_the_same_as_a_block() -> None:
    n = 3 * CHUNK + 17
    state = fed(window_ls.init(400, 3), SAMPLES[:n], list(range(1, n)))
    assert_is_lstsq(state, BALANCE[: n - 1], 400, 3)


@settings(max_examples=30, deadline=None)
@given(steps=st.lists(st.tuples(st.integers(60, 4000), st.integers(1, 9)), min_size=1, max_size=5))
def test_resizing_while_running_keeps_every_sample_held(steps: list[tuple[int, int]]) -> None:
    state = window_ls.init(500, 2)
    place = 0
    for length, m in steps:
        state = window_ls.resized(window_ls.update(state, SAMPLES[place : place + 700]), length, m)
        place += 700
        assert state.samples == min(length, place - 1)
    result = window_ls.estimate(state, noise_aware=False)
    length, m = steps[-1]
    A, b = regression(groups(BALANCE[: place - 1], length, m), result)
    assert values(result) == pytest.approx(np.linalg.lstsq(A, b)[0], rel=1e-9)


def test_a_window_longer_than_the_ring_is_exact() -> None:
    drive = VirtualDrive(PAPER)
    samples = streamed(drive, 80_000)
    state = fed(window_ls.init(60_000, 1), samples, list(range(7_777, 80_000, 7_777)))
    assert_is_lstsq(state, flux_balance(samples), 60_000, 1)


def test_a_thousand_times_larger_signals_and_a_standstill_leave_no_trace_once_they_have_left() -> None:
    loud = replace(
        SAMPLES, i_d=SAMPLES.i_d * 1e3, i_q=SAMPLES.i_q * 1e3, u_d=SAMPLES.u_d * 1e3, u_q=SAMPLES.u_q * 1e3
    )
    still = np.zeros(2000)
    rest = Samples(still, still, still, still, still, still, SAMPLES.T_s, SAMPLES.periods, still, still)
    state = window_ls.init(1000, 1)
    for samples in (loud, rest, SAMPLES):
        state = window_ls.update(state, samples, joined=False)
    assert_is_lstsq(state, BALANCE, 1000, 1)


@settings(max_examples=40, deadline=None)
@given(
    bad=st.lists(st.integers(0, 1999), min_size=1, max_size=30, unique=True),
    value=st.sampled_from([np.nan, np.inf, -np.inf]), cut=st.integers(1, 1999),
    column=st.sampled_from(["theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q", "i_d_mean", "i_q_mean"]),
)
def test_a_value_that_is_no_number_is_left_out_counted_and_gone_after_one_window(
    bad: list[int], value: float, cut: int, column: str
) -> None:
    spoilt = getattr(SAMPLES[:2000], column).copy()
    spoilt[bad] = value
    state = window_ls.init(800, 1)
    state = fed(state, replace(SAMPLES[:2000], **{column: spoilt}), [cut])
    assert state.left_out == len(bad)
    assert all(np.isfinite(e.value or 0.0) for e in window_ls.estimate(state).estimates.values())
    state = window_ls.update(state, SAMPLES[2000:3000])
    assert_is_lstsq(state, BALANCE[:2999], 800, 1)


def test_a_gap_makes_no_row_across_it_and_is_counted() -> None:
    state = window_ls.update(window_ls.init(1000, 1), SAMPLES[:400])
    state = window_ls.update(state, SAMPLES[500:800], joined=False)
    result = window_ls.estimate(state, noise_aware=False)
    A, b = regression(np.concatenate([BALANCE[:399], BALANCE[500:799]]), result)
    assert (result.samples, result.gaps) == (399 + 299, 1)
    assert values(result) == pytest.approx(np.linalg.lstsq(A, b)[0], rel=1e-9)


def test_a_group_that_a_gap_cuts_is_dropped_whole() -> None:
    state = window_ls.update(window_ls.init(1000, 10), SAMPLES[:96])  # 95 balances: 9 groups and 5 over
    state = window_ls.update(state, SAMPLES[100:151], joined=False)  # 50 balances: 5 groups
    assert window_ls.estimate(state).equations == 2 * (9 + 5)


@pytest.mark.parametrize("estimated", [("R_s",), ("L_d", "L_q"), ("R_s", "psi_f"), PARAMETERS])
def test_what_is_not_estimated_is_held(estimated: tuple[str, ...]) -> None:
    held = {"R_s": 0.95, "L_d": 4.2e-3, "L_q": 6.3e-3, "psi_f": 0.121}
    state = window_ls.update(window_ls.init(1000, 1), SAMPLES[:1500])
    result = window_ls.estimate(state, estimated, held, noise_aware=False)
    A, b = regression(groups(BALANCE[:1499], 1000, 1), result)
    free = [PARAMETERS.index(name) for name in estimated]
    b = b - A @ np.array([0.0 if name in estimated else held[name] for name in PARAMETERS])
    assert values(result)[free] == pytest.approx(np.linalg.lstsq(A[:, free], b)[0], rel=1e-9)
    for name in PARAMETERS:
        estimate = result.estimates[name]
        assert (estimate.status is Status.OK) == (name in estimated) == (estimate.std is not None)


def test_an_empty_window_has_no_values_and_says_so() -> None:
    result = window_ls.estimate(window_ls.init(100))
    assert {(e.value, e.std, e.status) for e in result.estimates.values()} == {(None, None, Status.NO_DATA)}
    assert "too few" in result.estimates["R_s"].reason


@pytest.mark.parametrize(
    ("length", "m"), [(0, 1), (9, 10), (MAX_LENGTH + 1, 1), (100, 0), (100, -1), (10**6, 1001)]
)
def test_a_window_that_cannot_work_is_refused_in_a_sentence(length: int, m: int) -> None:
    with pytest.raises(ValueError, match=r"must be .* got"):
        window_ls.init(length, m)


def test_a_parameter_neither_estimated_nor_held_is_refused_in_a_sentence() -> None:
    with pytest.raises(ValueError, match="psi_f is not estimated and so needs a held value"):
        window_ls.estimate(window_ls.init(100), ("R_s", "L_d", "L_q"))


@pytest.mark.slow
def test_after_a_hundred_million_samples_the_window_is_still_exact() -> None:
    """With a standstill and a stretch of a thousand times larger signals on the way."""
    samples = streamed(VirtualDrive(PAPER), 50_000)
    loud = replace(
        samples, i_d=samples.i_d * 1e3, i_q=samples.i_q * 1e3, u_d=samples.u_d * 1e3, u_q=samples.u_q * 1e3
    )
    still = np.zeros(50_000)
    rest = Samples(still, still, still, still, still, still, samples.T_s, samples.periods, still, still)
    balance = flux_balance(samples)
    for m, rounds in ((1, 2001), (7, 400)):
        state = window_ls.init(1000, m)
        for k in range(rounds):
            stretch = {300: rest, rounds - 3: loud, rounds - 2: rest}.get(k, samples)
            state = window_ls.update(state, stretch, joined=False)
        assert int(state.count[0]) == rounds * 49_999
        assert_is_lstsq(state, balance, 1000, m)
