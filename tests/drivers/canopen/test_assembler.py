"""Frames to blocks: golden frames, gaps, repetitions, and what any loss and any cut must leave true."""

import math
import struct
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.block import Block
from drivers.canopen.assembler import Assembler
from drivers.errors import FrameError
from drivers.rows import Counts

FULL = {"i_full": 32.768, "u_full": 327.68, "omega_full": 3276.8}  # one count: 1 mA, 10 mV, 0.1 rad/s
T_S = 1e-4
COLUMNS = [f.name for f in fields(Block) if f.name not in
           {"tick", "T_s", "periods", "lost_before", "i_step", "u_step", "temp_winding", "temp_magnet"}]


def started(tick: int = 0, periods: int = 10, after: int | None = None) -> Assembler:
    return Assembler(T_S, periods, FULL, tick, after)


def frame(number: int, tick: int, mark: int = 0) -> bytes:
    """TPDO `number` of the row at a tick, its values told apart by `mark`."""
    low = tick % 65536
    return struct.pack("<HHhh", low, (mark + 1) & 0x7FFF, mark + 2, mark + 3) if number == 0 else struct.pack(
        "<Hhhh", low, mark + 10 * number + 1, mark + 10 * number + 2, mark + 10 * number + 3
    )


def feed(assembler: Assembler, *ticks: int) -> None:
    for tick in ticks:
        for number in range(3):
            assembler.frame(number, frame(number, tick))


def ticks_of(blocks: list[Block]) -> list[int]:
    return [int(tick) for block in blocks for tick in block.tick]


def test_golden_frames_become_a_block_in_si_units() -> None:
    assembler = started(tick=4)
    assembler.frame(0, bytes.fromhex("0a000040e80318fc"))  # 10, 16384, 1000, -1000
    assembler.frame(1, bytes.fromhex("0a0010270180ff7f"))  # 10, 10000, -32767, 32767
    assembler.frame(2, bytes.fromhex("0a003079e90317fc"))  # 10, 31024, 1001, -1001
    (block,) = assembler.take()
    assert block.tick.tolist() == [10]
    assert block.tick.dtype == np.int64
    expected = {"theta_e": math.pi / 2.0, "omega_e": 1000.0, "i_d": 1.0, "i_q": -1.0, "u_d": -327.67, "u_q": 327.67,
                "i_d_mean": 1.001, "i_q_mean": -1.001, "u_dc": 310.24}
    for name, value in expected.items():
        column = getattr(block, name)
        assert column.dtype == np.float64
        assert column == pytest.approx([value]), name
    assert (block.T_s, block.periods, block.lost_before) == (T_S, 10, 0)
    assert (block.i_step, block.u_step) == pytest.approx((1e-3, 10e-3))
    assert math.isnan(block.temp_winding)
    assert math.isnan(block.temp_magnet)
    assert assembler.counts == Counts(rows=1)


def test_the_voltage_of_a_bridge_that_is_off_is_no_number() -> None:
    assembler = started()
    assembler.frame(0, frame(0, 10))
    assembler.frame(1, bytes.fromhex("0a00102700800080"))  # 10, 10000, not known, not known
    assembler.frame(2, frame(2, 10))
    (block,) = assembler.take()
    assert np.isnan(block.u_d).all()
    assert np.isnan(block.u_q).all()
    assert block.omega_e == pytest.approx([1000.0])
    assert assembler.counts == Counts(rows=1)


def test_the_slow_frame_gives_the_temperatures_of_the_blocks_after_it() -> None:
    assembler = started()
    feed(assembler, 10)
    assembler.frame(3, bytes.fromhex("0a00240960f0"))
    feed(assembler, 20)
    (block,) = assembler.take()
    assert (block.temp_winding, block.temp_magnet) == pytest.approx((23.4, -40.0))
    assert len(block) == 2


def test_consecutive_rows_are_one_block_and_nothing_is_given_twice() -> None:
    assembler = started()
    feed(assembler, 0, 10, 20)
    (block,) = assembler.take()
    assert block.tick.tolist() == [0, 10, 20]
    assert assembler.take() == []
    feed(assembler, 30)
    (block,) = assembler.take()
    assert (block.tick.tolist(), block.lost_before) == ([30], 0)


