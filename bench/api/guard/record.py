"""What is written down of every write: who, what, with which outcome; before and after where a route has told them."""

import asyncio
import json
from collections.abc import Mapping
from typing import Any, Final, cast

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from bench.api.exchange.kinds import changes_nothing, is_upload
from bench.store.write_log import SHORT, Entry, WriteLog, short

_LONGEST: Final = 1 << 16  # bytes of an answer that is looked into
_REFUSED: Final = (401, 403, 404, 405, 412, 413, 415, 421, 422)  # before anything was reached


class Record:
    """ASGI middleware around the application."""

    def __init__(self, app: ASGIApp, log: WriteLog) -> None:
        self._app, self._log = app, log

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if changes_nothing(scope["method"], scope["path"]):
            await self._app(scope, receive, send)
            return
        status: int = 500
        asked = scope["method"], scope["path"]
        body, answer = bytearray(), bytearray()

        async def received() -> Message:
            message = await receive()
            if message["type"] == "http.request" and len(body) <= 4 * SHORT and not is_upload(*asked):
                body.extend(message.get("body", b""))
            return message

        async def sent(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
            elif len(answer) <= _LONGEST:
                answer.extend(message.get("body", b""))
            await send(message)

        try:
            await self._app(scope, received, sent)
        except asyncio.CancelledError:
            status = 503
            answer[:] = b'{"detail": "the service ended meanwhile; whether it was done is not known"}'
            raise
        finally:
            told = _object(answer)
            state = cast(dict[str, Any], scope.get("state") or {})
            after = state.get("after", {key: told[key] for key in ("id", "state") if key in told} or None)
            self._log.tell(Entry.of(
                scope, status, "done" if status < 400 else str(told.get("detail", "failed")),
                body=short(body.decode("utf-8", "replace")), before=state.get("before"),
                after=after if status < 400 else None, done=int(status) not in _REFUSED,
            ))  # fmt: skip


def _object(answer: bytearray) -> dict[str, Any]:
    try:
        told = json.loads(answer)
    except (ValueError, RecursionError):
        return {}
    return cast(dict[str, Any], told) if isinstance(told, dict) else {}


def changes(before: Mapping[str, Any], after: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Of settings, what is not as it was."""
    keys = [key for key in after if after[key] != before.get(key)]
    return {key: before.get(key) for key in keys}, {key: after[key] for key in keys}
