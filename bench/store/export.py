"""A recording in another tool's form, with what has been said of it: a file without a name, gone when it is closed."""

import os
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import BinaryIO

from bench.files import check_free
from bench.recordings.foreign import process
from bench.store.shelf import Recording


def exported(recording: Recording, form: str) -> tuple[BinaryIO, int]:
    """A file in one of the foreign forms, open to be read, and its bytes. Raises RecordingError, OSError."""
    said = {
        "title": recording.title, "note": recording.note, "id": recording.id, "begun": recording.begun.isoformat(),
        "marks": [asdict(mark) for mark in recording.marks],
    }
    folder = recording.path.parent
    check_free(folder, 8 * recording.rows * len(recording.columns), f"{recording.id} in another form")
    with TemporaryDirectory(prefix=".", suffix=".unfinished", dir=folder) as place:
        name = Path(place) / f"recording.{form}"
        process.write(recording.path, form, name, said)
        file = name.open("rb")
    return file, os.fstat(file.fileno()).st_size
