"""Preconditions of requests: which state a client has seen, and whether it still is that one (RFC 9110, 8.8.3 and 13).

Knows nothing of what the states are.
"""

import hashlib
import re
from typing import Annotated, Final

from fastapi import Header
from pydantic import BaseModel

from bench.api.exchange.problems import PreconditionError
from bench.errors import shown

_TAG: Final = re.compile(r'(?:W/)?"[\x21\x23-\x7e\x80-\xff]*"')
_EXAMPLE: Final = '"3f0a1c5e9b7d2468"'

IfMatch = Annotated[
    str | None,
    Header(
        alias="If-Match", examples=[_EXAMPLE],
        description="ETag of the state that is to be changed; of another one: 412",
    ),
]
IfNoneMatch = Annotated[
    str | None,
    Header(
        alias="If-None-Match", examples=[_EXAMPLE],
        description="ETag of a state that is known; while it is that: 304",
    ),
]
TAGGED: Final = {"ETag": {"description": "of this state", "schema": {"type": "string", "examples": [_EXAMPLE]}}}
"""The description of an answer's header."""


def tag_of(state: BaseModel, **but: set[str]) -> str:
    """The ETag of a state; `include` or `exclude` as in `model_dump_json`."""
    said = state.model_dump_json(**but)  # pyright: ignore[reportArgumentType]
    return f'"{hashlib.sha256(said.encode()).hexdigest()[:16]}"'


def is_known(tag: str, if_none_match: str | None) -> bool:
    """Whether a client has this state already."""
    said = if_none_match or ""
    return said.strip() == "*" or tag in (one.removeprefix("W/") for one in _TAG.findall(said))


def check_match(tag: str, if_match: str | None) -> None:
    """Raise PreconditionError where a client has seen another state than this one; without the header, nothing."""
    if if_match is not None and if_match.strip() != "*" and tag not in _TAG.findall(if_match):
        raise PreconditionError(
            f"expected If-Match: {tag}, which is the state now, got {shown(if_match)}; nothing was changed"
        )
