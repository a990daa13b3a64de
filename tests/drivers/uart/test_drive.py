"""The client on a serial line against the virtual drive, on a pseudo-terminal and over TCP: all that a bench does."""

import contextlib
import itertools
import os
import random
import socket
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers import capture, operation
from drivers.block import Block
from drivers.connect import connect
from drivers.errors import ConnectError, DriveError, FaultError, FrameError, LostError, NoReplyError, RefusedError
from drivers.uart import drive as uart_drive
from drivers.uart.drive import UartDrive, _Upload
from drivers.wire import uart_frame as uf
from drivers.wire.cia402 import State
from drivers.wire.codec import count_size, counts_to_si
from drivers.wire.dictionary import CAPTURE_SAMPLES, STREAM_ROW, layout_id, layout_text, signal_named
from drivers.wire.uart_url import parse_uart_url
from emulator.drive.virtual_drive import VirtualDrive
from emulator.errors import BusError
from emulator.scenario.scenarios import PAPER
from emulator.servers.faults import Faults, parse_fault
from emulator.servers.uart import UartServer
from tests.support.served_drive import (
    PATIENCE,
    Listening,
    Served,
    emulator,
    first_blocks,
    in_threads,
    joined,
    listening,
    ready,
    served,
    until,
)
from tests.support.transports import pty_url, serial_socket_url

pytestmark = pytest.mark.live

URLS = {"pty": pty_url, "socket": serial_socket_url}


@pytest.fixture(params=URLS)
def url(request: pytest.FixtureRequest) -> str:
    return URLS[request.param]()


@pytest.fixture
def bench(url: str) -> Iterator[Served]:
    with served(url) as drive:
        yield drive


@pytest.fixture
def drive(bench: Served) -> Iterator[UartDrive]:
    with UartDrive(parse_uart_url(bench.url)) as connected:
        yield connected


def check(bench: Served, blocks: list[Block]) -> None:
    """Fail where a value of a block is not what the drive produced at that tick, to half a count."""
    produced = bench.produced()
    full = {name: bench.drive.read(name) for name in ("i_full", "u_full", "omega_full")}
    ticks = joined(blocks, "tick")
    place = np.searchsorted(produced["row_tick"], ticks)
    assert np.array_equal(produced["row_tick"][place], ticks)
    for name in STREAM_ROW:
        off = joined(blocks, name) - produced[name][place]
        if name == "theta_e":
            off = (off + np.pi) % (2.0 * np.pi) - np.pi
        assert np.abs(off).max() <= 0.5 * count_size(signal_named(name), full) * 1.001, name


# Values


def test_a_refusal_is_told_with_line_signal_and_code(drive: UartDrive) -> None:
    with pytest.raises(RefusedError, match=r"the drive at .* refused 0x2300:2 \(i_q_ref\) with 0x06090030: value") as e:
        drive.write("i_q_ref", 12.5)  # its current limit is 12 A
    assert e.value.code == 0x06090030


def test_many_threads_ask_at_once_while_rows_come(drive: UartDrive) -> None:
    expected = {"T_s": 1e-4, "u_full": 387.5, "control_R_s": 0.9664, "n_p": 4.0, "i_full": 24.0, "control_L_d": 4.24e-3}

    def reading(name: str, value: float) -> Callable[[], None]:
        def job() -> None:
            assert {drive.read(name) for _ in range(200)} == {value}
        return job

    with listening(drive) as listener:
        in_threads([reading(name, value) for name, value in expected.items()])
    assert listener.error is None
    assert drive.counts.rows_lost == 0


# The stream


def test_what_the_drive_produced_arrives_within_half_a_count(bench: Served, drive: UartDrive) -> None:
    drive.write("stream_periods", 1.0)
    blocks = first_blocks(drive, 20_000)
    bench.end()
    ticks = joined(blocks, "tick")
    assert np.array_equal(ticks, ticks[0] + np.arange(len(ticks)))
    assert all(block.lost_before == 0 and block.periods == 1 for block in blocks)
    assert blocks[-1].temp_winding == pytest.approx(23.4)
    assert blocks[-1].temp_magnet == pytest.approx(23.4)
    check(bench, blocks)


