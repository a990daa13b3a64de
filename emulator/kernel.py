"""Compiled functions: `kernel` is numba's `njit` with a type and with a cache that is never stale.

Numba's own cache notices a change of the file a function stands in, but not of the functions it calls in
other files. So the cache is kept in a folder named after a hash of all sources of this room: any change
compiles anew. Knows nothing of what is compiled.
"""

import hashlib
import os
import shutil
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba
from numba.core import config

P = ParamSpec("P")
R = TypeVar("R")

_ROOM = Path(__file__).parent
_KEPT = 4  # folders of other versions that stay, the latest used
_KEPT_TIME = 86400.0  # s, and none that was used within this time goes
_config: Any = config
_decorating = threading.Lock()


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """`function`, compiled at its first call or taken from the cache. Division by zero gives inf.

    Other threads go on while it runs: the drive's links are served meanwhile.
    """
    return _compiled(function, forceinline=False)


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """`kernel`, made a part of every kernel that calls it: for one called often, with much to hand over."""
    return _compiled(function, forceinline=True)


def _compiled(function: Callable[P, R], forceinline: bool) -> Callable[P, R]:
    with _decorating:
        before = _config.CACHE_DIR
        _config.CACHE_DIR = "" if _CACHE is None else str(_CACHE)  # numba reads it while it decorates only
        try:
            compiled = numba.njit(
                cache=_CACHE is not None, error_model="numpy", nogil=True, forceinline=forceinline
            )(function)
        finally:
            _config.CACHE_DIR = before
    return cast(Callable[P, R], compiled)


def source_hash(room: Path) -> str:
    """Path and content of every Python file below the folder, as 16 hex digits."""
    digest = hashlib.sha256()
    for file in sorted(room.rglob("*.py")):
        digest.update(file.relative_to(room).as_posix().encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def prune(folder: Path, used: Path, now: float) -> None:
    """Remove the folders beside `used` that were not used for long, but for the latest few. `now`: Unix time."""
    others = [entry for entry in folder.iterdir() if entry.is_dir() and entry != used]
    others.sort(key=lambda entry: entry.stat().st_mtime, reverse=True)
    for entry in others[_KEPT:]:
        if now - entry.stat().st_mtime > _KEPT_TIME:
            shutil.rmtree(entry, ignore_errors=True)


def _cache_folder() -> Path | None:
    """The folder for this version of the sources; None where none can be written (then nothing is cached)."""
    try:
        user = os.environ.get("XDG_CACHE_HOME")
        base = (Path(user) if user else Path.home() / ".cache") / "pmsm-bench" / "numba"
        folder = base / source_hash(_ROOM)
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)  # used now
        prune(base, folder, time.time())
    except (OSError, RuntimeError):  # no home, read-only, or another process prunes at this moment
        return None
    return folder if os.access(folder, os.W_OK) else None


_CACHE = _cache_folder()
