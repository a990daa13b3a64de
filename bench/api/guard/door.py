"""The listening socket: lets connections in, and turns away at once what is one request too many.

An event loop takes about a millisecond to make a connection, read it and refuse it; so, a flood would have whoever asks
for Stop wait behind it. Here a refusal costs some system calls. Over TLS nobody can be read before the handshake, and
all are let in, to be refused later.
"""

import asyncio
import contextlib
import socket
from collections.abc import Callable
from functools import partial
from typing import Final

from bench.api.guard.connections import Connections

_BATCH: Final = 256  # connections at once, then it is somebody else's turn
_HEAD: Final = 4096  # bytes, in which a request says what it is about
_PARTS: Final = 20  # of a request that is turned away
_SILENT: Final = 1  # s, after which who says nothing is let in, too, to be told so
_BREATH: Final = 0.1  # s without new connections where the system has no more descriptors or memory


class Door:
    """A listening socket, open from `open` to `close`."""

    def __init__(
        self, listener: socket.socket, connections: Connections, make: Callable[..., asyncio.Protocol]
    ) -> None:
        """`make` makes a connection's protocol, and is told whether its first request is counted already (`asked`)."""
        self._listener, self._connections, self._make = listener, connections, make
        self._loop = asyncio.get_running_loop()
        self._coming = set[asyncio.Task[object]]()
        self._open = False

    def open(self) -> None:
        """Let in from now on; as a rule, who has said something."""
        self._listener.setblocking(False)
        if hasattr(socket, "TCP_DEFER_ACCEPT"):
            self._listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_DEFER_ACCEPT, _SILENT)
        self._listener.listen(self._connections.limits.waiting)
        self._open = True
        self._loop.add_reader(self._listener, self._let_in)

    def close(self) -> None:
        """Let nobody in any more: who comes later is refused by the system."""
        self._open = False
        self._loop.remove_reader(self._listener)
        self._listener.close()

    def _let_in(self) -> None:
        for _ in range(_BATCH):
            try:
                new, address = self._listener.accept()
            except (BlockingIOError, InterruptedError, ConnectionAbortedError):
                return
            except OSError:  # no more descriptors, or memory
                self._loop.remove_reader(self._listener)
                self._loop.call_later(_BREATH, self._go_on)
                return
            new.setblocking(False)
            asked = self._head_of(new)
            if asked and not self._connections.may_ask() and self._turned_away(new, asked, str(address[0])):
                continue
            make = partial(self._make, asked=bool(asked))
            task = self._loop.create_task(self._loop.connect_accepted_socket(make, new))
            self._coming.add(task)
            task.add_done_callback(self._came)

    def _go_on(self) -> None:
        if self._open:
            self._loop.add_reader(self._listener, self._let_in)

    def _came(self, task: "asyncio.Task[object]") -> None:
        self._coming.discard(task)
        if not task.cancelled():
            task.exception()  # it is gone already

    def _head_of(self, new: socket.socket) -> bytes:
        """What it has said already, as far as it can be read."""
        if self._connections.tls is not None:
            return b""
        try:
            return new.recv(_HEAD, socket.MSG_PEEK)
        except OSError:
            return b""

    def _turned_away(self, new: socket.socket, head: bytes, who: str) -> bool:
        answer = self._connections.too_many(head, who)
        if answer is None:
            return False
        with contextlib.suppress(OSError), new:
            new.send(answer)
            new.shutdown(socket.SHUT_WR)
            for _ in range(_PARTS):  # unread, it would destroy the answer
                if not new.recv(_HEAD):
                    break
        return True
