"""Rows that come many at once: the same blocks, gaps and counts as one by one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.block import Block
from drivers.errors import FrameError
from drivers.rows import TICKS, RowBlocks
from drivers.wire.dictionary import STREAM_ROW

FULL = {"i_full": 24.0, "u_full": 387.5, "omega_full": 3000.0}
START = 65_000  # the 16-bit tick turns soon


def values(k: int) -> tuple[int, ...]:
    return tuple(((17 * k + 1000 * column) % 60000) - 30000 for column in range(len(STREAM_ROW)))


def same(one: Block, other: Block) -> bool:
    alike = all(np.array_equal(getattr(one, name), getattr(other, name)) for name in ("tick", *STREAM_ROW))
    return alike and (one.periods, one.lost_before) == (other.periods, other.lost_before)


@given(
    st.integers(1, 50), st.lists(st.tuples(st.integers(0, 20), st.integers(1, 30)), min_size=1, max_size=10),
    st.none() | st.integers(START - 500, START),
)
def test_runs_of_rows_make_the_same_blocks_as_rows_one_by_one(
    periods: int, runs: list[tuple[int, int]], after: int | None
) -> None:
    at_once, one_by_one = (RowBlocks(1e-4, periods, FULL, START, after) for _ in range(2))
    k = 0
    for lost, n in runs:
        k += lost
        counts = np.array([values(k + j) for j in range(n)]).astype(np.int16)
        at_once.run(START + k * periods, counts)
        for j in range(n):
            tick = (START + (k + j) * periods) % TICKS
            assert one_by_one.is_new(tick)
            one_by_one.row(tick, values(k + j))
        k += n
    assert at_once.counts == one_by_one.counts
    assert at_once.end == one_by_one.end
    assert all(map(same, at_once.take(), one_by_one.take()))


def test_rows_that_began_before_the_stream_are_ignored() -> None:
    rows = RowBlocks(1e-4, 10, FULL, START)
    rows.run(START - 25, np.array([values(k) for k in range(4)]).astype(np.int16))
    (block,) = rows.take()
    assert block.tick.tolist() == [START + 5]
    assert rows.counts.rows == 1


def test_a_tick_of_32_bits_turns_as_well() -> None:
    rows = RowBlocks(1e-4, 10, FULL, 2**32 - 5)
    for tick in (2**32 - 5, 5):
        rows.run(tick, np.array([values(0)]).astype(np.int16))
    (block,) = rows.take()
    assert block.tick.tolist() == [2**32 - 5, 2**32 + 5]


@pytest.mark.parametrize("ahead", [0, -10, 7])
def test_a_run_whose_tick_cannot_be_is_refused(ahead: int) -> None:
    rows = RowBlocks(1e-4, 10, FULL, START)
    row = np.array([values(0)]).astype(np.int16)
    rows.run(START, row)
    with pytest.raises(FrameError, match=f"rows come every 10 ticks, but tick {START + ahead} came {ahead} after"):
        rows.run(START + ahead, row)