def test_rows_of_any_length_follow_each_other_without_a_gap(bench: Served, drive: UartDrive) -> None:
    wanted = (20.0, 5.0, 1.0, 50.0, 7.0, 1000.0, 8.0)
    with listening(drive) as listener:
        for periods in wanted:
            drive.write("stream_periods", periods)
            until(lambda periods=periods: listener.blocks[-1].periods == periods, f"no rows of {periods} periods")
    assert listener.error is None
    assert [length for length, _ in itertools.groupby(b.periods for b in listener.blocks)] == [10, *wanted]
    for one, other in itertools.pairwise(listener.blocks):
        assert other.tick[0] == one.tick[-1] + one.periods
        assert other.lost_before == 0
    check(bench, listener.blocks)


def test_a_stream_that_is_left_stops_and_can_be_begun_again(bench: Served, drive: UartDrive) -> None:
    first = first_blocks(drive, 50)
    assert all(line.stream is None for line in bench.server._lines.values())
    left = bench.drive.tick
    until(lambda: bench.drive.tick > left + 200, "its time stands still")
    second = first_blocks(drive, 50)
    gap = int(second[0].tick[0] - first[-1].tick[-1]) - 10
    assert second[0].lost_before == gap // 10 > 0


@pytest.mark.parametrize("url", [pty_url()], ids=["pty"])  # TCP keeps megabytes on the way
def test_a_client_that_does_not_read_does_not_hold_the_drive_up(bench: Served, drive: UartDrive) -> None:
    drive.write("stream_periods", 1.0)
    stream = drive.stream()
    before = [next(stream)]

    def deaf() -> bytes:
        threading.Event().wait(0.02)
        return b""

    received, drive._received = drive._received, deaf
    bench.burst, bench.patient = 500, False
    until(lambda: bench.server.rows_dropped > 1000, "nothing was dropped")
    drive._received = received
    until(lambda: before.append(next(stream)) or before[-1].lost_before > 0, "the gap is not told")
    stream.close()  # pyright: ignore[reportAttributeAccessIssue, reportUnknownMemberType]
    bench.end()
    check(bench, before)
    assert before[-1].lost_before == before[-1].tick[0] - before[-2].tick[-1] - 1


