"""`python -m bench.recordings.foreign read|write FORM IN OUT MEMORY`: another tool's file to a plain Parquet, or back.

Says on standard output, in a line of JSON, what is wrong with the file, or nothing. For `process` alone.
"""

import contextlib
import json
import sys
from pathlib import Path
from typing import Any, Final

from bench.errors import RecordingError
from bench.recordings.foreign.content import Content
from bench.recordings.foreign.process import DONE

_FILE: Final = 4_000_000_000  # bytes that are written


def main() -> int:
    """0 where it is done, or `problem` says why not."""
    what, form, source, out = sys.argv[1:5]
    memory = int(sys.argv[5])  # bytes of addresses
    _be_bounded(memory)
    told: dict[str, Any] = {}
    try:
        with contextlib.redirect_stdout(sys.stderr):
            _work(what, form, Path(source), Path(out))
    except RecordingError as error:
        told = {"problem": str(error)}
    except MemoryError:
        told = {"problem": f"expected a file that takes up to {memory / 1e9:g} GB of memory, it takes more"}
    except OSError as error:
        told = {"problem": f"cannot be {DONE[what]}: {error.strerror or error}"}
    print(json.dumps(told))
    return 0


def _work(what: str, form: str, source: Path, out: Path) -> None:
    if form == "mat":
        from bench.recordings.foreign import mat as module
    else:
        from bench.recordings.foreign import mdf as module
    if what == "read":
        module.read(source).keep(out)
    else:
        module.write(out, Content.kept(source, json.loads(sys.stdin.read() or "{}")))


def _be_bounded(memory: int) -> None:
    """Whatever a file holds, this process takes so much and no more."""
    try:
        import resource
    except ImportError:  # not of this system
        return
    for kind, most in ((resource.RLIMIT_AS, memory), (resource.RLIMIT_FSIZE, _FILE), (resource.RLIMIT_CORE, 0)):
        resource.setrlimit(kind, (most, most))


if __name__ == "__main__":
    sys.exit(main())
