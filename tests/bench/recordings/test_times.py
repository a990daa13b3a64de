"""Times that are not what they should be: none, too coarse for the rows, or of a counter that wraps; gaps in them."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest
from numpy.typing import ArrayLike, NDArray

from bench.errors import ConfigError, RecordingError
from bench.recordings.recording import open_recording
from tests.support.recordings import read_recording
from tests.support.tables import NAMES, ROWS, cells, expect, plain, text

pa: Any = pyarrow
pq: Any = pyarrow.parquet

TABLE = plain()
PLAIN = cells(TABLE)
K = np.arange(ROWS)

Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Write the table with other times, in its plain form; `kept`: of these rows only."""

    def write_file(t: Sequence[str], name: str = "t", kept: NDArray[np.int64] = K) -> Path:
        path = tmp_path / "a.csv"
        lines = [[name, *NAMES[1:]]]
        lines += [[t[k], *PLAIN[k + 1][1:]] for k in map(int, kept)]
        path.write_text(text(lines), encoding="utf-8")
        return path

    return write_file


def said(form: str, t: ArrayLike) -> list[str]:
    return [form % x for x in np.asarray(t).tolist()]


# --- none


def test_rows_without_times_are_counted_where_their_duration_is_given(tmp_path: Path):
    path = tmp_path / "a.csv"
    path.write_text(text([line[1:] for line in PLAIN]), encoding="utf-8")
    with pytest.raises(RecordingError, match=r"missing columns: t; .* say how long that is \(--set T_s=1e-4\)"):
        read_recording(path)
    expect(path, TABLE, "t is the row's number times 0.0001 s; rows that are not in", constants={"T_s": 1e-4})
    assert read_recording(path, constants={"T_s": 5e-5}, T_s=1e-4).summary.T_s == 5e-5
    with pytest.raises(ConfigError, match=r"T_s = 0.0 s: expected a finite number above zero"):
        read_recording(path, constants={"T_s": 0.0})


def test_a_line_that_cannot_be_read_ends_a_run_without_times_too(tmp_path: Path):
    lines = [line[1:] for line in PLAIN]
    lines[1000] = ["?"]
    (tmp_path / "a.csv").write_text(text(lines), encoding="utf-8")
    expect(tmp_path / "a.csv", TABLE, "1 of 2000", runs=(slice(0, 999), slice(1000, None)), constants={"T_s": 1e-4})


def test_a_column_of_row_numbers_is_not_needed_and_may_be_used(write: Write):
    path = write(said("%d", K), "n", np.delete(K, [500, 501]))
    halves = (slice(0, 500), slice(502, None))
    told = ("t is column 'n', times 0.0001", "rows lost, by the times: 2")
    expect(path, TABLE, *told, runs=halves, mapping={"t": "n*1e-4"})
    assert len(read_recording(path, constants={"T_s": 1e-4}).runs) == 1
    with pytest.raises(RecordingError, match=r"is t a row number\? expected s, or .*: --map t=COLUMN\*0.0001"):
        read_recording(path, mapping={"t": "n"}, T_s=1e-4)


def test_rows_of_several_periods_are_counted_by_their_own_duration(tmp_path: Path):
    lines = [[*line[1:], line[3], line[4]] for line in PLAIN]
    lines[0][-2:] = ["i_d_mean", "i_q_mean"]
    (tmp_path / "a.csv").write_text(text(lines), encoding="utf-8")
    summary = read_recording(tmp_path / "a.csv", constants={"T_s": 1e-5, "periods": 10}).summary
    assert (summary.T_s, summary.duration) == (1e-5, pytest.approx(0.2))


# --- too coarse

SINGLE = said("%.9g", (1000.0 + K * 1e-4).astype(np.float32))


def test_times_in_single_precision_are_even_rows(write: Write):
    remark = "times are in single precision, in steps of 6.1e-05 s, too coarse: rows are taken as even, 0.0001 s apart"
    path = write(SINGLE)
    expect(path, TABLE, remark)
    expect(path, TABLE, remark, T_s=1e-4)
    assert read_recording(path).summary.T_s == 1e-4
    short = said("%.5f", (1000.0 + K * 1e-4).astype(np.float32))
    expect(write(short), TABLE, remark)


def test_single_precision_may_become_coarser_on_the_way(tmp_path: Path):
    columns = {name: TABLE[:, k] for k, name in enumerate(NAMES)} | {"t": (1023.9 + K * 1e-4).astype(np.float32)}
    pq.write_table(pa.table(columns), tmp_path / "a.parquet")
    expect(tmp_path / "a.parquet", TABLE, "times are in single precision")


@pytest.mark.parametrize(("step", "form"), [
    (50e-6, "%.4f"), (100e-6, "%.3f"), (37.3e-6, "%.5f"), (61.7e-6, "%.4f"), (62.5e-6, "%.4f"),
])  # fmt: skip
def test_rounded_times_are_even_rows_whose_period_they_tell(write: Write, step: float, form: str):
    path = write(said(form, 5.0 + K * step))
    expect(path, TABLE, "too coarse: rows are taken as even")
    assert read_recording(path).summary.T_s == pytest.approx(step, rel=1e-9)
    assert read_recording(path, T_s=step).summary.T_s == step


