"""Files of other tools by a process of its own, that is bounded in memory and killed when its time is up.

What is read stands for the file as long as this process lives, in the system's folder for such things.
"""

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from bench.errors import RecordingError, UnavailableError
from bench.recordings.foreign.content import install

FORMS: Final = {"mat": "MATLAB's .mat", "mdf": "ASAM MDF"}
DONE: Final = {"read": "read", "write": "written"}
_MEMORY: Final = 6_000_000_000  # bytes
_TIME: Final = 120.0  # s
_KEPT: Final = 4  # files that are read, at a time
_ONE: Final = threading.Lock()  # process at a time: it may take some GB
_WAIT: Final = 10.0  # s for another one to end
_ONE_CORE: Final = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


class _Plain:
    """Plain tables of foreign files, the latest."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._made: dict[tuple[str, int, int], Path] = {}
        self._count = 0

    def of(self, path: Path, form: str) -> Path:
        stat = path.stat()
        key = os.path.realpath(path), stat.st_mtime_ns, stat.st_size
        with self._lock:
            if (made := self._made.get(key)) is not None:
                return made
            if self._folder is None:
                self._folder = tempfile.TemporaryDirectory(prefix="pmsm-bench-")
            self._count += 1
            out = Path(self._folder.name) / f"{self._count}.parquet"
        _run("read", form, path, out)
        with self._lock:
            self._made[key] = out
            while len(self._made) > _KEPT:
                self._made.pop(next(iter(self._made))).unlink(missing_ok=True)
        return out


_plain: Final = _Plain()


def plain(path: Path, form: str) -> Path:
    """The plain Parquet that stands for a file in one of `FORMS`. Raises RecordingError, OSError."""
    check_there(path.name, form)
    return _plain.of(path, form)


def write(source: Path, form: str, out: Path, said: Mapping[str, Any]) -> None:
    """Write a Parquet in one of `FORMS`, with its notes and what is `said` besides. Raises RecordingError."""
    check_there(source.name, form)
    _run("write", form, source, out, json.dumps(dict(said)))


def check_there(name: str, form: str) -> None:
    """Raise RecordingError where what reads and writes a form is not installed."""
    if form == "mdf" and importlib.util.find_spec("asammdf") is None:
        raise RecordingError(f"{name}: ASAM MDF needs asammdf, which is not installed: {install('pmsm-bench[mdf]')}")


def _run(what: str, form: str, source: Path, out: Path, said: str = "") -> None:
    files = [str(source.absolute()), str(out)]
    command = [sys.executable, "-m", "bench.recordings.foreign", what, form, *files, str(_MEMORY)]
    paths = os.pathsep.join(os.path.realpath(place) for place in sys.path)
    if not _ONE.acquire(timeout=_WAIT):
        raise UnavailableError(f"{source.name} cannot be {DONE[what]} now: expected other files to be done, one is not")
    try:
        ended = subprocess.run(
            command, input=said, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, timeout=_TIME, check=False,
            text=True, env=os.environ | _ONE_CORE | {"PYTHONPATH": paths}, start_new_session=True,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        out.unlink(missing_ok=True)
        said = f"expected a file that can be {DONE[what]} within {_TIME:g} s, it takes longer"
        raise RecordingError(f"{source}: {said}") from None
    finally:
        _ONE.release()
    told: dict[str, Any] | None = None
    if ended.returncode == 0:
        told = json.loads(ended.stdout or "null")
    if told is None:
        code = ended.returncode
        how = f"signal {-code}" if code < 0 else f"exit code {code}"
        told = {"problem": f"it cannot be {DONE[what]} as {FORMS[form]}: the process that was to do it ended ({how})"}
    if "problem" in told:
        out.unlink(missing_ok=True)
        raise RecordingError(f"{source}: {told['problem']}")
