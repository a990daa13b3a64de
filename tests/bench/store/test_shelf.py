"""The shelf: what stands on it, what is said of it, and what is wrong with it."""

import contextlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.errors import RecordingError, UnknownError
from bench.recordings.capture_file import write_columns
from bench.recordings.table import pa, pq
from bench.store.annotations import Annotations, Mark
from bench.store.catalogue.found import Row
from bench.store.closing import closed
from bench.store.segments import FoundSegments, Segments
from bench.store.shelf import Shelf
from tests.bench.store.test_segments import HEADING, some, three


@pytest.fixture
def shelf(tmp_path: Path) -> Shelf:
    """A stream's recording, a capture, and a file that somebody has put there."""
    writing = Segments(tmp_path, HEADING)
    writing.rows(some(0, 1000))
    writing.event({"place": 5000, "what": "mark", "text": "load on", "whom": "me", "at": ""})
    writing.event({"place": 10_000, "what": "ended", "why": "stopped", "at": "2026-01-31T12:00:01+00:00"})
    writing.close()
    left = FoundSegments.found(tmp_path, HEADING.id)
    assert left is not None
    with contextlib.closing(left):
        closed(left)
    write_columns(tmp_path / "a.parquet", {"t": np.array([0.0, 1e-4, 2e-4]), "i_q": np.zeros(3)}, {
        "capture": "a", "drive": "spindle", "asked": "2026-01-31T13:00:00+00:00", "T_s": 1e-4, "complete": False,
        "request": {"length": 4},
    })  # fmt: skip
    pq.write_table(pa.table({"x": [1.0, 2.0]}), tmp_path / "mine.parquet")
    return Shelf(tmp_path)


def test_all_recordings_are_there_the_newest_first(shelf: Shelf) -> None:
    mine, capture, stream = shelf.all()
    assert [one.kind for one in (mine, capture, stream)] == ["file", "capture", "stream"]
    assert (stream.rows, stream.seconds, stream.title, stream.ended) == (1000, pytest.approx(1.0), "warm", "stopped")
    assert [(mark.t, mark.text) for mark in stream.marks] == [(pytest.approx(0.5), "load on")]
    assert stream.whole
    assert not capture.whole
    assert (capture.rows, capture.seconds, capture.drive) == (3, pytest.approx(3e-4), "spindle")
    assert (mine.rows, mine.seconds, mine.columns) == (2, None, ("x",))


def test_a_recording_whose_end_nobody_has_noted_is_not_whole(tmp_path: Path) -> None:
    writing = Segments(tmp_path, HEADING)
    writing.rows(some(0, 1000))
    writing.close()
    left = FoundSegments.found(tmp_path, HEADING.id)
    assert left is not None
    with contextlib.closing(left):
        closed(left, "the power failed")
    (one,) = Shelf(tmp_path).all()
    assert (one.rows, one.whole, one.ended) == (1000, False, "the power failed")


def test_an_experiment_is_as_long_as_from_its_first_row_to_its_last(tmp_path: Path) -> None:
    t = np.array([5.0, 5.0001, 8.0])  # with a break between its levels
    write_columns(tmp_path / "e.parquet", {"t": t, "i_q": np.zeros(3)}, {"experiment": {}, "T_s": 1e-4})
    (one,) = Shelf(tmp_path).all()
    assert (one.kind, one.seconds) == ("experiment", pytest.approx(3.0001))


def test_what_is_said_of_a_recording_stays_beside_it(shelf: Shelf) -> None:
    content = (shelf.folder / f"{HEADING.id}.parquet").read_bytes()
    shelf.annotate(HEADING.id, None, "after lunch")
    shelf.mark(HEADING.id, Mark(0.25, "knocks"))
    one = Shelf(shelf.folder).one(HEADING.id)
    assert (one.title, one.note, [mark.text for mark in one.marks]) == ("warm", "after lunch", ["knocks", "load on"])
    shelf.annotate(HEADING.id, "cold", None)
    assert (shelf.one(HEADING.id).title, shelf.one(HEADING.id).note) == ("cold", "after lunch")
    assert (shelf.folder / f"{HEADING.id}.parquet").read_bytes() == content
    with pytest.raises(RecordingError, match=r"expected a time of 0 to 1 s in .*, got 1\.5 s"):
        shelf.mark(HEADING.id, Mark(1.5, "late"))


def test_a_file_of_annotations_that_makes_no_sense_is_passed_over(shelf: Shelf) -> None:
    (shelf.folder / "mine.about.json").write_text('{"title": 3}')
    assert shelf.one("mine").title == ""
    assert Annotations.read(shelf.folder, "mine") == Annotations()


def test_what_is_deleted_is_gone_with_what_was_said_of_it(shelf: Shelf) -> None:
    shelf.annotate("mine", "x", None)
    shelf.delete("mine")
    assert {path.name for path in shelf.folder.iterdir()} == {"a.parquet", f"{HEADING.id}.parquet"}
    with pytest.raises(UnknownError, match="no recording 'mine'"):
        shelf.one("mine")


def test_what_was_read_once_is_known_to_the_next_as_long_as_the_file_is_the_same(shelf: Shelf) -> None:
    told: list[tuple[list[str], list[str]]] = []
    rows: dict[str, Row] = {}

    def hear(read: list[Row], gone: list[str]) -> None:
        told.append((sorted(row["id"] for row in read), gone))
        rows.update({row["id"]: row for row in read})

    first = Shelf(shelf.folder, hear)
    every = first.all()
    assert first.all() == every
    assert told == [(["a", "mine", HEADING.id], [])]
    again = Shelf(shelf.folder, hear)
    again.recall([*rows.values(), {**rows["a"], "id": "gone"}, {"id": "no row"}])
    again.annotate("mine", "x", None)
    assert [replace(one, title="") for one in again.all()] == [replace(one, title="") for one in every]
    assert again.all()[0].title == "x"  # what is said of it is another file's
    assert told[1:] == [([], ["gone"])]
    pq.write_table(pa.table({"x": [1.0, 2.0, 3.0]}), shelf.folder / "mine.parquet")
    assert again.one("mine").rows == 3
    again.delete("a")
    again.all()
    assert told[2:] == [(["mine"], []), ([], ["a"])]
    assert {row["id"] for row in again.rows()} == {"mine", HEADING.id}


@pytest.mark.parametrize("name", ["../x", "..", "", "a/../a", "nobody's"])
def test_no_other_name_leads_anywhere(shelf: Shelf, name: str) -> None:
    with pytest.raises(UnknownError):
        shelf.one(name)


def test_a_file_that_cannot_be_read_is_listed_with_what_is_wrong(shelf: Shelf) -> None:
    path = shelf.folder / "mine.parquet"
    path.write_bytes(path.read_bytes()[:-10])
    assert "cut short" in shelf.one("mine").problem


def test_verify_finds_a_flipped_bit_and_a_recording_that_was_not_closed(shelf: Shelf) -> None:
    assert [one.problem for one in shelf.verify()] == ["", "", ""]
    path = shelf.folder / "a.parquet"
    content = bytearray(path.read_bytes())
    content[len(content) // 3] ^= 4
    path.write_bytes(content)
    three(shelf.folder)
    said = {one.name: one.problem for one in shelf.verify()}
    assert "another checksum" in said["a.parquet"]
    assert "it was not closed" in said[HEADING.id]
