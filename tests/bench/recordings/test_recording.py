"""Recordings: what is read, where it is cut, and the sentence for each thing that cannot be read."""

import gzip
import io
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray

from bench.errors import ConfigError, RecordingError
from bench.recordings.recording import Recording, open_recording
from bench.recordings.runs import OF_INSTANTS
from estimator.samples import Samples
from tests.support.real_data import REAL_DATA
from tests.support.recordings import read_recording

pa: Any = pyarrow
pq: Any = pyarrow.parquet

T_S = 1e-4  # s
COLUMNS = ("t", "u_d", "u_q", "i_d", "i_q", "omega_e", "theta_e")
SERVO = REAL_DATA / "servo_standstill" / "current_steps.csv"

Table = dict[str, NDArray[np.float64]]


def table(n: int = 8, **columns: ArrayLike) -> Table:
    """Rows at 1e-4 s whose voltages count the rows: u_d = 0, 1, ... and u_q = 100, 101, ..."""
    k = np.arange(n, dtype=np.float64)
    made = {
        "t": np.round(k * T_S, 9), "u_d": k, "u_q": 100 + k, "i_d": -k, "i_q": 10 - k,
        "omega_e": np.full(n, 50.0), "theta_e": 50.0 * k * T_S,
    }
    return made | {name: np.asarray(column, dtype=np.float64) for name, column in columns.items()}


def without(columns: Table, *names: str) -> Table:
    return {name: column for name, column in columns.items() if name not in names}


def csv_text(columns: Mapping[str, NDArray[np.float64]]) -> str:
    rows = zip(*columns.values(), strict=True)
    lines = [",".join("" if math.isnan(x) else repr(float(x)) for x in row) for row in rows]
    return "\n".join([",".join(columns), *lines]) + "\n"


def parquet_bytes(columns: Mapping[str, Any], **options: Any) -> bytes:
    buffer = io.BytesIO()
    pq.write_table(pa.table(dict(columns)), buffer, **options)
    return buffer.getvalue()


