"""What routes have in common: names in their paths, JSON bodies, pages of lists, the refusals that their descriptions
tell.
"""

import json
import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from typing import Annotated, Any, Final, TypeVar, cast

from fastapi import Depends, Path, Query, Request
from starlette.requests import ClientDisconnect

from bench.api.exchange.kinds import BYTES, READS, TOML, is_stop, media_of
from bench.api.exchange.problems import MediaError, TooLargeError
from bench.errors import LimitError, shown
from bench.files import TwiceError, json_of
from bench.service.service import Service
from bench.store.catalogue.chronicle import Place

_MAX_BODY: Final = 1 << 16  # bytes

SHAPES: Final = "#/components/schemas/"
PROBLEM: dict[str, Any] = {"content": {"application/problem+json": {"schema": {"$ref": f"{SHAPES}ProblemModel"}}}}
Answers = dict[int | str, dict[str, Any]]
DRIVE: Answers = {
    404: {"description": "No drive of that name"} | PROBLEM,
    502: {"description": "The drive answered what cannot be"} | PROBLEM,
}
CHANGED: Answers = {412: {"description": "Another state than If-Match says; nothing was changed"} | PROBLEM}
SAME: Answers = {304: {"description": "The state is the one that If-None-Match says"}}
_ANY: Final = {  # of every route
    "400": "Not HTTP", "403": "Asked for by a page of another origin", "408": "The request took too long to come",
    "421": "Another Host than the service's", "422": "Not what can be asked for", "431": "A head that is too long",
    "500": "A fault of the service's own; its log says more",
    "503": "Too much at once, or no answer from the drive, or the service is ending",
}
_WRITE: Final = {  # of every route with a body
    "413": "A body that is too long", "415": "Not said to be JSON",
    "422": "Not what can be asked for; nothing was changed",
}
_WRITES: Final = "every PUT and POST but those that stop"
_TOKEN: Final = {"401": "The token is missing"}

T = TypeVar("T")

DriveName = Annotated[str, Path(description="name of a drive")]
_DAY: Final = r"(19|20)\d\d-(0[1-9]|1[0-2])-(0[1-9]|1\d|2[0-8])"
_PLACE: Final = rf"^{_DAY}T([01]\d|2[0-3]):[0-5]\d:[0-5]\d(\.\d{{1,6}})?Z(~[A-Za-z0-9_-]{{1,200}})?$"
Before = Annotated[str | None, Query(
    description="what `next` says, or a time (RFC 3339): of before that",
    json_schema_extra={"pattern": _PLACE, "examples": ["2026-01-31T12:00:00Z"]},
)]  # fmt: skip
Limit = Annotated[int, Query(description="how many", ge=1, le=1000)]
_FIRST: Final = 1970
_RFC_3339: Final = re.compile(r"\d{4}-\d\d-\d\d[Tt]\d\d:\d\d:\d\d(\.\d+)?([Zz]|[+ -]\d\d:\d\d)")


def of_known(service: Service) -> list[Any]:
    """The dependency of a route that refuses a drive it does not know before it looks at anything else."""

    async def known(name: DriveName) -> None:  # in the loop: a thread for it would cost more than it does
        service.drive(name)

    return [Depends(known)]


def body_of(model: str) -> dict[str, Any]:
    """The description of a route's JSON body: required, for no OpenAPI document can say that none is JSON, too."""
    schema = {"schema": {"$ref": f"{SHAPES}{model}"}}
    return {"requestBody": {"required": True, "content": {"application/json": schema}}}


def json_object(example: Mapping[str, Any], *, required: bool = True) -> Any:
    """The dependency that is the request's body, or an empty object where none is required and none came.

    Raises LimitError, with the example, when it is no JSON object.
    """

    async def body(request: Request) -> dict[str, Any]:
        text = await _body(request)
        return _object(text if text or required else b"{}", json.dumps(example))

    return Depends(body)


def text_or_object(example: Mapping[str, Any]) -> Any:
    """The dependency that is the request's body: a text where it is said to be TOML, else a JSON object.

    Raises LimitError, with the example.
    """

    async def body(request: Request) -> str | dict[str, Any]:
        text = await _body(request)
        if _media(request) == TOML:
            try:
                return text.decode()
            except UnicodeDecodeError:
                raise LimitError("expected TOML, which is UTF-8, got other bytes") from None
        return _object(text, json.dumps(example))

    return Depends(body)


