"""Exit codes: one meaning each, for every command."""

import os
import tempfile
from collections.abc import Iterable, Mapping
from typing import Any, Final

HOLDS: Final = 0  # what was asked holds, or is done
DOES_NOT: Final = 1  # it does not: a mismatch that stays unexplained, equations that do not fit
REFUSED: Final = 2  # wrong use, wrong input, nothing there: a file, a service, a drive
NOT_TOLD: Final = 3  # it cannot be told from this recording, or these rows
FAULT: Final = 70  # a fault of our own
INTERRUPTED: Final = 130  # Ctrl-C

_WORST: Final = (FAULT, REFUSED, DOES_NOT, NOT_TOLD, HOLDS)
EPILOG: Final = (
    "Exit codes: 0 what was asked holds; 1 it does not; 2 wrong use, wrong input, nothing there; 3 it cannot be told; "
    "70 a fault of pmsm-bench; 130 interrupted. Of several files the worst: 70, 2, 1, 3, 0."
)


def worst(codes: Iterable[int]) -> int:
    """Of several, in the order 70, 2, 1, 3, 0."""
    there = set(codes)
    return next((code for code in _WORST if code in there), HOLDS)


def code_of(estimates: Mapping[str, Mapping[str, Any]]) -> int:
    """Of estimates as REST and JSON show them: doubtful ones do not hold; where none is ok, it cannot be told."""
    statuses = {estimate["status"] for estimate in estimates.values()}
    if "doubtful" in statuses:
        return DOES_NOT
    return HOLDS if "ok" in statuses else NOT_TOLD


def details_kept(text: str) -> str:
    """Where the details of a fault lie, a clause that follows a sentence; empty where they cannot be written."""
    try:
        file, path = tempfile.mkstemp(prefix="pmsm-bench-fault-", suffix=".txt")
        with os.fdopen(file, "w", encoding="utf-8", errors="backslashreplace") as out:
            out.write(text)
    except OSError:
        return ""
    return f"; the details are in {path}"
