"""The machine: versions, compiled kernels, clock, limits."""

import ctypes
import platform
import re
import sys
import time
from collections.abc import Generator
from datetime import UTC, datetime
from importlib import metadata
from typing import Final

from bench.cli.doctor.check import Check, failed, ok, warning

PACKAGE: Final = "pmsm-bench"
_PYTHON: Final = (3, 11)
_YEARS: Final = (2025, 2100)  # that a clock can be set to
_UNSYNCHRONISED: Final = 5  # TIME_ERROR of adjtimex(2)
_TIMEX: Final = 512  # bytes, more than its structure has
_CONNECTIONS: Final = 512  # file descriptors: 300 connections of the service, and what drives and files take


def version_line() -> str:
    """The package, Python and the platform."""
    return f"{PACKAGE} {metadata.version(PACKAGE)}, Python {platform.python_version()}, {platform.platform()}"


def checks() -> Generator[Check]:
    """All of the machine."""
    yield _python()
    yield _packages()
    yield _kernels()
    yield _clock()
    if sys.platform != "win32":
        yield _descriptors()


def _python() -> Check:
    found = f"{version_line()}, in {sys.prefix}"
    if sys.version_info < _PYTHON:
        return failed("versions", found, "install Python 3.11 or later, and pmsm-bench into an environment of it")
    return ok("versions", found)


def _packages() -> Check:
    """The packages that it needs are there."""
    missing, count = list[str](), 0
    for line in metadata.requires(PACKAGE) or ():
        if "extra ==" in line:
            continue
        name, count = re.split(r"[^A-Za-z0-9._-]", line, maxsplit=1)[0], count + 1
        try:
            metadata.version(name)
        except metadata.PackageNotFoundError:
            missing.append(name)
    if missing:
        return failed("packages", f"not installed: {', '.join(missing)}", "install pmsm-bench once more: make run")
    return ok("packages", f"all {count} are installed")


def _kernels() -> Check:
    from estimator.kernel import kept

    folder, count = kept()
    if folder is None:
        return warning(
            "kernels", "no folder for compiled kernels can be written",
            "set XDG_CACHE_HOME to a folder that can be: without one every start compiles for about a minute",
        )
    if not count:
        return warning(
            "kernels", f"nothing is compiled yet in {folder}", "the first start does it, in about a minute: start once"
        )
    return ok("kernels", f"{count} compiled, in {folder}")


def _clock() -> Check:
    year = datetime.now(UTC).year
    if not _YEARS[0] <= year < _YEARS[1]:
        return failed("clock", f"it is in {year}", "set the clock: captures are named and ordered by it")
    before = time.monotonic()
    if time.monotonic() < before or not time.get_clock_info("monotonic").monotonic:
        return failed("clock", "its monotonic time goes back", "leases are renewed by it: use another machine")
    synchronised = _synchronised()
    if synchronised is None:
        return ok("clock", f"it is {datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC; whether by a server is not told")
    if not synchronised:
        return warning(
            "clock", f"it is {datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC, synchronised with nothing",
            "have it synchronised (timedatectl set-ntp true): times in recordings and logs are by it",
        )
    return ok("clock", "synchronised")


def _synchronised() -> bool | None:
    """Whether the kernel takes its clock for synchronised; None where it does not tell."""
    try:
        state = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(_TIMEX))  # all zero: only asks
    except (AttributeError, OSError, TypeError):
        return None
    return None if state < 0 else state != _UNSYNCHRONISED


def _descriptors() -> Check:
    import resource

    now = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    if now != resource.RLIM_INFINITY and now < _CONNECTIONS:
        return warning("open files", f"{now} at a time", f"allow {_CONNECTIONS} (ulimit -n), or clients are refused")
    return ok("open files", f"{'any number' if now == resource.RLIM_INFINITY else now} at a time")