def test_pacing_by_the_baud_rate_lets_through_what_the_line_carries() -> None:
    """At 115200 baud 11520 bytes a second: of rows of one period, about 590 a second of the drive's time."""
    url = pty_url().replace("3000000", "115200")
    with served(url, paced=True) as bench, UartDrive(parse_uart_url(url)) as drive:
        drive.write("stream_periods", 1.0)
        blocks = first_blocks(drive, 2400)
        bench.end()
        check(bench, blocks)
        blocks = blocks[len(blocks) // 3 :]  # by then the line is as far behind as it will be
        time_passed = (blocks[-1].tick[-1] - blocks[0].tick[0]) * 1e-4  # s
        assert 18 * sum(map(len, blocks)) / time_passed == pytest.approx(11520 * 0.9, rel=0.15)


# The state machine, the memory, the watchdog


def test_the_state_machine_goes_its_ways(bench: Served, drive: UartDrive) -> None:
    operation.disable(drive)
    assert operation.state(drive) is State.SWITCH_ON_DISABLED
    operation.enable(drive)
    assert operation.state(drive) is State.OPERATION_ENABLED
    operation.quick_stop(drive)
    assert operation.state(drive) is State.QUICK_STOP_ACTIVE
    operation.enable(drive)
    assert operation.fault(drive) is None
    assert bench.server.rows_dropped == 0


def test_a_fault_is_told_by_itself_and_left_by_a_reset(url: str) -> None:
    scenario = replace(PAPER, drive=replace(PAPER.drive, temperature_trip=60.0))
    with served(url, scenario) as bench, UartDrive(parse_uart_url(url)) as drive:
        operation.enable(drive)
        bench.drive.set_temperature(80.0)
        until(lambda: drive.fault_code == 0x4210, "no fault was told")
        with pytest.raises(FaultError, match="motor too hot"):
            operation.enable(drive)
        bench.drive.set_temperature(25.0)
        operation.reset_fault(drive)
        operation.enable(drive)


def test_what_is_stored_is_there_after_a_reset_and_what_is_not_is_not(bench: Served, drive: UartDrive) -> None:
    drive.write("control_R_s", 1.5)
    operation.store(drive)
    drive.write("control_R_s", 2.5)
    bench.drive.reset()
    until(lambda: drive.read("control_R_s") == 1.5, "what was stored is not there")
    operation.restore(drive)
    bench.drive.reset()
    until(lambda: drive.read("control_R_s") == 0.9664, "what was delivered is not there")


# The recorder


def recorded(bench: Served, drive: UartDrive, length: int, burst: int = 500) -> capture.Upload:
    setup = capture.Setup(("theta_e", "i_d", "i_q", "u_d", "u_q", "i_a"), length)
    bench.burst = burst
    capture.arm(drive, setup)
    return capture.awaited(drive, setup, 15.0)


def test_a_recording_arrives_as_the_drive_has_it(bench: Served, drive: UartDrive) -> None:
    under_way = recorded(bench, drive, 5000)
    told = list[int]()
    got = capture.upload(drive, under_way, told.append)
    counts = np.frombuffer(bench.drive.captured(0, CAPTURE_SAMPLES), "<i2").reshape(5000, 6)
    full = {name: getattr(drive.identity, name) for name in ("i_full", "u_full", "omega_full")}
    assert np.array_equal(np.array(list(got.columns.values())), counts_to_si(counts, tuple(got.columns), full))
    assert got.t[-1] - got.t[0] == pytest.approx(0.4999)
    assert np.abs(got.columns["u_q"]).max() > 10.0 * count_size(signal_named("u_q"), full)
    assert told == sorted(told)
    assert told[-1] == 5000
    assert len(told) > 10


def test_an_upload_goes_on_where_it_stood_after_the_link_is_lost(bench: Served) -> None:
    with UartDrive(parse_uart_url(bench.url)) as drive:
        under_way = recorded(bench, drive, 20_000)
        whole = bench.drive.captured(0, CAPTURE_SAMPLES)

        def cut(done: int) -> None:
            if done > 5000:
                drive.close()

        with pytest.raises(LostError, match="is closed"):
            capture.upload(drive, under_way, cut)
    stood = under_way.done
    assert 5000 < stood < 20_000
    with UartDrive(parse_uart_url(bench.url)) as drive:
        seen = list[int]()
        capture.upload(drive, under_way, seen.append)
        assert seen[0] > stood
    assert bytes(under_way.data) == whole


def test_a_recording_is_uploaded_while_rows_come_without_loss(bench: Served, drive: UartDrive) -> None:
    drive.write("stream_periods", 1.0)
    under_way = recorded(bench, drive, CAPTURE_SAMPLES)
    bench.burst = 40
    with listening(drive) as listener:
        capture.upload(drive, under_way)
    bench.end()
    assert bytes(under_way.data) == bench.drive.captured(0, CAPTURE_SAMPLES)
    assert listener.error is None
    assert drive.counts.rows_lost == 0


def test_a_piece_of_another_recording_is_refused_and_one_out_of_turn_is_asked_for_again() -> None:
    upload = _Upload(10, 100)
    assert upload.taken(uf.PIECE.pack(1, 10, 1) + b"abcd") == b"abcd"
    assert upload.taken(uf.PIECE.pack(1, 13, 1) + b"ef") is None
    assert upload.missing == uf.SPAN.pack(12, 98)
    with pytest.raises(RefusedError, match="the drive has recording 2 by now, and no longer 1"):
        upload.taken(uf.PIECE.pack(2, 12, 1) + b"ef")


# Who is there, and who is gone


def test_a_line_without_a_drive_is_told(tmp_path: Path) -> None:
    with pytest.raises(ConnectError, match=r"cannot open /.*/ttyNONE at 3000000 baud: No such file or directory"):
        connect(f"uart://{tmp_path}/ttyNONE")
    with pytest.raises(ConnectError, match=r"cannot open socket://127.0.0.1:\d+: Connection refused"):
        connect(serial_socket_url())


def test_a_line_that_another_client_holds_is_told() -> None:
    url = pty_url()
    told = pytest.raises(ConnectError, match=r"cannot open .* at 3000000 baud: another program holds it$")
    with served(url), connect(url), told:
        connect(url)


def test_another_baud_rate_is_told_before_anything_is_written(capfd: pytest.CaptureFixture[str]) -> None:
    url = pty_url()
    with served(url) as bench:
        begun = time.monotonic()
        with pytest.raises(ConnectError, match=r"no drive answered at .* at 115200 baud within 0.9 s: nothing came"):
            connect(url.replace("3000000", "115200"))
        assert time.monotonic() - begun < 2.0
        bench.server._lines[next(iter(bench.server._lines))].begin_stream(1)
        with pytest.raises(ConnectError, match=r"\d+ bytes came within 0.9 s, but no frame; it is another device, or"):
            connect(url.replace("3000000", "115200"))
        with connect(url) as drive:
            assert len(first_blocks(drive, 20)) > 0
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("came", [bytes(200), b"\x80" * 200], ids=["a break", "no end of a frame"])
def test_bytes_without_a_frame_are_not_told_as_silence(came: bytes) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]

        def send() -> None:
            with server.accept()[0] as line:
                line.recv(4096)  # what comes before the client's first request is not for it
                line.sendall(came)
                while line.recv(4096):
                    pass

        thread = threading.Thread(target=send)
        thread.start()
        with pytest.raises(ConnectError, match=r"200 bytes came within 0.9 s, but no frame; it is another device, or"):
            connect(f"uart://socket://127.0.0.1:{port}")
        thread.join(PATIENCE)


