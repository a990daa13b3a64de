"""A witness of what passes on vcan0: can-utils' `candump`, which shares no code with this project or its libraries.

And `cansend`, which says by hand what no client of ours says.
"""

import itertools
import re
import subprocess
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tests.support.served_drive import PATIENCE, until

BUS = "vcan0"
_LINE = re.compile(rf"\(([0-9.]+)\) {BUS} ([0-9A-F]+#[0-9A-F]*)\n")
_MARK = "7E5#"  # no one's identifier here, and a number
_BACKLOG = 4 << 20  # bytes that candump may be behind


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
        self._read = 0  # bytes of the log
        self._seen: list[Seen] = []
        self._marks = (f"{_MARK}{k:08X}" for k in itertools.count())

    def frames(self, since: int = 0) -> list[Seen]:
        """Every frame so far, in order; `since` as `heard` has told."""
        mark = next(self._marks)
        send(mark)
        until(lambda: self._has(mark), "candump does not see its mark")
        return [seen for seen in self._seen[since:] if not seen.frame.startswith(_MARK)]

    def heard(self) -> int:
        """How much has been seen so far."""
        return len(self._all())

    def wait_for(self, frame: str, times: int = 1, since: int = 0) -> None:
        """Return when a frame has passed so many times."""
        until(lambda: [seen.frame for seen in self._all()[since:]].count(frame) >= times, f"no {times} x {frame}")

    def ask(self, request: str, *answers: str) -> None:
        """Send a frame; the next with the answers' identifier are these, in this order."""
        identifier, begin = answers[0].partition("#")[0] + "#", self.heard()

        def got() -> list[str]:
            return [seen.frame for seen in self._all()[begin:] if seen.frame.startswith(identifier)]

        send(request)
        until(lambda: len(got()) >= len(answers), f"no answer to {request}")
        assert got() == list(answers), request

    def listens(self) -> bool:
        """Send a mark; whether any has been seen."""
        send(next(self._marks))
        return bool(self._all())

    def _has(self, frame: str) -> bool:
        return any(seen.frame == frame for seen in reversed(self._all()))

    def _all(self) -> list[Seen]:
        """With the marks; reads on in the log."""
        with self._log.open() as log:
            log.seek(self._read)
            text = log.read()
        whole = text[: text.rfind("\n") + 1]
        assert "DROPCOUNT" not in whole, whole
        self._read += len(whole)
        self._seen += [Seen(float(time), frame) for time, frame in _LINE.findall(whole)]
        return self._seen


def send(frame: str) -> None:
    """Send a frame, written as candump writes it."""
    subprocess.run(["cansend", BUS, frame], check=True, timeout=PATIENCE)


@contextmanager
def witness() -> Generator[Witness]:
    """candump, listening on vcan0."""
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log"
        with log.open("w") as file, subprocess.Popen(
            ["candump", "-L", "-d", "-D", "-r", str(_BACKLOG), BUS], stdout=file
        ) as process:
            try:
                seen = Witness(log)
                until(seen.listens, "candump does not listen")
                yield seen
            finally:
                process.kill()