Write = Callable[[str, str | bytes | Table], Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write_file(name: str, content: str | bytes | Table) -> Path:
        path = tmp_path / name
        if isinstance(content, dict):
            content = parquet_bytes(content) if name.endswith(".parquet") else csv_text(content)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write_file


def refusal(path: Path, **options: Any) -> str:
    with pytest.raises(RecordingError) as caught:
        read_recording(path, **options)
    said = str(caught.value)
    assert said.startswith(f"{path}: ")
    assert "\n" not in said
    return said.removeprefix(f"{path}: ")


def only(recording: Recording) -> Samples:
    (run,) = recording.runs
    return run


def columns_of(samples: Samples) -> dict[str, list[float]]:
    names = ("theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q")
    return {name: getattr(samples, name).tolist() for name in names}


# --- formats


def test_the_three_formats_give_the_same_samples(write: Write):
    rows = table(50)
    text = csv_text(rows)
    files = [
        write("a.csv", text), write("a.csv.gz", gzip.compress(text.encode())),
        write("a.parquet", parquet_bytes(rows, row_group_size=7)),
    ]
    first, *others = [read_recording(path) for path in files]
    assert columns_of(only(first)) == {name: rows[name].tolist() for name in COLUMNS if name != "t"}
    for other in others:
        assert columns_of(only(other)) == columns_of(only(first))


def test_a_file_is_what_its_content_says_whatever_its_name(write: Write):
    text = csv_text(table())
    for name, content in {
        "a": text, "b.txt": gzip.compress(text.encode()), "c.csv": parquet_bytes(table()),
    }.items():
        assert len(only(read_recording(write(name, content)))) == 8


def test_line_ends_blanks_and_a_byte_order_mark_do_not_matter(write: Write):
    lines = csv_text(without(table(), "theta_e")).splitlines()
    for content in (
        "\ufeff" + "\r\n".join(lines), "\r".join(lines), "\n\n" + "\n\n".join(lines) + "\n\n",
        "\n".join(line.replace(",", " , ") for line in lines),
    ):
        assert len(only(read_recording(write("a.csv", content)))) == 8


def test_whole_numbers_and_short_floats_are_numbers(write: Write):
    rows: dict[str, Any] = dict(table())
    rows["i_d"] = rows["i_d"].astype(np.int16)
    rows["i_q"] = rows["i_q"].astype(np.float32)
    assert columns_of(only(read_recording(write("a.parquet", parquet_bytes(rows)))))["i_d"][3] == -3.0


def test_a_long_csv_is_read_across_its_blocks(write: Write):
    n = 60_000
    recording = read_recording(write("a.csv", table(n)))
    assert only(recording).i_d.tolist() == (-np.arange(n, dtype=np.float64)).tolist()


def test_a_row_group_larger_than_memory_should_hold_is_streamed(write: Write):
    n = 1_000_000
    noise = np.random.default_rng(1).normal(size=n)
    rows = table(n, u_d=noise, u_q=noise, i_d=noise, i_q=noise)
    path = write("a.parquet", parquet_bytes(rows, row_group_size=n, use_dictionary=False))
    before = pa.total_allocated_bytes()
    most = read = 0
    with open_recording(path, chunk_rows=10_000) as reader:
        for chunk in reader:
            read += len(chunk.samples)
            most = max(most, pa.total_allocated_bytes() - before)
    assert read == n
    assert most < 16e6 < 7 * 8 * n


# --- sources


def test_columns_called_otherwise_are_mapped_and_constants_stand_in(write: Write):
    rows = table()
    path = write("a.csv", {"t": rows["t"], "vqd": rows["u_q"], "Iq": rows["i_q"], "more": rows["i_d"]})
    recording = read_recording(
        path, mapping={"u_q": "vqd", "i_q": "Iq"}, constants={"omega_e": 0, "i_d": 0, "u_d": 0}
    )
    assert only(recording).u_q.tolist() == rows["u_q"].tolist()
    assert only(recording).i_d.tolist() == [0.0] * 8
    assert recording.summary.sources == {
        "t": "column t", "u_q": "column vqd", "i_q": "column Iq", "u_d": "constant 0", "i_d": "constant 0",
        "omega_e": "constant 0", "theta_e": "integrated from omega_e",
    }
    assert recording.summary.unused == ("more",)


def test_a_constant_wins_over_a_column_and_the_summary_says_so(write: Write):
    recording = read_recording(write("a.csv", table()), constants={"i_d": 2.5})
    assert only(recording).i_d.tolist() == [2.5] * 8
    assert recording.summary.sources["i_d"] == "constant 2.5, in place of the column"
    assert recording.summary.unused == ("i_d",)


def test_the_dc_link_and_all_three_phase_currents_are_handed_on_where_they_are(write: Write):
    k = np.arange(8, dtype=np.float64)
    rows = np.delete(np.c_[310 + k, k, 2 * k, -3 * k], 3, axis=0).T
    there = dict(zip(("u_dc", "i_a", "i_b", "i_c"), rows, strict=True))
    path = write("a.parquet", {name: np.delete(column, 3) for name, column in table(8).items()} | there)
    for chunk_rows in (2, 100):
        with open_recording(path, align={"u": 1}, chunk_rows=chunk_rows) as reader:
            parts = [chunk.samples for chunk in reader]
        for name, column in there.items():
            handed_on = np.concatenate([getattr(part, name) for part in parts])
            assert handed_on.tolist() == np.delete(column, [0, 3]).tolist()  # no row of it has moved
    second = read_recording(path, align={"u": 1}).runs[1]
    assert second.u_dc is not None
    assert second[1:].u_dc is not None
    assert (second.u_dc.tolist(), second[1:].i_c) == ([315, 316, 317], pytest.approx([-18, -21]))
    del there["i_b"]
    lacking = only(read_recording(write("b.csv", table(7) | there)))
    assert lacking.u_dc is not None
    assert (lacking.i_a, lacking.i_b, lacking.i_c) == (None, None, None)
    with open_recording(path, optional=False) as reader:
        assert {chunk.samples.u_dc is None for chunk in reader} == {True}
        assert reader.summary.unused == ("u_dc", "i_a", "i_b", "i_c")


def test_a_nominal_dc_link_stands_in_for_a_missing_or_an_empty_column_only(write: Write):
    for name, rows in (("a.csv", table()), ("b.csv", table(u_dc=[math.nan] * 8))):
        recording = read_recording(write(name, rows), u_dc=310.0)
        assert only(recording).u_dc == pytest.approx([310.0] * 8)
        assert recording.summary.sources["u_dc"] == "constant 310, the machine file's"
    path = write("c.csv", table(u_dc=[300.0] * 8))
    assert only(read_recording(path, u_dc=310.0)).u_dc == pytest.approx([300.0] * 8)
    assert only(read_recording(path, u_dc=310.0, constants={"u_dc": 5})).u_dc == pytest.approx([5.0] * 8)


def test_a_row_without_a_dc_link_voltage_is_left_out_where_others_have_one(write: Write):
    rows = table(20, u_dc=[math.nan if k == 9 else 300.0 for k in range(20)])
    recording = read_recording(write("a.csv", rows))
    assert ([len(run) for run in recording.runs], recording.summary.missing) == ([9, 10], {"u_dc": 1})


def test_a_phase_current_without_a_value_is_none(write: Write):
    rows = table(i_a=[1.0] * 8, i_b=[math.nan] * 8, i_c=[1.0] * 8)
    recording = read_recording(write("a.csv", rows))
    assert only(recording).i_a is None
    assert recording.summary.unused == ("i_a", "i_b", "i_c")


def test_missing_columns_are_named_and_the_present_listed(write: Write):
    said = refusal(write("a.csv", "t,vqd,Iq\n0,1,2\n"))
    assert "missing columns: u_d, u_q, i_d, i_q, omega_e;" in said
    assert "present: t, vqd, Iq;" in said


def test_a_mapped_column_that_is_not_there_is_named_and_the_present_listed(write: Write):
    said = refusal(write("a.csv", table()), mapping={"u_q": "vq"})
    assert said == "no column 'vq' for u_q; present: t, u_d, u_q, i_d, i_q, omega_e, theta_e"


def test_a_column_there_twice_is_refused(write: Write):
    text = csv_text(table())
    assert "expected one column 'u_d', found 2" in refusal(write("a.csv", text.replace("theta_e", "u_d")))


def test_columns_not_needed_may_repeat_and_hold_anything(write: Write):
    lines = csv_text(table()).splitlines()
    path = write("a.csv", "\n".join([lines[0] + ",note,note", *(line + ",x,\xe4" for line in lines[1:])]))
    assert len(only(read_recording(path))) == 8


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"mapping": {"uq": "vqd"}}, "no quantity 'uq' in a recording, expected one of t, u_d, u_q"),
        ({"constants": {"vq": 0.0}}, "no quantity 'vq'"),
        ({"constants": {"t": 0.0}}, "t cannot be a constant"),
        ({"constants": {"i_d": math.nan}}, "constant i_d = nan: expected a finite number"),
        ({"constants": {"i_d": 0.0}, "mapping": {"i_d": "x"}}, "i_d is given twice: column 'x' and constant 0"),
        ({"T_s": 0.0}, "T_s = 0.0 s: expected a finite number above zero"),
        ({"T_s": math.nan}, "T_s = nan s"),
        ({"align": {"i": 1}}, "cannot align 'i', expected u"),
        ({"align": {"u": math.inf}}, "align u = inf rows: expected -1000 to 1000"),
        ({"constants": {"periods": 0.5}}, "periods = 0.5: expected a whole number"),
    ],
)
def test_an_option_that_cannot_be_is_refused_before_the_file_is_read(options: dict[str, Any], said: str):
    with pytest.raises(ConfigError) as caught:
        read_recording("no such file", **options)
    assert said in str(caught.value)