def time_of(text: str, what: str) -> datetime:
    """A time with its zone, whose + may have come as a space, as queries have it. Raises LimitError."""
    with suppress(ValueError):
        if _RFC_3339.fullmatch(text) and (at := datetime.fromisoformat(text.upper().replace(" ", "+"))).year >= _FIRST:
            return at
    raise LimitError(f"{what}: expected a time of {_FIRST} or later, such as 2026-01-31T12:00:00Z, got {shown(text)}")


def place_before(text: str | None) -> Place | None:
    """Where a page begins; None for the first one. Raises LimitError."""
    if text is None:
        return None
    at, _, id_ = text.partition("~")
    return time_of(at, "before"), id_


def told_place(place: Place) -> str:
    """As `next` tells the last of a page."""
    at, id_ = place
    return f"{at.astimezone(UTC).isoformat().replace('+00:00', 'Z')}~{id_}"


def page_of(
    items: Iterable[T], place: Callable[[T], Place], before: str | None, limit: int
) -> tuple[list[T], int, str | None]:
    """The first page before a place, the newest first; how many there are from there on; before which the next page
    begins, None on the last one. Raises LimitError.
    """
    begin = place_before(before)
    there = sorted((one for one in items if begin is None or place(one) < begin), key=place, reverse=True)
    page = there[:limit]
    return page, len(there), told_place(place(page[-1])) if len(there) > limit else None


def complete(document: dict[str, Any], *, with_token: bool) -> None:
    """Add to an OpenAPI document what every route may answer, and what everybody needs."""
    for methods in document["paths"].values():
        for method, told in methods.items():
            common = _ANY | (_TOKEN if with_token else {}) | ({} if method in ("get", "delete") else _WRITE)
            answers = {status: {"description": said} | PROBLEM for status, said in common.items()}
            ours = {key: answer for key, answer in told["responses"].items() if not _is_fastapis(answer)}
            told["responses"] = dict(sorted((answers | ours).items()))
    for shape in ("HTTPValidationError", "ValidationError"):
        document["components"]["schemas"].pop(shape, None)
    if with_token:
        document["components"]["securitySchemes"] = {"token": {"type": "http", "scheme": "bearer"}}
        document["security"] = [{"token": []}]


def _is_fastapis(answer: dict[str, Any]) -> bool:
    """The framework's own document of what is refused, where ours are problem documents."""
    schema = answer.get("content", {}).get("application/json", {}).get("schema", {})
    return schema.get("$ref") == f"{SHAPES}HTTPValidationError"


async def says_json(request: Request) -> None:
    """The dependency of every route: a PUT or POST says that it is JSON, which no form of another page can say.

    What stops a motor needs not say it; a file that is brought says that it is bytes, a parameter set may that it is
    TOML, which no form can say either.
    Raises MediaError.
    """
    if request.method in (*READS, "DELETE") or is_stop(request.method, request.url.path):
        return
    kinds = media_of(request.method, request.url.path)
    if _media(request) not in kinds:
        got = shown(said) if (said := request.headers.get("content-type", "")) else "none"
        of = "a file that is brought" if BYTES in kinds else "a parameter set" if TOML in kinds else _WRITES
        expected = f"the header Content-Type: {' or '.join(kinds)}, as of {of}"
        raise MediaError(f"expected {expected}, got {got}")


def _media(request: Request) -> str:
    return request.headers.get("content-type", "").partition(";")[0].strip().lower()


async def knows_query(request: Request) -> None:
    """The dependency of every route: a query says what the route's description has. Raises LimitError."""
    path, method = getattr(request.scope.get("route"), "path", ""), request.method.lower()
    routes = request.app.openapi()["paths"].get(path)
    if routes is None or not request.query_params:
        return
    told = routes.get("get" if method == "head" else method, {}).get("parameters", [])
    known = [parameter["name"] for parameter in told if parameter["in"] == "query"]
    if (key := next((key for key in request.query_params if key not in known), None)) is not None:
        raise LimitError(f"unknown query key {shown(key)}, expected {', '.join(known) or 'none'}")


async def _body(request: Request) -> bytes:
    text = b""
    try:
        async for part in request.stream():
            text += part
            if len(text) > _MAX_BODY:
                raise TooLargeError(f"expected a body of at most {_MAX_BODY} bytes, got more")
    except ClientDisconnect:
        raise LimitError("the body broke off") from None
    return text


def _object(text: bytes, example: str) -> dict[str, Any]:
    try:
        body = json_of(text)
    except TwiceError as error:
        raise LimitError(str(error)) from None
    except ValueError:
        raise LimitError(f"the body is not JSON, expected an object such as {example}") from None
    if not isinstance(body, dict):
        raise LimitError(f"expected a JSON object such as {example}, got {shown(body)}")
    return cast(dict[str, Any], body)
