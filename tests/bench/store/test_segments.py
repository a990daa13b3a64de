"""Recordings under way on disk: what is written comes back to the bit, and what a kill or damage leaves is told."""

import contextlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.errors import RecordingError
from bench.recordings.table import check_undamaged, notes
from bench.store import segments as segments_of
from bench.store.closing import closed
from bench.store.rows import COLUMNS, Rows, joined, packed, unpacked
from bench.store.segments import Event, FoundSegments, Heading, Hole, Segments, ids_in, path_of
from bench.store.shelf import Shelf
from tests.support.recordings import read_recording

T_S = 1e-4
HEADING = Heading(
    "spindle-20260131-120000-000", "spindle", "canopen://socketcan/can0/5", "a drive, serial 1", 1,
    "2026-01-31T12:00:00+00:00", "me", "2026-01-31T12:00:00+00:00", {"title": "warm"}, T_S, 10,
    dict.fromkeys(COLUMNS, 1e-3), {}, {}, {"pmsm-bench": "0.1.0"},
)  # fmt: skip


def some(place: int, n: int, seed: int = 1, lost_before: int = 0) -> Rows:
    columns = np.random.default_rng(seed + place).normal(size=(len(COLUMNS), n))
    return Rows(place, place + 7, 10, lost_before, columns, 40.0, np.nan)


def same(one: Rows, other: Rows) -> bool:
    names = ("place", "tick", "periods", "lost_before", "temp_winding", "temp_magnet")
    told = [[repr(getattr(rows, name)) for name in names] for rows in (one, other)]
    return told[0] == told[1] and np.array_equal(one.columns, other.columns)


def found(folder: Path) -> FoundSegments:
    one = FoundSegments.found(folder, HEADING.id)
    assert one is not None
    return one


def test_rows_come_back_to_the_bit() -> None:
    rows = some(1230, 250, lost_before=3)
    assert same(unpacked(packed(rows)), rows)
    with pytest.raises(ValueError, match="expected a head of"):
        unpacked(b"short")


def test_rows_are_joined_where_nothing_is_lost_between_them() -> None:
    rows = some(0, 300)
    parts = [rows.part(slice(0, 100)), rows.part(slice(100, 150)), rows.part(slice(150, 300))]
    (whole,) = joined(parts)
    assert same(whole, rows)
    assert [len(one) for one in joined([parts[0], parts[2]])] == [100, 150]
    assert [len(one) for one in joined([parts[0], replace(parts[1], lost_before=1)])] == [100, 50]


def test_rows_and_events_come_back_in_their_order_from_as_many_segments_as_it_takes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(segments_of, "_SEGMENT", 40_000)
    writing, written = Segments(tmp_path, HEADING), list[Rows | Event]()
    for k in range(10):
        rows, event = some(2000 * k, 200), {"place": 2000 * k, "what": "mark", "text": "ä"}
        writing.rows(rows)
        writing.event(event)
        written += [rows, event]
    assert FoundSegments.found(tmp_path, HEADING.id) is None  # under way
    writing.close()
    assert writing.size == sum(path.stat().st_size for path in tmp_path.iterdir())
    assert len(list(tmp_path.iterdir())) > 2
    assert ids_in(tmp_path) == [HEADING.id]
    with contextlib.closing(found(tmp_path)) as left:
        assert left.heading == HEADING
        for _ in range(2):
            back = list(left.records())
            assert len(back) == len(written)
            for one, other in zip(back, written, strict=True):
                if isinstance(one, Rows):
                    assert isinstance(other, Rows)
                    assert same(one, other)
                else:
                    assert one == other
            assert left.lacking == []


def three(folder: Path) -> Path:
    """Three stretches of rows in one segment; its file."""
    writing = Segments(folder, HEADING)
    for k in range(3):
        writing.rows(some(2000 * k, 200))
    writing.close()
    return path_of(folder, HEADING.id, 1)


