"""Diagnoses on disk: written whole or not at all, read back against their checksums, deleted."""

import os
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path

import pytest

from bench.errors import RecordingError, UnknownError
from bench.files import unfinished_folder
from bench.store.diagnoses import Diagnoses, Heading

ASKED = datetime(2026, 1, 31, 12, 0, 0, 250_000, UTC)
HEADING = Heading(
    "20260131-120000-250", "run", "spindle", ASKED, ASKED, ASKED + timedelta(seconds=40), "done", "", "explained",
    "Dead time was left out.", {"trust": {"R_s": 0.2}, "nominal": {"machine": {"n_p": 4}}}, {"pmsm-bench": "0.1.0"},
)  # fmt: skip
FILES = {"result.json": b"{}\n", "report.html": b"<!doctype html>" * 1000, "machine.toml": b"[machine]\n"}


@pytest.fixture
def kept(tmp_path: Path) -> Diagnoses:
    """One diagnosis with all its files, and an older one that failed."""
    kept = Diagnoses(tmp_path)
    kept.keep(HEADING, FILES)
    early = ASKED - timedelta(days=1)
    kept.keep(replace(HEADING, id="20260130-120000-250", asked=early, state="failed", reason="why"), {})
    return kept


def test_they_come_back_as_they_were_the_newest_first(kept: Diagnoses, tmp_path: Path) -> None:
    again = Diagnoses(tmp_path)
    first, second = again.all()
    assert replace(first, sums={}) == HEADING
    assert (second.id, second.state, second.reason) == ("20260130-120000-250", "failed", "why")
    assert again.one(HEADING.id) == first == kept.one(HEADING.id)
    for name, content in FILES.items():
        assert again.file(HEADING.id, name) == content
    assert again.file(second.id, "report.html") is None
    folder = tmp_path / "diagnoses" / HEADING.id
    assert {path.name for path in folder.iterdir()} == {"heading.json", "result.json", "report.html.gz", "machine.toml"}
    assert (folder / "report.html.gz").stat().st_size < 1000


def test_what_was_read_once_is_known_to_the_next(kept: Diagnoses, tmp_path: Path) -> None:
    told: list[tuple[list[str], list[str]]] = []
    rows = kept.rows()
    again = Diagnoses(tmp_path, lambda read, gone: told.append(([row["id"] for row in read], gone)))
    again.recall(rows)
    assert again.all() == kept.all()
    assert told == []
    Diagnoses(tmp_path).delete(HEADING.id)
    assert [one.id for one in again.all()] == ["20260130-120000-250"]
    assert told == [([], [HEADING.id])]


def test_one_is_whole_or_not_there_at_all(kept: Diagnoses, tmp_path: Path) -> None:
    folder = tmp_path / "diagnoses"
    with pytest.raises(OSError, match="File name too long"):
        kept.keep(replace(HEADING, id="20260131-120001-000"), FILES | {"x" * 300: b""})
    with pytest.raises(OSError, match="not empty"):  # another bench has that id
        kept.keep(HEADING, FILES)
    assert {path.name for path in folder.iterdir()} == {HEADING.id, "20260130-120000-250"}
    (folder / ".0123abcd.unfinished").mkdir()
    with unfinished_folder(folder) as another:  # another bench is at it, whatever the time of its files
        os.utime(another, (0.0, 0.0))
        kept.tidy()
        assert len(kept.all()) == 2
        assert list(folder.glob(".*")) == [another]


def test_what_is_damaged_is_told_and_hides_no_other(kept: Diagnoses, tmp_path: Path) -> None:
    assert [one.problem for one in kept.verify()] == ["", ""]
    folder = tmp_path / "diagnoses" / HEADING.id
    (folder / "machine.toml").write_bytes(b"[motor]\n")
    with pytest.raises(RecordingError, match="it has another checksum"):
        kept.file(HEADING.id, "machine.toml")
    packed = (folder / "report.html.gz").read_bytes()
    for damaged in (packed[:-10], b"something else"):
        (folder / "report.html.gz").write_bytes(damaged)
        with pytest.raises(RecordingError, match="cut short, or damaged"):
            kept.file(HEADING.id, "report.html")
    (folder / "heading.json").write_text("{")
    again = Diagnoses(tmp_path)
    assert [one.id for one in again.all()] == ["20260130-120000-250"]
    assert [bool(one.problem) for one in again.verify()] == [False, True]


def test_what_is_deleted_is_gone(kept: Diagnoses, tmp_path: Path) -> None:
    kept.delete(HEADING.id)
    assert [path.name for path in (tmp_path / "diagnoses").iterdir()] == ["20260130-120000-250"]
    for gone in (kept.delete, kept.one, partial(kept.file, name="result.json")):
        with pytest.raises(UnknownError, match=f"no diagnosis '{HEADING.id}'"):
            gone(HEADING.id)


@pytest.mark.parametrize("id_", ["", "..", "../run", "x" * 3000, "\0", "20260131-120000-2500", "٢٠٢٦٠١٣١-١٢٠٠٠٠-٢٥٠"])
def test_no_other_name_leads_anywhere(kept: Diagnoses, id_: str) -> None:
    with pytest.raises(UnknownError):
        kept.one(id_)
    with pytest.raises(UnknownError):
        kept.file(id_, "result.json")
