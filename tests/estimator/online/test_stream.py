"""A stream is cut into runs at gaps and at what is no number, in the same places however it arrives."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimator.online.stream import Stream, runs_of
from estimator.samples import Samples

ROWS = 200
T = 1e-3  # s


def counted(**given: np.ndarray) -> Samples:
    """Samples that are numbered in `i_d`."""
    zero = np.zeros(ROWS)
    plain = Samples(zero, zero, np.arange(ROWS, dtype=np.float64), zero, zero, zero, T / 10, 10, zero, zero, 7.0)
    return replace(plain, **given)


def balances(samples: Samples, cuts: list[int]) -> tuple[list[tuple[int, int]], Stream]:
    """The pairs of neighbours that make a row, over a stream cut at some places."""
    stream, pairs = Stream(), list[tuple[int, int]]()
    for a, b in zip([0, *cuts], [*cuts, len(samples)], strict=True):
        for run, _ in runs_of(stream, samples[a:b]):
            numbers = [int(i) for i in run.i_d]
            pairs += pairwise(numbers)
    return pairs, stream


@given(
    bad=st.lists(st.integers(0, ROWS - 1), max_size=30, unique=True),
    cuts=st.lists(st.integers(1, ROWS - 1), max_size=20, unique=True),
)
def test_every_pair_of_finite_neighbours_makes_a_row_once_and_nothing_else_does(
    bad: list[int], cuts: list[int]
) -> None:
    u_q = np.zeros(ROWS)
    u_q[bad] = np.nan
    pairs, stream = balances(counted(u_q=u_q), sorted(cuts))
    assert pairs == [(k, k + 1) for k in range(ROWS - 1) if k not in bad and k + 1 not in bad]
    assert stream.left_out == len(bad)


@pytest.mark.parametrize("last", [np.nan, np.inf, -np.inf])
def test_a_bad_value_at_the_end_of_a_block_ends_the_run_too(last: float) -> None:
    u_q = np.zeros(ROWS)
    u_q[99] = last
    pairs, stream = balances(counted(u_q=u_q), [100])
    assert (98, 100) not in pairs
    assert (stream.runs, stream.gaps) == (2, 1)
    assert (stream.T_s, stream.periods) == (T / 10, 10)


def test_opposite_infinities_in_one_row_are_one_row_left_out() -> None:
    i_q, u_d = np.zeros(ROWS), np.zeros(ROWS)
    i_q[5], u_d[5] = np.inf, -np.inf
    assert balances(counted(i_q=i_q, u_d=u_d), [])[1].left_out == 1


def test_a_run_that_continues_another_starts_with_its_last_sample_and_time() -> None:
    stream, samples = Stream(), counted()
    first, second = (list(runs_of(stream, samples[a:b])) for a, b in ((0, 10), (10, 20)))
    assert [continues for _, continues in (*first, *second)] == [False, True]
    run = second[0][0]
    assert (len(run), run.i_d[0], run.t0) == (11, 9.0, pytest.approx(7.0 + 9 * T))
    assert [continues for _, continues in runs_of(stream, samples[30:40], joined=False)] == [False]
    assert (stream.runs, stream.gaps) == (2, 1)


def test_an_empty_block_changes_nothing() -> None:
    stream = Stream()
    assert list(runs_of(stream, counted()[:0])) == []
    assert (stream.last, stream.runs, stream.left_out) == (None, 0, 0)
