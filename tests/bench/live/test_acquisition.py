"""The pump of a drive over real sockets: connects, counts, says since when a drive is lost, gets it back, ends."""

import socket
import time
from collections.abc import Generator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta

import pytest

from bench.config import Config, DriveConfig
from bench.live.acquisition import Acquisition, Link, LinkState
from bench.live.window import Window
from bench.service.service import Service
from drivers.block import Block
from tests.conftest import bus_url, free_port
from tests.support.relay import relayed
from tests.support.served_drive import emulator, ready, served, tcp_url, until

pytestmark = pytest.mark.live

SOON = timedelta(seconds=5)


@contextmanager
def pumping(url: str, blocks: list[Block] | None = None) -> Generator[Acquisition]:
    pump = Acquisition("spindle", url, (list[Block]() if blocks is None else blocks).append)
    pump.start()
    try:
        yield pump
    finally:
        pump.end()
        pump.join(10.0)
        assert not pump.thread.is_alive()


def streaming(pump: Acquisition, rows: int = 1) -> Link:
    """The link when so many rows more have come."""
    wanted = pump.status.rows + rows
    until(lambda: pump.status.state is LinkState.STREAMING and pump.status.rows >= wanted, "rows to come")
    return pump.status


def lost(pump: Acquisition) -> Link:
    until(lambda: pump.status.state is LinkState.LOST, "the link to be called lost")
    return pump.status


def recent(moment: datetime) -> bool:
    return timedelta(0) <= datetime.now(UTC) - moment < SOON


def test_a_pump_connects_streams_and_counts() -> None:
    blocks = list[Block]()
    with emulator("--at", url := tcp_url()) as process:
        ready(process)
        with pumping(url, blocks) as pump:
            assert pump.status.state is LinkState.CONNECTING
            assert pump.status.rate == 0.0
            assert pump.status.age is None
            link = streaming(pump, 600)
            assert link.identity is not None
            assert link.identity.device_name == "pmsm-bench virtual drive"
            assert link.row_time == pytest.approx(1e-3)
            assert (link.gaps, link.rows_lost, link.reconnects, link.last_error) == (0, 0, 0, None)
            assert recent(link.since)
            assert link.rate == pytest.approx(1000.0, rel=0.2)
            assert link.age is not None
            assert link.age < 1.0
        assert sum(map(len, blocks)) == pump.status.rows  # nothing is told that was not handed on


def test_a_drive_that_is_not_there_is_waited_for() -> None:
    url = tcp_url()
    with pumping(url) as pump:
        until(lambda: pump.status.last_error is not None, "an error")
        link = pump.status
        assert link.state is LinkState.CONNECTING
        assert link.last_error is not None
        assert link.last_error.sentence.startswith("nothing serves a CAN bus at 127.0.0.1:")
        assert recent(link.last_error.time)
        with served(url):
            link = streaming(pump)
            assert link.reconnects == 0
            assert link.last_error is not None
            assert link.since > link.last_error.time


def test_a_drive_that_is_killed_is_lost_since_then_and_comes_back_as_another_session() -> None:
    url, blocks = tcp_url(), list[Block]()
    with pumping(url, blocks) as pump:
        with emulator("--at", url) as process:
            ready(process)
            before = streaming(pump, 300)
            process.kill()
            process.wait()
        link = lost(pump)
        assert recent(link.since)
        assert link.since > before.since
        assert link.last_error is not None
        assert "socketcand can0 at 127.0.0.1:" in link.last_error.sentence
        assert link.rows >= before.rows
        since = link.since
        until(lambda: pump.status.last_error is not link.last_error, "another attempt")
        assert pump.status.since == since  # attempts do not make it lost anew
        with emulator("--at", url) as process:
            ready(process)
            heard = len(blocks)
            link = streaming(pump, 300)
        assert link.reconnects == 1
        first = int(blocks[heard].tick[0])
        assert (link.gaps, link.clock_resets) == (1, 1)  # what it made before it was killed is not known
        assert link.rows_lost == first // 10  # what it has made since then is
        assert link.rows >= before.rows + 300


