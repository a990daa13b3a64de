"""A drive's clock beside ours: how old a row is, whatever its line and both clocks do."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.live.drive_clock import DriveClock

T_S = 1e-4


def test_a_row_that_comes_later_than_others_is_old() -> None:
    clock = DriveClock(T_S, 1000, 50.0)
    assert clock.came(2000, 50.1) == pytest.approx(50.1)
    assert clock.came(3000, 50.7) == pytest.approx(50.2)
    assert clock.came(4000, 50.301) == pytest.approx(50.3)


def test_the_quickest_of_all_rows_tells_when_the_others_were() -> None:
    clock = DriveClock(T_S, 1000, 50.0)  # itself late
    assert clock.came(2000, 50.02) == pytest.approx(50.02)
    assert clock.came(3000, 50.5) == pytest.approx(50.12)


def test_a_tick_that_is_told_shows_that_all_rows_are_late() -> None:
    clock = DriveClock(T_S, 1000, 50.0)
    assert clock.told(81_000, 50.0, 50.01) == pytest.approx(42.01)
    assert clock.came(2000, 50.1) == pytest.approx(42.11)


def test_a_tick_that_is_told_shows_that_the_drives_clock_has_lost_time() -> None:
    clock = DriveClock(T_S, 1000, 50.0)
    clock.came(2000, 53.1)  # the drive was held up for 3 s, and so was its clock
    assert clock.told(2010, 53.1, 53.11) == pytest.approx(53.099)


@given(st.integers(0, 2**32 - 1), st.lists(st.tuples(st.integers(1, 30_000), st.floats(0.0, 5.0)), min_size=1))
def test_no_row_is_younger_than_by_the_quickest_one_over_any_turn_of_32_bits(
    start: int, rows: list[tuple[int, float]]
) -> None:
    clock, tick, quickest = DriveClock(T_S, start, 10.0), 0, 0.0
    for periods, latency in rows:
        tick += periods
        came = 10.0 + tick * T_S + latency
        quickest = min(quickest, latency)
        made = clock.came((start + tick) % 2**32, came)
        assert came - made == pytest.approx(latency - quickest, abs=1e-6)
