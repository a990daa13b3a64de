"""The last half minute of a drive's rows, thinned when they are asked for."""

import math

import numpy as np
import pytest

from bench.live.recent import SIGNALS, Place, Recent
from drivers.block import Block

T_S = 1e-4  # s
PERIODS = 10


def block(tick: int, *i_q: float, T_s: float = T_S, u_d: float = 1.0) -> Block:
    """Rows of 1 ms from a tick on."""
    n = len(i_q)
    one = np.ones(n)
    return Block(
        tick + PERIODS * np.arange(n), one, 400.0 * one, -one, np.array(i_q), u_d * one, 2.0 * one, -one, np.array(i_q),
        310.0 * one, T_s, PERIODS, 0, 1e-3, 1e-2, 25.0, math.nan,
    )  # fmt: skip


def filled(rows: int, begin: int = 0) -> Recent:
    """Rows whose i_q is their number, in blocks of five."""
    recent = Recent()
    for k in range(0, rows, 5):
        recent.put(block(begin + PERIODS * k, *(float(k + j) for j in range(5))))
    return recent


def test_before_the_first_row_there_is_nothing_to_say() -> None:
    assert Recent().latest() is None
    assert Recent().course() is None


def test_each_bin_has_the_extremes_of_its_rows() -> None:
    course = filled(100).course()
    assert course is not None
    assert course.bin_time == pytest.approx(0.02)
    assert (course.first, course.last) == (Place(0, 0), Place(0, 4))
    assert course.low["i_q"].tolist() == [0.0, 20.0, 40.0, 60.0, 80.0]
    assert course.high["i_q"].tolist() == [19.0, 39.0, 59.0, 79.0, 99.0]
    assert course.t_end == pytest.approx(0.1)
    assert set(course.low) == set(course.high) == set(SIGNALS)


def test_who_asks_again_has_what_came_since_and_the_last_bin_once_more() -> None:
    recent = filled(50)
    first = recent.course()
    assert first is not None
    assert first.last == Place(0, 2)
    assert first.high["i_q"][-1] == 49.0
    recent.put(block(PERIODS * 50, *(50.0 + np.arange(30))))
    more = recent.course(first.last)
    assert more is not None
    assert more.first == first.last
    assert more.high["i_q"].tolist() == [59.0, 79.0]


def test_a_gap_is_a_bin_without_a_value_and_so_is_a_voltage_that_is_none() -> None:
    recent = filled(20)
    recent.put(block(PERIODS * 60, 1.0, u_d=math.nan))
    course = recent.course()
    assert course is not None
    assert np.isfinite(course.low["i_q"]).tolist() == [True, False, False, True]
    assert np.isfinite(course.high["u_d"]).tolist() == [True, False, False, False]


def test_a_drive_whose_clock_begins_anew_begins_another_epoch() -> None:
    recent = filled(100)
    before = recent.course()
    assert before is not None
    recent.put(block(0, 7.0))
    course = recent.course(before.last)
    assert course is not None
    assert course.first == course.last == Place(1, 0)
    assert course.low["i_q"].tolist() == [7.0]


def test_half_a_minute_is_kept_and_no_more() -> None:
    recent = filled(40_000)
    course = recent.course()
    assert course is not None
    assert len(course.low["i_q"]) == pytest.approx(1500, abs=2)
    assert course.last == Place(0, 1999)
    assert course.high["i_q"][-1] == 39_999.0


def test_the_latest_values_are_means_over_a_tenth_of_a_second() -> None:
    latest = filled(1000).latest()
    assert latest is not None
    assert latest.values["i_q"] == pytest.approx(949.5, abs=3.0)
    assert latest.values["omega_e"] == 400.0
    assert latest.temp_winding == 25.0
    assert math.isnan(latest.temp_magnet)


def test_a_row_that_is_longer_than_a_bin_is_one() -> None:
    recent = Recent()
    for k in range(4):
        recent.put(block(PERIODS * k, float(k), T_s=5e-3))
    course = recent.course()
    assert course is not None
    assert course.bin_time == pytest.approx(0.05)
    assert course.low["i_q"].tolist() == [0.0, 1.0, 2.0, 3.0]
