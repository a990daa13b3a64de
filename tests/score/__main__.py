"""A development suite made, diagnosed and scored: 500 recordings of 6 s, of every kind; 4 GB for that time."""

import subprocess
import sys
import tempfile
from pathlib import Path

_COUNT, _SEED, _LENGTH = 500, 1000, 6.0


def main() -> int:
    """Options are those of `tests.score.score`."""
    with tempfile.TemporaryDirectory() as folder:
        out, answers = Path(folder) / "recordings", Path(folder) / "answers"
        made = [sys.executable, "-m", "emulator", "conceal", "--count", str(_COUNT), "--seed", str(_SEED)]
        subprocess.run([*made, "--length", str(_LENGTH), "--out", out, "--answers", answers], check=True)
        scored = [sys.executable, "-m", "tests.score.score", "--out", out, "--answers", answers]
        return subprocess.run([*scored, *sys.argv[1:]], check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
