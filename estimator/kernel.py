"""The decorator of the hot loops: compiled once, kept on disk, and never stale.

Numba's cache notices only a change of the decorated function's own file, not of a function inlined from
another one. So the cache lives in a folder named after the content of this room's sources.
"""

import contextlib
import hashlib
import os
import shutil
import time
from collections.abc import Callable, Generator
from pathlib import Path
from typing import ParamSpec, TypeVar, cast

import numba
from numba.core import config as numba_config
from numba.core import event

P = ParamSpec("P")
R = TypeVar("R")


_KEPT_TIME = 86400.0  # s without use after which the folders of other versions go


def _cache_folder() -> str | None:
    """The folder for this version of the sources; those of others not used for a day are removed.

    None where none can be written: then nothing is cached.
    """
    sources = sorted(Path(__file__).parent.rglob("*.py"))
    digest = hashlib.sha256(b"\0".join(source.read_bytes() for source in sources)).hexdigest()[:16]
    try:
        home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        folder = home / "pmsm-bench" / "estimator" / digest
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        with contextlib.suppress(FileNotFoundError):  # another process removes it too
            for other in folder.parent.iterdir():
                if time.time() - other.stat().st_mtime > _KEPT_TIME:
                    shutil.rmtree(other, ignore_errors=True)
    except (OSError, RuntimeError):  # read-only, or no home
        return None
    return str(folder) if os.access(folder, os.W_OK) else None


_FOLDER = _cache_folder()


def kept() -> tuple[str | None, int]:
    """The folder of what is compiled, None where none can be written, and how many kernels are there."""
    return _FOLDER, 0 if _FOLDER is None else sum(1 for _ in Path(_FOLDER).rglob("*.nbi"))


@contextlib.contextmanager
def on_compile(hear: Callable[[], object]) -> Generator[None]:
    """Hear of each kernel, before it is compiled, that is not on disk."""

    class Listener(event.Listener):
        def on_start(self, event: object) -> None:
            hear()

        def on_end(self, event: object) -> None:
            pass

    with event.install_listener("numba:compile", Listener()):
        yield


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function of numbers and arrays to machine code at its first call. It divides by zero as numpy does.

    It lets other threads go on meanwhile: the arrays it is given are its caller's alone.
    """
    return _compiled(function, fastmath=False)


def lean_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function that makes no arrays: it counts no references to those it is given, and is a part of whoever
    calls it. Of small functions that are given many arrays, handing these on is most of the time.
    """
    return _compiled(function, fastmath=False, counted=False)


def summing_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile sums whose order does not matter, so that several of their terms go at once."""
    return _compiled(function, fastmath={"reassoc", "contract"})


def _compiled(function: Callable[P, R], fastmath: bool | set[str], *, counted: bool = True) -> Callable[P, R]:
    before = getattr(numba_config, "CACHE_DIR", "")
    setattr(numba_config, "CACHE_DIR", _FOLDER or "")  # noqa: B010 - numba declares its settings at run time
    try:
        jit = cast(Callable[..., Callable[[Callable[P, R]], Callable[P, R]]], numba.njit)
        caches = _FOLDER is not None
        return jit(
            cache=caches, fastmath=fastmath, error_model="numpy", nogil=True, _nrt=counted, forceinline=not counted
        )(function)
    finally:
        setattr(numba_config, "CACHE_DIR", before)  # noqa: B010
