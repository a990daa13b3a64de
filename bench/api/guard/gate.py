"""The gate before the application: who may not call is refused here, and every answer forbids to be framed."""

from typing import Final

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from bench.api.exchange.kinds import READS
from bench.api.exchange.problems import problem
from bench.api.guard import login
from bench.api.guard.access import Access, Refusal
from bench.store.write_log import Entry, WriteLog

_NO_TOKEN: Final = Refusal(
    401, "expected the token of this service (`pmsm-bench token` on its machine prints it, with `--config FILE` where "
    "it has a configuration) as `Authorization: Bearer TOKEN`, or of a browser that has logged in at /login",
)  # fmt: skip
_HEADERS: Final = {
    "X-Frame-Options": "DENY",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",  # `no-referrer` would make the page's own Origin null
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
}
_POLICY: Final = "frame-ancestors 'none'; object-src 'none'; base-uri 'none'; form-action 'self'"


class Gate:
    """ASGI middleware: the outermost."""

    def __init__(self, app: ASGIApp, access: Access, log: WriteLog) -> None:
        self._app, self._access, self._log = app, access, log

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers[name] = value
                headers.append("Content-Security-Policy", _POLICY)  # beside a route's own: both hold
            await send(message)

        answer = await self._answer(scope, receive)
        await (answer or self._app)(scope, receive, guarded)

    async def _answer(self, scope: Scope, receive: Receive) -> Response | None:
        """What the gate answers itself; None where the application is to."""
        access, method, headers = self._access, scope["method"], Headers(scope=scope)
        refusal = access.refusal(method, headers)
        if refusal is None and access.token is not None and scope["path"] == login.PATH:
            answer = await login.answer(Request(scope, receive), access)
            if method not in READS:
                self._tell(scope, answer.status_code, "logged in" if answer.status_code < 400 else "not the token")
            return answer
        by = access.by(headers)
        if refusal is None and by is not None:
            scope.setdefault("state", {})["by"] = by
            return None
        refusal = refusal or _NO_TOKEN
        self._tell(scope, refusal.status, refusal.detail)
        if refusal.status == 401 and method in READS and "text/html" in headers.get("accept", ""):
            return login.asking("Reading and writing need the token of this service.")
        answer = problem(refusal.status, refusal.detail)
        if refusal.status == 401:
            answer.headers["WWW-Authenticate"] = "Bearer"
        return answer

    def _tell(self, scope: Scope, status: int, outcome: str) -> None:
        if status >= 400 or scope["method"] not in READS:
            self._log.tell(Entry.of(scope, status, outcome))