def test_rows_between_two_sessions_of_a_drive_that_ran_on_are_counted_as_lost() -> None:
    blocks = list[Block]()
    port = free_port()
    with emulator("--at", bus_url(port)) as process:
        ready(process)
        with relayed(port) as relay, pumping(bus_url(relay.port), blocks) as pump:
            streaming(pump, 200)
            relay.cut()
            lost(pump)
            relay.mend()
            link = streaming(pump, 200)
    ticks = [int(tick) for block in blocks for tick in block.tick]
    missing = (ticks[-1] - ticks[0]) // 10 + 1 - len(ticks)
    assert (link.gaps, link.reconnects, link.clock_resets) == (1, 1, 0)
    assert link.rows_lost == missing > 100


def test_a_drive_that_falls_silent_is_lost_and_comes_back_on_the_same_bus() -> None:
    with served(tcp_url()) as drive, pumping(drive.url) as pump:
        streaming(pump, 100)
        drive.running.clear()
        link = lost(pump)
        assert link.last_error is not None
        assert "fell silent: no row for 1" in link.last_error.sentence
        drive.running.set()
        assert streaming(pump, 100).reconnects == 1


def test_another_device_at_the_address_is_named_and_not_streamed() -> None:
    with served(tcp_url()) as drive, pumping(drive.url.replace("/5", "/6")) as pump:
        until(lambda: pump.status.last_error is not None, "an error")
        assert pump.status.last_error is not None
        assert pump.status.last_error.sentence.startswith("no node 6 answered on socketcand can0 at 127.0.0.1:")
        assert pump.status.rows == 0


def test_a_fault_of_the_bench_on_a_block_is_told_and_the_pump_goes_on() -> None:
    seen = list[Block]()

    def refuse_first(block: Block) -> None:
        seen.append(block)
        if len(seen) == 1:
            raise ZeroDivisionError("of all things")

    with served(tcp_url()) as drive:
        pump = Acquisition("spindle", drive.url, refuse_first)
        pump.start()
        until(lambda: len(seen) > 3, "more blocks")
        link = pump.status
        pump.end()
        pump.join(5.0)
    assert link.reconnects == 1
    assert link.last_error is not None
    assert link.last_error.sentence == "the bench failed on this drive: ZeroDivisionError: of all things"


def test_a_pump_ends_quickly_whatever_it_is_doing() -> None:
    with served(tcp_url()) as drive, socket.create_server(("127.0.0.1", 0)) as silent:
        mute = bus_url(silent.getsockname()[1])  # accepts and says nothing
        for url in (drive.url, mute, tcp_url()):
            pump = Acquisition("spindle", url, lambda _: None)
            pump.start()
            if url == drive.url:
                streaming(pump, 10)
            else:
                time.sleep(0.05)
            began = time.monotonic()
            pump.end()
            assert time.monotonic() - began < 1.0
            pump.join(5.0)
            assert not pump.thread.is_alive(), url
            assert time.monotonic() - began < 3.5, url
    Acquisition("spindle", "canopen://nowhere", lambda _: None).end()  # never started


def test_a_service_ends_within_its_time_though_all_its_drives_are_held_up() -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        url = bus_url(silent.getsockname()[1])
        drives = tuple(DriveConfig(f"d{k}", url.replace("/5", f"/{k + 1}"), Window()) for k in range(6))
        with Service(Config(drives)) as service:
            time.sleep(0.05)
            began = time.monotonic()
        assert time.monotonic() - began < 3.0
        assert all(not thread.alive for thread in service.threads() if thread.name == "estimation")
        for pump in [drive.link for drive in service.drives.values()]:
            pump.join(5.0)


def test_estimates_that_the_worker_no_longer_renews_are_old_however_fresh_the_stream() -> None:
    with served(tcp_url()) as drive, Service(Config((DriveConfig("a", drive.url, Window()),))) as service:
        until(lambda: service.estimates("a").result.samples > 100, "estimates")
        service._estimation.stop()
        until(lambda: (service.estimates("a").age or 0.0) > 1.0, "the estimates to age")
        assert (service.link("a").age or 9.0) < 0.5
        assert not service.healthy()
