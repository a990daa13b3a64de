"""The Modbus client against the virtual drive, and against what is none: values, rows, recordings, late answers."""

import asyncio
import contextlib
import itertools
import os
import random
import socket
import struct
import threading
import time
from collections.abc import Callable, Generator, Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from drivers import capture, operation
from drivers.connect import connect
from drivers.drive import Drive
from drivers.errors import ConnectError, DriveError, FaultError, FrameError, LostError, NoReplyError, RefusedError
from drivers.modbus import line as modbus_line
from drivers.modbus.turns import Turns
from drivers.wire import modbus_map as registers
from drivers.wire.cia402 import State
from drivers.wire.codec import count_size
from drivers.wire.dictionary import layout_id, layout_text, signal_named
from drivers.wire.modbus_url import parse_modbus_url
from emulator.servers.faults import Faults, parse_fault
from emulator.servers.modbus.row_ring import CAPACITY
from tests.conftest import free_port
from tests.support.served_drive import (
    PATIENCE,
    Listening,
    Served,
    first_blocks,
    in_threads,
    joined,
    listening,
    served,
    until,
)
from tests.support.served_modbus import ALL_URLS, URLS, Disturbed, path_of, pty_url, tcp_url

pytestmark = pytest.mark.live

COLUMNS = ("theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q", "i_d_mean", "i_q_mean", "u_dc")


@pytest.fixture(params=URLS)
def bench(request: pytest.FixtureRequest) -> Iterator[Served]:
    with served(URLS[request.param]()) as drive:
        yield drive


@pytest.fixture
def drive(bench: Served) -> Iterator[Drive]:
    with connect(bench.url) as connected:
        yield connected


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """What waits for answers in vain does so for a short while."""
    monkeypatch.setattr(modbus_line, "REPLY_TIMEOUT", 0.1)


# Rows


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
        off = joined(blocks, name) - rows[name][place]
        if name == "theta_e":
            off = (off + np.pi) % (2.0 * np.pi) - np.pi
        assert np.abs(off).max() <= 0.5 * count_size(signal_named(name), full) * 1.001, name
    assert (blocks[-1].temp_winding, blocks[-1].temp_magnet) == pytest.approx((23.4, 23.4))


def test_rows_of_every_control_period_arrive_without_loss(drive: Drive) -> None:
    drive.write("stream_periods", 1.0)
    blocks = first_blocks(drive, 5000)
    assert all(block.lost_before == 0 for block in blocks)
    assert np.all(np.diff(joined(blocks, "tick")) == 1)


