"""A CAN bus on a TCP port: the raw mode of the socketcand protocol, so that any socketcand client can join.

Every client hears every frame but its own, as on a bus. A client that does not read is dropped: a bus waits for nobody.
Protocol: github.com/linux-can/socketcand, doc/protocol.md. Knows nothing of CANopen.
"""

import contextlib
import math
import queue
import re
import select
import socket
import threading
import time
from collections.abc import Iterable
from types import TracebackType
from typing import Self

from emulator.errors import BusError

Frame = tuple[int, bytes]
"""CAN identifier (11 bit) and up to 8 data bytes."""

SETTLE = 0.25  # s in which a client that has said nothing yet hears nothing: it expects the handshake's bare answer
HANDSHAKE_TIMEOUT = 10.0  # s
SEND_TIMEOUT = 1.0  # s after which a client that takes nothing is dropped
BACKLOG = 4 << 20  # bytes that a client may be behind
_SEND = re.compile(r"send +([0-9A-Fa-f]{1,3}) +([0-8])((?: +[0-9A-Fa-f]{1,2})*)")


class SocketcandServer:
    """Serves one bus, `channel`, at host:port from construction to `close`. `received` holds the clients' frames."""

    def __init__(self, host: str, port: int, channel: str) -> None:
        self.channel = channel
        self.received: queue.SimpleQueue[Frame] = queue.SimpleQueue()
        self._clients: dict[_Client, threading.Thread] = {}
        self._lock = threading.Lock()
        self._closing = threading.Event()
        try:
            self._listener = socket.create_server((host, port))
        except (OSError, UnicodeError) as error:
            reason, *_ = str(getattr(error, "strerror", None) or error).split(" (while attempting")
            raise BusError(f"cannot serve a CAN bus at {host}:{port}: {reason}") from None
        self.port: int = self._listener.getsockname()[1]
        self._accepting = threading.Thread(target=self._accept, name=f"socketcand {self.port}", daemon=True)
        self._accepting.start()

    def broadcast(self, frames: Iterable[Frame], sender: "_Client | None" = None) -> None:
        """Put frames on the bus: all clients but the sender hear them. Returns at once."""
        now = time.time()
        data = b"".join(b"< frame %03X %.6f %s >" % (cob_id, now, payload.hex().encode()) for cob_id, payload in frames)
        heard = time.monotonic()
        with self._lock:  # all clients hear all frames in the same order
            for client in self._clients:
                if data and client is not sender and heard >= client.hears_from:
                    client.put(data)

    def close(self) -> None:
        """Leave the port and all clients."""
        self._closing.set()
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._accepting.join(timeout=2.0)
        with self._lock:
            clients = dict(self._clients)
        for client, thread in clients.items():
            client.leave()
            thread.join(timeout=2.0)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _accept(self) -> None:
        while not self._closing.is_set():
            try:
                connection, _ = self._listener.accept()
            except OSError:  # closed, or out of file descriptors for a while
                self._closing.wait(0.1)
                continue
            client = _Client(connection)
            thread = threading.Thread(
                target=self._serve, args=(client,), name=f"socketcand {self.port} client", daemon=True
            )
            with self._lock:
                self._clients[client] = thread
            thread.start()

    def _serve(self, client: "_Client") -> None:
        """Handshake, then frames until the client leaves."""
        writer = threading.Thread(target=client.write, name=f"socketcand {self.port} writer", daemon=True)
        try:
            if not self._welcomed(client):
                return
            writer.start()
            client.hears_from = time.monotonic() + SETTLE
            while (command := client.next()) is not None:
                client.hears_from = 0.0
                frame = parse_send(command)
                if frame is None:
                    client.put(b"< error unknown command >")
                else:
                    self.broadcast([frame], sender=client)
                    self.received.put(frame)
        except OSError:
            return
        finally:
            client.leave()
            if writer.ident is not None:
                writer.join()
            client.connection.close()
            with self._lock:
                del self._clients[client]

    def _welcomed(self, client: "_Client") -> bool:
        """Whether the client has opened this bus and asked for raw mode."""
        connection = client.connection
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.settimeout(HANDSHAKE_TIMEOUT)
        connection.sendall(b"< hi >")
        for expected, refusal in (
            (f"open {self.channel}", b"< error could not open bus >"), ("rawmode", b"< error unknown command >")
        ):
            if client.next(patient=False) != expected:
                connection.sendall(refusal)
                return False
            connection.sendall(b"< ok >")
        connection.settimeout(SEND_TIMEOUT)
        return True


class _Client:
    """A client's connection: commands, `< ... >`, out of it; what it has still to be sent into it."""

    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
        self.hears_from = math.inf  # s, monotonic
        self._read = ""
        self._unsent = bytearray()
        self._left = False
        self._writing = False  # the writer is under way with what was put before
        self._change = threading.Condition()

    def next(self, patient: bool = True) -> str | None:
        """The next command's inside; None when the client has left or talks something else.

        Raises TimeoutError after a silence, unless patient.
        """
        while ">" not in self._read:
            try:
                data = self.connection.recv(4096)
            except TimeoutError:
                if patient and not self._left:
                    continue
                raise
            if not data or len(self._read) > 4096:
                return None
            self._read += data.decode("ascii", "replace")
        command, _, self._read = self._read.partition(">")
        return command.partition("<")[2].strip()

    def put(self, data: bytes) -> None:
        """Send this as far as the client takes it at once, and have the writer send the rest; a client that is too far
        behind is dropped.
        """
        with self._change:
            if not self._unsent and not self._writing:
                data = data[self._sent_at_once(data) :]
                if not data:
                    return
            self._unsent += data
            self._change.notify()
            behind = len(self._unsent)
        if behind > BACKLOG:
            self.leave()

    def write(self) -> None:
        """Send what is put until the client leaves or takes nothing any more."""
        try:
            while data := self._taken():
                sent = 0
                while sent < len(data):
                    sent += self.connection.send(memoryview(data)[sent:])
                self._writing = False
        except OSError:
            self.leave()

    def _sent_at_once(self, data: bytes) -> int:
        """Send what can be sent without waiting; how many bytes that were."""
        try:
            return self.connection.send(data) if select.select([], [self.connection], [], 0.0)[1] else 0
        except (OSError, ValueError):  # it has left, which the writer meets
            return 0

    def leave(self) -> None:
        """End both directions; whoever waits on them wakes up."""
        with self._change:
            self._left = True
            self._change.notify()
        with contextlib.suppress(OSError):
            self.connection.shutdown(socket.SHUT_RDWR)

    def _taken(self) -> bytes:
        """What is to be sent; nothing when the client has left."""
        with self._change:
            self._change.wait_for(lambda: self._unsent or self._left)
            data, self._unsent = bytes(self._unsent), bytearray()
            self._writing = bool(data)
            return b"" if self._left else data


def parse_send(command: str) -> Frame | None:
    """The frame of a `send ID DLC BYTE ...` command, or None when it is none of 11-bit identifier."""
    match = _SEND.fullmatch(command)
    if match is None:
        return None
    cob_id, length, data = int(match[1], 16), int(match[2]), match[3].split()
    if cob_id > 0x7FF or length != len(data):
        return None
    return cob_id, bytes(int(byte, 16) for byte in data)
