"""What buses do to a CANopen client: loss, delay, repetition, silence, resets, nonsense. Gaps are told, values true."""

import threading
from collections.abc import Iterator
from typing import Any

import canopen
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivers import capture, operation
from drivers.canopen.drive import CanopenDrive
from drivers.connect import connect
from drivers.drive import Drive
from drivers.errors import DriveError, FrameError, LostError, NoReplyError, RefusedError
from drivers.wire import canopen_od as od
from drivers.wire.can_url import parse_can_url
from drivers.wire.cia402 import COMMUNICATION
from drivers.wire.codec import count_size
from drivers.wire.dictionary import signal_named
from emulator.servers.faults import Faults, parse_fault
from tests.support.served_drive import (
    Served,
    emulator,
    first_blocks,
    joined,
    listening,
    ready,
    served,
    tcp_url,
    until,
    virtual_url,
)

pytestmark = pytest.mark.live

COLUMNS = ("theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q", "i_d_mean", "i_q_mean", "u_dc")


@pytest.fixture
def bench() -> Iterator[Served]:
    with served(virtual_url()) as drive:
        yield drive


@pytest.fixture
def drive(bench: Served) -> Iterator[CanopenDrive]:
    with CanopenDrive(parse_can_url(bench.url)) as connected:
        yield connected


def spoil(bench: Served, *texts: str) -> None:
    """What befalls the drive's line from now on."""
    bench.server.faults = Faults(map(parse_fault, texts))


@pytest.mark.parametrize("texts", [("lose=0.05",), ("corrupt=0.02", "delay=0.03", "double=0.05")], ids=" ".join)
def test_rows_that_were_spoilt_are_gaps_and_the_others_are_the_drives_own(
    bench: Served, drive: CanopenDrive, texts: tuple[str, ...]
) -> None:
    with listening(drive) as listener:
        spoil(bench, *texts)
        seen = listener.rows
        until(lambda: listener.rows > seen + 600, "no rows")
        assert listener.error is None
        counts = drive.counts
    bench.end()
    rows = bench.produced()
    ticks = joined(listener.blocks, "tick")
    place = np.searchsorted(rows["row_tick"], ticks)
    assert np.array_equal(rows["row_tick"][place], ticks)
    full = {"i_full": 24.0, "u_full": 387.5, "omega_full": drive.identity.omega_full}
    for name in COLUMNS:
        off = joined(listener.blocks, name) - rows[name][place]
        if name == "theta_e":
            off = (off + np.pi) % (2.0 * np.pi) - np.pi
        assert np.abs(off).max() <= 0.5 * count_size(signal_named(name), full) * 1.001, name
    lost = int(ticks[-1] - ticks[0]) // 10 + 1 - len(ticks)
    assert sum(block.lost_before for block in listener.blocks) == lost
    assert lost > 10
    assert (counts.frames_late > 0) == ("delay=0.03" in texts)


def test_values_are_right_or_told_to_be_missing_while_frames_are_lost(bench: Served, drive: CanopenDrive) -> None:
    spoil(bench, "lose=0.05", "double=0.1")
    answered = 0
    for name, value in 8 * [("u_full", 387.5), ("n_p", 4.0), ("bandwidth", 1250.0)]:
        try:
            assert drive.read(name) == value
            answered += 1
        except NoReplyError as error:
            assert f"({name}) within 0.3 s" in str(error)
    assert answered >= 20


@pytest.mark.parametrize("texts", [("lose=0.001", "double=0.001"), ("late=0.0003",)], ids=" ".join)
def test_a_recording_is_whole_although_segments_are_lost_repeated_or_late(
    bench: Served, drive: CanopenDrive, texts: tuple[str, ...]
) -> None:
    setup = capture.Setup(("i_d", "i_q", "theta_e"), length=5000)
    capture.arm(drive, setup)
    under_way = capture.awaited(drive, setup, 10.0)
    spoil(bench, *texts)
    for _ in range(20):
        try:
            capture.upload(drive, under_way)
            break
        except (NoReplyError, FrameError):  # an order that was lost, or spoilt time and again: never a refusal
            continue
    assert bytes(under_way.data) == bench.drive.captured(0, 5000)


def test_samples_from_where_somebody_else_has_set_the_offset_are_not_taken(bench: Served, drive: CanopenDrive) -> None:
    setup = capture.Setup(("i_d", "i_q", "theta_e"), length=5000)
    capture.arm(drive, setup)
    under_way = capture.awaited(drive, setup, 10.0)
    ended, told = threading.Event(), 0

    def meddle() -> None:
        while not ended.wait(0.0005):
            bench.drive.write("capture_offset", 1000.0)

    meddler = threading.Thread(target=meddle)
    meddler.start()
    try:
        for _ in range(5):
            try:
                capture.upload(drive, under_way)
            except FrameError as error:
                assert "somebody else has set capture_offset of node 5" in str(error)
                told += 1
    finally:
        ended.set()
        meddler.join()
    assert told
    capture.upload(drive, under_way)
    assert bytes(under_way.data) == bench.drive.captured(0, 5000)


def test_a_bus_that_is_closed_for_a_while_is_lost_and_had_again(bench: Served, drive: CanopenDrive) -> None:
    with listening(drive) as listener:
        spoil(bench, "closed")
        error = listener.ended()
    assert isinstance(error, LostError)
    assert "fell silent: no row for 1.0 s" in str(error)
    spoil(bench)
    with connect(bench.url) as again:
        assert len(first_blocks(again, 20)) > 0


