"""The smoothest course through counts: how near it comes to the true one, and what it says of how far it may be off."""

import math
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.diagnosis.angle.smoothest_course import smoothest, surer, surest

Real = NDArray[np.float64]

COUNT = 0.01
ROUNDING = COUNT / math.sqrt(12.0)
N = 20_000
T: Real = np.arange(N, dtype=np.float64)


def counted(theta: Real) -> Real:
    """Middles of the counts."""
    return COUNT * (np.floor(theta / COUNT) + 0.5)


def turning(by: float) -> Real:
    """An angle that turns by so many counts in a period, and by a share more and less over some thousand periods."""
    return COUNT * (by * T + 300.0 * by * np.sin(T / 3000.0))


@pytest.mark.parametrize("by", [0.2, 0.9, 6.3, 40.0])
def test_little_is_left_of_rounding_and_as_much_is_told(by: float) -> None:
    """A mean over as many periods leaves 0.08 to 0.1 of it."""
    theta = turning(by)
    found = smoothest(counted(theta), 0.5 * COUNT, [0, N])
    off, told = float(np.std(found.course - theta)), math.sqrt(float(np.mean(found.variance)))
    print(f"{by:g} counts a period: {off / ROUNDING:.3f} of the rounding is left, told {told / ROUNDING:.3f}")
    assert off < 0.06 * ROUNDING
    assert 0.5 * off < told < 3.0 * off


def test_ends_of_a_run_are_as_good_as_its_middle() -> None:
    theta = turning(6.3)
    off = smoothest(counted(theta), 0.5 * COUNT, [0, N]).course - theta
    assert np.std(np.r_[off[:100], off[-100:]] - np.mean(off)) < 0.1 * ROUNDING


def test_a_speed_that_changes_at_once_bends_the_course_there_alone() -> None:
    theta = turning(3.3) + 4.0 * COUNT * np.maximum(T - 10_000.0, 0.0)
    found = smoothest(counted(theta), 0.5 * COUNT, [0, N])
    off, near = found.course - theta, np.abs(T - 10_000.0) < 400.0
    assert np.count_nonzero(np.abs(off) > COUNT) < 12
    assert np.std(off[~near]) < 0.1 * ROUNDING
    assert np.min(found.span[near]) < np.min(found.span[~near])


@pytest.mark.parametrize(("uneven", "noise"), [(0.05, 0.0), (0.1, 0.0), (0.2, 0.0), (0.0, 0.1)])
def test_edges_that_are_not_all_in_place_are_given_room(uneven: float, noise: float) -> None:
    """Counts as an encoder of uneven lines gives them, or one whose edges jitter."""
    chance, theta = np.random.default_rng(1), turning(6.3)
    seen = theta + noise * COUNT * chance.standard_normal(N)
    first, last = int(np.min(seen) / COUNT) - 2, int(np.max(seen) / COUNT) + 3
    edges = COUNT * (np.arange(first, last) + uneven * chance.uniform(-1.0, 1.0, last - first))
    counts = cast(Real, COUNT * (np.searchsorted(edges, seen, "right") + (first - 0.5)))
    strict = smoothest(counts, 0.5 * COUNT, [0, N])
    found = surer(counts, strict)
    off = float(np.std(found.course - theta))
    print(f"edges {uneven:g}, noise {noise:g} of a count: {off / ROUNDING:.3f} of the rounding is left")
    assert off < 0.12 * ROUNDING
    assert off < 0.6 * float(np.std(strict.course - theta))
    assert 0.5 * off < found.off < 4.0 * off


def test_it_is_the_smoothest_that_edges_and_middles_of_counts_hold() -> None:
    """As one equation of all periods says: the search ends with neighbourhoods of a few counts."""
    n = 3000
    counts = counted(turning(3.3) + 10.0 * COUNT * np.sin(np.maximum(T - 1500.0, 0.0) / 40.0) ** 3)[:n]
    found = smoothest(counts, 0.5 * COUNT, [0, n])
    off, stiff = found.course - counts, np.min(np.lib.stride_tricks.sliding_window_view(found.span, 4), axis=1) ** 6
    third = cast(Real, np.diff(np.eye(n), 3, axis=0))
    held = found.weight * np.where(found.pull != 0.0, found.pull, -off) - third.T @ (stiff * (third @ found.course))
    step = cast(Real, np.linalg.solve(np.diag(found.weight) + third.T @ (stiff[:, None] * third), held))
    assert np.min(found.span) < np.max(found.span)
    assert np.max(np.abs(step)) < 0.02 * COUNT
    assert np.std(step) < 1e-3 * COUNT


@pytest.mark.parametrize("good", [0, 1])
def test_blocks_of_a_long_recording_say_which_counts_hold_a_course(good: int) -> None:
    longer = np.arange(150_000.0)
    theta = COUNT * (3.3 * longer + 2000.0 * np.sin(longer / 3000.0))
    swings = COUNT * np.sin(longer / 4.0)
    tried = [(counted(theta + swings) - by * swings, 0.5 * COUNT) for by in ((1.0, 0.0) if good == 0 else (0.0, 1.0))]
    which, course = surest(tried, [0, 60_000, len(longer)])
    assert which == good
    assert np.array_equal(course.course, smoothest(*tried[good], [0, 60_000, len(longer)]).course)


def test_an_oscillation_that_no_course_follows_stays_in_the_counts() -> None:
    theta = turning(3.3) + 3.0 * COUNT * np.cos(2.0 * math.pi * T / 6.0)
    found = smoothest(counted(theta), 0.5 * COUNT, [0, N])
    assert np.std(found.course - theta) < 1.1 * ROUNDING
    assert found.off > 0.9 * ROUNDING


def test_runs_are_on_their_own() -> None:
    theta = np.concatenate((turning(3.3)[:8000], 5.0 - turning(0.7)[:12_000]))
    both = smoothest(counted(theta), 0.5 * COUNT, [0, 8000, N])
    for run in (slice(0, 8000), slice(8000, N)):
        alone = smoothest(counted(theta[run]), 0.5 * COUNT, [0, len(theta[run])])
        assert np.array_equal(both.course[run], alone.course)
        assert np.array_equal(both.lost(np.sin(T))[run], alone.lost(np.sin(T[run])))


@pytest.mark.parametrize("by", [0.0, 5.0])
def test_whole_counts_in_each_period_say_nothing_within_one(by: float) -> None:
    theta = COUNT * (by * T + 0.1)
    found = smoothest(counted(theta), 0.5 * COUNT, [0, N])
    assert np.sqrt(found.variance) == pytest.approx(ROUNDING, rel=1e-6)
    assert np.max(np.abs(found.course - theta)) < 0.5 * COUNT


def test_what_is_too_short_stays_as_it_is() -> None:
    counts = counted(turning(3.3)[:12])
    found = smoothest(counts, 0.5 * COUNT, [0, 5, 12])
    assert np.array_equal(found.course, counts)
    assert np.sqrt(found.variance) == pytest.approx(ROUNDING)


def test_movement_that_shows_is_followed_and_the_rest_lost() -> None:
    """As the edges hold the course that it has."""
    theta = turning(6.3)
    found = smoothest(counted(theta), 0.5 * COUNT, [0, N])
    slow, fast = np.sin(T / 2000.0), np.sin(T / 5.0)
    assert np.std(found.lost(slow)) < 0.01
    assert np.std(found.lost(fast)) > 0.95 * np.std(fast)
