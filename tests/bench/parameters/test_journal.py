"""The journal of a flash on disk, ended at every step."""

import threading
from dataclasses import replace
from pathlib import Path

import pytest

from bench.errors import ConflictError, LimitError
from bench.parameters.flash import before
from bench.parameters.journal import Begun, Journal, Past, Step, history, is_there, past
from drivers.drive import Identity

DRIVE = Identity("a drive", 0, 1, 1, 5, 0, 1e-4, 20.0, 400.0, 3000.0)


def begun(name: str) -> Begun:
    return Begun("x", name, 1, "somebody", "2026-01-31T12:00:00+00:00", {"bandwidth": 1.0}, {"bandwidth": 2.0})


def noted(folder: Path, name: str, *steps: Step) -> None:
    """A flash whose bench was killed after these steps."""
    journal = Journal.begin(folder, DRIVE, begun(name))
    for step in steps:
        journal.note(step, said="so")
    journal.close()


@pytest.mark.parametrize("end", [Step.DONE, Step.ROLLED_BACK])
def test_one_that_had_ended_is_put_away_by_the_next_look_and_not_offered(tmp_path: Path, end: Step) -> None:
    noted(tmp_path, "a", Step.WRITE, end)
    assert is_there(tmp_path, DRIVE)
    assert Journal.found(tmp_path, DRIVE) is None
    assert not is_there(tmp_path, DRIVE)
    assert [(one.begun.name, one.step, one.said) for one in past(tmp_path, DRIVE)] == [("a", end, "so")]


def test_one_that_was_cut_between_history_and_the_journals_end_is_there_once(tmp_path: Path) -> None:
    for name in ("a", "b"):
        noted(tmp_path, name, Step.WRITE, Step.DONE)
        journal = next(tmp_path.glob("*.flash.jsonl"))
        kept = journal.read_bytes()
        assert Journal.found(tmp_path, DRIVE) is None
    (folder,) = tmp_path.glob("*.flashed.jsonl")
    whole = folder.read_bytes()
    for length in range(len(whole) - len(kept), len(whole) + 1, 7):  # how far the history had come
        folder.write_bytes(whole[:length])
        journal.write_bytes(kept)
        assert Journal.found(tmp_path, DRIVE) is None
        assert folder.read_bytes() == whole
    assert [line["step"] for line in history(tmp_path, DRIVE)] == ["begun", "write", "done"] * 2


def test_one_that_was_cut_is_found_with_its_step_and_one_under_way_is_left_alone(tmp_path: Path) -> None:
    noted(tmp_path, "a", Step.WRITE, Step.STORE)
    journal = Journal.found(tmp_path, DRIVE)
    assert journal is not None
    assert (journal.begun, journal.step) == (begun("a"), Step.STORE)
    with pytest.raises(ConflictError, match="is under way"):
        Journal.found(tmp_path, DRIVE, 0.0)
    with pytest.raises(ConflictError, match="has to be finished or rolled back first"):
        Journal.begin(tmp_path, DRIVE, begun("b"))
    journal.end(Step.ROLLED_BACK, "it was cut")
    assert past(tmp_path, DRIVE) == [Past(begun("a"), Step.ROLLED_BACK, past(tmp_path, DRIVE)[0].at, "it was cut")]


TIMES = (
    "2026-11-28T09:30:00.250000", "2026-11-29T22:10:11.500000", "2026-11-29T22:10:11.750000", "2026-11-30T08:00:00",
)  # fmt: skip


def flashed(folder: Path, name: str, since: str, bandwidth: float, end: Step = Step.DONE) -> None:
    """One that had this bandwidth before."""
    one = replace(begun(name), since=f"{since}+00:00", image={"bandwidth": bandwidth, "gone": 1.0})
    Journal.begin(folder, DRIVE, one).end(end, "so")


@pytest.fixture
def four(tmp_path: Path) -> Path:
    """The folder of four flashes that were done, and one that was rolled back."""
    for k, since in enumerate(TIMES):
        flashed(tmp_path, f"set {k}", since, 100.0 * (k + 1))
    flashed(tmp_path, "no", "2026-11-30T09:00:00", 900.0, Step.ROLLED_BACK)
    return tmp_path


@pytest.mark.parametrize(("since", "k"), [
    (None, 3), ("2026-11-28", 0), ("2026-11-28T09:30:00Z", 0), ("2026-11-28T09:30:00.250000Z", 0),
    ("2026-11-28T09:30Z", 0), ("2026-11-29T22:10:11.5Z", 1), ("2026-11-29T22:10:11.750000+00:00", 2),
    ("2026-11-30", 3), ("2026-11-30T08:00:00Z", 3),
])  # fmt: skip
def test_what_a_drive_had_is_found_by_the_beginning_of_a_flashs_time(four: Path, since: str | None, k: int) -> None:
    given = before(four, DRIVE, since)
    assert (given.name, given.values) == (f"before set {k}", {"bandwidth": 100.0 * (k + 1)})
    assert given.entries["bandwidth"].source == f"of {TIMES[k][:19]}Z"


def test_no_flash_of_a_time_or_several_are_told_with_those_that_there_are(four: Path, tmp_path: Path) -> None:
    expected = "expected the time of one flash that was done, as the history has it"
    for since, said in (
        ("2026-11-29", ", got '2026-11-29', which is the beginning of 2, the latest 2026-11-29T22:10:11.500000Z, "
                       "2026-11-29T22:10:11.750000Z"),
        ("2026-11-28T10", ", such as 2026-11-28T09:30:00Z, 2026-11-29T22:10:11Z, 2026-11-29T22:10:11Z, "
                          "got '2026-11-28T10'"),
        ("2026-11-30T09:00:00Z", ", such as 2026-11-29T22:10:11Z, 2026-11-30T08:00:00Z, got '2026-11-30T09:00:00Z'"),
    ):  # fmt: skip
        with pytest.raises(ConflictError) as told:
            before(four, DRIVE, since)
        assert str(told.value) == expected + said
    for since in ("", "yesterday", "2026", "2026-11-29 22:10", "2026-11-29\n", "T22:10"):
        with pytest.raises(LimitError, match=f"{expected}, such as .*, or its beginning, got"):
            before(four, DRIVE, since)
    with pytest.raises(ConflictError, match="nothing was flashed into this drive from here"):
        before(tmp_path / "other", DRIVE, "2026-11-29")


def test_who_only_looks_takes_nobody_the_journal(tmp_path: Path) -> None:
    """As a service does all the time, while a command line begins and ends flashes."""
    ended = threading.Event()

    def look() -> None:
        while not ended.is_set():
            try:
                if (found := Journal.found(tmp_path, DRIVE, 0.0)) is not None:
                    found.close()
            except ConflictError:
                continue

    looking = threading.Thread(target=look)
    looking.start()
    try:
        for k in range(100):
            noted(tmp_path, str(k), Step.WRITE)
            journal = Journal.found(tmp_path, DRIVE)
            assert journal is not None
            journal.end(Step.DONE, "so")
    finally:
        ended.set()
        looking.join()
    assert [one.begun.name for one in past(tmp_path, DRIVE)] == [str(k) for k in range(100)]
