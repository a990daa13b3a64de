"""The stream of a drive on a CAN bus: what the drive produced arrives, whole and in order, or the end is told."""

import contextlib
import itertools
import os
import time
from collections.abc import Callable, Iterator

import can
import numpy as np
import pytest

from drivers.connect import connect
from drivers.drive import Drive
from drivers.errors import ConnectError, FrameError, LostError
from drivers.wire import canopen_od as od
from drivers.wire.codec import count_size
from drivers.wire.dictionary import signal_named
from tests.support.served_drive import (
    Listening,
    Served,
    first_blocks,
    joined,
    listening,
    served,
    tcp_url,
    until,
    virtual_url,
)

pytestmark = pytest.mark.live

URLS = {"virtual": virtual_url, "socketcand": tcp_url}
COLUMNS = ("theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q", "i_d_mean", "i_q_mean", "u_dc")


@pytest.fixture(params=URLS)
def bench(request: pytest.FixtureRequest) -> Iterator[Served]:
    with served(URLS[request.param]()) as drive:
        yield drive


@pytest.fixture
def drive(bench: Served) -> Iterator[Drive]:
    with connect(bench.url) as connected:
        yield connected


def test_what_the_drive_produced_arrives_within_half_a_count(bench: Served, drive: Drive) -> None:
    blocks = first_blocks(drive, 1000)
    bench.end()
    ticks = joined(blocks, "tick")
    assert np.array_equal(ticks, ticks[0] + 10 * np.arange(len(ticks)))
    assert all(block.lost_before == 0 and (block.T_s, block.periods) == (1e-4, 10) for block in blocks)
    rows = bench.produced()
    place = np.searchsorted(rows["row_tick"], ticks)
    assert np.array_equal(rows["row_tick"][place], ticks)
    full = {"i_full": 24.0, "u_full": 387.5, "omega_full": drive.identity.omega_full}
    for name in COLUMNS:
        count = count_size(signal_named(name), full)
        off = joined(blocks, name) - rows[name][place]
        if name == "theta_e":
            off = (off + np.pi) % (2.0 * np.pi) - np.pi
        assert np.abs(off).max() <= 0.5 * count * 1.001, name
    assert blocks[-1].temp_winding == pytest.approx(23.4)
    assert blocks[-1].temp_magnet == pytest.approx(23.4)


def test_a_stream_goes_on_over_the_turn_of_its_16_bit_tick(bench: Served, drive: Drive) -> None:
    bench.running.clear()
    drive.write("stream_periods", 1000.0)
    bench.step(65_000 - bench.drive.tick)
    bench.running.set()
    ticks = joined(first_blocks(drive, 5), "tick")
    assert ticks[0] >= 65_000
    assert ticks[-1] > 68_000
    assert np.all(np.diff(ticks) == 1000)


