"""The publication's findings on the emulated drive, each as it comes out here; `make paper` shows all the numbers.

On a development seed, but for the bars.
"""

import numpy as np
import pytest

from tests.paper.findings import best_of, by_window, table_1
from tests.paper.published import TABLE_1, per_cent, without_misprint
from tests.paper.runs import RIVALS, SEEDS, Run, fixed, rmse, tracked, warming

pytestmark = pytest.mark.slow

SEED = 1
WINDOWS = (50, 150, 250, 350, 450, 500)


@pytest.fixture(scope="module")
def warm() -> Run:
    """Parameters that move by up to a fifth within the second."""
    return warming(SEED, noise=True)


@pytest.fixture(scope="module")
def windows(warm: Run) -> np.ndarray:
    """Tracking errors in per cent of some of the published windows, (6, 3)."""
    return by_window([warm], WINDOWS)


@pytest.fixture(scope="module")
def rivals(warm: Run) -> dict[str, np.ndarray]:
    """Tracking errors in per cent of the others, (3,) each."""
    return {name: rmse(tracked(make(), warm), warm) for name, make in RIVALS.items()}


def test_the_published_errors_are_those_that_the_publication_states() -> None:
    worst = {method: np.abs(per_cent(values)).max(axis=1) for method, values in TABLE_1.items()}
    assert worst["EKF"] == pytest.approx([1.19, 0.82, 0.019], rel=0.03)
    assert worst["RLS"] == pytest.approx([1.22, 3.18, 3.45], rel=0.01)
    assert worst["WLS"] == pytest.approx([0.11, 1.76, 0.031], rel=0.05)
    assert np.nanmax(np.abs(without_misprint(per_cent(TABLE_1["WLS"])))) == pytest.approx(0.153, abs=1e-3)


@pytest.mark.parametrize(("noise", "bar"), [(False, 0.02), (True, 0.3)])
def test_every_cell_of_the_table_is_within_its_bar(noise: bool, bar: float) -> None:
    assert table_1(SEEDS[:2], noise=noise, methods=["WLS"])["WLS"].worst.max() <= bar


def test_with_fixed_parameters_a_longer_window_is_better() -> None:
    errors = by_window([fixed(23.4, SEED, noise=True)], [100, 200, 500])
    assert np.all(np.diff(errors, axis=0) < 0.0), errors


def test_with_varying_parameters_the_best_window_is_neither_the_shortest_nor_one_that_lags(windows: np.ndarray) -> None:
    best = best_of(WINDOWS, windows)
    assert all(length >= 250 for length in best), best
    assert np.all(windows[0] > 3.0 * windows.min(axis=0))  # too short is noisy
    assert best[0] <= 350  # R_s moves most, so it lags first
    assert windows[-1, 0] > 1.3 * windows[:, 0].min()


def test_without_noise_only_the_lag_is_left_and_a_short_window_is_best() -> None:
    errors = by_window([warming(SEED, noise=False)], [100, 300, 500])
    assert np.all(np.diff(errors, axis=0) > 0.0), errors


def test_windows_in_rows_of_a_millisecond_lag_by_per_cents() -> None:
    errors = by_window([warming(SEED, noise=True)], [500, 3000], m=10)
    assert errors[1, 0] > 2.5
    assert np.all(errors[1] > 2.5 * errors[0])


def test_recursive_least_squares_without_forgetting_does_not_follow(
    windows: np.ndarray, rivals: dict[str, np.ndarray]
) -> None:
    assert rivals["RLS"][0] > 5.0
    assert np.all(rivals["RLS"] > 5.0 * windows.min(axis=0))
    assert np.all(rivals["RLS forgetting"] < 0.2 * rivals["RLS"])


def test_the_published_filter_is_too_noisy_to_follow_anything(rivals: dict[str, np.ndarray]) -> None:
    assert rivals["EKF published"][0] > 2.0
    assert np.all(rivals["EKF published"][1:] > 20.0)


def test_a_filter_follows_as_fast_as_its_tuning_says_and_no_faster(
    windows: np.ndarray, rivals: dict[str, np.ndarray]
) -> None:
    slow, fast = rivals["EKF tuned"], rivals["EKF tuned to 57 K/s"]
    assert slow[0] > 0.4
    assert np.all(fast[1:] < slow[1:])
    assert np.all(fast < 2.0 * windows.min(axis=0))