def test_leaving_removes_the_path_and_a_killed_drives_path_is_taken_over(tmp_path: Path) -> None:
    path = tmp_path / "tty"
    path.symlink_to("/dev/pts/99999")
    with served(f"uart://{path}"), connect(f"uart://{path}"):
        assert path.is_symlink()
    assert not path.is_symlink()
    path.write_text("mine")
    with pytest.raises(BusError, match=f"cannot serve a serial line at {path}: File exists"):
        UartServer(VirtualDrive(PAPER), parse_uart_url(f"uart://{path}"))
    assert path.read_text() == "mine"


def test_a_port_that_is_taken_is_told() -> None:
    url = serial_socket_url()
    with (
        served(url),
        pytest.raises(BusError, match=r"cannot serve a serial line at 127.0.0.1:\d+: Address already in use"),
    ):
        UartServer(VirtualDrive(PAPER), parse_uart_url(url))


def test_a_drive_that_resets_is_lost_and_can_be_had_again(bench: Served, drive: UartDrive) -> None:
    with listening(drive) as listener:
        bench.drive.reset()
        error = listener.ended()
        assert isinstance(error, LostError)
        assert str(error).endswith("has reset")
    with connect(bench.url) as again:
        assert len(first_blocks(again, 20)) > 0


def test_a_tick_that_jumps_back_is_a_reset_where_its_event_was_lost(bench: Served, drive: UartDrive) -> None:
    drive._note = lambda event: None
    with listening(drive) as listener:
        bench.drive.reset()
        error = listener.ended()
        assert isinstance(error, LostError)
        assert str(error).endswith("has reset")


