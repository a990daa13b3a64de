"""The bus on a TCP port, against python-can's own client and against clients that behave badly."""

import contextlib
import queue
import re
import socket
import threading
import time
from collections.abc import Callable, Generator, Iterator

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from emulator.errors import BusError
from emulator.servers.socketcand import SETTLE, Frame, SocketcandServer, parse_send

pytestmark = pytest.mark.live

PATIENCE = 10.0  # s


@pytest.fixture
def server() -> Iterator[SocketcandServer]:
    with SocketcandServer("127.0.0.1", 0, "can0") as serving:
        yield serving


@contextlib.contextmanager
def client(server: SocketcandServer) -> Generator[can.BusABC]:
    """python-can's own, joined to the bus."""
    bus = can.Bus(interface="socketcand", host="127.0.0.1", port=server.port, channel="can0")
    try:
        yield bus
    finally:
        bus.shutdown()


@contextlib.contextmanager
def plain(server: SocketcandServer, raw: bool = True) -> Generator[socket.socket]:
    """A bare connection, in raw mode when so wanted."""
    with socket.create_connection(("127.0.0.1", server.port), PATIENCE) as connection:
        assert connection.recv(100) == b"< hi >"
        if raw:
            for command in (b"< open can0 >", b"< rawmode >"):
                connection.sendall(command)
                assert connection.recv(100) == b"< ok >"
        yield connection


def message(cob_id: int, payload: bytes = b"") -> can.Message:
    return can.Message(arbitration_id=cob_id, data=payload, is_extended_id=False)


def until(happened: Callable[[], bool], what: str) -> None:
    deadline = time.monotonic() + PATIENCE
    while not happened():
        assert time.monotonic() < deadline, what
        time.sleep(0.005)


def heard(bus: can.BusABC, count: int) -> list[Frame]:
    frames = list[Frame]()
    while len(frames) < count:
        got = bus.recv(PATIENCE)
        assert got is not None, f"heard {len(frames)} of {count} frames"
        frames.append((got.arbitration_id, bytes(got.data)))
    return frames


def received(server: SocketcandServer, count: int) -> list[Frame]:
    try:
        return [server.received.get(timeout=PATIENCE) for _ in range(count)]
    except queue.Empty:
        raise AssertionError(f"fewer than {count} frames came to the node") from None


def closed_by_server(connection: socket.socket) -> bytes:
    """What still comes until the server closes."""
    data = b""
    with contextlib.suppress(ConnectionResetError):
        while part := connection.recv(4096):
            data += part
    return data


def test_a_client_of_python_can_joins_and_is_heard(server: SocketcandServer) -> None:
    with client(server) as bus:
        for frame in ((0x605, bytes(range(8))), (0, b"\x01\x05"), (0x7FF, b"")):
            bus.send(message(*frame))
            assert received(server, 1) == [frame]


def test_a_client_that_has_spoken_hears_the_answer_at_once(server: SocketcandServer) -> None:
    with client(server) as bus:
        bus.send(message(0x605, b"\x40"))
        received(server, 1)
        begun = time.monotonic()
        server.broadcast([(0x585, b"\x43"), (0x705, b"")])
        assert heard(bus, 2) == [(0x585, b"\x43"), (0x705, b"")]
        assert time.monotonic() - begun < SETTLE


def test_a_client_that_only_listens_hears_the_bus_soon(server: SocketcandServer) -> None:
    with client(server) as bus:
        deadline = time.monotonic() + PATIENCE
        while (got := bus.recv(0.02)) is None:
            assert time.monotonic() < deadline
            server.broadcast([(0x705, b"\x7f")])
        assert (got.arbitration_id, bytes(got.data)) == (0x705, b"\x7f")


def test_nothing_but_the_answers_comes_during_the_handshake(server: SocketcandServer) -> None:
    """python-can takes whatever comes with an answer for a wrong answer."""
    stop = threading.Event()

    def chatter() -> None:
        while not stop.is_set():
            server.broadcast([(0x185, bytes(8))])

    thread = threading.Thread(target=chatter)
    thread.start()
    try:
        for _ in range(20):
            with client(server):
                pass
    finally:
        stop.set()
        thread.join()


def test_every_client_hears_every_frame_but_its_own(server: SocketcandServer) -> None:
    with client(server) as one, client(server) as other:
        for bus in (one, other):
            bus.send(message(0x600))
            received(server, 1)  # from now on it hears all
        one.send(message(0x603, b"3"))
        received(server, 1)
        other.send(message(0x604, b"4"))
        received(server, 1)
        server.broadcast([(0x605, b"5")])
        for bus, expected in ((one, [(0x604, b"4"), (0x605, b"5")]), (other, [(0x603, b"3"), (0x605, b"5")])):
            frames = heard(bus, 2)
            while frames[0][0] == 0x600:
                frames = frames[1:] + heard(bus, 1)
            assert frames == expected
            assert bus.recv(0.0) is None


def test_a_flood_comes_through_whole_and_in_order(server: SocketcandServer) -> None:
    n = 20_000
    sent = [(k % 0x800, k.to_bytes(4, "little")) for k in range(n)]
    with plain(server) as sender, client(server) as listener:
        listener.send(message(1))
        received(server, 1)
        flood = b"".join(b"< send %x %d %s >" % (c, len(p), p.hex(" ").encode()) for c, p in sent)
        thread = threading.Thread(target=sender.sendall, args=(flood,))
        thread.start()
        assert heard(listener, n) == sent
        assert received(server, n) == sent
        thread.join()
        server.broadcast(sent)
        assert heard(listener, n) == sent


