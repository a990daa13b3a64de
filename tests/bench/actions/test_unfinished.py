"""What is to be undone, on disk: kept until it is, whatever becomes of who noted it."""

import resource
from pathlib import Path
from typing import Any

import pytest

from bench.actions.safety.under_control import under_control
from bench.actions.safety.unfinished import Noted, Origin, undo
from bench.errors import ConflictError, UnavailableError
from drivers.connect import connect
from drivers.drive import Drive
from drivers.lease import Lease
from tests.support.served_drive import served, virtual_url

pytestmark = pytest.mark.live


@pytest.fixture
def drive() -> Any:
    with served(virtual_url()) as bench, connect(bench.url) as connected:
        yield connected


def noted(folder: Path, drive: Drive, **settings: float) -> Noted:
    return Noted(Origin(folder, "x", "a test"), drive, Lease(), settings)


def only(folder: Path) -> Path:
    (path,) = folder.iterdir()
    return path


def test_what_was_before_a_bench_that_died_is_before_the_next_as_well(tmp_path: Path, drive: Drive) -> None:
    before = drive.read("step_time")
    noted(tmp_path, drive, step_time=before).close()  # as at its death
    drive.write("step_time", 2.0 * before)
    noted(tmp_path, drive, step_time=2.0 * before, field_weakening=0.0).close()
    assert "step_time restored as before" in undo(tmp_path, drive)
    assert drive.read("step_time") == before
    assert undo(tmp_path, drive) == ""


def test_what_a_bench_that_died_has_left_is_restored_though_another_ended_well(tmp_path: Path, drive: Drive) -> None:
    before = drive.read("step_time")
    noted(tmp_path, drive, step_time=before).close()
    drive.write("step_time", 2.0 * before)
    noted(tmp_path, drive).undone()
    assert "step_time restored as before" in undo(tmp_path, drive)
    assert (drive.read("step_time"), list(tmp_path.iterdir())) == (before, [])


def test_one_setting_that_is_refused_keeps_no_other_from_being_restored(tmp_path: Path, drive: Drive) -> None:
    before = drive.read("step_time")
    noted(tmp_path, drive, excitation_kind=99.0, step_time=before).close()
    drive.write("step_time", 2.0 * before)
    said = undo(tmp_path, drive)
    assert "step_time restored as before, but not excitation_kind (" in said
    assert drive.read("step_time") == before


def test_what_a_bench_that_died_has_left_is_not_before_who_takes_control_next(tmp_path: Path, drive: Drive) -> None:
    before = drive.read("step_time")
    noted(tmp_path, drive, step_time=before).close()
    drive.write("step_time", 2.0 * before)
    with under_control(drive, Lease(), Origin(tmp_path, "x", "a test"), ["step_time"]):
        assert drive.read("step_time") == before
    assert (drive.read("step_time"), list(tmp_path.iterdir())) == (before, [])


def test_what_another_changes_while_control_is_taken_is_not_kept(
    tmp_path: Path, drive: Drive, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, taken = drive.read("step_time"), Lease.take

    def late(lease: Lease, of: Drive) -> None:
        of.write("step_time", before)  # as another restores it
        taken(lease, of)

    drive.write("step_time", 2.0 * before)
    monkeypatch.setattr(Lease, "take", late)
    with (
        pytest.raises(ConflictError, match="another client has just changed step_time: ask again"),
        under_control(drive, Lease(), Origin(tmp_path, "x", "a test"), ["step_time"]),
    ):
        raise AssertionError
    assert (drive.read("step_time"), list(tmp_path.iterdir())) == (before, [])


def test_a_disk_that_is_full_destroys_no_note(tmp_path: Path, drive: Drive) -> None:
    noted(tmp_path, drive, step_time=0.01).close()
    content = only(tmp_path).read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    for size in (0, 20):
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
        try:
            with pytest.raises(UnavailableError, match=r"what is to be undone later cannot be noted in .*: "):
                noted(tmp_path, drive)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        (path,) = tmp_path.glob("*.json")
        assert path.read_bytes() == content


def test_a_damaged_note_is_kept_by_who_writes_the_next(tmp_path: Path, drive: Drive) -> None:
    noted(tmp_path, drive).close()
    only(tmp_path).write_bytes(b"{")
    noted(tmp_path, drive).undone()
    assert only(tmp_path).suffix == ".damaged"


def test_a_note_under_way_is_left_alone(tmp_path: Path, drive: Drive) -> None:
    first = noted(tmp_path, drive)
    with pytest.raises(ConflictError, match="another bench on this machine is at work with this drive"):
        noted(tmp_path, drive)
    with pytest.raises(ConflictError, match="another bench on this machine is at work with this drive"):
        undo(tmp_path, drive)
    first.undone()
    assert list(tmp_path.iterdir()) == []
    noted(tmp_path, drive).undone()


@pytest.mark.parametrize("content", [b"{", b"[]", b"\xff", b'{"drive": "x"}', b"null"])
def test_a_note_that_cannot_be_read_is_told_and_kept(tmp_path: Path, drive: Drive, content: bytes) -> None:
    noted(tmp_path, drive).close()
    path = only(tmp_path)
    path.write_bytes(content)
    assert undo(tmp_path, drive).startswith("what a bench before this one has changed cannot be read: see the drive's")
    assert only(tmp_path).suffix == ".damaged"
    assert only(tmp_path).read_bytes() == content
    assert undo(tmp_path, drive) == ""


def test_an_empty_note_is_of_a_bench_that_had_changed_nothing(tmp_path: Path, drive: Drive) -> None:
    noted(tmp_path, drive).close()
    only(tmp_path).write_bytes(b"")
    assert undo(tmp_path, drive) == ""
    assert list(tmp_path.iterdir()) == []
