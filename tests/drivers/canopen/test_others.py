"""Who else is on a CAN bus: a node of the same number, clients that set what a stream rests on, frames of nobody."""

import contextlib
import threading
import time
from collections.abc import Generator, Iterator
from typing import Any

import can
import numpy as np
import pytest

from drivers import capture
from drivers.canopen.drive import CanopenDrive
from drivers.capture import Setup
from drivers.connect import connect
from drivers.errors import ConnectError, DriveError, FrameError, LostError
from drivers.wire import canopen_od as od
from drivers.wire.can_url import parse_can_url
from drivers.wire.codec import count_size
from drivers.wire.dictionary import CAPTURE_DATA, signal_named
from emulator.servers.canopen.server import CanopenNode
from emulator.servers.faults import Faults, parse_fault
from tests.support.served_drive import Served, first_blocks, joined, listening, served, tcp_url, until, virtual_url

pytestmark = pytest.mark.live


@pytest.fixture
def bench() -> Iterator[Served]:
    with served(virtual_url()) as drive:
        yield drive


@pytest.fixture
def drive(bench: Served) -> Iterator[CanopenDrive]:
    with CanopenDrive(parse_can_url(bench.url)) as connected:
        yield connected


@contextlib.contextmanager
def on_the_bus(bench: Served) -> Generator[can.BusABC]:
    """Another end of the drive's bus."""
    with can.Bus(interface="virtual", channel=parse_can_url(bench.url).channel) as bus:
        yield bus


def send(bus: can.BusABC, cob_id: int, data: bytes) -> None:
    bus.send(can.Message(arbitration_id=cob_id, data=data, is_extended_id=False))


def own_rows(bench: Served, drive: CanopenDrive, blocks: list[Any]) -> bool:
    """Every value of the blocks is what this drive produced under their ticks."""
    bench.end()
    rows, ticks = bench.produced(), joined(blocks, "tick")
    place = np.minimum(np.searchsorted(rows["row_tick"], ticks), len(rows["row_tick"]) - 1)
    full = drive.identity.full
    near = [np.abs(joined(blocks, name) - rows[name][place]).max() <= 0.5001 * count_size(signal_named(name), full)
            for name in ("i_d", "i_q", "u_d", "u_q")]
    return bool(np.array_equal(rows["row_tick"][place], ticks)) and all(near)


# Another node of the same number


@pytest.mark.parametrize("serials", [(1, 1), (1, 2)], ids=["of the same serial number", "of another"])
def test_two_nodes_of_one_number_are_refused_each_time(bench: Served, serials: tuple[int, int]) -> None:
    with served(bench.url) as other:
        for drive, serial in zip((bench.drive, other.drive), serials, strict=True):
            drive.serial = serial  # pyright: ignore[reportAttributeAccessIssue]
        expected = r"two nodes answer as node 5 on virtual \w+: (to \d+ requests|their serial numbers are [12])"
        for _ in range(10):
            with pytest.raises(ConnectError, match=expected):
                connect(bench.url)
        assert {node.server._state for node in (bench, other)} == {od.STATE_PRE_OPERATIONAL}


def test_a_node_that_boots_with_the_same_number_ends_the_stream(bench: Served, drive: CanopenDrive) -> None:
    with listening(drive) as listener, served(bench.url):
        assert isinstance(listener.ended(), LostError)
        with pytest.raises(ConnectError, match="two nodes answer as node 5"):
            connect(bench.url)
    assert own_rows(bench, drive, listener.blocks)


def test_a_node_of_the_same_number_that_comes_in_silence_ends_the_stream(
    bench: Served, drive: CanopenDrive, monkeypatch: pytest.MonkeyPatch
) -> None:
    boot = CanopenNode._boot

    def mute(node: CanopenNode) -> None:
        sending, node._send = node._send, lambda frames: None  # pyright: ignore[reportUnknownLambdaType]
        boot(node)
        node._send = sending

    with listening(drive) as listener:
        monkeypatch.setattr(CanopenNode, "_boot", mute)
        with served(bench.url):
            begun = time.monotonic()
            error = listener.ended()
            assert time.monotonic() - begun < 3.0
    assert isinstance(error, LostError)
    assert "two nodes answer as node 5" in str(error)
    assert own_rows(bench, drive, listener.blocks)


