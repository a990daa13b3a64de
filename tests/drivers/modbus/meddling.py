"""A TCP line whose bytes are meddled with on their way: between a client and an emulated drive's port."""

import contextlib
import socket
import struct
import threading
import time
from collections.abc import Callable, Generator
from dataclasses import dataclass, field

from tests.conftest import free_port

Meddle = Callable[[bytes, bool, socket.socket], bytes]
"""Bytes, whether they go to the drive, and the end that they came from, to what goes on."""

_PATIENCE = 10.0  # s


@dataclass
class Meddled:
    """A line at `port`; while `open` is clear nothing passes, and nothing is closed."""

    port: int
    open: threading.Event = field(default_factory=threading.Event)
    ended: threading.Event = field(default_factory=threading.Event)


@contextlib.contextmanager
def meddled(server_port: int, meddle: Meddle = lambda data, _up, _source: data) -> Generator[Meddled]:
    """A line to a server, open."""
    line = Meddled(free_port())
    line.open.set()
    ends, threads = list[socket.socket](), list[threading.Thread]()

    def begin(target: Callable[..., None], *args: object) -> None:
        threads.append(threading.Thread(target=target, args=args, name="meddled line"))
        threads[-1].start()

    def carry(source: socket.socket, sink: socket.socket, up: bool) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(1 << 16):
                while not line.open.wait(0.01) and not line.ended.is_set():
                    pass
                sink.sendall(meddle(data, up, source))
        for end in (source, sink):
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    def accept() -> None:
        with contextlib.suppress(OSError):
            while True:
                client, _ = listener.accept()
                try:
                    server = socket.create_connection(("127.0.0.1", server_port))
                except OSError:  # it is not there just now
                    client.close()
                    continue
                for end in (client, server):
                    end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                ends.extend((client, server))
                begin(carry, client, server, True)
                begin(carry, server, client, False)

    with socket.create_server(("127.0.0.1", line.port)) as listener:
        begin(accept)
        try:
            yield line
        finally:
            line.ended.set()
            for end in (listener, *ends):
                with contextlib.suppress(OSError):
                    end.shutdown(socket.SHUT_RDWR)
            for thread in list(threads):
                thread.join(_PATIENCE)
            for end in ends:
                end.close()


def other_numbers() -> Meddle:
    """A gateway whose Modbus answers carry transaction numbers of its own. Frames come whole here."""
    count = 0

    def meddle(data: bytes, up: bool, _source: socket.socket) -> bytes:
        nonlocal count
        count += not up
        return data if up else struct.pack(">H", 0x8000 | count & 0x7FFF) + data[2:]

    return meddle


def slow(delay: float) -> Meddle:
    """Every answer comes so many s late."""

    def meddle(data: bytes, up: bool, _source: socket.socket) -> bytes:
        time.sleep(0.0 if up else delay)
        return data

    return meddle


def echoing(data: bytes, up: bool, source: socket.socket) -> bytes:
    """An adapter that hears itself: what is sent comes back before the answer."""
    if up:
        source.sendall(data)
    return data