@pytest.mark.parametrize("periods", [5.0, 20.0, 7.0, 1000.0])
def test_another_row_length_counts_from_the_next_block_on(drive: Drive, periods: float) -> None:
    with listening(drive) as listener:
        drive.write("stream_periods", periods)
        before = len(listener.blocks)
        until(lambda: sum(b.periods == periods and len(b) for b in listener.blocks) > 3 or listener.error is not None,
              "no rows of the new length")
        assert listener.error is None
        assert drive.read("stream_periods") == periods
    blocks = listener.blocks
    new = [block for block in blocks if block.periods == periods]
    assert [b.periods for b in blocks] == [10] * (len(blocks) - len(new)) + [int(periods)] * len(new)
    assert len(new) <= len(blocks) - before + 1
    for one, other in itertools.pairwise(blocks):
        gap = int(other.tick[0] - one.tick[-1]) - one.periods
        assert gap >= 0
        assert other.lost_before == -(-gap // other.periods)
    for block in blocks:
        assert np.all(np.diff(block.tick) == block.periods)


def test_rows_of_any_length_are_the_drives_own(bench: Served, drive: Drive) -> None:
    """The means of a row tell its true length: they are compared with what was produced under the same tick."""
    full = {"u_full": 387.5}
    with listening(drive) as listener:
        for periods in (20.0, 5.0, 10.0, 50.0, 8.0):
            drive.write("stream_periods", periods)
            seen = listener.rows
            until(lambda seen=seen: listener.rows > seen + 3, "no rows")
    assert listener.error is None
    bench.end()
    rows = bench.produced()
    starts = rows["row_tick"]
    lengths = dict(zip(starts[:-1].tolist(), np.diff(starts).tolist(), strict=True))
    for block in listener.blocks:
        place = np.searchsorted(starts, block.tick)
        assert np.abs(block.u_q - rows["u_q"][place]).max() <= 0.5 * count_size(signal_named("u_q"), full) * 1.001
        assert {lengths.get(int(tick), block.periods) for tick in block.tick} == {block.periods}


def test_somebody_elses_change_of_the_row_length_ends_the_stream(bench: Served, drive: Drive) -> None:
    with listening(drive) as listener, connect(bench.url) as other:
        other.write("stream_periods", 20.0)
        error = listener.ended()
    assert isinstance(error, FrameError)
    assert "somebody else has set stream_periods of node 5 on" in str(error)
    starts = bench.produced()["row_tick"]
    ticks = joined(listener.blocks, "tick")
    assert np.all(np.isin(ticks + 10, starts)), "a row of another length was given out"


def test_two_clients_hear_the_same_rows_and_a_reader_disturbs_neither(bench: Served, drive: Drive) -> None:
    with connect(bench.url) as second, connect(bench.url) as reader, listening(drive) as one, listening(second) as two:
        for _ in range(50):
            assert reader.read("control_R_s") == 0.9664
        until(lambda: two.rows > 500, "no rows")
        until(lambda: one.blocks[-1].tick[-1] >= two.blocks[-1].tick[0], "no rows in common")
        assert one.error is two.error is None
    first = dict(zip(joined(one.blocks, "tick").tolist(), joined(one.blocks, "i_q").tolist(), strict=True))
    common = {t: i for t, i in zip(joined(two.blocks, "tick").tolist(), joined(two.blocks, "i_q"), strict=True)
              if t in first}
    assert len(common) > 100
    assert all(first[tick] == i_q for tick, i_q in common.items())


def test_closing_from_another_thread_ends_the_stream_without_an_error(drive: Drive) -> None:
    with listening(drive) as listener:
        begun = time.monotonic()
        drive.close()
        assert listener.ended() is None
        assert time.monotonic() - begun < 1.0


def test_a_stream_that_is_left_stops_on_the_bus_and_can_be_begun_again(bench: Served, drive: Drive) -> None:
    first = first_blocks(drive, 50)
    until(lambda: bench.server._state == od.STATE_PRE_OPERATIONAL, "it streams on")
    left = bench.drive.tick
    until(lambda: bench.drive.tick > left + 200, "its time stands still")
    second = first_blocks(drive, 50)
    gap = int(second[0].tick[0] - first[-1].tick[-1]) - 10
    assert second[0].lost_before == gap // 10
    assert gap > 0


def test_a_reset_node_is_lost_and_can_be_had_again(bench: Served, drive: Drive) -> None:
    with listening(drive) as listener:
        bench.server._on_nmt(0, bytearray([od.NMT_RESET_NODE, 5]), 0.0)
        error = listener.ended()
    assert isinstance(error, LostError)
    assert "node 5 on" in str(error)
    assert str(error).endswith("has reset")
    with connect(bench.url) as again:
        assert len(first_blocks(again, 20)) > 0


def test_a_node_that_falls_silent_is_lost_within_about_a_second(bench: Served, drive: Drive) -> None:
    with listening(drive) as listener:
        bench.running.clear()
        begun = time.monotonic()
        error = listener.ended()
        assert 0.8 < time.monotonic() - begun < 1.6
    assert isinstance(error, LostError)
    assert "fell silent: no row for 1.0 s, expected one every 1 ms" in str(error)


def test_a_bus_that_vanishes_is_lost_and_had_again_when_it_is_back() -> None:
    url = tcp_url()
    with served(url) as bench:
        drive = connect(url)
        listener = Listening(drive)
        until(lambda: listener.rows > 20, "no rows")
        bench.end()
        bench.server.close()
        begun = time.monotonic()
        assert isinstance(listener.ended(), LostError)
        assert time.monotonic() - begun < 1.6
        with pytest.raises(ConnectError, match="nothing serves a CAN bus"):
            connect(url)
        drive.close()
        assert time.monotonic() - begun < 2.5
    with served(url), connect(url) as again:
        assert len(first_blocks(again, 20)) > 0


def test_a_bus_whose_reader_fails_is_lost_and_closes(capfd: pytest.CaptureFixture[str]) -> None:
    with served(virtual_url()) as bench, connect(bench.url) as drive, listening(drive) as listener:
        bus: can.BusABC = drive._bus._network.bus  # pyright: ignore[reportAttributeAccessIssue, reportUnknownVariableType]
        bus.shutdown()
        error = listener.ended()
        assert isinstance(error, LostError)
        assert "virtual" in str(error)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("make_url", URLS.values(), ids=URLS)
def test_coming_and_going_leaves_no_socket_open(make_url: Callable[[], str]) -> None:
    def open_files() -> int:
        return len(os.listdir("/proc/self/fd"))  # noqa: PTH208

    before = open_files()
    with served(make_url()) as bench:
        for _ in range(5):
            with connect(bench.url) as drive:
                first_blocks(drive, 5)
            with contextlib.suppress(ConnectError):
                connect(bench.url.replace("/5", "/5?x"))
    until(lambda: open_files() <= before, "files left open")
