"""A TCP relay between a client and a server: a test can cut the line, or let it lag, while both ends live."""

import contextlib
import queue
import socket
import threading
import time
from collections.abc import Generator

from tests.conftest import free_port


class Relay:
    """Passes bytes both ways between clients of `port` and a server, while the line is up."""

    def __init__(self, server_port: int) -> None:
        self.port = free_port()
        self.lag = 0.0  # s, by which clients hear the server late
        self._server_port = server_port
        self._listener: socket.socket | None = None
        self._pairs = list[socket.socket]()
        self._threads = list[threading.Thread]()

    def mend(self) -> None:
        """Let clients connect."""
        self._listener = socket.create_server(("127.0.0.1", self.port))
        self._begin(self._accept, self._listener)

    def cut(self) -> None:
        """Drop the clients and refuse new ones."""
        if self._listener is not None:
            _hang_up(self._listener)
            self._listener.close()
        _hang_up(*self._pairs)
        for thread in self._threads:
            thread.join(5.0)
        for end in self._pairs:
            end.close()
        self._pairs, self._threads = [], []

    def _begin(self, target: object, *args: socket.socket) -> None:
        assert callable(target)
        thread = threading.Thread(target=target, args=args)
        self._threads.append(thread)
        thread.start()

    def _accept(self, listener: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while True:
                client, _ = listener.accept()
                server = socket.create_connection(("127.0.0.1", self._server_port))
                self._pairs += [client, server]
                self._begin(self._pass, client, server)
                self._begin(self._pass_late, server, client)

    def _pass_late(self, source: socket.socket, sink: socket.socket) -> None:
        waiting = queue.SimpleQueue[tuple[float, bytes]]()

        def take() -> None:
            data = b"-"
            while data:
                with contextlib.suppress(OSError):
                    data = b""
                    data = source.recv(1 << 16)
                waiting.put((time.monotonic(), data))

        self._begin(take)
        with contextlib.suppress(OSError):
            while True:
                came, data = waiting.get()
                while (left := came + self.lag - time.monotonic()) > 0.0 and data:
                    time.sleep(min(left, 0.05))
                if not data:
                    break
                sink.sendall(data)
        _hang_up(source, sink)

    @staticmethod
    def _pass(source: socket.socket, sink: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(1 << 16):
                sink.sendall(data)
        _hang_up(source, sink)


def _hang_up(*ends: socket.socket) -> None:
    for end in ends:
        with contextlib.suppress(OSError):
            end.shutdown(socket.SHUT_RDWR)


@contextlib.contextmanager
def relayed(server_port: int) -> Generator[Relay]:
    """A relay whose line is up."""
    relay = Relay(server_port)
    relay.mend()
    try:
        yield relay
    finally:
        relay.cut()
