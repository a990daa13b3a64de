"""What a drive's limits say of parameters that are to be flashed."""

import re

import pytest

from bench.actions.safety.limits import Limits

LIMITS = Limits(6.0, 3000.0, n_p=4)
FIT = {"n_p": 4.0, "current_limit": 6.0, "field_weakening": 0.0, "i_d_weakening": 20.0, "overspeed_trip": 1382.0}


@pytest.mark.parametrize(("change", "said"), [
    ({"current_limit": 6.1}, "current_limit: currents go up to 6 A, the machine's rated .*, got 6.1 A$"),
    ({"overspeed_trip": 1400.0}, "overspeed_trip goes up to 1382 rad/s, 1.1 times"),
    ({"field_weakening": 1.0}, "i_d_weakening: currents go up to 6 A"),
    ({"n_p": 3.0}, "n_p: the machine file says 4 pole pairs, by which speeds are bounded, got 3"),
])  # fmt: skip
def test_what_would_go_beyond_them_is_a_problem(change: dict[str, float], said: str) -> None:
    (told,) = LIMITS.problems(FIT | change, list(change))
    assert re.search(said, told), told


def test_what_stays_as_it_is_is_none() -> None:
    beyond = {"n_p": 3.0, "current_limit": 12.0, "field_weakening": 1.0, "i_d_weakening": 20.0, "overspeed_trip": 3e3}
    assert LIMITS.problems(beyond, ["bandwidth"]) == []
    assert len(LIMITS.problems(beyond, list(beyond))) == 4
    assert Limits().problems(beyond, list(beyond)) == []
