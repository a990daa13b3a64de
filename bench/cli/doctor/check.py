"""One check: what was looked at, how it stands, what was found, what to do. Knows nothing of what is looked at."""

from dataclasses import dataclass
from enum import StrEnum


class Verdict(StrEnum):
    """How it stands."""

    OK = "ok"
    WARNING = "warning"  # it runs, with less than it could have
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class Check:
    """What was looked at; `advice` is a sentence where there is something to do."""

    what: str
    verdict: Verdict
    found: str
    advice: str = ""


def ok(what: str, found: str) -> Check:
    """All is well."""
    return Check(what, Verdict.OK, found)


def warning(what: str, found: str, advice: str) -> Check:
    """It runs, with less than it could have."""
    return Check(what, Verdict.WARNING, found, advice)


def failed(what: str, found: str, advice: str) -> Check:
    """It does not run so."""
    return Check(what, Verdict.FAILED, found, advice)