@pytest.mark.parametrize("cut", [1, 17, 4000])
def test_what_a_kill_cut_off_is_told_and_the_rest_is_kept(tmp_path: Path, cut: int) -> None:
    path = three(tmp_path)
    path.write_bytes(path.read_bytes()[:-cut])
    with contextlib.closing(found(tmp_path)) as left:
        assert closed(left, "killed") == tmp_path / f"{HEADING.id}.parquet"
    told = notes(tmp_path / f"{HEADING.id}.parquet")
    assert (told["rows"], told["ended"]) == (400, "killed")
    assert told["lacking"][0].startswith("the last ")
    assert read_recording(tmp_path / f"{HEADING.id}.parquet").summary.rows == 400
    assert [path.name for path in tmp_path.iterdir()] == [f"{HEADING.id}.parquet"]


def test_a_segment_that_is_missing_or_damaged_costs_itself_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(segments_of, "_SEGMENT", 20_000)
    writing = Segments(tmp_path, HEADING)
    for k in range(6):
        writing.rows(some(2000 * k, 200))
    writing.close()
    paths = sorted(tmp_path.iterdir())
    assert len(paths) == 6
    paths[1].unlink()
    paths[3].write_bytes(b"\0" * 1000)
    with contextlib.closing(found(tmp_path)) as left:
        places = [one.place for one in left.records() if isinstance(one, Rows)]
        assert places == [0, 4000, 8000, 10_000]
        assert left.lacking == [
            "segments 2 to 2 are not there",
            f"1000 bytes of {paths[3].name} are damaged, and are left out; it is kept as {HEADING.id}.0004.damaged",
        ]
        assert left.holes == [Hole(2000, 4000), Hole(6000, 8000)]
        closed(left)
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"{HEADING.id}.0004.damaged", f"{HEADING.id}.parquet"]
    assert (tmp_path / f"{HEADING.id}.0004.damaged").read_bytes() == b"\0" * 1000
    one = Shelf(tmp_path).one(HEADING.id)
    assert (one.rows, one.gaps, one.rows_lost, one.whole) == (800, 2, 400, False)


@pytest.mark.parametrize("damage", ["beginning", "heading", "length", "checksum", "rows", "stretch", "last"])
def test_rows_after_damage_within_a_segment_are_kept_and_the_hole_is_a_gap(tmp_path: Path, damage: str) -> None:
    writing, ends = Segments(tmp_path, HEADING), list[int]()
    for k in range(6):
        ends.append(writing.size)
        writing.rows(some(2000 * k, 200))
        writing.event({"place": 2000 * (k + 1), "what": "drive", "state": f"state {k}"})
    writing.close()
    (second, third), path = ends[1:3], path_of(tmp_path, HEADING.id, 1)
    content = bytearray(path.read_bytes())
    at = {"beginning": 3, "heading": 60, "length": second + 1, "checksum": second + 5, "rows": second + 400,
          "stretch": second + 30, "last": ends[5] + 300}[damage]  # fmt: skip
    for k in range(at, third + 50 if damage == "stretch" else at + 1):
        content[k] ^= 0x41
    path.write_bytes(content)
    if damage == "heading":
        beside = Segments(tmp_path, replace(HEADING, segment=2))
        beside.close()
    with contextlib.closing(found(tmp_path)) as left:
        recording = closed(left, "killed")
    assert recording is not None
    missing = {"beginning": [], "heading": [], "stretch": [1, 2], "last": [5]}.get(damage, [1])
    kept = np.concatenate([some(2000 * k, 200).columns for k in range(6) if k not in missing], axis=1)
    runs = read_recording(recording).runs
    np.testing.assert_array_equal(np.concatenate([run.i_q for run in runs]), kept[COLUMNS.index("i_q")])
    one = Shelf(tmp_path).one(HEADING.id)
    assert (one.gaps, one.rows_lost) == (bool(missing), 200 * len(missing))
    assert (one.seconds, one.whole) == (pytest.approx(1.2), False)
    assert one.ended.startswith("killed. ")
    assert one.ended.endswith(f"are damaged, and are left out; it is kept as {HEADING.id}.0001.damaged")
    assert (tmp_path / f"{HEADING.id}.0001.damaged").read_bytes() == content
    said = {checked.name: checked.problem for checked in Shelf(tmp_path).verify()}
    assert set(said) == {f"{HEADING.id}.parquet", f"{HEADING.id}.0001.damaged"}
    assert "a damaged segment" in said[f"{HEADING.id}.0001.damaged"]
    Shelf(tmp_path).delete(HEADING.id)
    assert list(tmp_path.iterdir()) == []


