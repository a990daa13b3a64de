"""The CANopen client against the virtual drive, where CANopen shows; the rest is in test_contract."""

import contextlib
import os
import select
import socket
import threading
import time
import tty
from collections.abc import Generator, Iterator
from dataclasses import dataclass

import pytest

from drivers.connect import connect
from drivers.drive import Drive
from drivers.errors import ConnectError, DriveError, LostError, NoReplyError, RefusedError
from drivers.wire import canopen_od as od
from drivers.wire.can_url import parse_can_url
from drivers.wire.dictionary import layout_id, layout_text
from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER
from emulator.servers.canopen.server import CanopenNode
from emulator.servers.faults import Faults, parse_fault
from tests.support.served_drive import PATIENCE, in_threads, served, tcp_url, virtual_url

pytestmark = pytest.mark.live


@dataclass(frozen=True)
class Place:
    """Where the drive of this transport is."""

    url: str


@pytest.fixture(scope="module", params=["virtual", "socketcand"])
def place(request: pytest.FixtureRequest) -> Iterator[Place]:
    with served(virtual_url() if request.param == "virtual" else tcp_url()) as drive:
        yield Place(drive.url)


@pytest.fixture(scope="module")
def drive(place: Place) -> Iterator[Drive]:
    with connect(place.url) as connected:
        yield connected


def test_a_value_that_this_drive_refuses_is_told_with_node_object_and_code(drive: Drive) -> None:
    before = drive.read("i_q_ref")
    with pytest.raises(RefusedError, match=r"node 5 on .* answered SDO abort 0x06090030 to 0x2300:2 \(i_q_ref\): ."):
        drive.write("i_q_ref", 12.5)  # its current limit is 12 A
    assert drive.read("i_q_ref") == before


def test_two_clients_on_one_bus_each_get_their_own_values(drive: Drive, place: Place) -> None:
    drive.write("stream_periods", 10.0)
    with connect(place.url) as other:
        def one() -> None:
            assert {drive.read("control_R_s") for _ in range(100)} == {0.9664}

        def two() -> None:
            assert {other.read("u_full") for _ in range(100)} == {387.5}

        in_threads([one, two])


def test_a_drive_can_be_closed_twice_and_then_answers_nothing(place: Place) -> None:
    drive = connect(place.url)
    drive.close()
    drive.close()
    with pytest.raises(LostError, match="no longer takes frames"):
        drive.read("i_d")
    assert list(drive.stream()) == []


def test_a_node_that_is_not_there_is_told_in_time(place: Place) -> None:
    url = place.url.removesuffix("/5") + "/6"
    begun = time.monotonic()
    with pytest.raises(ConnectError, match=r"no node 6 answered on (virtual|socketcand) .* within 0.9 s"):
        connect(url)
    assert time.monotonic() - begun < 2.0


@pytest.mark.parametrize(
    ("interface", "sentence"),
    [("nonsense", "no CAN bus nonsense can0: "), ("socketcan", "no CAN bus socketcan no-such-bus: ")],
)
def test_a_bus_that_is_not_there_is_a_connect_error(interface: str, sentence: str) -> None:
    channel = "can0" if interface == "nonsense" else "no-such-bus"
    with pytest.raises(ConnectError, match=sentence):
        connect(f"canopen://{interface}/{channel}/5")


def test_a_port_without_a_server_is_a_connect_error_at_once() -> None:
    begun = time.monotonic()
    with pytest.raises(ConnectError, match=r"nothing serves a CAN bus at 127.0.0.1:\d+: Connection refused"):
        connect(tcp_url())
    assert time.monotonic() - begun < 1.0


@pytest.mark.parametrize("host", ["x" * 70, "a..b"])
def test_a_host_that_cannot_be_is_a_connect_error(host: str) -> None:
    with pytest.raises(ConnectError, match="nothing serves a CAN bus at"):
        connect(f"canopen://socketcand/{host}:29536/can0/5")


@pytest.mark.parametrize(
    ("greeting", "sentence"),
    [
        (b"HTTP/1.1 400 Bad Request\r\n", r"127.0.0.1:\d+ is no socketcand: expected '< hi >', got 'HTTP/1.1 400"),
        (b"", r"127.0.0.1:\d+ is no socketcand: expected '< hi >', got nothing"),
        (None, r"127.0.0.1:\d+ does not answer: expected a socketcand server's greeting within 2 s"),
    ],
)
def test_a_port_that_serves_something_else_is_a_connect_error(greeting: bytes | None, sentence: str) -> None:
    with contextlib.ExitStack() as open_sockets:
        listener = open_sockets.enter_context(socket.create_server(("127.0.0.1", 0)))

        def answer() -> None:
            connection = open_sockets.enter_context(listener.accept()[0])
            if greeting is not None:
                connection.sendall(greeting)
                connection.shutdown(socket.SHUT_WR)

        thread = threading.Thread(target=answer)
        thread.start()
        with pytest.raises(ConnectError, match=sentence):
            connect(f"canopen://socketcand/127.0.0.1:{listener.getsockname()[1]}/can0/5")
        thread.join(PATIENCE)


