"""Recordings read as tests look at them."""

from pathlib import Path
from typing import Any

from bench.recordings.recording import Recording, open_recording, whole


def read_recording(path: str | Path, **options: Any) -> Recording:
    """A whole recording in memory, by the options of `open_recording`."""
    with open_recording(path, **options) as reader:
        return whole(reader)