def test_an_object_that_the_drive_refuses_is_told_with_its_code(bench: Served, drive: CanopenDrive) -> None:
    spoil(bench, "refuse=0x2200")
    for access in (lambda: drive.read("bandwidth"), lambda: drive.write("bandwidth", 500.0)):
        with pytest.raises(RefusedError, match=r"node 5 on .* answered SDO abort 0x08000000 to 0x2200:6 \(bandwidth\)"):
            access()
    assert drive.read("u_full") == 387.5


@pytest.mark.slow
def test_faults_of_the_command_line_befall_the_drive() -> None:
    url = tcp_url()
    with emulator("--at", url, "--fault", "reset@2", "--fault", "refuse=0x2200") as process:
        ready(process)
        with connect(url) as drive, listening(drive) as listener:
            with pytest.raises(RefusedError, match="0x08000000"):
                drive.read("bandwidth")
            error = listener.ended()
        assert isinstance(error, LostError)
        assert str(error).endswith("has reset")
        with connect(url) as again:
            assert again.read("tick") < 100_000
            assert len(first_blocks(again, 20)) > 0


def test_a_node_that_was_off_the_bus_says_so_and_is_no_drive_in_fault(bench: Served, drive: CanopenDrive) -> None:
    told = list[bytes]()
    with CanopenDrive(parse_can_url(bench.url)) as other, listening(drive) as listener:
        other._bus.subscribe(od.emergency_cob_id(5), told.append)
        spoil(bench, "busoff")
        assert isinstance(listener.ended(), LostError)
        assert told == []
        spoil(bench)
        until(lambda: len(told) == 2, "it does not say that it is back")
        assert [frame.hex() for frame in told] == ["4081110000000000", "0000000000000000"]
        assert other.fault is None
        assert bench.server._state == od.STATE_PRE_OPERATIONAL
    with connect(bench.url) as again:
        assert len(first_blocks(again, 20)) > 0


def test_a_fault_and_its_end_are_told_by_the_drive_itself(bench: Served, drive: CanopenDrive) -> None:
    assert drive.fault is None
    bench.drive.write("watchdog_time", 1e-4)
    until(lambda: drive.fault is not None, "nothing is told")
    assert drive.fault == operation.Fault(COMMUNICATION, "the bench fell silent")
    with connect(bench.url) as late:
        assert isinstance(late, CanopenDrive)
        assert late.fault == drive.fault  # before it could be told
    drive.write("watchdog_time", 0.0)
    operation.reset_fault(drive)
    until(lambda: drive.fault is None, "its end is not told")


def test_rows_that_no_bus_could_carry_are_refused(drive: Drive) -> None:
    drive.write("stream_periods", 4.0)
    with pytest.raises(RefusedError, match=r"SDO abort 0x06090030 to 0x2000:4 \(stream_periods\)"):
        drive.write("stream_periods", 3.0)
    assert drive.read("stream_periods") == 4.0


# Nonsense on the bus

FRAMES = st.lists(st.tuples(
    st.sampled_from([0x185, 0x285, 0x385, 0x485, 0x085, 0x705, 0x585, 0x77F, 0x000, 0x7FF]), st.binary(max_size=8),
), max_size=15)


def test_nonsense_on_the_bus_ends_nothing_and_becomes_no_value(bench: Served, drive: CanopenDrive) -> None:
    bench.running.clear()
    bench.step(10)
    network: Any = drive._bus._network

    @settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
    @given(FRAMES)
    def survives(frames: list[tuple[int, bytes]]) -> None:
        drive._start()
        rows = drive.counts.rows
        for cob_id, data in frames:
            network.notify(cob_id, bytearray(data), 0.0)
        try:
            assert drive._drain() == []
        except FrameError as error:
            assert "has 8 bytes, got" in str(error) or "has 6 bytes, got" in str(error) or "somebody else" in str(error)
        assert drive.counts.rows == rows
        assert drive.read("u_full") == 387.5

    survives()


def test_answers_that_are_nonsense_are_told_and_become_no_value(bench: Served, drive: CanopenDrive) -> None:
    url = parse_can_url(bench.url)
    drive._bus._sdo.RESPONSE_TIMEOUT = 0.004
    bench.running.clear()
    bench.server._network.unsubscribe(od.sdo_request_cob_id(5))
    network = canopen.Network()
    network.NOTIFIER_CYCLE = 0.02
    network.connect(interface="virtual", channel=url.channel)
    answers = list[bytes]()

    def answer(_cob_id: int, data: bytearray, _time: float) -> None:
        if data[0] != 0x80:
            for nonsense in answers:
                network.send_message(od.sdo_response_cob_id(5), nonsense)

    network.subscribe(od.sdo_request_cob_id(5), answer)
    address = od.sdo_address(0x2010, 2)

    def answered(head: int, tail: bytes) -> bytes:
        return bytes([head]) + address + tail

    @settings(deadline=None, max_examples=25)
    @given(st.lists(st.one_of(
        st.binary(max_size=8),
        st.builds(answered, st.integers(0, 255), st.binary(min_size=4, max_size=4)),
    ), max_size=4))
    def survives(nonsense: list[bytes]) -> None:
        answers[:] = [frame for frame in nonsense if frame[:1] and (frame[0] >> 5 != 2 or frame[1:4] != address)]
        with pytest.raises(DriveError, match="node 5 on virtual"):
            drive.read("u_full")
        with pytest.raises(DriveError, match="node 5 on virtual"):
            drive._bus.read_block(0x2010, 2, "u_full")

    try:
        survives()
    finally:
        network.disconnect()
