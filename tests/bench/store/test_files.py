"""Files that are written whole or not at all, and what is left of those that were not."""

import subprocess
import sys
from pathlib import Path

from bench.files import sweep, unfinished

_WRITING = """
import sys, time
from pathlib import Path
from bench.files import unfinished
with unfinished(Path(sys.argv[1])) as (name, file):
    file.write(b"half")
    file.flush()
    print(name.name, flush=True)
    time.sleep(60)
"""


def test_what_a_killed_process_left_is_swept_and_what_is_being_written_stays(tmp_path: Path) -> None:
    (tmp_path / ".another.unfinished").touch()
    with subprocess.Popen([sys.executable, "-c", _WRITING, tmp_path], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        left = tmp_path / process.stdout.readline().strip()
        sweep(tmp_path)
        assert left.read_bytes() == b"half"
        process.kill()
    with unfinished(tmp_path) as (mine, _):
        sweep(tmp_path)
        assert {path.name for path in tmp_path.iterdir()} == {mine.name, ".another.unfinished"}
    sweep(tmp_path / "nowhere")
