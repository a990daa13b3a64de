"""Folders that the service writes to, its token, its certificate. Makes and writes nothing."""

import getpass
import os
import shutil
from collections.abc import Generator
from pathlib import Path
from typing import Final

from bench.api.guard.access import is_loopback, tls_of
from bench.cli.doctor.check import Check, failed, ok, warning
from bench.config import Config
from bench.errors import ConfigError
from bench.service import token

_FULL: Final = 20e6  # bytes: a capture of 65536 samples by all signals, and its part file
_LOW: Final = 1e9  # bytes


def checks(config: Config) -> Generator[Check]:
    """All places of a configuration."""
    folders = {
        "captures": config.captures, "journals of flashes and control": config.journals, "log": config.log,
    }
    for what, folder in folders.items():
        yield _folder(f"folder of {what}" if what != "log" else "folder of logs", folder)
    yield _token(config)
    if config.certificate is not None:
        yield _certificate(config)


def _folder(what: str, folder: Path) -> Check:
    """It, or what it will be made in, can be written, and has room."""
    there = next(place for place in (folder, *folder.absolute().parents) if os.path.lexists(place))
    name = str(folder) if there == folder else f"{folder}, to be made in {there}"
    if not there.is_dir():
        return failed(what, f"{there} is no folder", "move it away, or name another folder in [service]")
    if not os.access(there, os.W_OK | os.X_OK):
        return failed(
            what, f"{name} cannot be written by {_user()}",
            f"sudo chown {_user()} {there}, or name another folder in [service]",
        )
    free = shutil.disk_usage(there).free
    found = f"{name}, {free / 1e9:.3g} GB are free"
    if free < _FULL:
        return failed(what, found, "make room: captures and logs cannot be kept")
    return ok(what, found) if free >= _LOW else warning(what, found, "make room: a full disk refuses captures")


def _token(config: Config) -> Check:
    path, needed = config.token, not is_loopback(config.host)
    what = "token" if needed else "token (not needed on loopback)"
    if not os.path.lexists(path):
        return ok(what, f"{path} is not there; " + ("the first start makes it" if needed else "nobody asks for it"))
    try:
        token.read(path)
    except ConfigError as error:
        return (failed if needed else warning)(
            what, str(error), f"chmod 600 {path} as its owner, or make another: pmsm-bench token --new",
        )  # fmt: skip
    return ok(what, f"{path}, readable by its owner alone")


def _certificate(config: Config) -> Check:
    try:
        tls_of(config)
    except ConfigError as error:
        return failed("certificate", str(error), "see [service] certificate and key")
    return ok("certificate", f"{config.certificate} and its key belong together")


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError):
        return str(os.geteuid())