def test_a_client_that_never_reads_is_dropped_and_stalls_nobody(server: SocketcandServer) -> None:
    rows = [(0x185, bytes(8))] * 100
    with plain(server) as deaf, client(server) as listener:
        deaf.sendall(b"< send 1 0 >")
        listener.send(message(2))
        received(server, 2)
        longest, deadline = 0.0, time.monotonic() + PATIENCE
        while len(server._clients) == 2:
            assert time.monotonic() < deadline, "never dropped"
            begun = time.monotonic()
            server.broadcast(rows)
            frames = heard(listener, 100)
            longest = max(longest, time.monotonic() - begun)
            assert (frames[0][0], len(frames)) in {(0x185, 100), (1, 100)}
        assert longest < 0.5
        until(lambda: len(server._clients) == 1, "the deaf one alone goes")
        closed_by_server(deaf)


def test_commands_may_come_in_any_pieces(server: SocketcandServer) -> None:
    with plain(server) as connection:
        for byte in b"< send 605 3 1 2 ff >< send 0 0 >":
            connection.sendall(bytes([byte]))
        assert received(server, 2) == [(0x605, b"\x01\x02\xff"), (0, b"")]


@pytest.mark.parametrize("garbage", [b"< fly >", b">", b"<>", b"< send 605 9 1 >", b"\xff\xfe\x00 >", b"< send >"])
def test_garbage_gets_an_error_and_the_next_command_is_taken(server: SocketcandServer, garbage: bytes) -> None:
    with plain(server) as connection:
        connection.sendall(garbage)
        assert connection.recv(100) == b"< error unknown command >"
        connection.sendall(b"< send 5 1 aa >")
        assert received(server, 1) == [(5, b"\xaa")]


def test_a_client_that_talks_without_an_end_is_dropped(server: SocketcandServer) -> None:
    with plain(server) as connection:
        with contextlib.suppress(OSError):
            connection.sendall(b"x" * 100_000)
        closed_by_server(connection)
        until(lambda: not server._clients, "it is still there")


@pytest.mark.parametrize(
    ("spoken", "answer"),
    [
        (b"< open can7 >", b"< error could not open bus >"),
        (b"GET / HTTP/1.1\r\n<p>", b"< error could not open bus >"),
        (b"< open can0 >< bcmmode >", b"< ok >< error unknown command >"),
    ],
)
def test_a_client_that_wants_something_else_is_told_and_left(
    server: SocketcandServer, spoken: bytes, answer: bytes
) -> None:
    with plain(server, raw=False) as connection:
        connection.sendall(spoken)
        assert closed_by_server(connection) == answer
    until(lambda: not server._clients, "it is still there")


def test_a_client_that_vanishes_is_forgotten(server: SocketcandServer) -> None:
    with plain(server), plain(server, raw=False):
        until(lambda: len(server._clients) == 2, "two should be there")
    until(lambda: not server._clients, "nobody should be there")
    server.broadcast([(1, b"")])


def test_closing_ends_clients_in_any_state_at_once() -> None:
    server = SocketcandServer("127.0.0.1", 0, "can0")
    with plain(server), plain(server, raw=False) as silent, plain(server, raw=False) as half:
        half.sendall(b"< open can0 >")
        assert half.recv(100) == b"< ok >"
        begun = time.monotonic()
        server.close()
        assert time.monotonic() - begun < 1.0
        assert closed_by_server(silent) == closed_by_server(half) == b""
    server.close()
    SocketcandServer("127.0.0.1", server.port, "can0").close()  # the port is free again


def test_a_port_in_use_is_told_in_a_sentence(server: SocketcandServer) -> None:
    with pytest.raises(BusError, match=f"cannot serve a CAN bus at 127.0.0.1:{server.port}: Address already in use"):
        SocketcandServer("127.0.0.1", server.port, "can0")


@pytest.mark.parametrize("host", ["192.0.2.1", "x" * 70, "a..b"])
def test_a_place_that_cannot_be_is_told_in_a_sentence(host: str) -> None:
    with pytest.raises(BusError, match=rf"cannot serve a CAN bus at {re.escape(host)}:29536: \S"):
        SocketcandServer(host, 29536, "can0")


@given(st.integers(0, 0x7FF), st.binary(max_size=8))
def test_any_frame_survives_its_command(cob_id: int, payload: bytes) -> None:
    for form in ("x", "02x", "02X"):
        command = f"send {cob_id:03X} {len(payload):X} " + " ".join(format(byte, form) for byte in payload)
        assert parse_send(command.strip()) == (cob_id, payload)


@given(st.text() | st.text("send 0123456789abcdefx+-_").map(lambda text: f"send {text}"))
def test_any_text_is_a_frame_or_none(text: str) -> None:
    frame = parse_send(text)
    if frame is not None:
        assert 0 <= frame[0] <= 0x7FF
        assert len(frame[1]) <= 8


@pytest.mark.parametrize(
    "command",
    ["send 800 0", "send 00000705 1 0", "send 0x5 0", "send -1 0", "send 5 1", "send 5 1 100", "send 5 2 1", "send",
     "send 5 9 1 2 3 4 5 6 7 8 9", "send 5 1 -1", "send 5 1 0_0", "isotpmode 5 1 1", "send 5 01 1", "SEND 5 0"],
)
def test_what_is_no_frame_of_11_bit_identifier_is_refused(command: str) -> None:
    assert parse_send(command) is None
