"""Files that are written whole or not at all, and what is left of those that were not."""

import subprocess
import sys
from pathlib import Path

from bench.files import sweep, unfinished, unfinished_folder

_WRITING = """
import sys, time
from pathlib import Path
from bench.files import unfinished, unfinished_folder
folder = Path(sys.argv[1])
with unfinished(folder) as (name, file), unfinished_folder(folder) as place:
    file.write(b"half")
    file.flush()
    (place / "half").write_bytes(b"half")
    print(name.name, place.name, flush=True)
    time.sleep(60)
"""


def test_what_a_killed_process_left_is_swept_and_what_is_being_written_stays(tmp_path: Path) -> None:
    (tmp_path / ".another.unfinished").touch()
    with subprocess.Popen([sys.executable, "-c", _WRITING, tmp_path], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        file, place = (tmp_path / name for name in process.stdout.readline().split())
        sweep(tmp_path)
        assert file.read_bytes() == (place / "half").read_bytes() == b"half"
        process.kill()
    with unfinished(tmp_path) as (mine, _), unfinished_folder(tmp_path) as folder:
        (folder / "half").write_bytes(b"half")
        sweep(tmp_path)
        assert {path.name for path in tmp_path.iterdir()} == {mine.name, folder.name, ".another.unfinished"}
    assert [path.name for path in tmp_path.iterdir()] == [".another.unfinished"]
    sweep(tmp_path / "nowhere")