# --- angle and time base


def test_a_missing_angle_is_the_integral_of_speed(write: Write):
    n = 2000
    omega_e = 300 + 100 * np.sin(np.arange(n) / 100)
    path = write("a.csv", without(table(n, omega_e=omega_e), "theta_e"))
    samples = only(read_recording(path))
    t = np.arange(n) * T_S
    truth = 300 * t + 1 - np.cos(t * 100)
    most = T_S**2 / 12 * 2 * (100 * 100)  # the trapezoidal rule's error: step^2 / 12 by the change of slope
    assert np.max(np.abs(samples.theta_e - truth)) < 1.01 * most
    assert samples.theta_e[0] == 0.0


def test_the_integral_of_speed_goes_on_across_a_gap(write: Write):
    rows = {name: np.delete(column, slice(40, 60)) for name, column in table(100).items()}
    first, second = read_recording(write("a.csv", without(rows, "theta_e"))).runs
    assert second.theta_e[0] - first.theta_e[-1] == pytest.approx(21 * T_S * 50.0)


def test_the_sampling_period_is_told_by_the_times_even_where_they_are_rounded(write: Write):
    t = np.round(np.arange(1001) * 62.5e-6, 6)
    recording = read_recording(write("a.csv", table(1001, t=t)))
    assert recording.summary.T_s == pytest.approx(62.5e-6, rel=1e-6)
    assert recording.summary.duration == pytest.approx(1001 * 62.5e-6)