def test_a_drive_that_falls_silent_is_lost_within_about_a_second(bench: Served, drive: UartDrive) -> None:
    with listening(drive) as listener:
        bench.running.clear()
        begun = time.monotonic()
        error = listener.ended()
        assert 0.8 < time.monotonic() - begun < 1.6
    assert isinstance(error, LostError)
    assert "fell silent: no row for 1.0 s, expected one every 1 ms" in str(error)


def test_a_line_that_is_unplugged_is_lost_at_once_and_had_again_when_it_is_back(url: str) -> None:
    with served(url) as bench:
        drive = UartDrive(parse_uart_url(url))
        listener = Listening(drive)
        until(lambda: listener.rows > 20, "no rows")
        bench.end()
        bench.server.close()
        begun = time.monotonic()
        assert isinstance(listener.ended(), LostError)
        assert time.monotonic() - begun < 1.0
        with pytest.raises(LostError, match=r"is gone: ."):
            drive.read("i_d")
        with pytest.raises(ConnectError, match="cannot open"):
            connect(url)
        drive.close()
    with served(url), connect(url) as again:
        assert len(first_blocks(again, 20)) > 0


def test_coming_and_going_leaves_no_file_open(url: str) -> None:
    def open_files() -> int:
        return len(os.listdir("/proc/self/fd"))  # noqa: PTH208

    before = open_files()
    with served(url):
        for _ in range(3):
            with connect(url) as drive:
                first_blocks(drive, 5)
    with contextlib.suppress(ConnectError):
        connect(url)
    until(lambda: open_files() <= before, "files left open")


class OtherServer(UartServer):
    """A drive of another layout."""

    def _identify(self, _line: object, _frame: uf.Frame) -> bytes:
        return uf.IDENTITY.pack(0, 0, 0, 0, layout_id() ^ 1) + b"another"


def test_a_drive_with_another_layout_is_told_before_anything_else_is_asked(url: str) -> None:
    sentence = rf"\('another'\) has another signal layout: expected {layout_text()}, got 0x{layout_id() ^ 1:08X}"
    with OtherServer(VirtualDrive(PAPER), parse_uart_url(url)), pytest.raises(ConnectError, match=sentence):
        connect(url)


# Noise


def test_noise_makes_gaps_that_are_told_and_never_a_wrong_value(url: str) -> None:
    with served(url) as bench, UartDrive(parse_uart_url(url)) as drive:
        drive.write("stream_periods", 1.0)
        with listening(drive) as listener:
            bench.server.faults = Faults([parse_fault("noise=0.0001")], seed=3)
            values = set[float]()
            for _ in range(200):
                with contextlib.suppress(NoReplyError):
                    values.add(drive.read("control_R_s"))
            until(lambda: drive.counts.rows_lost > 500, "nothing was hit")
            assert listener.error is None
            bench.server.faults = Faults()
        bench.end()
        assert values == {0.9664}
        blocks = listener.blocks
        check(bench, blocks)
        for one, other in itertools.pairwise(blocks):
            assert other.tick[0] == one.tick[-1] + 1 + other.lost_before
        assert drive.counts.rows_lost == sum(block.lost_before for block in blocks)
        assert drive.seen.frames_dropped > 0


def test_any_bytes_and_any_frame_leave_the_drive_serving(drive: UartDrive) -> None:
    before = drive.parameters()
    dice = random.Random(7)
    for _ in range(300):
        kind, payload = dice.randrange(256), dice.randbytes(dice.randrange(40))
        harmless = kind not in (uf.Kind.WRITE, uf.Kind.START)
        drive._port.write(dice.randbytes(100) + (uf.packed(uf.Frame(kind, 0, payload)) if harmless else b"\0"))
    assert drive.parameters() == before