def test_a_bus_of_another_name_is_a_connect_error() -> None:
    with (
        served(tcp_url()) as bench,
        pytest.raises(ConnectError, match="has no bus 'can7': it answered '< error could not open bus >'"),
    ):
        connect(bench.url.replace("can0", "can7"))


class OtherNode(CanopenNode):
    """A node whose answers to some objects are other than this drive's."""

    def get_data(self, index: int, subindex: int) -> bytes:
        if (index, subindex) == (0x2000, 1):
            return (layout_id() ^ 1).to_bytes(4, "little")
        return super().get_data(index, subindex)


def test_a_node_with_another_layout_is_a_connect_error() -> None:
    url = virtual_url()
    with (
        OtherNode(VirtualDrive(PAPER), parse_can_url(url)),
        pytest.raises(ConnectError, match=rf"'pmsm-bench virtual drive'\) has another signal layout: expected "
                                          rf"{layout_text()}, got 0x{layout_id() ^ 1:08X}"),
    ):
        connect(url)


def sent(seen: list[bytes]) -> list[str]:
    return [data.hex() for data in seen if data[0] != 0x80]


def test_a_write_without_an_answer_goes_out_again_only_after_it_reads_back_otherwise() -> None:
    url, seen = virtual_url(), list[bytes]()
    write, read = "230023010000803f", "4000230100000000"
    with CanopenNode(VirtualDrive(PAPER), parse_can_url(url)) as node, connect(url) as drive:
        node._network.subscribe(od.sdo_request_cob_id(5), lambda _id, data, _time: seen.append(bytes(data)))
        answer, node._send = node._send, lambda frames: None  # pyright: ignore[reportUnknownLambdaType]
        threading.Timer(0.4, lambda: setattr(node, "_send", answer)).start()
        drive.write("i_d_ref", 1.0)  # taken, but for its answer
        assert sent(seen) == [write, read, read][: len(sent(seen))]
        assert len(sent(seen)) >= 2
        node._on_nmt(0, bytearray([od.NMT_STOP, 5]), 0.0)
        seen.clear()
        with pytest.raises(NoReplyError, match=r"node 5 on virtual \w+ did not answer for 0x2300:1 \(i_d_ref\)"):
            drive.write("i_d_ref", 2.0)
        assert sent(seen) == ["2300230100000040", read, read, read]
        seen.clear()
        with pytest.raises(NoReplyError):
            drive.write("capture_command", 1.0)
        assert len(sent(seen)) == 1  # a command is given once
        seen.clear()
        with pytest.raises(DriveError):
            drive.read("i_d_ref")
        assert len(sent(seen)) == 3


def test_a_write_that_was_lost_is_made_again() -> None:
    url, seen = virtual_url(), list[bytes]()
    with CanopenNode(VirtualDrive(PAPER), parse_can_url(url)) as node, connect(url) as drive:
        drive.write("i_d_ref", 0.0)
        faults = node.faults
        node.faults = Faults([parse_fault("lose=1")])
        threading.Timer(0.2, lambda: setattr(node, "faults", faults)).start()
        node._network.subscribe(od.sdo_request_cob_id(5), lambda _id, data, _time: seen.append(bytes(data)))
        drive.write("i_d_ref", 1.0)
        assert sent(seen).count("230023010000803f") == 2
        assert drive.read("i_d_ref") == 1.0


@contextlib.contextmanager
def crossed_lines() -> Generator[list[str]]:
    """Two pseudo-terminals; what is written to one is read from the other."""
    opened = [os.openpty() for _ in range(2)]
    (one, _), (other, _) = opened
    end, sign = os.pipe()
    for _, terminal in opened:
        tty.setraw(terminal)

    def carry() -> None:
        while end not in (ready := select.select([one, other, end], [], [])[0]):
            for line in ready:
                os.write(other if line == one else one, os.read(line, 4096))

    thread = threading.Thread(target=carry)
    thread.start()
    try:
        yield [os.ttyname(terminal) for _, terminal in opened]
    finally:
        os.write(sign, b"!")
        thread.join()
        for file in (end, sign, *(file for pair in opened for file in pair)):
            os.close(file)


def test_an_adapter_on_a_serial_device_is_an_interface_like_others_and_takes_its_options() -> None:
    options = "bitrate=1000000&sleep_after_open=0.01&rtscts=False"
    with crossed_lines() as devices:
        drives, benches = (f"canopen://slcan/{device}/5?{options}" for device in devices)
        with served(drives), connect(benches) as drive:
            assert drive.read("u_full") == 387.5
            drive.write("bandwidth", 1250.0)
            assert drive.read("bandwidth") == 1250.0
