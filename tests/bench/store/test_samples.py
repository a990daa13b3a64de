"""Samples for plots: thinned with their extremes kept, gaps broken, long recordings by their overview."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.errors import LimitError, RecordingError
from bench.recordings.table import pa, pq
from bench.store import overview, samples
from bench.store.samples import Samples, samples_of
from bench.store.shelf import Shelf
from bench.store.thinning import Bins, gaps_in, thinned

STEP = 1e-3  # s
ROWS = 200_000


def written(path: Path, t: Any, **columns: Any) -> Path:
    """A Parquet whose row groups are short and end nowhere near a bin."""
    pq.write_table(pa.table({"t": t} | columns), path, row_group_size=30_001)
    return path


@pytest.fixture(params=["rows", "overview"])
def long(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Three minutes with two gaps, a spike and cells without a value; short or long by what is read at once."""
    chance = np.random.default_rng(7)
    t = 5.0 + STEP * np.arange(ROWS)
    t[70_000:] += 0.3
    t[120_000:] += 40.0
    i_q = chance.standard_normal(ROWS)
    i_q[99_999], i_q[150_000:150_050] = 50.0, np.nan
    if request.param == "overview":
        monkeypatch.setattr(samples, "_READ", 30_000)
    return written(tmp_path / "long.parquet", t, i_q=i_q, n=np.arange(ROWS), word=["x"] * ROWS)


def exact(path: Path, one: Samples, name: str) -> None:
    """Points are what the file's rows are, in their order, and each row is of one point."""
    table = pq.read_table(path)
    t, x = (table[key].to_numpy() for key in ("t", name))
    inside = (t - t[0] >= one.since) & (t - t[0] <= one.until)
    spread = one.course.signals[name]
    told = ~np.isnan(spread.mean)
    assert np.all(np.diff(one.course.t) > 0.0)
    assert np.all(spread.low[told] <= spread.mean[told])
    assert np.all(spread.mean[told] <= spread.high[told])
    assert np.nanmin(spread.low) <= np.nanmin(x[inside])
    assert np.nanmax(spread.high) >= np.nanmax(x[inside])
    if not one.course.thinned:
        rows = np.isin(one.course.t, t - t[0])
        assert np.array_equal(spread.mean[rows], x[inside], equal_nan=True)


def test_a_whole_recording_is_thinned_with_its_extremes_kept(long: Path) -> None:
    one = samples_of(long, ["i_q", "n"], 0.0, None, 500)
    exact(long, one, "i_q")
    assert (one.since, one.until) == (0.0, pytest.approx(ROWS * STEP - STEP + 40.3))
    assert (one.course.rows, one.course.thinned) == (ROWS, True)
    assert len(one.course.t) <= 500 + 2
    spike = np.nanargmax(one.course.signals["i_q"].high)
    assert one.course.signals["i_q"].high[spike] == 50.0
    assert one.course.t[spike] == pytest.approx(99.999 + 0.3, abs=one.until / 500 + 1.024)
    breaks = one.course.t[np.isnan(one.course.signals["n"].mean)]
    assert breaks == pytest.approx([70.15, 140.3], abs=1.1)  # in the middle of the gaps, but for a point's time
    assert one.units == {"i_q": "A", "n": ""}


@pytest.mark.parametrize(("since", "until"), [(0.0, 2.0), (69.9, 70.5), (99.0, 101.5), (119.0, 165.0), (130.0, 135.0)])
@pytest.mark.parametrize("points", [10, 300])
def test_a_stretch_is_thinned_alone(long: Path, since: float, until: float, points: int) -> None:
    one = samples_of(long, ["i_q", "n"], since, until, points)
    if one.course.rows:
        exact(long, one, "i_q")
    assert len(one.course.t) <= 1.5 * points
    assert np.all((one.course.t > since - 1.1) & (one.course.t < until + 1.1))


def test_no_more_rows_than_points_come_as_they_are(long: Path) -> None:
    one = samples_of(long, ["n"], 69.9, 70.5, 1000)
    assert not one.course.thinned
    exact(long, one, "n")
    assert one.course.t[np.isnan(one.course.signals["n"].mean)] == pytest.approx([70.1495])


