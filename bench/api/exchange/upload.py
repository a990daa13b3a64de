"""A file that is brought over HTTP: to the disk as it comes, then to a recording. Knows nothing of what it holds."""

import hashlib
from collections.abc import AsyncIterator
from typing import Final

from anyio import to_thread
from fastapi import Request
from starlette.requests import ClientDisconnect

from bench.api.exchange.problems import TooLargeError
from bench.errors import LimitError, UnavailableError
from bench.service.service import Service
from bench.store.importing import MOST, Import, check_room, imported, place_for

_PIECE: Final = 1 << 22  # bytes that are written at once
_TOO_LONG: Final = f"expected a file of at most {MOST / 1e9:g} GB, got more"


async def brought(service: Service, request: Request, said: Import) -> str:
    """The id of the recording that a request's file becomes. Raises BenchError."""
    folder, kept_free = service.config.captures.absolute(), service.config.keep_free_megabytes * 1e6
    told = request.headers.get("content-length", "")
    expected = int(told) if told.isascii() and told.isdigit() else 0
    if expected > MOST:
        raise TooLargeError(_TOO_LONG)
    try:
        with place_for(folder, said.name) as place:
            check_room(folder, 3 * expected, kept_free)  # the file, what stands for it, the recording
            digest, size = hashlib.sha256(), 0
            with place.open("wb") as file:
                async for piece in _pieces(request):
                    size += len(piece)
                    if size > MOST:
                        raise TooLargeError(_TOO_LONG)
                    check_room(folder, len(piece), kept_free)
                    digest.update(piece)
                    await to_thread.run_sync(file.write, piece)
            if not size:
                raise LimitError("expected a file's bytes as the body, got none")
            path = await to_thread.run_sync(imported, folder, place, said, digest.hexdigest())
    except OSError as error:
        raise UnavailableError(f"the file cannot be kept: {error.strerror or error}") from None
    return path.stem


async def _pieces(request: Request) -> AsyncIterator[bytes]:
    """The body, some MB at once. Raises LimitError where it breaks off."""
    waiting = bytearray()
    try:
        async for part in request.stream():
            waiting += part
            if len(waiting) >= _PIECE:
                yield bytes(waiting)
                waiting.clear()
    except ClientDisconnect:
        raise LimitError("the body broke off") from None
    if waiting:
        yield bytes(waiting)
