"""Faults of a link: what a word tells, how many frames are hit, and that a seed makes them the same."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from emulator.servers.faults import DELAY, Fault, Faults, Passed, parse_fault


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("lose=0.01", Fault("lose", 0.01)),
        ("delay=1@5", Fault("delay", 1.0, 5.0)),
        ("double=0.5@2.5+0.5", Fault("double", 0.5, 2.5, 3.0)),
        ("closed@5+2", Fault("closed", 0.0, 5.0, 7.0)),
        ("closed", Fault("closed")),
        ("reset@5", Fault("reset", 0.0, 5.0)),
        ("refuse=0x2200", Fault("refuse", 0x2200)),
        ("refuse=8704@1", Fault("refuse", 0x2200, 1.0)),
    ],
)
def test_a_fault_is_told_in_a_word(text: str, fault: Fault) -> None:
    assert parse_fault(text) == fault


@pytest.mark.parametrize(
    "text", ["", "lose", "lose=x", "lose=", "closed=1", "explode=0.1", "lose=0.1@", "lose=0.1@x", "refuse=0.5", "@5"]
)
def test_what_is_no_fault_is_told_with_those_there_are(text: str) -> None:
    with pytest.raises(ValueError, match=r"expected a fault as lose=RATE, .* refuse=INDEX, each with @BEGIN or"):
        parse_fault(text)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("lose=1.5", "expected a rate of 0 to 1 in 'lose=1.5', got 1.5"),
        ("delay=nan", "expected a rate of 0 to 1 in 'delay=nan', got nan"),
        ("closed@-1", "expected times of 0 s or more in 'closed@-1'"),
        ("closed@1+0", "expected times of 0 s or more in"),
        ("reset@inf", "expected times of 0 s or more in"),
        ("reset@5+2", r"a reset takes no time: expected reset@BEGIN, got 'reset@5\+2'"),
        ("refuse=0x22", "expected an index of 0x1000 to 0x9FFF in 'refuse=0x22', got 0x22"),
        ("refuse=0xA000@1", "expected an index of 0x1000 to 0x9FFF in 'refuse=0xA000@1', got 0xA000"),
    ],
)
def test_numbers_that_cannot_be_are_told(text: str, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        parse_fault(text)


@given(st.text(max_size=20))
def test_any_text_is_a_fault_or_refused(text: str) -> None:
    try:
        assert math.isfinite(parse_fault(text).begin)
    except ValueError as error:
        assert "expected" in str(error)


def passed(seed: int, *texts: str, frames: int = 4000) -> list[list[Passed]]:
    faults = Faults(map(parse_fault, texts), seed)
    return [faults.passed(k.to_bytes(4, "little"), k * 1e-3) for k in range(frames)]


def test_without_faults_everything_passes_as_it_is() -> None:
    assert passed(1) == [[Passed(k * 1e-3, k.to_bytes(4, "little"), True)] for k in range(4000)]


def test_so_many_frames_are_hit_as_the_rates_say_and_a_seed_makes_them_the_same() -> None:
    texts = ("lose=0.1", "delay=0.2", "double=0.05", "corrupt=0.02")
    out = passed(7, *texts)
    assert out == passed(7, *texts)
    assert out != passed(8, *texts)
    arrived = [frames for frames in out if frames]
    assert len(arrived) / 4000 == pytest.approx(0.9, abs=0.02)
    assert sum(len(frames) == 2 for frames in arrived) / len(arrived) == pytest.approx(0.05, abs=0.015)
    assert sum(not frames[0].intact for frames in arrived) / len(arrived) == pytest.approx(0.02, abs=0.01)
    late = [frames[0].at - k * 1e-3 for k, frames in enumerate(out) if frames]
    assert sum(delay > 0.0 for delay in late) / len(late) == pytest.approx(0.2, abs=0.03)
    assert {round(delay, 9) for delay in late} == {0.0, DELAY}


def test_a_corrupted_frame_differs_in_one_bit() -> None:
    for k, ((at, data, intact),) in enumerate(passed(3, "corrupt=1", frames=100)):
        assert at == k * 1e-3
        assert not intact
        assert (int.from_bytes(data, "little") ^ k).bit_count() == 1


def test_a_fault_happens_in_its_time_alone() -> None:
    out = passed(1, "lose=1@1+0.5", "closed@3+0.25")
    gone = [k for k, frames in enumerate(out) if not frames]
    assert gone == [*range(1000, 1500), *range(3000, 3250)]


def test_resets_and_refusals_are_told_when_they_are_due() -> None:
    faults = Faults(map(parse_fault, ("reset@2", "reset@1", "refuse=0x2200@5")))
    assert [faults.reset_due(t) for t in (0.5, 1.0, 1.5, 2.5, 9.0)] == [False, True, False, True, False]
    assert [faults.refuses(index, t) for index, t in ((0x2200, 4.9), (0x2200, 5.0), (0x2201, 5.0))] == [
        False, True, False,
    ]
