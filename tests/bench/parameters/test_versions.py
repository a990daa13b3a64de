"""What a drive's history says of another version: told, and never forbidden."""

from pathlib import Path
from typing import Any

from bench.parameters.journal import Begun, Journal, Past, Step, past
from bench.parameters.parameter_set import ParameterSet, set_of
from bench.parameters.versions import remarks_on
from drivers.drive import Identity

DRIVE = Identity("a drive", 1, 2, 3, 4, 5, 1e-4, 24.0, 310.0, 5000.0)
SINCE = "2026-01-31T12:00:00+00:00"
WANTED = {"bandwidth": 900.0, "k_p_d": 5.0}


def flashed(folder: Path, version: int, end: Step = Step.DONE, **more: Any) -> list[Past]:
    image = more.pop("image", {})
    begun = Begun("x", more.pop("name", "servo"), version, "me", SINCE, image, WANTED | more)
    journal = Journal.begin(folder, DRIVE, begun)
    journal.end(end, "so it ended")
    return past(folder, DRIVE)


def given(version: int, name: str = "servo", **values: float) -> ParameterSet:
    return set_of({"bandwidth": 900.0} | values, name, "by hand", version=version)


def on(one: ParameterSet, lines: list[Past], **present: float) -> tuple[str, ...]:
    return remarks_on(one, WANTED | present, lines)


def test_a_lower_version_is_told_and_a_higher_one_is_not(tmp_path: Path) -> None:
    lines = flashed(tmp_path, 3)
    assert on(given(2), lines) == ("version 2 is lower than that of the latest 'servo', 3 of 2026-01-31T12:00:00Z",)
    assert on(given(3), lines) == on(given(4, bandwidth=1.0), lines) == ()
    assert on(given(1, "another"), lines) == on(given(1), []) == ()


def test_the_same_version_with_other_values_is_told(tmp_path: Path) -> None:
    lines = flashed(tmp_path, 3)
    assert on(given(3, bandwidth=901.0, k_i_d=7.0, k_p_d=5.0), lines) == (
        "version 3 of 'servo' was flashed with other values on 2026-01-31T12:00:00Z: bandwidth, k_i_d",
    )


def test_only_what_was_done_counts_and_of_that_the_latest(tmp_path: Path) -> None:
    flashed(tmp_path, 5)
    flashed(tmp_path, 2)
    lines = flashed(tmp_path, 9, Step.ROLLED_BACK)
    assert on(given(3), lines) == ()
    assert "2 of" in on(given(1), lines)[0]


def test_what_another_has_changed_since_is_told(tmp_path: Path) -> None:
    lines = flashed(tmp_path, 3)
    said = "the drive does not hold any more what the flash of 2026-01-31T12:00:00Z left in it"
    assert on(given(4), lines, bandwidth=901.0) == (f"{said}: bandwidth",)
    assert on(given(4), lines, bandwidth=901.0, k_p_d=6.0) == (f"{said}: bandwidth, k_p_d",)
    assert on(given(4), [], bandwidth=901.0) == ()
    lines = flashed(tmp_path, 4, Step.ROLLED_BACK, image=WANTED | {"k_p_d": 4.0})
    assert on(given(5), lines, k_p_d=4.0) == ()
    assert on(given(5), lines) == (f"{said}: k_p_d",)
