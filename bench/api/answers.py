"""What routes have in common: names in their paths, JSON bodies, the refusals that their descriptions tell."""

import json
from collections.abc import Mapping
from typing import Annotated, Any, Final, cast

from fastapi import Depends, Path, Request

from bench.errors import LimitError, shown
from bench.service import Service

_MAX_BODY: Final = 1 << 16  # bytes

SHAPES: Final = "#/components/schemas/"
PROBLEM: dict[str, Any] = {"content": {"application/problem+json": {"schema": {"$ref": f"{SHAPES}ProblemModel"}}}}
Answers = dict[int | str, dict[str, Any]]
ANY: Answers = {"default": {"description": "Any other refusal or failure"} | PROBLEM}
DRIVE: Answers = {404: {"description": "No drive of that name"} | PROBLEM} | ANY

DriveName = Annotated[str, Path(description="name of a drive")]


def of_known(service: Service) -> list[Any]:
    """The dependency of a route that refuses a drive it does not know before it looks at anything else."""

    def known(name: DriveName) -> None:
        service.url(name)

    return [Depends(known)]


def body_of(model: str, *, required: bool = True) -> dict[str, Any]:
    """The description of a route's JSON body."""
    schema = {"schema": {"$ref": f"{SHAPES}{model}"}}
    return {"requestBody": {"required": required, "content": {"application/json": schema}}}


def json_object(example: Mapping[str, Any], *, required: bool = True) -> Any:
    """The dependency that is the request's body, or an empty object where none is required and none came.

    Raises LimitError, with the example, when it is no JSON object.
    """

    async def body(request: Request) -> dict[str, Any]:
        text = await _body(request)
        return _object(text if text or required else b"{}", json.dumps(example))

    return Depends(body)


async def _body(request: Request) -> bytes:
    text = b""
    async for part in request.stream():
        text += part
        if len(text) > _MAX_BODY:
            raise LimitError(f"expected a body of at most {_MAX_BODY} bytes, got more")
    return text


def _object(text: bytes, example: str) -> dict[str, Any]:
    try:
        body = json.loads(text)
    except (ValueError, RecursionError):
        raise LimitError(f"the body is not JSON, expected an object such as {example}") from None
    if not isinstance(body, dict):
        raise LimitError(f"expected a JSON object such as {example}, got {shown(body)}")
    return cast(dict[str, Any], body)