def test_a_given_control_period_that_agrees_is_used(write: Write):
    recording = read_recording(write("a.csv", table()), T_s=1.005e-4)
    assert recording.summary.T_s == only(recording).T_s == 1.005e-4


def test_a_control_period_that_disagrees_is_refused_naming_both(write: Write):
    said = refusal(write("a.csv", table()), T_s=1.02e-4)
    assert said == "expected T_s = 0.000102 s, the times say 0.0001 s"
    assert f"i_q_mean and periods = 10; {OF_INSTANTS}" in refusal(write("a.csv", table()), T_s=1e-5)


def test_what_times_look_like_that_disagree_is_told(write: Write):
    for t, said in (
        (np.arange(8) * 0.1, "the times say 0.1 s: is t in ms? expected s"),
        (np.arange(8.0), "the times say 1 s: is t a row number? expected s"),
        (np.arange(8) * 1e-3, "is it one row in 10? A diagnosis needs every control period; pmsm-bench replay takes"),
    ):
        assert said in refusal(write("a.csv", table(t=t)), T_s=1e-4)
    assert "is t a row number or in ms? expected s" in refusal(write("a.csv", table(t=np.arange(8.0))), T_s=1e-3)
    assert "is t a row number or in us? expected s" in refusal(write("a.csv", table(t=np.arange(8.0))), T_s=1e-6)


def test_times_in_another_unit_are_told_by_their_size(write: Write):
    assert "t steps by 100 s" in refusal(write("a.csv", table(t=np.arange(8) * 100.0)))


def test_a_time_that_repeats_or_runs_backwards_names_rows_and_times(write: Write):
    t = np.arange(8) * T_S
    t[4] = t[3]
    said = refusal(write("a.csv", table(t=t)))
    assert said == "row 5: time repeats: expected more than 0.0003 s (row 4), came 0.0003 s"
    t[4] = 0.00005
    assert "row 5: time runs backwards: expected more than 0.0003 s (row 4), came 5e-05 s" in refusal(
        write("a.csv", table(t=t))
    )


def test_a_time_that_runs_backwards_is_found_wherever_it_is(write: Write):
    t = np.arange(30_000) * T_S
    t[20_000] = 0.5
    path = write("a.parquet", table(30_000, t=t))
    said = "row 20001: time runs backwards: expected more than 1.9999 s (row 20000), came 0.5 s"
    assert refusal(path) == said
    with pytest.raises(RecordingError, match="row 20001"), open_recording(path, chunk_rows=20_000) as reader:
        list(reader)


