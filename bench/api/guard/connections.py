"""Connections of the HTTP server: how many there may be, and how long each may take for what it has to say.

Beyond the most that may be open, the one that has been silent longest is answered 503 and closed: who comes with a
request is let in, however many come without one. Counted from the first packet, before TLS.
"""

import asyncio
import json
import select
import ssl
import sys
from collections.abc import Callable
from dataclasses import dataclass
from http import HTTPStatus
from itertools import islice
from typing import Any, Final, cast
from urllib.parse import unquote

import h11
from uvicorn.config import Config
from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle
from uvicorn.server import ServerState

from bench.api.exchange.kinds import READS, is_stop, is_upload
from bench.store.write_log import Allowance

_RETRY: Final = 1  # s
_SHORT: Final = 200  # bytes of a request's first line
_LOOKED_AT: Final = 50  # connections, for a silent one


@dataclass(frozen=True, slots=True)
class Limits:
    """Of all connections, and of each one's time in s. Serial ports need file descriptors below 1024."""

    open: int = 300
    unread: int = 100  # beyond those, whose requests have come and are about to be read
    waiting: int = 2048  # that the system keeps until they are let in
    head: float = 5.0  # from the connection, or the answer before, to the end of a request's head
    body: float = 10.0  # from there to the end of its body
    handshake: float = 5.0  # TLS
    taking: float = 20.0  # for the next part of an answer to be taken
    leaving: float = 1.0  # for who is refused to take the answer: closed at once, unread bytes would destroy it
    refused: int = 400  # connections that may take that time
    burst: int = 200  # requests at once, and so many a second for longer; what is more is not even looked into,
    rate: float = 100.0  # so that the threads that read from the drives get their share of the processor


class Connections:
    """All that are open."""

    def __init__(
        self, limits: Limits, tls: ssl.SSLContext | None = None,
        tell: Callable[[str, str, str, str], None] = lambda who, method, path, said: None,
    ) -> None:  # fmt: skip
        """`tell` is told of writes that are not looked into: whose, method, path, and a sentence."""
        self.limits, self.tls, self.tell = limits, tls, tell
        self.may_ask = Allowance(limits.burst, limits.rate).take  # whether one more request is not too many
        self._open: dict[Connection, None] = {}
        self._waiting: dict[Connection, None] = {}  # for a whole request; the longest waiting first
        self._leaving: set[Connection] = set()

    def protocol(
        self, config: Config, server_state: ServerState, app_state: dict[str, Any],
        _loop: asyncio.AbstractEventLoop | None = None, *, asked: bool = False,
    ) -> "Connection":
        """One for a new connection, as uvicorn asks for it; `asked`: its first request is counted already."""
        return Connection(self, config, server_state, app_state, _loop, asked=asked)

    def __len__(self) -> int:
        return len(self._open)

    def too_many(self, head: bytes, who: str) -> bytes | None:
        """The answer to a request that is one too many, by its first bytes; None to what may be Stop."""
        line, whole, _ = head.lstrip(b"\r\n").partition(b"\r\n")
        method, target, *_ = (*line.decode("latin-1").split(" "), "", "")
        if is_stop(method, unquote(target.partition("?")[0])) or (not whole and len(line) < _SHORT):
            return None  # what is not told yet may be Stop
        said = f"the service takes {self.limits.rate:g} requests a second for longer, and more came"
        if method not in READS:
            self.tell(who, method, target, said)
        return _answer(503, said)

    def come(self, new: "Connection") -> None:
        """Somebody connects."""
        self._open[new] = None
        self._waiting[new] = None
        if len(self._open) <= self.limits.open:
            return
        longest = next((one for one in islice(self._waiting, _LOOKED_AT) if one.is_silent), None)
        if longest is None and len(self._open) > self.limits.open + self.limits.unread:
            longest = new
        if longest is not None:
            self.leave(longest)
            longest.refuse(503, f"the service has {self.limits.open} connections at most, and this one waited longest")

    def wait(self, one: "Connection") -> None:
        """It is to say what it wants."""
        if one in self._open:
            self._waiting[one] = None

    def work(self, one: "Connection") -> None:
        """It has said what it wants."""
        self._waiting.pop(one, None)

    def leave(self, one: "Connection") -> None:
        """It is closed, or about to be."""
        self._open.pop(one, None)
        self._waiting.pop(one, None)
        self._leaving.discard(one)

    def may_linger(self, one: "Connection") -> bool:
        """Whether it may stay until its last answer is taken."""
        if len(self._leaving) < self.limits.refused:
            self._leaving.add(one)
        return one in self._leaving


