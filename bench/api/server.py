"""The HTTP server: a port, who may call, the application, an orderly end."""

import asyncio
import contextlib
import errno
import logging
import os
import socket
import sys
from collections.abc import Callable
from typing import Any, Final, cast

import uvicorn
from starlette.types import ASGIApp, Receive, Scope, Send

from bench.api.app import create_app
from bench.api.guard.access import Access
from bench.api.guard.connections import Connection, Connections, Limits
from bench.api.guard.door import Door
from bench.api.guard.gate import Gate
from bench.api.guard.idempotency import Idempotency
from bench.api.guard.load import Lanes, Load
from bench.api.guard.record import Record
from bench.errors import ConfigError
from bench.service.service import Service
from bench.store.write_log import Allowance, Entry, WriteLog, short

_GRACE: Final = 1.0  # s for answers under way at the end
_BROKEN_OFF: Final = 2  # s after which the library itself gives up what is left of them
_SWITCH: Final = 0.001  # s that a thread keeps others waiting, as those that read from the drives and stop them
_LINES: Final = 10.0  # of the server's own log at once, and one a second for longer


def listen(host: str, port: int) -> socket.socket:
    """A listening socket. Raises ConfigError when the port is not to be had."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # The protocol is named so that asyncio sends small answers at once: TCP_NODELAY, else 40 ms
    listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        if os.name == "posix":
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((host, port))
        listener.listen()
    except (OSError, OverflowError, ValueError) as error:
        listener.close()
        reason = getattr(error, "strerror", None) or error
        if isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
            reason = f"{reason}; another port: --port {port % 65535 + 1} (make run PORT={port % 65535 + 1})"
        raise ConfigError(f"cannot listen on {host}:{port}: {reason}") from None
    return listener


def serve(service: Service, listener: socket.socket, access: Access, log: WriteLog) -> None:
    """Answer requests until SIGINT or SIGTERM; the service begins to end as soon as one comes."""
    limits = Limits()

    def tell(who: str, method: str, path: str, said: str) -> None:
        log.tell(Entry(who, "", short(method), short(path), 503, said))

    connections = Connections(limits, access.tls, tell)
    app = create_app(service, lambda: server.should_exit, with_token=access.token is not None)
    loaded = Load(Idempotency(Record(app, log), log), log, Lanes.for_drives(service.drives))
    config = uvicorn.Config(
        _quiet(Gate(loaded, access, log)), http=cast(Any, connections.protocol), ws="none",
        log_level="warning", timeout_graceful_shutdown=_BROKEN_OFF, access_log=False, lifespan="off",
        proxy_headers=False, server_header=False,
    )
    for name in ("uvicorn.error", "asyncio"):
        logging.getLogger(name).addFilter(_Bounded())
    server = _Server(config, connections, service.leave)
    sys.setswitchinterval(_SWITCH)
    server.run(sockets=[listener])


class _Server(uvicorn.Server):
    """Has a door of ours in place of the event loop's; `leave` is called when it is to end."""

    def __init__(self, config: uvicorn.Config, connections: Connections, leave: Callable[[], None]) -> None:
        super().__init__(config)
        self._connections, self._leave = connections, leave
        self._doors: list[Door] = []

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        if sys.platform == "win32":  # its event loop cannot wait for a socket that listens
            await super().startup(sockets)
            return
        await super().startup([])
        self._doors = [Door(listener, self._connections, self._connection) for listener in sockets or ()]
        for door in self._doors:
            door.open()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Let nobody in any more, and wait for who is there, but not for long."""
        self._leave()
        for door in self._doors:
            door.close()
        patience = asyncio.get_running_loop().call_later(_GRACE, self._break_off)
        await super().shutdown(sockets)
        patience.cancel()

    def _break_off(self) -> None:
        """Who still waits for an answer is told why none comes, who does not take one has had time to."""
        for connection in list(self.server_state.connections):
            cast(Connection, connection).break_off(503, "the service is ending")
        for task in self.server_state.tasks:
            task.cancel()

    def _connection(self, *, asked: bool) -> asyncio.Protocol:
        return self._connections.protocol(self.config, self.server_state, {}, asked=asked)


def _quiet(app: ASGIApp) -> ASGIApp:
    """An application whose answers may be broken off without complaint."""

    async def quiet(scope: Scope, receive: Receive, send: Send) -> None:
        with contextlib.suppress(asyncio.CancelledError):
            await app(scope, receive, send)

    return quiet


class _Bounded(logging.Filter):
    """Passes so many records, and so many a second for longer: no client fills a disk with them."""

    def __init__(self) -> None:
        super().__init__()
        self._lines, self._held_back = Allowance(_LINES, 1.0), 0

    def filter(self, record: logging.LogRecord) -> bool:
        if not self._lines.take():
            self._held_back += 1
            return False
        if self._held_back:
            record.msg, record.args = f"{record.getMessage()} ({self._held_back} before it were not told)", None
            self._held_back = 0
        return True