@pytest.mark.parametrize("texts", [("double=0.01", "late=0.01"), ("double=0.1",), ("delay=0.1",)], ids=" ".join)
def test_frames_doubled_or_late_are_no_second_node(bench: Served, texts: tuple[str, ...]) -> None:
    bench.server.faults = Faults(map(parse_fault, texts))
    with CanopenDrive(parse_can_url(bench.url)) as drive, listening(drive) as listener:
        seen = time.monotonic() + 2.0
        until(lambda: time.monotonic() > seen or listener.error is not None, "time stands still")
        assert listener.error is None
        assert drive.counts.frames_late > 0
        assert drive.counts.frames_foreign == 0


# Clients that set what a stream rests on


def remap(other: CanopenDrive, *steps: tuple[int, int, int, int]) -> None:
    for index, subindex, value, size in steps:
        other._bus.write(index, subindex, "TPDO", value.to_bytes(size, "little"))


INVALID, VALID = 0x285 | od.NOT_VALID, 0x285
SWAPPED = [
    (0x1801, 1, INVALID, 4), (0x1A01, 0, 0, 1), (0x1A01, 3, od.tpdo_mapping(1)[3], 4),
    (0x1A01, 4, od.tpdo_mapping(1)[2], 4), (0x1A01, 0, 4, 1), (0x1801, 1, VALID, 4),
]  # u_d and u_q change places: the same length, and nothing shows it


@pytest.mark.parametrize(
    ("steps", "said"),
    [
        (SWAPPED, "TPDO 2 (0x1801:1)"), ([(0x1802, 2, 1, 1)], "TPDO 3 (0x1802:2)"),
        ([(0x1803, 1, 0x1A5 | od.NOT_VALID, 4)], "TPDO 4 (0x1803:1)"),
    ],
    ids=["mapping", "transmission type", "COB-ID"],
)
def test_somebody_elses_change_of_a_tpdo_ends_the_stream_and_no_row_of_it_is_given(
    bench: Served, drive: CanopenDrive, steps: list[tuple[int, int, int, int]], said: str
) -> None:
    with CanopenDrive(parse_can_url(bench.url)) as other, listening(drive) as listener:
        remap(other, *steps)
        error = listener.ended()
    assert isinstance(error, FrameError)
    assert f"somebody else has set {said} of node 5 on" in str(error)
    assert own_rows(bench, drive, listener.blocks)


def test_a_mapping_that_was_changed_unheard_ends_the_stream(bench: Served, drive: CanopenDrive) -> None:
    with listening(drive) as listener:
        for index, subindex, value, size in SWAPPED:  # as if its answers were lost
            bench.server._objects.set_data(index, subindex, value.to_bytes(size, "little"))
        begun = time.monotonic()
        error = listener.ended()
        assert time.monotonic() - begun < 6.0
    assert isinstance(error, FrameError)
    assert "somebody else has set TPDO 2 (0x1A01:" in str(error)


LIKE_AN_ANSWER = bytes.fromhex("001a0304030201")  # after a segment's number 0x60: "TPDO 1 has been mapped anew"


def test_the_data_of_a_block_is_no_answer_whatever_it_looks_like(
    bench: Served, drive: CanopenDrive, monkeypatch: pytest.MonkeyPatch
) -> None:
    samples, what = LIKE_AN_ANSWER * 127, (*CAPTURE_DATA, "recording")

    def captured(_offset: int, _count: int) -> bytes:
        return samples

    monkeypatch.setattr(bench.drive, "captured", captured)
    with CanopenDrive(parse_can_url(bench.url)) as other, listening(drive) as listener:
        for reader in (drive, other) * 5:
            assert reader._bus.read_block(*what) == samples
        rows = drive.counts.rows
        until(lambda: drive.counts.rows > rows or listener.error is not None, "rows")
        assert listener.error is None


def test_a_mapping_that_was_changed_before_the_stream_is_set_up_again(bench: Served, drive: CanopenDrive) -> None:
    for index, subindex, value, size in SWAPPED:
        bench.server._objects.set_data(index, subindex, value.to_bytes(size, "little"))
    blocks = first_blocks(drive, 200)
    assert own_rows(bench, drive, blocks)


# Frames of nobody


