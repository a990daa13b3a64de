"""The pooled score: its recordings are those that were kept, it goes on after a stop, and lays pairs side by side."""

from dataclasses import replace
from pathlib import Path

import pytest

from tests.score.pooled.outcome import Outcome, kept_outcomes
from tests.score.pooled.pairwise import falls, lacking, others, pairs_of, table
from tests.score.pooled.population import Kept, kept_population
from tests.score.pooled.work import OtherRecordingError, outcomes
from tests.score.score import FUNCTION

ONE = Outcome("2019/rich/0001", "abc", "one", "iron_loss", "explained", "iron_loss", 1, 0, 1, 1, "1")


def wrong(one: Outcome, n: int) -> Outcome:
    return replace(one, name=f"2019/rich/{n:04}", found="-", right=0)


def right(n: int) -> Outcome:
    return replace(ONE, name=f"2019/rich/{n:04}")


@pytest.fixture(scope="module")
def shortest() -> list[Kept]:
    """Two recordings of poor excitation, of few periods, in which nothing is concealed: they are soon diagnosed."""
    healthy = [one for one in kept_population() if one.answer["kind"] == "none"]
    return sorted(healthy, key=lambda one: int(one.answer["periods"]))[:2]


@pytest.mark.thorough
def test_a_kept_recording_is_made_anew_diagnosed_and_not_twice(shortest: list[Kept], tmp_path: Path) -> None:
    done = tmp_path / "done.tsv"
    first = outcomes(shortest[:1], done, FUNCTION, 1)
    done.write_text(done.read_text() + "2019/cut", encoding="utf-8")
    both = outcomes(shortest, done, FUNCTION, 1)
    done.write_text(done.read_text().replace(shortest[1].digest, "0" * 16), encoding="utf-8")
    assert outcomes(shortest, done, FUNCTION, 1) == both  # what another recording's file said is not taken
    assert [one.digest for one in both.values()] == [kept.digest for kept in shortest]
    assert both[shortest[0].name] == first[shortest[0].name]
    assert kept_outcomes(done) == both


def test_a_recording_that_became_another_is_refused(shortest: list[Kept], tmp_path: Path) -> None:
    other = replace(shortest[0], digest="0" * 16)
    with pytest.raises(OtherRecordingError, match=r"expected the recording with hash 0+, the emulator makes one with"):
        outcomes([other], tmp_path / "done.tsv", FUNCTION, 1)


def test_pairs_are_counted_and_a_fall_is_told() -> None:
    before = {one.name: one for one in (right(1), right(2), wrong(ONE, 3), right(4))}
    now = {one.name: one for one in (right(1), wrong(ONE, 2), right(3), replace(right(4), sizes_right=0))}
    pairs = pairs_of(before, now)
    assert table(pairs)[-1] == ("all", "4", "3", "3", "1", "1", "0", "1.000")
    assert ("  of these right", "4", "3") in others(pairs)
    assert not falls(pairs)
    assert falls(pairs_of(before, {**now, "2019/rich/0003": before["2019/rich/0003"]}))


def test_a_recording_of_which_nothing_is_kept_is_told_before_any_is_diagnosed(shortest: list[Kept]) -> None:
    first, second = shortest
    kept = {first.name: replace(ONE, name=first.name, digest=first.digest)}
    assert lacking([first], kept) is None
    assert lacking(shortest, kept) == (
        f"expected a kept outcome of each of 2 recordings, 1 have none, the first is {second.name}"
    )
    assert str(lacking([replace(first, digest="0" * 16)], kept)).endswith(f"1 have none, the first is {first.name}")


def test_a_file_that_makes_no_sense_is_told_by_its_line(tmp_path: Path) -> None:
    (tmp_path / "kept.tsv").write_text("# heads\n2019/rich/0001\tabc\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"kept.tsv, line 2: expected 11 cells, got 2"):
        kept_outcomes(tmp_path / "kept.tsv")


def test_of_another_recording_no_pair_is_made() -> None:
    with pytest.raises(ValueError, match="2019/rich/0001: its hash was abc, and is def"):
        pairs_of({ONE.name: ONE}, {ONE.name: replace(ONE, digest="def")})
