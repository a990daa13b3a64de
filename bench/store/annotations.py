"""Titles, notes and marks of a recording, in a small JSON beside it: `ID.about.json`. The recording itself stays as it
is.
"""

import json
import os
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Final, Self

from pydantic import StringConstraints, TypeAdapter, ValidationError

from bench.errors import RecordingError
from bench.expected import Else
from bench.files import read_bytes, sync_folder, unfinished

SUFFIX: Final = ".about.json"
_MOST: Final = 1000  # marks of a recording

Title = Annotated[str, StringConstraints(max_length=200), Else("expected a text of at most 200 characters")]
Words = Annotated[str, StringConstraints(max_length=4000), Else("expected a text of at most 4000 characters")]


@dataclass(frozen=True, slots=True)
class Mark:
    """A moment of a recording that somebody has marked."""

    t: float  # s, from the recording's begin
    text: str
    whom: str = ""  # who marked it
    at: str = ""  # RFC 3339, when


@dataclass(frozen=True, slots=True)
class Annotations:
    """What people have said of a recording since it was made."""

    title: str | None = None  # None: that it was made with
    note: str | None = None
    marks: tuple[Mark, ...] = field(default=())

    @classmethod
    def read(cls, folder: Path, id_: str) -> Self:
        """Of a recording; empty where nobody has said anything, or the file makes no sense."""
        try:
            return _KIND.validate_json(read_bytes(folder / f"{id_}{SUFFIX}"))  # pyright: ignore[reportReturnType]
        except (OSError, ValidationError):
            return cls()

    def write(self, folder: Path, id_: str) -> None:
        """Beside the recording, in place of what was there. Raises OSError."""
        with unfinished(folder) as (part, file):
            file.write(json.dumps(asdict(self), indent=1).encode())
            file.flush()
            os.fsync(file.fileno())
            part.replace(folder / f"{id_}{SUFFIX}")
            sync_folder(folder)

    def marked(self, mark: Mark) -> "Annotations":
        """With one more mark. Raises RecordingError where there are too many."""
        if len(self.marks) >= _MOST:
            raise RecordingError(f"expected at most {_MOST} marks of a recording, it has them")
        return replace(self, marks=tuple(sorted((*self.marks, mark), key=lambda one: one.t)))


_KIND: Final = TypeAdapter(Annotations)