def test_rows_of_any_length_are_the_drives_own(bench: Served, drive: Drive) -> None:
    with listening(drive) as listener:
        for periods in (20.0, 5.0, 10.0, 50.0, 8.0):
            drive.write("stream_periods", periods)
            until(lambda periods=periods: periods in (listener.blocks[-1].periods, listener.error), "no rows")
    assert listener.error is None
    bench.end()
    starts = bench.produced()["row_tick"]
    lengths = dict(zip(starts[:-1].tolist(), np.diff(starts).tolist(), strict=True))
    for block in listener.blocks:
        assert {lengths.get(int(tick), block.periods) for tick in block.tick} == {block.periods}
    for one, other in itertools.pairwise(listener.blocks):
        gap = int(other.tick[0] - one.tick[-1]) - one.periods
        assert other.lost_before == -(-gap // other.periods) >= 0


def test_rows_that_fell_out_of_the_ring_are_a_gap_that_is_counted(bench: Served, drive: Drive) -> None:
    drive.write("stream_periods", 1.0)
    stream = drive.stream()
    first = next(stream)
    bench.running.clear()
    bench.step(3 * CAPACITY)
    bench.running.set()
    blocks = [first]
    while blocks[-1].lost_before == 0:
        blocks.append(next(stream))
    before, after = blocks[-2], blocks[-1]
    assert after.lost_before == after.tick[0] - before.tick[-1] - 1 > CAPACITY
    drive.close()
    assert sum(map(len, stream)) < CAPACITY


def test_a_slow_reader_is_no_silence_of_the_drive() -> None:
    with served(tcp_url()) as bench, connect(bench.url) as drive:
        stream = drive.stream()
        before = next(stream)
        patience = time.monotonic() + 1.2
        until(lambda: time.monotonic() > patience, "time stands still")
        after = next(stream)
        assert after.tick[0] == before.tick[-1] + 10
        drive.close()


def test_a_gap_longer_than_16_bits_of_ticks_is_counted_too() -> None:
    with served(tcp_url()) as bench, connect(bench.url) as drive:
        drive.write("stream_periods", 10.0)
        stream = drive.stream()
        blocks = [next(stream)]
        bench.running.clear()
        bench.step(10 * CAPACITY + 70_000)
        bench.running.set()
        while blocks[-1].lost_before == 0:
            blocks.append(next(stream))
        before, after = blocks[-2], blocks[-1]
        assert 10 * after.lost_before == after.tick[0] - before.tick[-1] - 10 >= 65_536
        drive.close()


def test_somebody_elses_change_of_the_row_length_ends_the_stream() -> None:
    with served(tcp_url()) as bench, connect(bench.url) as drive, listening(drive) as listener:
        with connect(bench.url) as other:
            other.write("stream_periods", 20.0)
        error = listener.ended()
    assert isinstance(error, FrameError)
    assert "somebody else has set stream_periods of unit 1 at" in str(error)
    assert {block.periods for block in listener.blocks} == {10}


def test_a_drive_that_resets_is_lost_and_had_again(bench: Served, drive: Drive) -> None:
    with listening(drive) as listener:
        bench.drive.reset()
        error = listener.ended()
    assert isinstance(error, LostError)
    assert "has reset" in str(error)
    drive.close()
    with connect(bench.url) as again:
        assert len(first_blocks(again, 20)) > 0


def test_a_drive_whose_time_stands_still_is_lost_within_about_a_second(bench: Served, drive: Drive) -> None:
    with listening(drive) as listener:
        bench.running.clear()
        begun = time.monotonic()
        error = listener.ended()
        assert 0.8 < time.monotonic() - begun < 2.0
    assert isinstance(error, LostError)
    assert "fell silent: no row for 1.0 s, expected one every 1 ms" in str(error)


def test_a_stream_may_be_left_and_begun_again(bench: Served, drive: Drive) -> None:
    first = first_blocks(drive, 50)
    left = bench.drive.tick
    until(lambda: bench.drive.tick > left + 200, "its time stands still")
    second = first_blocks(drive, 50)
    assert 10 * second[0].lost_before == second[0].tick[0] - first[-1].tick[-1] - 10 > 0


def test_closing_from_another_thread_ends_the_stream_without_an_error(drive: Drive) -> None:
    with listening(drive) as listener:
        drive.close()
        assert listener.ended() is None


def test_values_come_while_many_rows_are_fetched(drive: Drive) -> None:
    drive.write("stream_periods", 1.0)
    with listening(drive) as listener:
        def work() -> None:
            for k in range(50):
                assert drive.read("u_full") == 387.5
                if threading.current_thread().name.endswith("-0"):
                    drive.write("i_q_ref", k / 100.0)
        begun = time.monotonic()
        in_threads([work] * 4)
        assert time.monotonic() - begun < PATIENCE
        seen = listener.rows
        until(lambda: listener.rows > seen, "the stream starved")
    assert listener.error is None


# Values


def test_a_refusal_names_unit_register_signal_and_code(bench: Served, drive: Drive) -> None:
    expected = r"unit 1 .* answered Modbus exception 3 \(illegal data value\) for register 0x4004 \(i_q_ref\)"
    with pytest.raises(RefusedError, match=expected) as caught:
        drive.write("i_q_ref", 12.5)  # its current limit is 12 A
    assert caught.value.code == 3
    bench.server.faults = Disturbed(0, refused=0x2100)
    with pytest.raises(RefusedError, match=r"exception 6 \(device busy\) for register 0x2008 \(i_q\)") as caught:
        drive.read("i_q")
    assert caught.value.code == 6
    with pytest.raises(RefusedError, match=r"register 0x2008 \(i_q\) is ro, it cannot be written") as caught:
        drive.write("i_q", 1.0)
    assert caught.value.code == 2


def test_all_signals_are_read_as_the_drive_has_them(bench: Served, drive: Drive) -> None:
    bench.running.clear()
    full = {name: bench.drive.read(name) for name in ("i_full", "u_full", "omega_full")}
    for signal in drive.identity.signals:
        step = count_size(signal, full) if signal.full_scale or signal.scale != 1.0 else 0.0
        assert drive.read(signal.name) == pytest.approx(bench.drive.read(signal.name), rel=1e-7, abs=0.5001 * step)


def test_what_reads_back_otherwise_is_told(bench: Served, drive: Drive) -> None:
    def changed(frame: bytes) -> bytes:
        return frame.replace(struct.pack(">f", 1.5), struct.pack(">f", 2.5))

    if not bench.url.startswith("modbus+tcp"):
        return  # its checksum would tell before
    bench.server.faults = Disturbed(1, change=changed)
    with pytest.raises(FrameError, match=r"took 0x3fc00000 for register 0x4004 \(i_q_ref\), but reads back 0x40200000"):
        drive.write("i_q_ref", 1.5)


def test_nothing_is_stored_that_does_not_read_the_same_twice() -> None:
    with served(tcp_url()) as bench, connect(bench.url) as drive:
        blocks = len(registers.blocks(s for s in drive.identity.signals if s.is_parameter))
        stored = bench.drive._memory.count
        bench.server.faults = Disturbed(
            1, skip=2 * blocks + 1, change=lambda frame: frame[:-1] + bytes([frame[-1] ^ 1])
        )
        with pytest.raises(FrameError, match=r"is not told to store: read twice, \w+ changed in between"):
            operation.store(drive)
        tick = bench.drive.tick
        until(lambda: bench.drive.tick > tick + 200, "its time stands still")
        assert bench.drive._memory.count == stored
        operation.store(drive)
        until(lambda: bench.drive._memory.count > stored, "nothing is stored")


def test_parameters_that_are_stored_outlive_a_reset_and_restored_ones_are_as_delivered(
    bench: Served, drive: Drive
) -> None:
    drive.write("bandwidth", 777.0)
    operation.store(drive)
    drive.write("bandwidth", 888.0)
    reset(bench)
    assert drive.read("bandwidth") == 777.0
    operation.restore(drive)
    assert drive.read("bandwidth") == 777.0
    reset(bench)
    assert drive.read("bandwidth") not in (777.0, 888.0)


def reset(bench: Served) -> None:
    before = bench.drive._reset_at
    bench.drive.reset()
    until(lambda: bench.drive._reset_at > before, "it does not reset")


def test_the_state_machine_goes_all_its_ways(drive: Drive) -> None:
    operation.disable(drive)
    assert operation.state(drive) is State.SWITCH_ON_DISABLED
    operation.enable(drive)
    assert operation.state(drive) is State.OPERATION_ENABLED
    drive.write("watchdog_time", 1e-4)  # shorter than any request takes
    until(lambda: operation.state(drive) is State.FAULT, "no fault")
    with pytest.raises(FaultError, match="the bench fell silent"):
        operation.enable(drive)
    drive.write("watchdog_time", 0.0)
    operation.reset_fault(drive)
    assert operation.fault(drive) is None
    operation.enable(drive)
    operation.quick_stop(drive)
    operation.disable(drive)


# Recordings


def test_a_recording_is_uploaded_piece_by_piece_and_resumed_where_it_stood(bench: Served, drive: Drive) -> None:
    setup = capture.Setup(("i_d", "theta_e", "i_a"), 2000, trigger="i_q", level=0.0, edge=0, pre=100)
    capture.arm(drive, setup)
    under_way = capture.awaited(drive, setup, PATIENCE)
    pieces = drive.captured(0, under_way.count)
    under_way.data += next(pieces) + next(pieces)[:-3]  # here the line breaks
    done: list[int] = []
    found = capture.upload(drive, under_way, done.append)
    assert done == sorted(done)
    assert len(done) > 10
    assert done[-1] == 2000
    assert bytes(under_way.data) == bench.drive.captured(0, 65536)
    assert {name: len(column) for name, column in found.columns.items()} == {"i_d": 2000, "theta_e": 2000, "i_a": 2000}
    assert found.tick == bench.drive.read("capture_tick")


def test_another_recording_in_the_middle_of_an_upload_is_told(drive: Drive) -> None:
    setup = capture.Setup(("i_d", "i_q"), 1000)
    capture.arm(drive, setup)
    capture.awaited(drive, setup, PATIENCE)
    pieces = drive.captured(0, 1000)
    next(pieces)
    capture.arm(drive, setup)
    with pytest.raises(RefusedError, match="no longer has recording 1, it has 2"):
        list(pieces)


def test_a_drive_without_a_recording_gives_no_samples(drive: Drive) -> None:
    assert list(drive.captured(0, 100)) == []


# Late answers


@pytest.mark.usefixtures("impatient")
def test_late_and_double_answers_never_become_another_registers_value(bench: Served, drive: Drive) -> None:
    expected = {"T_s": 1e-4, "u_full": 387.5, "i_full": 24.0, "control_R_s": 0.9664, "n_p": 4.0, "bandwidth": 2000.0}
    drive.write("bandwidth", 2000.0)
    chance, answered = random.Random(3), 0
    for _ in range(12):
        name = chance.choice(sorted(expected))
        bench.server.faults = Disturbed(
            chance.choice([1, 1, 2]), delay=chance.choice([0.0, 0.15, 0.35, 0.7]), copies=chance.choice([1, 2, 3]),
            skip=chance.choice([0, 1]),  # in the drive's time, which is faster
        )
        try:
            assert drive.read(name) == expected[name], name
            answered += 1
        except (NoReplyError, FrameError):
            pass
    assert answered > 3
    bench.server.faults = Faults()
    until(lambda: soon(drive), "the line stays disturbed")
    for name, value in expected.items():
        assert drive.read(name) == value


def soon(drive: Drive) -> bool:
    try:
        return drive.read("u_full") == 387.5
    except (NoReplyError, FrameError):
        return False


def test_an_answer_of_the_same_number_that_is_of_another_register_is_no_value() -> None:
    """As it was asked for by a client before this one, which counts its requests, too."""
    i_full, u_full = (registers.address_of(signal_named(name)) for name in ("i_full", "u_full"))

    def of_the_other(answer: bytes) -> bytes:
        return answer.replace(struct.pack(">I", u_full), struct.pack(">I", i_full)).replace(
            struct.pack(">f", 387.5), struct.pack(">f", 24.0)
        )

    with served(tcp_url()) as bench, connect(bench.url) as drive:
        bench.server.faults = Disturbed(1000, change=of_the_other)
        with pytest.raises(FrameError, match=rf"answered from {i_full} on, expected {u_full}, for .*\(u_full\)"):
            drive.read("u_full")
        bench.server.faults = Faults()
        assert drive.read("u_full") == 387.5


def test_no_two_clients_number_their_requests_alike(bench: Served) -> None:
    def number() -> list[int]:
        with contextlib.closing(modbus_line.ModbusLine(parse_modbus_url(bench.url))) as line:
            line.window(registers.REGISTERS, registers.address_of(signal_named("T_s")), 2, "T_s")
            return line.read(registers.REQUEST, 1)

    assert len({number()[0] for _ in range(4)}) > 1


@pytest.mark.usefixtures("impatient")
def test_a_write_whose_answer_is_late_is_not_taken_for_another(bench: Served, drive: Drive) -> None:
    bench.server.faults = Disturbed(1, delay=0.7, skip=1)  # of the drive's time, which is faster
    with contextlib.suppress(NoReplyError, FrameError):
        drive.write("i_q_ref", 1.0)
    for value in (2.0, 3.0):
        with contextlib.suppress(NoReplyError, FrameError):
            drive.write("i_q_ref", value)
            assert bench.drive.read("i_q_ref") == value
    until(lambda: soon(drive), "the line stays disturbed")


@pytest.mark.usefixtures("impatient")
def test_rows_come_whole_over_a_line_that_delays_doubles_and_loses() -> None:
    for url in (tcp_url(), pty_url()):
        with served(url) as bench, connect(bench.url) as drive:
            bench.server.faults = Faults(map(parse_fault, ("lose=0.01", "double=0.05", "delay=0.05")), 7)
            blocks = first_blocks(drive, 1000)
            bench.end()
            ticks = joined(blocks, "tick")
            assert np.all(np.diff(ticks) % 10 == 0)
            assert np.all(np.diff(ticks) > 0)
            assert int(np.diff(ticks).sum()) // 10 + 1 - len(ticks) == sum(block.lost_before for block in blocks)
            rows = bench.produced()
            place = np.searchsorted(rows["row_tick"], ticks)
            assert np.array_equal(rows["row_tick"][place], ticks)
            assert np.abs(joined(blocks, "i_q") - rows["i_q"][place]).max() <= 24.0 / 65536 * 1.001


# Loss and return


def test_a_unit_that_is_not_there_is_told_in_time(bench: Served) -> None:
    other = bench.url.removesuffix("/1") + "/2"
    begun = time.monotonic()
    with pytest.raises(ConnectError, match=r"no unit 2 answered (at|on) .* within 0.9\d* s"):
        connect(other)
    assert time.monotonic() - begun < 2.0


@pytest.mark.parametrize(
    ("url", "sentence"),
    [
        (f"modbus+tcp://127.0.0.1:{free_port()}/1", r"nothing serves Modbus at 127.0.0.1:\d+: Connection refused"),
        ("modbus+tcp://nowhere.invalid/1", "nothing serves Modbus at nowhere.invalid:502: "),
        ("modbus+rtu:///dev/nowhere/1", "nothing serves Modbus on /dev/nowhere: .*No such file"),
        (f"modbus+rtu://socket://127.0.0.1:{free_port()}/1", "nothing serves Modbus on socket://127.0.0.1"),
        ("modbus+rtu://nothing://x/1", "nothing serves Modbus on nothing://x: invalid URL"),
    ],
    ids=["port", "host", "device", "socket", "scheme"],
)
def test_a_line_that_is_not_there_is_one_sentence(url: str, sentence: str) -> None:
    with pytest.raises(ConnectError, match=sentence) as caught:
        connect(url)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("make_url", ALL_URLS.values(), ids=ALL_URLS)
def test_a_server_that_goes_is_lost_and_had_again_when_it_is_back(make_url: Callable[[], str]) -> None:
    url = make_url()
    with served(url) as bench:
        drive = connect(url)
        listener = Listening(drive)
        until(lambda: listener.rows > 20, "no rows")
        bench.server.close()
        error = listener.ended()
        assert isinstance(error, LostError)
        assert "unit 1" in str(error)
        with pytest.raises(LostError):
            drive.read("i_q")
        drive.close()
        with pytest.raises(ConnectError):
            connect(url)
    with served(url), connect(url) as again:
        assert len(first_blocks(again, 20)) > 0


@pytest.mark.parametrize("make_url", URLS.values(), ids=URLS)
def test_coming_and_going_leaves_no_file_open(make_url: Callable[[], str]) -> None:
    def open_files() -> int:
        return len(os.listdir("/proc/self/fd"))  # noqa: PTH208

    before = open_files()
    with served(make_url()) as bench:
        for _ in range(2):
            with connect(bench.url) as drive:
                first_blocks(drive, 5)
            with pytest.raises(ConnectError):
                connect(bench.url.removesuffix("/1") + "/9")
    until(lambda: open_files() <= before, "files left open")


def test_a_serial_line_in_use_is_one_sentence() -> None:
    with served(pty_url()) as bench, connect(bench.url):
        expected = f"nothing serves Modbus on {path_of(bench.url)}: another program holds it"
        with pytest.raises(ConnectError, match=expected):
            connect(bench.url)


# What is no such drive


@contextlib.contextmanager
def simulator(device: SimDevice) -> Generator[str]:
    """A server of another make with registers of its own, in a thread; its URL."""
    port, loop, begun = free_port(), asyncio.new_event_loop(), threading.Event()
    servers: list[Any] = []

    async def serve() -> None:
        servers.append(ModbusTcpServer(device, address=("127.0.0.1", port)))
        await servers[0].serve_forever(background=True)
        begun.set()
        await servers[0].serving

    def run() -> None:
        with contextlib.closing(loop):
            loop.run_until_complete(serve())

    thread = threading.Thread(target=run, name="simulator")
    thread.start()
    try:
        assert begun.wait(PATIENCE)
        yield f"modbus+tcp://127.0.0.1:{port}/1"
    finally:
        asyncio.run_coroutine_threadsafe(servers[0].shutdown(), loop)
        thread.join(PATIENCE)


def test_another_device_is_told_in_one_sentence_before_anything_is_written() -> None:
    written: list[int] = []

    async def seen(
        function: int, start: int, address: int, count: int, current: list[int], values: list[int] | list[bool] | None
    ) -> None:
        del start, address, count, current
        if values is not None or function not in (3, 4):
            written.append(function)

    device = SimDevice(1, simdata=[SimData(0, count=200, values=17, datatype=DataType.REGISTERS)], action=seen)
    with simulator(device) as url:
        expected = rf"unit 1 at .* has another signal layout: expected {layout_text()}, got 0x00110011"
        with pytest.raises(ConnectError, match=expected) as caught:
            connect(url)
    assert "\n" not in str(caught.value)
    assert written == []


def test_a_device_without_such_registers_is_told_in_one_sentence() -> None:
    device = SimDevice(1, simdata=[SimData(100, count=5, values=17, datatype=DataType.REGISTERS)])
    expected = (
        r"unit 1 at .* is no such drive: it has no identity where one is expected; "
        r"unit 1 at .* answered Modbus exception 2 \(illegal data address\) for register 0x0000 \(identity\)"
    )
    with simulator(device) as url, pytest.raises(ConnectError, match=expected):
        connect(url)


def test_a_drive_of_ours_behind_another_make_of_server_is_known_by_its_head() -> None:
    head = registers.our_head(layout_id() ^ 1, 1).words()
    device = SimDevice(1, simdata=[SimData(0, values=head, datatype=DataType.REGISTERS)])
    expected = r"unit 1 at .* \('pmsm-bench virtual drive'\) has another signal layout"
    with simulator(device) as url, pytest.raises(ConnectError, match=expected):
        connect(url)


# Answers that cannot be


class Liar:
    """A TCP server that answers each request with the next of some bytes; the last goes on for ever."""

    def __init__(self, answer: Callable[[bytes], bytes]) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._answer = answer
        self.port: int = self._listener.getsockname()[1]
        self._clients: list[socket.socket] = []
        self._threads = [threading.Thread(target=self._accept)]
        self._threads[0].start()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                self._clients.append(client)
                self._threads.append(threading.Thread(target=self._serve, args=(client,)))
                self._threads[-1].start()

    def _serve(self, client: socket.socket) -> None:
        with contextlib.suppress(OSError), client:
            while request := client.recv(1 << 12):
                answer = self._answer(request)
                if not answer:
                    return
                client.sendall(answer)

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._threads[0].join()
        for client in self._clients:
            with contextlib.suppress(OSError):
                client.shutdown(socket.SHUT_RDWR)
        for thread in self._threads[1:]:
            thread.join()


@pytest.mark.usefixtures("impatient")
@given(data=st.data())
@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_no_answer_breaks_a_client_or_becomes_a_drive(data: st.DataObject) -> None:
    noise = [data.draw(st.binary(max_size=60)) for _ in range(4)]
    kind = data.draw(st.sampled_from(["bytes", "header", "function", "head"]))
    count = itertools.count()

    def answer(request: bytes) -> bytes:
        some = noise[next(count) % len(noise)]
        head = request[:4] + (len(some) + 1).to_bytes(2, "big") + request[6:7]
        return {
            "bytes": some,
            "header": head + some,
            "function": head[:4] + (len(some) + 2).to_bytes(2, "big") + request[6:8] + some,
            "head": request[:4] + bytes([0, 55]) + request[6:8] + bytes([52]) + some.ljust(52, b"\0")[:52],
        }[kind]

    with contextlib.closing(Liar(answer)) as liar, pytest.raises(ConnectError) as caught:
        connect(f"modbus+tcp://127.0.0.1:{liar.port}/1")
    assert "\n" not in str(caught.value)


@pytest.mark.usefixtures("impatient")
def test_an_answer_without_an_end_is_told_by_how_it_begins() -> None:
    with contextlib.closing(Liar(lambda request: request[:4] + b"\0\5\1" + bytes(50_000))) as liar:
        told = pytest.raises(ConnectError, match=r"with what is no Modbus: \w\w( \w\w){23} \.\.\. \(\d+ bytes\)$")
        with told as caught:
            connect(f"modbus+tcp://127.0.0.1:{liar.port}/1")
    assert len(str(caught.value)) < 250


@pytest.mark.usefixtures("impatient")
@given(noise=st.binary(min_size=1, max_size=80))
@settings(max_examples=5, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_no_bytes_on_a_serial_line_break_a_client(noise: bytes) -> None:
    with contextlib.closing(Liar(lambda _: noise)) as liar, pytest.raises(ConnectError) as caught:
        connect(f"modbus+rtu://socket://127.0.0.1:{liar.port}/1")
    assert "\n" not in str(caught.value)


@given(seed=st.integers(0, 1 << 30))
@settings(max_examples=10, deadline=None)
def test_corrupted_answers_become_no_value_over_a_serial_line(corrupted: Drive, disturbed: Served, seed: int) -> None:
    chance = random.Random(seed)

    def flipped(frame: bytes) -> bytes:
        data = bytearray(frame)
        data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
        return bytes(data)

    disturbed.server.faults = Disturbed(chance.choice([1, 2]), change=flipped, skip=chance.choice([0, 1]))
    for name, value in (("u_full", 387.5), ("control_R_s", 0.9664), ("T_s", 1e-4)):
        with contextlib.suppress(DriveError):
            assert corrupted.read(name) == value


@pytest.fixture(scope="module")
def disturbed() -> Iterator[Served]:
    with served(pty_url()) as bench:
        yield bench


@pytest.fixture(scope="module")
def corrupted(disturbed: Served) -> Iterator[Drive]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(modbus_line, "REPLY_TIMEOUT", 0.1)
        with connect(disturbed.url) as drive:
            yield drive


def test_another_baud_rate_is_told_before_anything_is_written(capfd: pytest.CaptureFixture[str]) -> None:
    url = pty_url()
    with served(url) as bench:
        with pytest.raises(ConnectError) as told:
            connect(url.replace("baudrate=1000000", "baudrate=115200"))
        assert "\n" not in str(told.value)
        with connect(url) as drive:
            assert drive.read("u_full") == bench.drive.read("u_full")
    assert capfd.readouterr().err == ""


def test_turns_are_taken_in_the_order_in_which_threads_come() -> None:
    turns, order = Turns(), list[int]()

    def take(k: int) -> None:
        with turns:
            order.append(k)

    threads = [threading.Thread(target=take, args=(k,)) for k in range(8)]
    with turns:
        for k, thread in enumerate(threads):
            thread.start()
            until(lambda k=k: len(turns._waiting) == k + 1, "it does not wait")
    for thread in threads:
        thread.join()
    assert order == list(range(8))