@pytest.mark.parametrize("lost", [1, 2, 10, 300])
def test_rows_lost_among_times_in_single_precision_are_found(write: Write, lost: int):
    path = write(SINGLE, "t", np.delete(K, np.arange(700, 700 + lost)))
    expect(path, TABLE, f"rows lost, by the times: {lost}", runs=(slice(0, 700), slice(700 + lost, None)))


@pytest.mark.parametrize("lost", [3, 5, 40])
def test_rows_lost_among_rounded_times_are_found_to_within_what_is_told(write: Write, lost: int):
    path = write(said("%.4f", K * 50e-6), "t", np.delete(K, np.arange(701, 701 + lost)))
    recording = read_recording(path)
    assert [len(run) for run in recording.runs] == pytest.approx([701, ROWS - 701 - lost], abs=2)
    assert abs(recording.summary.lost_rows - lost) <= 2
    assert any("a gap of up to 2 rows need not show in such times" in one for one in recording.summary.remarks())


def test_rows_that_repeat_now_and_then_are_not_taken_for_coarse_times(write: Write):
    twice = np.sort(np.r_[K, K[200::100]])
    with pytest.raises(RecordingError, match=r"row 202: time repeats: expected more than 0.02 s"):
        read_recording(write(said("%.4f", K * 1e-4), "t", twice))


def test_uneven_times_are_still_refused(write: Write):
    t = np.cumsum(np.random.default_rng(2).uniform(0.5e-4, 1.5e-4, ROWS))
    with pytest.raises(RecordingError, match="expected evenly sampled rows"):
        read_recording(write(said("%.7f", t)))


def test_an_even_period_that_is_nearly_the_grain_is_told_by_the_user(write: Write):
    path = write(said("%.4f", K * 102.4e-6))  # as if a row in 42 were lost
    expect(path, TABLE, "too coarse: rows are taken as even, 0.0001024 s apart", T_s=102.4e-6)
    assert read_recording(path).summary.lost_rows == 48


@pytest.mark.parametrize("seed", range(20))
def test_even_rows_are_found_however_the_file_is_divided_and_no_gap_is_made_up(tmp_path: Path, seed: int):
    chance = np.random.default_rng(seed)
    grain = (1e-5, 1e-4, 2.0**-14, 1e-3)[seed % 4]
    step, start = chance.uniform(20e-6, 500e-6), chance.uniform(0.0, 5.0)
    kept = np.ones(ROWS, dtype=np.bool_)
    for place in chance.integers(100, 1900, seed % 3):
        kept[place : place + chance.integers(1, 30)] = False
    columns = {name: TABLE[kept, k] for k, name in enumerate(NAMES)}
    columns["t"] = np.array(np.round((start + K[kept] * step) / grain) * grain, dtype=np.float64)
    pq.write_table(pa.table(columns), tmp_path / "a.parquet")
    whole = read_recording(tmp_path / "a.parquet")
    with open_recording(tmp_path / "a.parquet", chunk_rows=int(chance.integers(1, 300))) as reader:
        assert sum(len(chunk.samples) for chunk in reader) == kept.sum()
        assert reader.summary == whole.summary
    if kept.all() and any("too coarse" in remark for remark in whole.summary.remarks()):
        assert (whole.summary.runs, whole.summary.lost_rows) == (1, 0)
        assert whole.summary.T_s == pytest.approx(step, abs=2.0 * grain / ROWS)


# --- a counter that wraps


@pytest.mark.parametrize(("name", "unit", "mapping"), [
    ("t [us]", 1e-6, {}), ("time_us", 1e-6, {"t": "time_us[us]"}), ("tick", 1e-6, {"t": "tick*1e-6"}),
    ("tick", 1e-8, {"t": "tick/1e8"}),
])  # fmt: skip
def test_counts_go_on_where_their_counter_wraps(write: Write, name: str, unit: float, mapping: dict[str, str]):
    counts = (2**32 - 50_000 + np.rint(K * 1e-4 / unit).astype(np.int64)) % 2**32
    path = write(said("%d", counts), name)
    expect(path, TABLE, "times of a 32-bit counter that wraps were made to go on: 1", mapping=mapping)
    signed = write(said("%d", (counts + 2**31) % 2**32 - 2**31), name)
    expect(signed, TABLE, mapping=mapping)


def test_times_in_seconds_may_be_of_a_counter_too(write: Write):
    counts = (2**32 - 50_000 + K * 100) % 2**32
    expect(write(said("%.6f", counts * 1e-6)), TABLE, "times of a 32-bit counter that wraps")


def test_rows_lost_where_a_counter_wraps_are_found(write: Write):
    counts = (2**32 - 50_000 + K * 100) % 2**32
    path = write(said("%d", counts), "t [us]", np.delete(K, np.arange(480, 520)))
    expect(path, TABLE, "rows lost, by the times: 40", runs=(slice(0, 480), slice(520, None)))


def test_times_that_begin_anew_are_still_refused(write: Write):
    with pytest.raises(RecordingError, match="row 1001: time runs backwards"):
        read_recording(write(said("%.4f", (K % 1000) * 1e-4)))