def test_times_without_a_common_step_are_refused(write: Write):
    t = np.cumsum(np.random.default_rng(2).uniform(0.5e-4, 1.5e-4, 200))
    assert "expected evenly sampled rows" in refusal(write("a.csv", table(200, t=t)))


def test_jitter_of_the_times_is_borne(write: Write):
    t = np.arange(500) * T_S + np.random.default_rng(3).uniform(-0.09, 0.09, 500) * T_S
    assert len(only(read_recording(write("a.csv", table(500, t=t))))) == 500


def test_a_sampling_period_that_changes_on_the_way_is_refused(write: Write):
    t = np.cumsum(np.r_[np.full(11_000, 1e-4), np.full(11_000, 1.1e-4)])
    assert "rows 1 to 22000 are 0.000105 s apart on average, expected 0.0001 s" in refusal(
        write("a.csv", table(22_000, t=t))
    )


# --- gaps and cells without a value


def test_lost_rows_end_a_run_and_are_counted(write: Write):
    rows = {name: np.delete(column, [10, 11, 12, 30]) for name, column in table(50).items()}
    recording = read_recording(write("a.csv", rows))
    assert [len(run) for run in recording.runs] == [10, 17, 19]
    assert [run.t0 for run in recording.runs] == pytest.approx([0.0, 13e-4, 31e-4])
    assert (recording.summary.lost_rows, recording.summary.runs) == (4, 3)
    assert recording.summary.duration == pytest.approx(50 * T_S)
    assert recording.summary.remarks() == ("rows lost, by the times: 4", "runs without a gap: 3")


def test_a_step_that_is_no_multiple_of_the_period_ends_a_run_and_is_counted(write: Write):
    t = np.arange(50) * T_S
    t[20:] += 0.5 * T_S
    recording = read_recording(write("a.csv", table(50, t=t)))
    assert [len(run) for run in recording.runs] == [20, 30]
    assert recording.summary.irregular_steps == 1


@pytest.mark.parametrize("cell", ["", "nan", " NaN ", "inf", "-inf", "null", "1e300"])
def test_a_row_with_a_cell_without_value_is_left_out_and_ends_a_run(write: Write, cell: str):
    lines = csv_text(table(20)).splitlines()
    cells = lines[6].split(",")
    lines[6] = ",".join([*cells[:4], cell, *cells[5:]])
    recording = read_recording(write("a.csv", "\n".join(lines)))
    assert [run.u_d.tolist() for run in recording.runs] == [list(range(5)), list(range(6, 20))]
    assert recording.summary.left_out == 1
    assert recording.summary.missing == {"i_q": 1}
    assert recording.summary.lost_rows == 0
    assert "rows left out for want of a value: 1 of 20 (i_q in 1)" in recording.summary.remarks()


def test_a_row_without_time_is_left_out_and_not_lost(write: Write):
    for name in ("a.csv", "a.parquet"):
        t = np.arange(20) * T_S
        t[[5, 6]] = math.nan
        recording = read_recording(write(name, table(20, t=t)))
        assert [len(run) for run in recording.runs] == [5, 13]
        assert recording.summary.missing == {"t": 2}
        assert (recording.summary.left_out, recording.summary.lost_rows) == (2, 0)


def test_missing_cells_in_columns_not_read_do_not_matter(write: Write):
    path = write("a.csv", table(u_dc=[math.nan] * 8))
    assert len(only(read_recording(path))) == 8


def test_a_recording_without_two_consecutive_usable_rows_is_refused(write: Write):
    said = refusal(write("a.csv", table(u_q=[math.nan] * 8)))
    assert said == "expected at least 2 consecutive usable rows, found none in 8 rows (no value: u_q in 8)"


# --- alignment


def test_align_one_applies_the_voltage_of_a_row_in_the_next(write: Write):
    recording = read_recording(write("a.csv", table()), align={"u": 1})
    samples = only(recording)
    assert samples.i_d.tolist() == [-1, -2, -3, -4, -5, -6, -7]
    assert samples.u_d.tolist() == [0, 1, 2, 3, 4, 5, 6]
    assert samples.u_q.tolist() == [100, 101, 102, 103, 104, 105, 106]
    assert samples.t0 == T_S
    assert recording.summary.unaligned == 1


