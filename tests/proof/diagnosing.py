"""`python -m tests.proof.diagnosing FOLDER OUT [--jobs N]`: what is said of a folder's recordings, as a pickle.

A process of its own, that is told a folder and nothing else: neither its arguments, nor its environment, nor its
memory have a seed or an answer in them. Those that it starts are new ones, too.
"""

import argparse
import pickle
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Final, cast

from tests.score.diagnosed import Said, diagnosed
from tests.score.score import FUNCTION

_EVERY: Final = 20  # recordings, between lines of progress


def said_of(recordings: Path, out: Path, jobs: int, function: str = FUNCTION) -> Mapping[str, Said]:
    """What a process of its own says of the recordings, by name. Raises CalledProcessError."""
    command = [sys.executable, "-m", "tests.proof.diagnosing", recordings, out, "--jobs", str(jobs)]
    subprocess.run([*command, "--function", function], check=True)
    with out.open("rb") as file:
        return cast(Mapping[str, Said], pickle.load(file))


def main() -> int:
    """Diagnose, and write what is said once all is."""
    parser = argparse.ArgumentParser("python -m tests.proof.diagnosing", description=__doc__)
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("out", type=Path, metavar="OUT")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="processes (default 2)")
    parser.add_argument("--function", default=FUNCTION, metavar="MODULE:NAME", help=f"what diagnoses ({FUNCTION})")
    given = parser.parse_args()
    wanted = [(given.folder, path.stem) for path in sorted(given.folder.glob("*.parquet"))]
    said: dict[str, Said] = {}
    for (_, name), heard in diagnosed(wanted, given.function, given.jobs):
        said[name] = heard
        if len(said) % _EVERY == 0 or len(said) == len(wanted):
            print(f"diagnosed {len(said)} of {len(wanted)}", file=sys.stderr, flush=True)
    with given.out.open("wb") as file:
        pickle.dump(said, file)
    return 0


if __name__ == "__main__":
    sys.exit(main())
