"""Kinds of requests, by method and path: reads, and what stops a motor or what may move it."""

import re
from typing import Final

READS: Final = ("GET", "HEAD")
_ENDED: Final = "DELETE /api/drives/[^/]+/(?:experiments|commissionings|captures)/[^/]+"
_STOP: Final = re.compile(f"POST /api/drives/([^/]+)/stop|{_ENDED}")

BYTES: Final = "application/octet-stream"
JSON: Final = "application/json"
TOML: Final = "application/toml"
_OF_DRIVE: Final = "drives/[^/]+/(captures|recordings|experiments|commissionings|flashes|parameters/(rollback|resume))"
_JOB: Final = re.compile(f"POST /api/({_OF_DRIVE}|recordings/[^/]+/diagnosis)")
_PLAN: Final = re.compile("POST /api/drives/[^/]+/parameters/plan")
_SET: Final = re.compile("POST /api/drives/[^/]+/(parameters/plan|flashes)")


def changes_nothing(method: str, path: str) -> bool:
    """Whether a request reads, though it may bring what is asked about."""
    return method in READS or _PLAN.fullmatch(f"{method} {path}") is not None


def begins_job(method: str, path: str) -> bool:
    """Whether a request begins what goes on after its answer."""
    return _JOB.fullmatch(f"{method} {path}") is not None


def is_upload(method: str, path: str) -> bool:
    """Whether a request brings a file, which is long."""
    return (method, path) == ("POST", "/api/recordings")


def media_of(method: str, path: str) -> tuple[str, ...]:
    """What a write's body may be said to be: never what a form of another page can say."""
    if is_upload(method, path):
        return (BYTES,)
    return (JSON, TOML) if _SET.fullmatch(f"{method} {path}") else (JSON,)


def stopped_drive(method: str, path: str) -> str | None:
    """The drive that a request stops; None where it stops none, or ends something else."""
    found = _STOP.fullmatch(f"{method} {path}")
    return found and found[1]


def is_stop(method: str, path: str) -> bool:
    """Whether a request ends something that moves or may move a motor."""
    return _STOP.fullmatch(f"{method} {path}") is not None