class Connection(H11Protocol):
    """A connection of uvicorn's, with limits to its time."""

    def __init__(
        self, all_: Connections, config: Config, server_state: ServerState, app_state: dict[str, Any],
        loop: asyncio.AbstractEventLoop | None, *, asked: bool,
    ) -> None:  # fmt: skip
        super().__init__(config, server_state, app_state, loop)
        self._asked = asked
        self._all, self._limits = all_, all_.limits
        self._ready = False  # for HTTP; before that is TLS's handshake
        self._awaited: type[object] | None = None  # of the client: IDLE a head, SEND_BODY a body
        self._heard = False  # something since the last answer
        self._refused = False  # what comes is not listened to
        self._patience: asyncio.TimerHandle | None = None
        self._taking: asyncio.TimerHandle | None = None
        self._securing: asyncio.Task[None] | None = None
        self._early = b""  # that came with the end of the handshake

    @property
    def is_silent(self) -> bool:
        """Nothing has come that is still to be read."""
        descriptor = cast(int, self.transport.get_extra_info("socket").fileno())
        if descriptor < 0:
            return True
        poll = select.poll()
        poll.register(descriptor, select.POLLIN)
        return not poll.poll(0)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = cast(asyncio.Transport, transport)
        if self._all.tls is None:
            self._begin()
        else:
            self.transport.pause_reading()  # until there is who knows TLS
            self._securing = self.loop.create_task(self._secure(self._all.tls))
        self._all.come(self)

    def connection_lost(self, exc: Exception | None) -> None:
        self._all.leave(self)
        self._be_patient(None)
        self._have_taken()
        if self._ready:
            super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        if self._refused:
            return
        if not self._ready:
            self._early += data
            return
        asked, self._asked = self._asked, False
        if self._awaited is h11.IDLE and not self._heard and not asked and not self._all.may_ask():
            answer = self._all.too_many(data, self.client[0] if self.client else "")
            if answer is not None:
                self._leave(answer)
                return
        self._heard = True
        super().data_received(data)
        self._watch()
        if self._awaited is h11.SEND_BODY and is_upload(self.scope["method"], self.scope["path"]):
            self._be_patient(self._limits.body)  # for its next part

    def on_response_complete(self) -> None:
        """The next request may come; one that has come already is counted, too."""
        self._heard = False
        if self.conn.trailing_data[0] and not self._all.may_ask():
            self._leave(_answer(503, "requests came on one connection before those before them were answered"))
        super().on_response_complete()
        self._unset_keepalive_if_required()  # ours goes on while a head comes letter by letter
        self._watch()

    def pause_writing(self) -> None:
        """The client does not take what it asked for."""
        super().pause_writing()
        self._have_taken()
        self._taking = self.loop.call_later(self._limits.taking, self.transport.abort)

    def resume_writing(self) -> None:
        self._have_taken()
        super().resume_writing()

    def send_400_response(self, msg: str) -> None:
        """What came is not HTTP, or its head too long."""
        error = sys.exc_info()[1]
        self.refuse(getattr(error, "error_status_hint", 400), f"{msg.removesuffix(' received.')}: {error}")

    def refuse(self, status: int, said: str) -> None:
        """Answer where an answer can still be given, and close."""
        self._leave(_answer(status, said))

    def break_off(self, status: int, said: str) -> None:
        """Close at once; who has not had the beginning of an answer gets this one."""
        cycle = cast(RequestResponseCycle | None, self.cycle)
        if cycle is not None:
            cycle.disconnected = True  # what the application says from now on is not sent
        if not self._answering and not self.transport.is_closing():
            self.transport.write(_answer(status, said))
            self.transport.close()
        else:
            self.transport.abort()

    def _leave(self, answer: bytes) -> None:
        self._all.leave(self)
        self._be_patient(None)
        if self.transport.is_closing():
            return
        if not self._ready or self._answering:
            self.transport.abort()
            return
        self.transport.write(answer)
        if self.transport.can_write_eof() and self._all.may_linger(self):
            self._refused = True
            self.transport.write_eof()
            self._patience = self.loop.call_later(self._limits.leaving, self.transport.close)
        else:
            self.transport.close()

    @property
    def _answering(self) -> bool:
        cycle = cast(RequestResponseCycle | None, self.cycle)
        return cycle is not None and cycle.response_started and not cycle.response_complete

    def _begin(self) -> None:
        super().connection_made(self.transport)
        self._ready = True
        self._watch()

    async def _secure(self, tls: ssl.SSLContext) -> None:
        try:
            secured = await self.loop.start_tls(
                self.transport, self, tls, server_side=True, ssl_handshake_timeout=self._limits.handshake
            )
        except OSError:  # it speaks no TLS, or is gone, or too slow
            self._all.leave(self)
            return
        if secured is None or secured.is_closing():
            self._all.leave(self)
            return
        self.transport = secured
        self._begin()
        if self._early:
            self.data_received(self._early)

    def _watch(self) -> None:
        """Have patience with what is awaited of the client now, as long as it deserves."""
        awaited = self.conn.their_state
        if awaited is self._awaited or self.transport.is_closing():
            return
        self._awaited = awaited
        if awaited is h11.IDLE:
            self._all.wait(self)
            self._be_patient(self._limits.head)
        else:
            self._all.work(self)
            self._be_patient(self._limits.body if awaited is h11.SEND_BODY else None)

    def _be_patient(self, seconds: float | None) -> None:
        """So long, and not longer; None: without end."""
        if self._patience is not None:
            self._patience.cancel()
        self._patience = None if seconds is None else self.loop.call_later(seconds, self._lose_patience, seconds)

    def _lose_patience(self, seconds: float) -> None:
        if self._heard:
            self.refuse(408, f"expected the rest of a request within {seconds:g} s, got a part of it")
        else:
            self.transport.close()

    def _have_taken(self) -> None:
        if self._taking is not None:
            self._taking.cancel()
            self._taking = None


def _answer(status: int, said: str) -> bytes:
    """All of an answer, without the application."""
    title = HTTPStatus(status).phrase
    body = json.dumps({"type": "about:blank", "title": title, "status": status, "detail": said}).encode()
    retry = f"Retry-After: {_RETRY}\r\n" if status == HTTPStatus.SERVICE_UNAVAILABLE else ""
    head = (
        f"HTTP/1.1 {status} {title}\r\nContent-Type: application/problem+json\r\nContent-Length: {len(body)}\r\n"
        f"{retry}X-Content-Type-Options: nosniff\r\nConnection: close\r\n\r\n"
    )
    return head.encode() + body
