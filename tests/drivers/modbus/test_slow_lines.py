"""Lines that are slower than the stream, and gateways with habits: nothing old passes for new, what is lost is told."""

import itertools
import re
import threading
import time
from collections.abc import Callable

import numpy as np
import pytest

from bench.live.acquisition import Acquisition
from drivers.block import Block
from drivers.connect import connect
from drivers.drive import Drive
from drivers.errors import ConnectError
from drivers.uart.drive import UartDrive
from drivers.wire import uart_frame as uf
from drivers.wire.uart_url import parse_uart_url
from emulator.servers.faults import Faults, parse_fault
from tests.drivers.modbus.meddling import echoing, meddled, other_numbers, slow
from tests.support import served_modbus, transports
from tests.support.served_drive import Served, emulator, first_blocks, joined, listening, ready, served, until

pytestmark = [pytest.mark.live, pytest.mark.thorough]

SERIAL = {
    "modbus": lambda: served_modbus.pty_url(baudrate=115_200),
    "uart": lambda: transports.pty_url().replace("3000000", "115200"),
}


def port_of(url: str) -> int:
    return int(re.findall(r":(\d+)", url)[-1])


def in_order(blocks: list[Block]) -> bool:
    """No row twice, none of before, and every gap told in rows."""
    gaps = [(int(b.tick[0]) - int(a.tick[-1]) - a.periods, b) for a, b in itertools.pairwise(blocks)]
    return all(gap >= 0 and b.lost_before == -(-gap // b.periods) for gap, b in gaps)


# A line slower than the stream


@pytest.mark.parametrize("make_url", SERIAL.values(), ids=SERIAL)
def test_on_a_slow_line_longer_rows_are_asked_for_and_none_is_old(make_url: Callable[[], str]) -> None:
    """By the drive's time, which passes quicker than ours: 115,200 baud carry a few hundred rows/s, not 1,000."""
    ages = list[float]()

    def aged(drive: Drive, bench: Served) -> list[Block]:
        blocks, deadline = list[Block](), time.monotonic() + 60.0
        for block in drive.stream():
            assert time.monotonic() < deadline, f"rows of {block.periods} control periods, {drive.counts}"
            blocks.append(block)
            ages.append((bench.drive.tick - int(block.tick[-1])) * block.T_s)
            settled = [b for b in blocks if b.periods > 10]
            if sum(map(len, settled)) * block.periods * block.T_s > 4.0:
                return blocks
        raise AssertionError("the stream has ended")

    with served(make_url(), paced=True) as bench, connect(bench.url) as drive:
        assert drive.note == ""
        drive.write("stream_periods", 10.0 if bench.url.startswith("modbus") else 2.0)
        blocks = aged(drive, bench)
        assert re.fullmatch(r"rows of \d+ control periods are asked for, in place of \d+: the line carries .* rows/s",
                            drive.note)
    assert in_order(blocks)
    late = [block for block in blocks if block.periods == blocks[-1].periods][-20:]
    assert sum(block.lost_before for block in late) == 0
    assert max(ages) < 3.0  # s of the drive's time, which is over twice as quick as ours
    assert np.median(ages) < 1.0


def test_a_modbus_stream_that_lags_goes_on_with_the_newest_rows() -> None:
    with served(served_modbus.pty_url(baudrate=57_600), paced=True) as bench, connect(bench.url) as drive:
        drive._lengthen = lambda: None  # pyright: ignore[reportAttributeAccessIssue]
        blocks = first_blocks(drive, 1500)
        assert in_order(blocks)
        lost = sum(block.lost_before for block in blocks)
        span = (int(blocks[-1].tick[-1]) - int(blocks[0].tick[0])) // 10 + 1
        assert lost > 0.3 * span
        assert sum(map(len, blocks)) + lost == span


def test_the_age_of_a_stream_that_lags_is_that_of_its_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    """A line that holds every frame of the stream for a while, from the first on, and answers at once."""
    hand_out, held = UartDrive._hand_out, list[threading.Timer]()

    def late(client: UartDrive, frame: uf.Frame) -> None:
        if frame.kind == uf.Kind.STREAM:
            held.append(threading.Timer(0.6, hand_out, (client, frame)))
            held[-1].start()
        else:
            hand_out(client, frame)

    monkeypatch.setattr(UartDrive, "_hand_out", late)
    ages = list[float]()
    with emulator("--at", url := transports.serial_socket_url()) as process:
        ready(process)
        with connect(url) as drive:
            drive.write("stream_periods", 200.0)
        pump = Acquisition("spindle", url, lambda _block: ages.append(pump.status.age or 0.0))
        pump.start()
        try:
            until(lambda: len(ages) > 30, "no rows")
        finally:
            pump.end()
            pump.join(10.0)
            for timer in held:
                timer.join()
    assert min(ages) > 0.55
    assert np.median(ages) < 1.0


# UART frames twice or late


@pytest.mark.parametrize("text", ["double=0.05", "late=0.02", "delay=0.05"])
def test_uart_frames_twice_or_late_are_passed_over_and_counted(text: str) -> None:
    with served(transports.pty_url()) as bench, UartDrive(parse_uart_url(bench.url)) as drive:
        with listening(drive) as listener:
            bench.server.faults = Faults([parse_fault(text)])
            until(lambda: drive.counts.frames_late > 30 or listener.error is not None, "none is late")
            assert listener.error is None
            seen = listener.rows
            until(lambda: listener.rows > seen + 500 or listener.error is not None, "no rows")
            assert listener.error is None
        assert in_order(listener.blocks)
        bench.end()
        rows = bench.produced()
        place = np.searchsorted(rows["row_tick"], joined(listener.blocks, "tick"))
        assert np.abs(joined(listener.blocks, "i_q") - rows["i_q"][place]).max() <= 24.0 / 65536 * 1.001


@pytest.mark.parametrize("make_url", [served_modbus.tcp_url, served_modbus.pty_url, transports.pty_url])
def test_a_write_whose_answer_or_request_is_lost_is_made_good(make_url: Callable[[], str]) -> None:
    with served(make_url()) as bench, connect(bench.url) as drive:
        bench.server.faults = Faults([parse_fault("lose=0.1")], seed=5)
        for k in range(25):
            drive.write("i_q_ref", k / 10.0)
            assert bench.drive.read("i_q_ref") == pytest.approx(k / 10.0)


# Gateways and adapters


def test_a_gateway_that_returns_another_transaction_number_is_told() -> None:
    with served(served_modbus.tcp_url()) as bench, meddled(port_of(bench.url), other_numbers()) as line:
        expected = r"unit 1 at .* transaction number 80\w\w, expected \w{4}: a gateway that does not return it\?$"
        with pytest.raises(ConnectError, match=expected):
            connect(f"modbus+tcp://127.0.0.1:{line.port}/1")


def test_a_gateway_that_is_slow_is_told_with_its_delay_and_works_where_it_is_waited_for() -> None:
    with served(served_modbus.tcp_url()) as bench, meddled(port_of(bench.url), slow(0.35)) as line:
        expected = r"answers of unit 1 at .* come after 0\.\d\d s, expected within 0.3 s: \?timeout=\d in its URL"
        with pytest.raises(ConnectError, match=expected):
            connect(f"modbus+tcp://127.0.0.1:{line.port}/1")
        with connect(f"modbus+tcp://127.0.0.1:{line.port}?timeout=2/1") as drive:
            drive.write("i_q_ref", 1.0)
            begun = time.monotonic()
            assert drive.read("i_q_ref") == 1.0
            assert time.monotonic() - begun > 0.3


def test_an_adapter_that_echoes_what_is_sent_is_heard_past_its_echo() -> None:
    with (
        served(served_modbus.socket_url()) as bench, meddled(port_of(bench.url), echoing) as line,
        connect(f"modbus+rtu://socket://127.0.0.1:{line.port}/1") as drive,
    ):
        drive.write("i_q_ref", 1.5)
        assert drive.read("i_q_ref") == 1.5
        drive.write("stream_periods", 20.0)
        assert in_order(first_blocks(drive, 100))
