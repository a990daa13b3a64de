"""Kinds of requests, by method and path: reads, and what stops a motor or what may move it."""

import re
from typing import Final

READS: Final = ("GET", "HEAD")
_STOP: Final = re.compile(r"POST /api/drives/([^/]+)/stop|DELETE /api/drives/[^/]+/(?:experiments|captures)/[^/]+")

_JOB: Final = re.compile(r"POST /api/(drives/[^/]+/(captures|recordings|experiments)|recordings/[^/]+/diagnosis)")


def begins_job(method: str, path: str) -> bool:
    """Whether a request begins what goes on after its answer."""
    return _JOB.fullmatch(f"{method} {path}") is not None


def is_upload(method: str, path: str) -> bool:
    """Whether a request brings a file, which is long."""
    return (method, path) == ("POST", "/api/recordings")


def stopped_drive(method: str, path: str) -> str | None:
    """The drive that a request stops; None where it stops none, or ends something else."""
    found = _STOP.fullmatch(f"{method} {path}")
    return found and found[1]


def is_stop(method: str, path: str) -> bool:
    """Whether a request ends something that moves or may move a motor."""
    return _STOP.fullmatch(f"{method} {path}") is not None