def test_align_minus_two_applies_the_voltage_of_a_row_two_rows_before(write: Write):
    samples = only(read_recording(write("a.csv", table()), align={"u": -2}))
    assert samples.i_d.tolist() == [0, -1, -2, -3, -4, -5]
    assert samples.u_d.tolist() == [2, 3, 4, 5, 6, 7]


def test_align_by_a_fraction_weighs_two_rows_by_the_time_each_was_applied(write: Write):
    path = write("a.csv", table())
    assert only(read_recording(path, align={"u": 0.25})).u_d.tolist() == [0.75, 1.75, 2.75, 3.75, 4.75, 5.75, 6.75]
    assert only(read_recording(path, align={"u": -0.25})).u_d.tolist() == [0.25, 1.25, 2.25, 3.25, 4.25, 5.25, 6.25]


def test_alignment_does_not_reach_across_a_gap(write: Write):
    rows = {name: np.delete(column, 4) for name, column in table(10).items()}
    first, second = read_recording(write("a.csv", rows), align={"u": 1}).runs
    assert first.u_d.tolist() == [0, 1, 2]
    assert second.u_d.tolist() == [5, 6, 7, 8]
    assert second.i_d.tolist() == [-6, -7, -8, -9]


# --- rows of several control periods


def test_rows_of_several_periods_carry_their_mean_currents(write: Write):
    rows = table(i_d_mean=np.arange(8), i_q_mean=np.arange(8) + 1.0, periods=[10] * 8)
    samples = only(read_recording(write("a.csv", rows), T_s=1e-5))
    assert (samples.T_s, samples.periods, samples.T) == (1e-5, 10, pytest.approx(1e-4))
    assert samples.i_q_mean is not None
    assert samples.i_q_mean.tolist() == [1, 2, 3, 4, 5, 6, 7, 8]
    same = only(read_recording(write("b.csv", without(rows, "periods")), constants={"periods": 10}))
    assert (same.periods, same.T_s) == (10, pytest.approx(1e-5))


def test_rows_of_several_periods_without_mean_currents_are_refused(write: Write):
    path = write("a.csv", table())
    assert f"missing columns: i_d_mean, i_q_mean; {OF_INSTANTS}" in refusal(path, constants={"periods": 10})
    assert "missing columns: i_q_mean;" in refusal(write("a.csv", table(i_d_mean=np.arange(8))))


def test_a_number_of_periods_that_changes_or_is_none_is_refused(write: Write):
    rows = table(i_d_mean=np.arange(8), i_q_mean=np.arange(8), periods=[10] * 5 + [5] * 3)
    assert "came 10 before, 5 in row 6" in refusal(write("a.csv", rows))
    assert "periods = 2.5: expected a whole number" in refusal(write("a.csv", rows | table(periods=[2.5] * 8)))


# --- files that cannot be


def test_text_in_a_column_of_numbers_names_column_row_and_text(write: Write):
    lines = csv_text(table(20)).splitlines()
    lines[6] = lines[6].replace("105.0", "1O5")
    assert refusal(write("a.csv", "\n".join(lines))) == "column 'u_q', row 6: expected a number, came '1O5'"
    rows: dict[str, Any] = dict(table())
    rows["u_q"] = ["x"] * 8
    assert refusal(write("a.parquet", parquet_bytes(rows))) == "column 'u_q': expected numbers, it holds 'string'"


def test_a_csv_whose_last_line_is_cut_short_loses_this_row_and_says_so(write: Write):
    text = csv_text(table(2000))
    recording = read_recording(write("a.csv", text[: text.rindex(",")]))
    assert (len(only(recording)), recording.summary.rows) == (1999, 1999)
    (said,) = recording.summary.remarks()
    assert said.startswith("the last line is cut short and left out: row 2000: expected 7 cells, came 6: '0.1999")


