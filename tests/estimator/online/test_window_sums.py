"""The sums behind the standard errors, against sums made by numpy."""

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.online.window_ls import WindowState, init, sums_of
from estimator.online.window_sums import BATCH, SHORTEST_BATCH, take_balances

Array = NDArray[np.float64]

U_D, U_Q = 8, 9  # columns of a balance
U = 5  # place of the voltage in a row of the sums


def taken(u: Array, starts: NDArray[np.bool_], m: int) -> WindowState:
    """A window over balances that are nothing but voltages (2, n)."""
    balances = np.zeros((10, u.shape[1]))
    balances[[U_D, U_Q]] = u
    state = init(u.shape[1], m)
    take_balances(balances, starts, m, state.rows, state.starts, state.sums, state.places, state.count)
    return state


def level(u: Array, starts: NDArray[np.bool_], m: int) -> tuple[Array, Array]:
    """gamma0 and the level of the spectrum at frequency zero, by axis, from the sums of batches."""
    sums = sums_of(taken(u, starts, m), [u.shape[1]])
    gamma0 = sums.lag0[0, :, U, U] / sums.rows[0]
    return gamma0, (sums.batch[0, :, U, U] - gamma0 * (sums.w_w[0] - sums.w_next[0])) / sums.w_next[0]


@pytest.mark.parametrize("m", [1, 3, 20])
def test_batches_know_a_white_signal_from_one_that_cancels_over_neighbouring_rows(m: int) -> None:
    n = 40_000 * m
    e = np.random.default_rng(m).normal(size=n + 1)
    starts = np.zeros(n, dtype=np.bool_)
    starts[:: 977 * m] = True
    gamma0, f = level(np.stack((e[:-1], np.diff(e))), starts, m)
    assert gamma0 == pytest.approx([1.0 / m, 2.0 / m**2], rel=0.05)
    assert f[0] == pytest.approx(1.0 / m, rel=0.15)
    assert abs(f[1]) < 0.01 * gamma0[1]


def test_batches_of_a_run_half_overlap_and_are_weighted_by_sin_squared() -> None:
    n = 200
    u = np.random.default_rng(0).normal(size=(2, n))
    starts = np.zeros(n, dtype=np.bool_)
    starts[[0, 90, 93]] = True  # three rows are too few for a batch
    begun = [(0, 32), (16, 48), (32, 64), (48, 80), (64, 90), (93, 125), (109, 141), (125, 157), (141, 173), (157, 189),
             (173, 200)]
    assert all(SHORTEST_BATCH <= end - begin <= BATCH for begin, end in begun)
    expected = np.zeros(2)
    for begin, end in begun:
        w = np.sin(np.pi * (np.arange(end - begin) + 0.5) / (end - begin)) ** 2
        expected += (u[:, begin:end] @ w) ** 2
    sums = sums_of(taken(u, starts, 1), [n])
    assert sums.batches[0] == len(begun)
    assert sums.batch[0, :, U, U] == pytest.approx(expected, rel=1e-12)
