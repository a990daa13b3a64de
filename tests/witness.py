"""A witness of what passes on vcan0: can-utils' `candump`, which shares no code with this project or its libraries."""

import re
import subprocess
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tests.served_drive import PATIENCE, until

BUS = "vcan0"
_LINE = re.compile(rf"\(([0-9.]+)\) {BUS} ([0-9A-F]+#[0-9A-F]*)\n")
_MARK = "7E5#"  # no one's identifier here


@dataclass(frozen=True, slots=True)
class Seen:
    """A frame and when it passed, s."""

    time: float
    frame: str  # as candump writes it: identifier, `#`, data

    @property
    def data(self) -> bytes:
        """The frame's data."""
        return bytes.fromhex(self.frame.partition("#")[2])


class Witness:
    """What candump has written so far."""

    def __init__(self, log: Path) -> None:
        self._log = log

    def frames(self) -> list[Seen]:
        """Every frame so far, in order."""
        before = self._marks()
        self.mark()
        until(lambda: self._marks() > before, "candump does not see its mark")
        lines = _LINE.finditer(self._log.read_text())
        return [Seen(float(time), frame) for time, frame in (line.groups() for line in lines) if frame != _MARK]

    def mark(self) -> bool:
        """Send a mark; whether any has been seen."""
        subprocess.run(["cansend", BUS, _MARK], check=True, timeout=PATIENCE)
        return self._marks() > 0

    def _marks(self) -> int:
        return self._log.read_text().count(_MARK)


@contextmanager
def witness() -> Generator[Witness]:
    """candump, listening on vcan0."""
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log"
        with log.open("w") as file, subprocess.Popen(["candump", "-L", BUS], stdout=file) as process:
            try:
                seen = Witness(log)
                until(seen.mark, "candump does not listen")
                yield seen
            finally:
                process.kill()
