"""Pictures show a mismatch, not noise, and stay small."""

import math

import numpy as np
import pytest

from estimator.diagnosis.answer.pictures import traces
from estimator.diagnosis.answer.quality import floor_of_means
from estimator.diagnosis.verdict import Traces
from estimator.twin.model import Model
from tests.estimator.diagnosis.where.test_place import ROWS, T, run

VOLTS = 0.5
SIGMA = 2e-5  # Vs


def drawn_of(rows_: int = 0) -> Traces:
    """A voltage above 4 A of i_q before, noise alone after, with a burst at 3.2 s."""
    rows = ROWS if not rows_ else ROWS[:rows_]
    n = np.random.default_rng(5).normal(size=(2, len(rows) + 1))
    noise = rows.balance(SIGMA * (n[0] + 1j * n[1]))
    burst = 2.0 * (np.abs(rows.t[:-1] - 3.2) < 0.01)
    before = VOLTS * (rows.i[:-1].imag > 4.0) + burst + 0j
    i = rows.i.copy()
    i[:10] = np.nan
    return traces(rows, before + noise, noise, i + 1.0, i)


def test_rms_in_time_is_that_of_the_mismatch_and_not_of_noise() -> None:
    found = drawn_of()
    raw = SIGMA * 2.0 / T  # V of single periods
    assert raw > 0.3
    assert np.nanmax(found.after_V) < 0.25 * raw
    assert np.nanmax(found.before_V) > 1.0
    assert found.t[np.nanargmax(found.before_V)] == pytest.approx(3.2, abs=0.03)
    assert len(found.t) == 300


def test_the_floor_is_what_noise_leaves_of_the_same_means() -> None:
    def floor(periods: int) -> float:
        return floor_of_means(ROWS, Model(ROWS.machine), (SIGMA, SIGMA, 1.0), periods)

    n = np.random.default_rng(7).normal(size=(2, len(ROWS) + 1))
    noise = ROWS.balance(SIGMA * (n[0] + 1j * n[1]))
    found = traces(ROWS, noise, noise, ROWS.i, ROWS.i, floor)
    assert found.periods == 10
    assert found.floor_V is not None
    assert math.sqrt(np.nanmean(found.after_V**2)) == pytest.approx(found.floor_V, rel=0.03)
    assert found.floor_V == pytest.approx(floor(1) / 10.0, rel=0.03)


def test_the_window_is_where_the_mismatch_is_largest() -> None:
    found = drawn_of()
    assert len(found.window_t) == 400
    assert found.window_t[0] < 3.19
    assert found.window_t[-1] > 3.21
    u_d, after = found.window["u_d"]
    middle = np.argmin(np.abs(found.window_t - 3.2))
    assert u_d[middle] == pytest.approx(2.0, abs=0.6)
    assert abs(after[middle]) < 0.4
    measured, without, with_it = found.window_i["i_q"]
    np.testing.assert_array_equal(with_it, measured)
    np.testing.assert_array_equal(found.window_i["i_d"][1], found.window_i["i_d"][0] + 1.0)
    np.testing.assert_array_equal(without, measured)


def test_a_spectrum_is_a_density_of_amplitude() -> None:
    f = 40.0 * 10.0 / 1.024
    n = len(ROWS)
    line = 0.3 * np.exp(2j * np.pi * f * T * np.arange(n))
    white = np.random.default_rng(1).normal(size=n).astype(np.complex128)
    found = traces(ROWS, line.astype(np.complex128), white, ROWS.i, ROWS.i)
    before, after = found.spectrum
    assert found.frequency[np.argmax(before)] == pytest.approx(f, abs=1.0)
    df = found.frequency[1]
    assert math.sqrt(np.sum(before**2) * df) == pytest.approx(0.3, rel=0.02)
    assert np.median(after) == pytest.approx(math.sqrt(2.0 * T), rel=0.05)


def test_maps_show_where_it_is() -> None:
    found = drawn_of()
    by_name = {(m.x, m.y): m for m in found.maps}
    m = by_name["i_d (A)", "i_q (A)"]
    centre = 0.5 * (m.y_edges[:-1] + m.y_edges[1:])
    above, below = m.before_V[centre > 4.3], m.before_V[(centre < 3.7) & (centre > -3.0)]
    assert np.nanmedian(above) == pytest.approx(VOLTS, rel=0.15)
    assert np.nanmedian(below) < 0.3 * VOLTS
    assert np.nanmedian(m.after_V) < 0.3 * VOLTS
    assert ("speed (rpm)", "i_q (A)") in by_name
    assert ("electrical angle (deg)", "smallest phase current (A)") in by_name


def test_arrays_stay_small_and_short_runs_have_pictures_too() -> None:
    found = drawn_of()
    arrays = [found.t, found.before_V, found.after_V, found.window_t, found.frequency, *found.spectrum]
    arrays += [a for m in found.maps for a in (m.before_V, m.after_V)]
    assert sum(a.size for a in arrays) < 10_000
    short = run(0.02)
    r = np.ones(len(short), np.complex128)
    found = traces(short, r, 0.0 * r, short.i, short.i)
    assert len(found.window_t) == len(short)
    assert np.nanmax(np.abs(found.before_V - 1.0)) < 0.1
