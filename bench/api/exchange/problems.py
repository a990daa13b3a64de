"""Errors as RFC 9457 problem documents: every refusal is a status, a title and a sentence."""

from http import HTTPStatus
from typing import cast

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException
from starlette.routing import Match

from bench.errors import BenchError, ConflictError, LimitError, UnavailableError, UnknownError, shown
from drivers.errors import ConnectError, DriveError, FaultError, LostError, NoReplyError, RefusedError


class PreconditionError(LimitError):
    """A change of another state than the one that a client has seen."""


class MediaError(LimitError):
    """A write that does not say that it is JSON."""


class TooLargeError(LimitError):
    """A body that is too long."""


_LONGEST = 280  # characters of a sentence that is made of several
_STATUS: dict[type[Exception], int] = {
    UnknownError: 404,
    ConflictError: 409,
    PreconditionError: 412,
    TooLargeError: 413,
    MediaError: 415,
    LimitError: 422,
    UnavailableError: 503,
    BenchError: 422,
    RefusedError: 409,
    FaultError: 409,
    ConnectError: 503,
    LostError: 503,
    NoReplyError: 503,
    DriveError: 502,
}


def problem(status: int, detail: str) -> JSONResponse:
    """A problem document. Of several lines all are in `problems`, the first that fit in the sentence."""
    lines = detail.splitlines()
    content: dict[str, object] = {"type": "about:blank", "title": HTTPStatus(status).phrase, "status": status}
    content |= {"detail": detail} if len(lines) < 2 else {"detail": _joined(lines), "problems": lines}
    return JSONResponse(content, status, media_type="application/problem+json")


def _joined(lines: list[str]) -> str:
    """As many as a sentence takes, the first in any case."""
    for count in range(len(lines), 1, -1):
        more = f"; and {len(lines) - count} more" if count < len(lines) else ""
        if len(text := "; ".join(lines[:count]) + more) <= _LONGEST:
            return text
    return f"{lines[0]}; and {len(lines) - 1} more"


def install(app: FastAPI) -> None:
    """Answer every error of the application with a problem document."""

    async def expected(_request: Request, error: Exception) -> JSONResponse:
        status = next(code for kind, code in _STATUS.items() if isinstance(error, kind))
        return problem(status, str(error))

    async def http(request: Request, error: Exception) -> JSONResponse:
        status, path = cast(HTTPException, error).status_code, request.url.path[:100]
        if status == HTTPStatus.NOT_FOUND:
            return problem(status, f"nothing at {path}; see /docs")
        if status == HTTPStatus.METHOD_NOT_ALLOWED:
            answer = problem(status, f"{path} does not take {request.method}; see /docs")
            answer.headers["Allow"] = ", ".join(sorted(_methods(app, request)))
            return answer
        return problem(status, str(cast(HTTPException, error).detail))

    async def invalid(_request: Request, error: Exception) -> JSONResponse:
        return problem(422, "; ".join(_sentence(item) for item in cast(RequestValidationError, error).errors()))

    async def unexpected(_request: Request, error: Exception) -> JSONResponse:
        return problem(500, f"the service failed: {type(error).__name__}; its log says more")

    for kind in _STATUS:
        app.add_exception_handler(kind, expected)
    app.add_exception_handler(HTTPException, http)
    app.add_exception_handler(RequestValidationError, invalid)
    app.add_exception_handler(Exception, unexpected)


def _methods(app: FastAPI, request: Request) -> set[str]:
    """What all routes of a path take together."""
    there = (route for route in app.routes if route.matches(request.scope)[0] is not Match.NONE)
    return {method for route in there for method in getattr(route, "methods", None) or ("GET", "HEAD")}


def _sentence(item: dict[str, object]) -> str:
    where = ".".join(str(part) for part in cast(tuple[object, ...], item.get("loc", ())) if part != "body") or "body"
    if item.get("type") == "json_invalid":
        return "the body is not JSON"
    return f"{where}: {item.get('msg')}, got {shown(item.get('input'))}"