def test_rows_that_never_came_are_not_counted_again_where_their_record_is_damaged(tmp_path: Path) -> None:
    writing = Segments(tmp_path, HEADING)
    writing.rows(some(0, 200))
    at = writing.size
    writing.rows(some(3000, 200, lost_before=100))
    writing.event({"place": 3000, "what": "gap", "rows": 100})
    writing.rows(some(5000, 200))
    writing.close()
    path = path_of(tmp_path, HEADING.id, 1)
    content = bytearray(path.read_bytes())
    content[at + 400] ^= 1
    path.write_bytes(content)
    with contextlib.closing(found(tmp_path)) as left:
        closed(left)
    one = Shelf(tmp_path).one(HEADING.id)
    assert (one.rows, one.gaps, one.rows_lost) == (400, 2, 300)


def test_a_kill_while_damaged_segments_are_put_aside_loses_none(tmp_path: Path) -> None:
    path = three(tmp_path)
    content = bytearray(path.read_bytes())
    content[4000] ^= 1
    path.write_bytes(content)
    with contextlib.closing(found(tmp_path)) as left:
        closed(left)
    (tmp_path / f"{HEADING.id}.0001.damaged").rename(path)
    with contextlib.closing(found(tmp_path)) as left:
        closed(left)
    assert (tmp_path / f"{HEADING.id}.0001.damaged").read_bytes() == content
    assert not path.exists()


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    path_of(tmp_path, "x", 1).write_bytes(b"not of ours")
    with pytest.raises(RecordingError, match="none of 1 can be read"):
        FoundSegments.found(tmp_path, "x")


def test_closing_makes_a_recording_that_replays_with_its_gaps_and_notes(tmp_path: Path) -> None:
    writing = Segments(tmp_path, HEADING)
    writing.rows(some(0, 500))
    writing.event({"place": 7000, "what": "gap", "rows": 200})
    writing.rows(some(7000, 300, lost_before=200))
    writing.event({"place": 10_000, "what": "ended", "why": "stopped by me", "at": "2026-01-31T12:00:01+00:00"})
    writing.close()
    with contextlib.closing(found(tmp_path)) as left:
        path = closed(left)
    assert path is not None
    check_undamaged(path)
    recording = read_recording(path)
    assert (recording.summary.rows, recording.summary.lost_rows, len(recording.runs)) == (800, 200, 2)
    np.testing.assert_array_equal(recording.runs[1].i_q, some(7000, 300).columns[COLUMNS.index("i_q")])
    assert (recording.summary.T_s, recording.summary.periods) == (T_S, 10)
    told = notes(path)
    assert (told["ended"], told["duration"], told["lacking"]) == ("stopped by me", pytest.approx(1.0), [])
    assert told["events"] == [{"t": pytest.approx(0.7), "what": "gap", "rows": 200}]
    assert told["recording"] == HEADING.id
    assert json.dumps(told)


def test_a_kill_between_the_recording_and_the_end_of_its_segments_does_no_harm(tmp_path: Path) -> None:
    path = three(tmp_path)
    content = path.read_bytes()
    with contextlib.closing(found(tmp_path)) as left:
        recording = closed(left)
    assert recording is not None
    before = recording.read_bytes()
    path.write_bytes(content)
    (tmp_path / f".{recording.stem}.unfinished").write_bytes(before)
    with contextlib.closing(found(tmp_path)) as left:
        assert closed(left) == recording
    assert recording.read_bytes() == before
    assert [one.name for one in tmp_path.iterdir()] == [recording.name]


def test_one_without_a_row_leaves_nothing(tmp_path: Path) -> None:
    Segments(tmp_path, HEADING).close()
    with contextlib.closing(found(tmp_path)) as left:
        assert closed(left) is None
    assert list(tmp_path.iterdir()) == []
