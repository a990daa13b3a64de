"""`pmsm-bench recordings verify`: files against their checksums; what a catalogue says of them, made anew."""

import json
import sys
from contextlib import closing
from pathlib import Path
from typing import Final

from rich.text import Text

from bench.cli.terminal import Terminal
from bench.config import usual_database
from bench.errors import BenchError, ConfigError
from bench.files import captures_folder
from bench.store.catalogue.database import check_address, opened
from bench.store.catalogue.memory import Memory
from bench.store.diagnoses import Diagnoses
from bench.store.shelf import Shelf

_console: Final = Terminal(soft_wrap=True)


def check_all(folder: Path | None, database: str | None, *, as_json: bool) -> int:
    """Read all against their checksums, and have the catalogue say of them what they do; the exit code.

    Raises ConfigError.
    """
    folder = folder or captures_folder()
    if not folder.is_dir():
        raise ConfigError(f"{folder}: expected a folder of recordings, there is none")
    address = usual_database() if database is None else database
    check_address(address)
    shelf, kept = Shelf(folder), Diagnoses(folder)
    recordings, diagnoses = list(shelf.verify()), list(kept.verify())
    checked = {"recordings": recordings, "diagnoses": diagnoses}
    if as_json:
        told = {kind: [{"name": one.name, "problem": one.problem} for one in found] for kind, found in checked.items()}
        print(json.dumps(told, indent=1))
    else:
        for one in (*recordings, *diagnoses):
            _console.print(Text(one.problem or f"{one.name}: whole"))
        _console.print(f"{len(recordings)} recordings and {len(diagnoses)} diagnoses in {folder}")
    if said := _rebuilt(address, shelf, kept):
        print(f"pmsm-bench: {said}", file=sys.stderr)
    return int(any(one.problem for one in (*recordings, *diagnoses)))


def _rebuilt(address: str, shelf: Shelf, kept: Diagnoses) -> str:
    """Have a catalogue that is there say of the files what they do; why it does not, a sentence, or empty."""
    if "://" not in address and not Path(address).exists():
        return ""
    try:
        with closing(Memory(opened(address), "")) as memory:
            memory.recordings(shelf.folder).rebuild(shelf.rows())
            memory.diagnoses(kept.folder).rebuild(kept.rows())
    except BenchError as error:
        return f"the files were read, and {error}"
    return ""