def test_frames_whatever_end_nothing_and_become_no_value() -> None:
    with served(pty_url()) as bench, UartDrive(parse_uart_url(bench.url)) as drive:
        bench.running.clear()
        bench.step(10)
        rows = uf.ROWS.size + uf.ROW_BYTES

        @settings(deadline=None)
        @given(st.lists(st.tuples(
            st.sampled_from(list(uf.Kind)) | st.integers(0, 255), st.integers(0, 3),
            st.binary(max_size=40).filter(lambda payload: len(payload) != rows),
        ), max_size=15))
        def survives(frames: list[tuple[int, int, bytes]]) -> None:
            drive._start()
            for kind, ahead, payload in frames:
                drive._hand_out(uf.Frame(kind, (drive._sequence + ahead) % 65536, payload))
            with contextlib.suppress(FrameError):
                assert drive._drain() == []
            assert drive.counts.rows == 0
            assert drive.read("u_full") == 387.5

        survives()


@given(st.binary(max_size=60))
def test_a_piece_whatever_is_samples_or_an_error(payload: bytes) -> None:
    upload = _Upload(0, 10)
    try:
        data = upload.taken(payload)
    except (FrameError, RefusedError):
        return
    assert data is None or payload.endswith(data)


class Liar(UartServer):
    """A drive whose answers are what is told here, whatever was asked."""

    lies = b""

    def _answer(self, line: Any, frame: uf.Frame) -> None:
        if self.lies and frame.kind != uf.Kind.STOP:
            line.reply(uf.Frame(frame.kind | uf.REPLY, frame.sequence, self.lies))
        else:
            super()._answer(line, frame)


def test_answers_whatever_become_no_value(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(uart_drive, "REPLY_TIMEOUT", 0.1)
    url = parse_uart_url(pty_url())
    with Liar(VirtualDrive(PAPER), url) as server, UartDrive(url) as drive:
        number = uf.NUMBER.pack(uf.number_of(signal_named("u_full")))

        @settings(deadline=None, max_examples=50)
        @given(st.binary(min_size=1, max_size=40) | st.binary(max_size=8).map(lambda data: number + data))
        def survives(lies: bytes) -> None:
            server.lies = lies
            with contextlib.suppress(DriveError):
                assert (lies[:2], len(lies)) == (number, 6), drive.read("u_full")
            with contextlib.suppress(DriveError):
                assert all(lies.endswith(piece) for piece in itertools.islice(drive.captured(0, 10), 2))
            with contextlib.suppress(FrameError):
                drive._start()
            drive._stop()
            server.lies = b""
            assert drive.read("u_full") == 387.5

        survives()


@pytest.mark.parametrize("lies", [b"\0", bytes(20), bytes(40), b"\xff" * 40, bytes(range(30))])
def test_answers_whatever_become_no_drive(lies: bytes) -> None:
    url = parse_uart_url(pty_url())
    with Liar(VirtualDrive(PAPER), url) as server:
        server.lies = lies
        with pytest.raises(ConnectError) as caught:
            UartDrive(url)
        assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_ten_thousand_rows_a_second_for_a_minute_without_loss() -> None:
    url = pty_url()
    with emulator("--at", url) as process:
        ready(process)
        with UartDrive(parse_uart_url(url)) as drive:
            drive.write("stream_periods", 1.0)
            busy, begun = time.process_time(), time.monotonic()
            rows = sum(map(len, first_blocks(drive, 600_000)))
            lasted, busy = time.monotonic() - begun, time.process_time() - busy
            lost = drive.counts.rows_lost
            print(f"{rows} rows in {lasted:.1f} s, {lost} lost, client {100.0 * busy / lasted:.1f} % CPU")
            assert drive.counts.rows_lost == 0
            assert drive.seen.bytes_dropped == 0
            assert lasted == pytest.approx(60.0, abs=2.0)
