"""The HTTP interface under too much, smaller than `python -m tests.bars.bench_http`."""

import math

import pytest

from tests.bars.bench_http import Load, measured

pytestmark = [pytest.mark.live, pytest.mark.slow]


def test_under_too_much_the_surplus_is_answered_503_and_stop_gets_through_and_no_row_is_lost() -> None:
    said = measured(Load(rate=400, streams=60, idle=500, seconds=8.0))
    kinds = {kind.partition(":")[0] for kind in said.answers}
    assert {"request 200", "stream 200", "stream 503", "idle 503"} <= kinds
    assert said.answers["stream 200"] == 32
    assert said.stops
    assert max(said.stops) < max(1.0, 3.0 * said.alone)  # other work may hold the machine up
    assert not any(math.isinf(each) for each in said.stops)
    assert (said.lost, said.gaps, said.reconnects) == (0, 0, 0)
    assert said.rows > 0
