"""Requests that begin a job, asked again with the same Idempotency-Key: answered as the first, and nothing is begun.

After the IETF's draft "The Idempotency-Key HTTP Header Field". A refusal began nothing: it is not kept, and the same
key may be tried again. What is kept ends with the service.
"""

import asyncio
import hashlib
import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from bench.api.exchange.kinds import begins_job
from bench.api.exchange.problems import problem
from bench.store.write_log import Entry, WriteLog

HEADER: Final = "Idempotency-Key"
_LASTS: Final = 3600.0  # s
_MOST: Final = 1000  # answers kept, and
_BYTES: Final = 8 << 20  # of them together; beyond, the oldest are forgotten
_BODY: Final = 1 << 16  # bytes; a longer one is refused by the application
_KEY: Final = re.compile(r"[ -~]{1,255}")

REPEATABLE: Final[dict[str, Any]] = {"parameters": [{
    "name": HEADER, "in": "header", "required": False,
    "description": "chosen by the client: asked again with it within an hour, the first answer comes again, and "
    "nothing is begun anew; with another body, or of another route: 422",
    "schema": {"type": "string", "minLength": 1, "maxLength": 255, "pattern": "^[ -~]+$",
               "examples": ["8e03978e-40d5-43dd-bc93-6894a57f9324"]},
}]}  # fmt: skip
"""The description of the header, of the routes that heed it."""


@dataclass(frozen=True, slots=True)
class _First:
    """The first request with a key."""

    request: bytes  # digest of method, path, query and body
    until: float  # s, by the clock
    answer: "asyncio.Future[list[Message]]"  # empty: it broke off

    @property
    def size(self) -> int:
        """Bytes of the answer's body."""
        return sum(len(message.get("body", b"")) for message in self.answer.result()) if self.answer.done() else 0


class Idempotency:
    """ASGI middleware around the application; touched by its event loop alone."""

    def __init__(self, app: ASGIApp, log: WriteLog, clock: Callable[[], float] = time.monotonic) -> None:
        self._app, self._log, self._clock = app, log, clock
        self._known: dict[str, _First] = {}  # by key, the oldest first

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        keys = Headers(scope=scope).getlist(HEADER) if begins_job(scope["method"], scope["path"]) else []
        if not keys:
            await self._app(scope, receive, send)
            return
        if len(keys) > 1 or not _KEY.fullmatch(keys[0]):
            await self._refuse(f"expected one {HEADER} of 1 to 255 printable ASCII letters, got another", scope, send)
            return
        came = await _come(receive)
        again = _again(came, receive)
        if not _is_whole(came):
            await self._app(scope, again, send)
            return
        asked = f"{scope['method']} {scope['path']}\n".encode() + scope.get("query_string", b"") + b"\n"
        request = hashlib.sha256(asked + b"".join(part.get("body", b"") for part in came)).digest()
        self._tidy()
        first = self._known.get(keys[0])
        if first is None:
            await self._begin(keys[0], request, scope, again, send)
        elif first.request != request:
            said = f"expected an {HEADER} of its own, got that of another request, with another body or of another path"
            await self._refuse(said, scope, send)
        else:
            await _tell(await asyncio.shield(first.answer), scope, receive, send)

    async def _begin(self, key: str, request: bytes, scope: Scope, receive: Receive, send: Send) -> None:
        first = _First(request, self._clock() + _LASTS, asyncio.get_running_loop().create_future())
        self._known[key] = first
        messages = list[Message]()

        async def sent(message: Message) -> None:
            messages.append(dict(message))  # whoever sends it adds to its headers
            await send(message)

        try:
            await self._app(scope, receive, sent)
        finally:
            whole = bool(messages) and not messages[-1].get("more_body", False) and len(messages) > 1
            first.answer.set_result(messages if whole else [])
            if not (whole and _is_kept(messages[0]["status"])):
                del self._known[key]

    async def _refuse(self, said: str, scope: Scope, send: Send) -> None:
        self._log.tell(Entry.of(scope, 422, said))
        await problem(422, said)(scope, _nothing, send)

    def _tidy(self) -> None:
        """Forget what is over, and the oldest where there is too much; one that is under way stays."""
        ended = {key: one for key, one in self._known.items() if one.answer.done()}
        count, size = len(ended), sum(one.size for one in ended.values())
        for key, one in ended.items():
            if one.until > self._clock() and count < _MOST and size < _BYTES:
                break  # those after it are younger
            count, size = count - 1, size - one.size
            del self._known[key]


def _is_kept(status: int) -> bool:
    """Whether something was begun, or may have been."""
    return status < 400 or status == 500


async def _come(receive: Receive) -> list[Message]:
    """What comes of a request's body, as far as it is looked at."""
    came, size = list[Message](), 0
    while not came or (came[-1].get("more_body", False) and size <= _BODY):
        came.append(await receive())
        size += len(came[-1].get("body", b""))
    return came


def _is_whole(came: list[Message]) -> bool:
    return came[-1]["type"] == "http.request" and not came[-1].get("more_body", False)


def _again(came: list[Message], receive: Receive) -> Receive:
    """Hands out what has come already, then what comes."""
    waiting = iter(came)

    async def again() -> Message:
        message = next(waiting, None)
        return await receive() if message is None else message

    return again


async def _tell(messages: list[Message], scope: Scope, receive: Receive, send: Send) -> None:
    if not messages:
        await problem(503, "the request with this key that came first broke off; whether it was done is not known")(
            scope, receive, send
        )
    for message in messages:
        await send(dict(message))


async def _nothing() -> Message:
    return {"type": "http.disconnect"}
