"""A CAN bus on a TCP port: the raw mode of the socketcand protocol, so that any socketcand client can join.

Every client hears every frame but its own, as on a bus. A client that does not read is dropped: a bus waits for nobody.
Protocol: github.com/linux-can/socketcand, doc/protocol.md. Knows nothing of CANopen.
"""

import contextlib
import queue
import socket
import threading
import time
from collections.abc import Iterable
from types import TracebackType
from typing import Self

Frame = tuple[int, bytes]
"""CAN identifier (11 bit) and up to 8 data bytes."""

SETTLE = 0.05  # s between a client's handshake and its first frame: clients expect the bare answer first
SEND_TIMEOUT = 1.0  # s after which a client that does not read is dropped


class BusError(Exception):
    """The bus cannot be served; its text is a sentence for the user."""


class SocketcandServer:
    """Serves one bus, `channel`, at host:port from construction to `close`. `received` holds the clients' frames."""

    def __init__(self, host: str, port: int, channel: str) -> None:
        self.channel = channel
        self.received: queue.SimpleQueue[Frame] = queue.SimpleQueue()
        self._clients: dict[socket.socket, float] = {}  # and the time from which each hears the bus
        self._lock = threading.Lock()
        self._closing = False
        try:
            self._listener = socket.create_server((host, port))
        except OSError as error:
            raise BusError(f"cannot serve a CAN bus at {host}:{port}: {error.strerror or error}") from None
        self.port: int = self._listener.getsockname()[1]
        self._threads = [threading.Thread(target=self._accept, name=f"socketcand {self.port}", daemon=True)]
        self._threads[0].start()

    def broadcast(self, frames: Iterable[Frame], sender: socket.socket | None = None) -> None:
        """Put frames on the bus: all clients but the sender hear them."""
        now = time.time()
        data = b"".join(b"< frame %03X %.6f %s >" % (cob_id, now, payload.hex().encode()) for cob_id, payload in frames)
        heard = time.monotonic()
        with self._lock:
            for client, since in list(self._clients.items()):
                if client is not sender and heard >= since:
                    try:
                        client.sendall(data)
                    except OSError:
                        self._drop(client)

    def close(self) -> None:
        """Leave the port and all clients."""
        self._closing = True
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        with self._lock:
            for client in list(self._clients):
                self._drop(client)
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join(timeout=2.0)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _accept(self) -> None:
        while not self._closing:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._threads = [thread for thread in self._threads if thread.is_alive()]
            name = f"socketcand {self.port} client"
            thread = threading.Thread(target=self._serve, args=(client,), name=name, daemon=True)
            self._threads.append(thread)
            thread.start()

    def _serve(self, client: socket.socket) -> None:
        """Handshake, then frames until the client leaves."""
        try:
            client.settimeout(10.0)
            client.sendall(b"< hi >")
            reader = _Reader(client)
            if reader.next() != f"open {self.channel}":
                client.sendall(b"< error could not open bus >")
                return
            client.sendall(b"< ok >")
            if reader.next() != "rawmode":
                client.sendall(b"< error unknown command >")
                return
            client.sendall(b"< ok >")
            client.settimeout(SEND_TIMEOUT)
            with self._lock:
                self._clients[client] = time.monotonic() + SETTLE
            while not self._closing:
                command = reader.next()
                if command is None:
                    return
                frame = parse_send(command)
                if frame is None:
                    client.sendall(b"< error unknown command >")
                else:
                    self.broadcast([frame], sender=client)
                    self.received.put(frame)
        except OSError:
            return
        finally:
            with self._lock:
                self._drop(client)

    def _drop(self, client: socket.socket) -> None:
        self._clients.pop(client, None)
        with contextlib.suppress(OSError):
            client.shutdown(socket.SHUT_RDWR)
        client.close()


def parse_send(command: str) -> Frame | None:
    """The frame of a `send ID DLC BYTE ...` command, or None when it is none."""
    match command.split():
        case ["send", identifier, length, *data]:
            try:
                cob_id, payload = int(identifier, 16), bytes(int(byte, 16) for byte in data)
                if 0 <= cob_id <= 0x7FF and len(payload) == int(length) <= 8:
                    return cob_id, payload
            except ValueError:
                return None
        case _:
            pass
    return None


class _Reader:
    """Commands, `< ... >`, out of a TCP stream."""

    def __init__(self, client: socket.socket) -> None:
        self._client = client
        self._buffer = ""

    def next(self) -> str | None:
        """The next command's inside; None when the client has left or talks something else."""
        while ">" not in self._buffer:
            try:
                data = self._client.recv(4096)
            except TimeoutError:
                continue
            if not data or len(self._buffer) > 4096:
                return None
            self._buffer += data.decode("ascii", "replace")
        command, _, self._buffer = self._buffer.partition(">")
        return command.partition("<")[2].strip()