def test_a_gzip_cut_short_says_after_which_row(write: Write):
    packed = gzip.compress(csv_text(table(100_000)).encode())
    said = refusal(write("a.csv.gz", packed[: len(packed) // 2]))
    assert said.startswith("the gzip file is cut short in the rows after ")
    assert "cut short in its header" in refusal(write("a.csv.gz", packed[:20]))


def test_a_parquet_file_without_its_end_says_so(write: Write):
    whole = parquet_bytes(table(1000))
    for size in (4, 100, len(whole) - 4):
        assert "the Parquet file is cut short" in refusal(write("a.parquet", whole[:size]))


def test_a_parquet_file_damaged_inside_is_refused(write: Write):
    whole = bytearray(parquet_bytes(table(1000), write_page_checksum=True))
    whole[2000] ^= 0xFF
    assert refusal(write("a.parquet", bytes(whole))).startswith("damaged in the rows after 0: ")


def test_an_empty_file_and_one_without_rows_are_refused(write: Write):
    header = ",".join(COLUMNS)
    for name in ("a.csv", "a.parquet"):
        assert "empty" in refusal(write(name, b""))
    assert "empty" in refusal(write("a.csv", "\n\n"))
    for text in (header, header + "\n", header + "\n\n\n"):
        assert refusal(write("a.csv", text)) == "expected at least 2 rows, came 0"
    assert refusal(write("a.csv", table(1))) == "expected at least 2 rows, came 1"
    assert refusal(write("a.parquet", table(0))) == "expected at least 2 rows, came 0"


def test_a_path_that_is_no_file_says_why(tmp_path: Path):
    assert refusal(tmp_path / "none.csv") == "cannot be read: No such file or directory"
    assert refusal(tmp_path) == "cannot be read: Is a directory"


def test_binary_data_is_not_taken_for_text(write: Write):
    assert "came binary data" in refusal(write("a.csv", csv_text(table()).encode("utf-16-le")))
    assert "expected a Parquet file, begins with b't,u_'" in refusal(write("a.parquet", csv_text(table()).encode()))


# --- properties


@st.composite
def damaged(draw: st.DrawFn) -> Table:
    """Rows with lost ones, cells without value and a pause."""
    n = draw(st.integers(5, 60))
    rows = table(n, omega_e=draw(st.lists(st.floats(-1e3, 1e3), min_size=n, max_size=n)))
    for place in draw(st.lists(st.integers(0, n - 1), max_size=4)):
        name = draw(st.sampled_from(["t", "u_q", "i_d", "omega_e"]))
        rows[name][place] = math.nan
    rows["t"][draw(st.integers(0, n)):] += draw(st.sampled_from([0.0, 0.4 * T_S, 7 * T_S]))
    lost = draw(st.lists(st.integers(0, n - 1), max_size=4, unique=True))
    return {name: np.delete(column, lost) for name, column in rows.items() if name != "theta_e"}


@given(damaged(), st.integers(1, 70), st.sampled_from([0, 1, 2, -1, 0.4, -1.5]))
@settings(deadline=None)
def test_the_samples_do_not_depend_on_how_the_file_is_divided(
    tmp_path_factory: pytest.TempPathFactory, rows: Table, chunk_rows: int, shift: float
):
    path = tmp_path_factory.getbasetemp() / "divided.parquet"
    path.write_bytes(parquet_bytes(rows))
    try:
        whole = read_recording(path, align={"u": shift})
    except RecordingError:
        assume(False)
        raise
    with open_recording(path, align={"u": shift}, chunk_rows=chunk_rows) as reader:
        chunks = list(reader)
        assert reader.summary == whole.summary
    assert sum(not chunk.joined for chunk in chunks) == len(whole.runs) == whole.summary.runs
    for number, run in enumerate(whole.runs, start=1):
        parts = [chunk.samples for chunk in chunks if chunk.run == number]
        assert parts[0].t0 == run.t0
        for name, column in columns_of(run).items():
            assert np.concatenate([getattr(part, name) for part in parts]).tolist() == column


@given(damaged(), st.sampled_from([0, 1, -2, 0.5]))
@settings(deadline=None)
def test_every_row_of_the_file_is_accounted_for(
    tmp_path_factory: pytest.TempPathFactory, rows: Table, shift: float
):
    path = tmp_path_factory.getbasetemp() / "accounted.csv"
    path.write_text(csv_text(rows))
    try:
        recording = read_recording(path, align={"u": shift})
    except RecordingError:
        assume(False)
        raise
    told = recording.summary
    assert told.rows == len(rows["t"]) == told.used + told.left_out + told.unaligned
    assert told.used == sum(len(run) for run in recording.runs)


HEADER = ",".join(COLUMNS).encode() + b"\n"
WHOLE_PARQUET = parquet_bytes(table(100), compression="none", use_dictionary=False)


@st.composite
def flipped(draw: st.DrawFn) -> bytes:
    """A Parquet file with some bytes changed, perhaps cut."""
    content = bytearray(WHOLE_PARQUET)
    for place in draw(st.lists(st.integers(0, len(content) - 1), min_size=1, max_size=5)):
        content[place] = draw(st.integers(0, 255))
    return bytes(content[: draw(st.integers(len(content) - 50, len(content)))])


@given(
    st.one_of(
        st.binary(max_size=300),
        st.binary(max_size=300).map(lambda tail: HEADER + tail),
        st.binary(max_size=300).map(lambda tail: gzip.compress(HEADER + tail)),
        st.binary(max_size=300).map(lambda tail: gzip.compress(HEADER)[:-8] + tail),
        st.text("0123456789.,-+einaf \n\r\"", max_size=300).map(lambda text: HEADER + text.encode()),
        st.lists(st.lists(st.floats(width=32), min_size=7, max_size=7), max_size=9).map(
            lambda rows: HEADER + "\n".join(",".join(map(repr, row)) for row in rows).encode()
        ),
        flipped(),
    )
)
@example(b"PAR1")
@example(b"\x1f\x8b")
@example(b'"' + HEADER)
@settings(deadline=None, max_examples=300)
def test_any_bytes_are_a_recording_or_a_sentence(tmp_path_factory: pytest.TempPathFactory, content: bytes):
    path = tmp_path_factory.getbasetemp() / "any"
    path.write_bytes(content)
    try:
        assert read_recording(path).summary.used >= 2
    except RecordingError as error:
        assert str(error).startswith(f"{path}: ")


# --- a real recording


@pytest.fixture
def servo() -> Path:
    if not SERVO.is_file():
        pytest.skip(f"the real recordings are not here: {SERVO} is absent")
    return SERVO


def test_the_servos_current_steps_are_read(servo: Path):
    recording = read_recording(
        servo, mapping={"u_q": "vqd", "i_q": "Iq"}, constants={"omega_e": 0, "i_d": 0, "u_d": 0}, T_s=50e-6,
        align={"u": 1},
    )
    samples = only(recording)
    assert len(samples) == 599
    assert (recording.summary.rows, recording.summary.runs, recording.summary.T_s) == (600, 1, 50e-6)
    assert recording.summary.remarks() == ("rows without a voltage after alignment: 1",)
    assert samples.theta_e.tolist() == [0.0] * 599
    assert samples.u_q[0] == -0.16436759
    assert samples.i_q[0] == -1.0039444


def test_a_real_recording_whose_time_starts_anew_in_every_segment_is_refused_naming_the_row(servo: Path):
    constants = {"omega_e": 0.0, "i_d": 0.0, "i_q": 0.0, "u_d": 0.0, "u_q": 0.0}
    said = refusal(servo.with_name("voltage_pulses.csv.gz"), mapping={"t": "t_us"}, constants=constants)
    assert "time runs backwards" in said
    said = refusal(servo.with_name("sine_identification.csv"), mapping={"t": "t_s"}, constants=constants)
    assert "time runs backwards" in said