@pytest.mark.parametrize("number", [0, 1, 2])
def test_a_lost_frame_is_a_gap_and_never_a_repetition(number: int) -> None:
    assembler = started()
    feed(assembler, 0)
    for other in {0, 1, 2} - {number}:
        assembler.frame(other, frame(other, 10))
    feed(assembler, 20, 30)
    first, second = assembler.take()
    assert (first.tick.tolist(), second.tick.tolist()) == ([0], [20, 30])
    assert (first.lost_before, second.lost_before) == (0, 1)
    assert assembler.counts == Counts(rows=3, gaps=1, rows_lost=1)


def test_a_gap_at_a_blocks_edge_is_counted_too() -> None:
    assembler = started()
    feed(assembler, 0)
    assert len(assembler.take()) == 1
    feed(assembler, 50)
    assert [block.lost_before for block in assembler.take()] == [4]
    feed(assembler, 60)
    assert [block.lost_before for block in assembler.take()] == [0]
    assert assembler.counts == Counts(rows=3, gaps=1, rows_lost=4)


def test_repeated_frames_are_counted_and_change_nothing() -> None:
    assembler = started()
    for number in range(3):
        assembler.frame(number, frame(number, 10))
        assembler.frame(number, frame(number, 10))
    (block,) = assembler.take()
    assert len(block) == 1
    assert block.i_d == pytest.approx([2e-3])
    assert assembler.counts == Counts(rows=1, frames_late=3)
    assert assembler.conflicts == 0


def test_a_row_of_which_two_frames_say_otherwise_is_lost_and_the_second_sender_is_seen() -> None:
    assembler = started()
    feed(assembler, 0)
    for number in range(3):
        assembler.frame(number, frame(number, 10))
        assembler.frame(number, frame(number, 10, mark=500 * (number == 1)))
    feed(assembler, 20)
    assembler.frame(2, frame(2, 20, mark=500))  # after its row was whole
    assert ticks_of(assembler.take()) == [0, 20]
    assert assembler.counts == Counts(rows=2, gaps=1, rows_lost=1, frames_late=2, frames_foreign=2)
    assert assembler.conflicts == 2


def test_frames_of_two_sequences_of_ticks_are_told_from_frames_that_are_late() -> None:
    one_of_ten_late, two_senders = started(), started()
    for tick in range(0, 3000, 10):
        feed(one_of_ten_late, tick)
        feed(two_senders, tick)
        if tick >= 1000:
            feed(two_senders, tick - 997)
            if tick % 100 == 0:
                feed(one_of_ten_late, tick - 903)
    assert not one_of_ten_late.two_sequences
    assert two_senders.two_sequences
    assert ticks_of(two_senders.take()) == list(range(0, 3000, 10))


def test_frames_of_a_row_that_is_past_are_counted_and_ignored() -> None:
    assembler = started()
    feed(assembler, 20, 30)
    feed(assembler, 10, 20)
    assert ticks_of(assembler.take()) == [20, 30]
    assert assembler.counts == Counts(rows=2, frames_late=6)


def test_a_row_under_way_before_the_stream_began_is_ignored() -> None:
    assembler = started(tick=1005)
    feed(assembler, 990, 1000)
    assert assembler.take() == []
    feed(assembler, 1010, 1020)
    assert ticks_of(assembler.take()) == [1010, 1020]
    assert assembler.counts == Counts(rows=2)


def test_a_row_that_begins_with_the_stream_counts() -> None:
    assembler = started(tick=1010)
    feed(assembler, 1010, 1020)
    assert ticks_of(assembler.take()) == [1010, 1020]


@pytest.mark.parametrize("tick", [0, 65530, 65536, 3_000_000_007, 2**32 - 5])
def test_the_16_bit_tick_is_completed_from_the_drives_full_one(tick: int) -> None:
    assembler = started(tick=tick)
    feed(assembler, tick + 7, tick + 17)
    assert ticks_of(assembler.take()) == [tick + 7, tick + 17]


def test_the_tick_runs_on_over_many_turns_of_its_16_bits() -> None:
    assembler, periods = started(periods=1000), 1000
    ticks = list(range(0, 20 * 65536, periods))
    for tick in ticks:
        feed(assembler, tick)
    (block,) = assembler.take()
    assert block.tick.tolist() == ticks
    assert assembler.counts == Counts(rows=len(ticks))


def test_a_gap_across_the_turn_of_the_tick_is_measured() -> None:
    assembler = started(tick=65000)
    feed(assembler, 65530, 65530 + 3000)
    first, second = assembler.take()
    assert (first.lost_before, second.lost_before) == (0, 299)
    assert second.tick.tolist() == [68530]