def test_a_frame_of_another_length_under_a_tpdos_identifier_is_passed_over_and_counted(
    bench: Served, drive: CanopenDrive
) -> None:
    with listening(drive) as listener, on_the_bus(bench) as bus:
        for length in (3, 0, 7):
            send(bus, od.tpdo_cob_id(0, 5), bytes(length))
        until(lambda: drive.counts.frames_foreign == 3, "they are not counted")
        seen = listener.rows
        until(lambda: listener.rows > seen + 100 or listener.error is not None, "no rows")
        assert listener.error is None
    assert own_rows(bench, drive, listener.blocks)


# Another SDO client


@pytest.mark.parametrize("period", [0.003, 0.05])
def test_a_client_that_asks_the_same_node_all_the_time_hinders_nothing_or_is_told(period: float) -> None:
    """Two clients cannot use one SDO channel in turns: what takes several frames is begun anew until it passes."""
    with served(tcp_url()) as bench:
        url, ended = parse_can_url(bench.url), threading.Event()
        requests = [bytes.fromhex(text) for text in ("4018100400000000", "4041600000000000", "4000100000000000")]

        def ask() -> None:
            with can.Bus(interface="socketcand", host=url.host, port=url.port, channel=url.channel) as bus:
                count = 0
                while not ended.wait(period):
                    send(bus, od.sdo_request_cob_id(5), requests[count % 3])
                    count += 1

        asker = threading.Thread(target=ask)
        asker.start()
        try:
            for _ in range(3):
                try:
                    drive = connect(bench.url)
                except ConnectError as error:
                    assert period == 0.003
                    assert "(device name)" in str(error)
                    assert "another SDO client is on the bus: it asks for 0x" in str(error)
                    continue
                with drive, listening(drive) as listener:
                    for _ in range(30):
                        assert drive.read("u_full") == 387.5
                    until(lambda listener=listener: listener.rows > 300 or listener.error is not None, "no rows")
                    assert listener.error is None
        finally:
            ended.set()
            asker.join()


def test_a_failure_beside_another_client_says_that_there_is_one(bench: Served, drive: CanopenDrive) -> None:
    with on_the_bus(bench) as bus:
        bench.server.faults = Faults([parse_fault("lose=1")])
        send(bus, od.sdo_request_cob_id(5), bytes.fromhex("4018100400000000"))
        expected = r"did not answer for .* within 0.3 s; another SDO client is on the bus: it asks for 0x1018:4$"
        with pytest.raises(DriveError, match=expected):
            drive.read("u_full")


def test_blocks_of_another_client_are_let_pass_by_who_reads_all_the_time(bench: Served, drive: CanopenDrive) -> None:
    """Two benches at one drive: one uploads a recording while the other looks at the drive's state."""
    ended, reads, failed = threading.Event(), 0, list[DriveError]()

    def look() -> None:
        nonlocal reads
        with CanopenDrive(parse_can_url(bench.url)) as other:
            while not ended.wait(0.1):
                try:
                    for name in ("status_word", "error_code", "watchdog_time", "u_full", "n_p"):
                        other.read(name)
                        reads += 1
                except DriveError as error:
                    failed.append(error)

    setup = Setup(("u_d", "u_q", "i_d", "i_q"), 20_000)
    looking = threading.Thread(target=look)
    looking.start()
    try:
        number = capture.arm(drive, setup)
        until(lambda: capture.seen(drive, number).state == capture.DONE, "the recording")
        got = capture.upload(drive, capture.found(drive, setup))
    finally:
        ended.set()
        looking.join()
    assert len(got.t) == 20_000
    assert not failed
    assert reads > 20


def test_a_block_that_another_client_never_ends_is_waited_for_but_not_for_long(
    bench: Served, drive: CanopenDrive
) -> None:
    number = capture.arm(drive, Setup(("u_d", "u_q"), 100))
    until(lambda: capture.seen(drive, number).state == capture.DONE, "the recording")
    with on_the_bus(bench) as bus:
        begun = time.monotonic()
        send(bus, od.sdo_request_cob_id(5), bytes.fromhex("a41024017f000000"))
        time.sleep(0.05)
        assert drive.read("u_full") == 387.5
        assert 0.5 < time.monotonic() - begun < 3.0  # the node gives it up after 2 s, by its own clock