def test_an_overview_is_made_anew_where_the_recording_has_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(samples, "_READ", 1000)
    t = STEP * np.arange(100_000)
    path = written(tmp_path / "one.parquet", t, i_q=np.zeros(len(t)), i_d=np.ones(len(t)))
    assert samples_of(path, ["i_q"], 0.0, None, 50).course.signals["i_q"].high.max() == 0.0
    kept = overview.beside(path)
    before = kept.read_bytes()
    assert samples_of(path, ["i_q"], 0.0, None, 50).course.rows == len(t)
    assert kept.read_bytes() == before
    assert samples_of(path, ["i_q", "i_d"], 0.0, None, 50).course.signals["i_d"].low.min() == 1.0  # added to it
    kept.write_bytes(before[:-100])
    assert samples_of(path, ["i_q"], 0.0, None, 50).course.rows == len(t)
    written(path, t, i_q=np.full(len(t), 3.0), i_d=np.ones(len(t)))
    os.utime(path, ns=(1, 1))
    assert samples_of(path, ["i_q"], 0.0, None, 50).course.signals["i_q"].high.max() == 3.0
    Shelf(tmp_path).delete("one")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("asked", "error", "said"), [
    ({"names": ["x"]}, LimitError, r"signals: expected some of i_q, got 'x'"),
    ({"since": 2.0, "until": 1.0}, LimitError, r"until: expected a time after since = 2 s, got 1 s"),
    ({"t": [0.0, 2.0, 1.0]}, RecordingError, r"expected a time in each row, .* after 2 s comes 1 s; .* import"),
    ({"t": [0.0, 1.0, np.nan]}, RecordingError, r"expected a time in each row"),
    ({"t": [np.nan, 1.0, 2.0]}, RecordingError, r"expected a time in each row"),
    ({"t": ["a", "b", "c"]}, RecordingError, r"expected a column t of times in s"),
])  # fmt: skip
def test_what_cannot_be_plotted_is_refused(
    tmp_path: Path, asked: dict[str, Any], error: type[Exception], said: str
) -> None:
    path = written(tmp_path / "one.parquet", asked.get("t", [0.0, 1.0, 2.0]), i_q=[1.0, 2.0, 3.0])
    with pytest.raises(error, match=said):
        samples_of(path, asked.get("names", []), asked.get("since", 0.0), asked.get("until"), 100)


def test_a_stretch_beyond_the_end_is_empty(tmp_path: Path) -> None:
    path = written(tmp_path / "one.parquet", [0.0, 1.0, 2.0], i_q=[1.0, 2.0, 3.0])
    one = samples_of(path, [], 5.0, 6.0, 100)
    assert (one.course.rows, len(one.course.t)) == (0, 0)


@given(st.lists(st.floats(0.1, 10.0), min_size=2, max_size=60), st.integers(1, 40), st.data())
def test_thinned_twice_is_thinned_once(steps: list[float], points: int, data: st.DataObject) -> None:
    """Bins of bins have the extremes of their rows, and as many rows."""
    t = np.cumsum(steps)
    values = data.draw(st.lists(st.floats(-1e6, 1e6) | st.just(np.nan), min_size=len(t), max_size=len(t)))
    rows = Bins.of_rows(t, {"x": np.array(values)})
    starts = np.unique([0, *data.draw(st.lists(st.integers(0, len(t) - 1)))])
    for bins in (rows, rows.wider(starts)):
        course = thinned(bins, gaps_in(t, 1.0), float(t[0]), float(t[-1]), points)
        spread = course.signals["x"]
        assert course.rows == len(t)
        assert np.array_equal(np.nanmin(np.r_[spread.low, 1e9]), np.nanmin(np.r_[values, 1e9]))
        assert np.array_equal(np.nanmax(np.r_[spread.high, -1e9]), np.nanmax(np.r_[values, -1e9]))
        assert np.all(np.diff(course.t) >= 0.0)