def test_rows_of_another_length_than_told_cannot_be() -> None:
    assembler = started()
    feed(assembler, 0)
    with pytest.raises(FrameError, match="rows come every 10 ticks, but tick 5 came 5 after the one before"):
        feed(assembler, 5)


def test_rows_lost_since_an_earlier_stream_are_told_before_the_first_block() -> None:
    assembler = started(tick=1000, periods=20, after=950)
    feed(assembler, 1010)
    (block,) = assembler.take()
    assert block.lost_before == 3  # 60 ticks
    assert started(tick=1000, after=1000).end == 1000
    assert assembler.end == 1030


def test_a_stream_that_joins_the_one_before_has_lost_nothing() -> None:
    assembler = started(tick=1000, after=1000)
    feed(assembler, 1000)
    assert assembler.take()[0].lost_before == 0
    assert assembler.counts == Counts(rows=1)


@pytest.mark.parametrize(("number", "size"), [(0, 7), (0, 0), (0, 3), (1, 9), (2, 6), (3, 8), (3, 5)])
def test_a_frame_of_another_length_is_passed_over_and_counted(number: int, size: int) -> None:
    assembler = started()
    feed(assembler, 0)
    assembler.frame(number, bytes(size))
    feed(assembler, 10)
    assert ticks_of(assembler.take()) == [0, 10]
    assert assembler.counts == Counts(rows=2, frames_foreign=1)


def test_what_is_never_complete_is_not_kept_for_ever() -> None:
    assembler = started()
    feed(assembler, 0)
    for tick in range(10, 100_000, 10):
        assembler.frame(0, frame(0, tick))
    assert assembler.take()[0].tick.tolist() == [0]
    assert len(assembler._pending) < 65536 / 10


@given(st.data())
def test_exactly_the_rows_whose_frames_all_came_come_out_in_order(data: st.DataObject) -> None:
    periods = data.draw(st.integers(5, 1000))
    n = data.draw(st.integers(1, 30))
    start = data.draw(st.integers(0, 2**32 - 1))
    lost = data.draw(st.sets(st.tuples(st.integers(0, n - 1), st.integers(0, 2)), max_size=3 * n))
    assembler, blocks = started(start, periods), list[Block]()
    for row in range(n):
        for number in data.draw(st.permutations(range(3))):
            if (row, number) not in lost:
                assembler.frame(number, frame(number, start + row * periods, mark=7 * row))
        if data.draw(st.booleans()):
            blocks += assembler.take()
    blocks += assembler.take()
    whole = [row for row in range(n) if not any((row, number) in lost for number in range(3))]
    assert ticks_of(blocks) == [start + row * periods for row in whole]
    assert [round(1e3 * i) - 2 for block in blocks for i in block.i_d] == [7 * row for row in whole]
    counts = assembler.counts
    assert counts.rows == len(whole)
    assert counts.frames_late == 0
    if whole:
        assert counts.rows + counts.rows_lost == whole[-1] - whole[0] + 1
    assert counts.rows_lost == sum(block.lost_before for block in blocks)
    assert counts.gaps == sum(block.lost_before > 0 for block in blocks)
    for block in blocks:
        assert np.all(np.diff(block.tick) == periods)


@given(st.lists(st.integers(0, 60), max_size=60), st.sets(st.integers(0, 60)))
def test_any_cut_into_takes_gives_the_same_rows(rows: list[int], cuts: set[int]) -> None:
    """Rows may come late, twice or not at all."""
    def taken(at: set[int]) -> tuple[dict[str, list[float]], Counts]:
        assembler, blocks = started(), list[Block]()
        for k, row in enumerate(rows):
            feed(assembler, 10 * row)
            if k in at:
                blocks += assembler.take()
        blocks += assembler.take()
        return {name: [float(x) for b in blocks for x in getattr(b, name)] for name in ("tick", *COLUMNS)}, \
            assembler.counts

    assert taken(cuts) == taken(set())


@given(st.lists(st.tuples(st.integers(0, 3), st.binary(max_size=9)), max_size=60))
def test_any_garbage_is_refused_or_gives_rising_ticks(frames: list[tuple[int, bytes]]) -> None:
    assembler = started(periods=5)
    for number, data in frames:
        try:
            assembler.frame(number, data)
        except FrameError:
            continue
    ticks = ticks_of(assembler.take())
    assert ticks == sorted(set(ticks))
