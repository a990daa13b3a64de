"""Answers under seal: in one process's memory alone, with a hash beside the recordings that anyone can check later.

What it keeps from happening is that a diagnosis reads answers by accident or habit, and that answers change after the
fact. A program that set out to cheat could draw them anew from the population's seed.
"""

import hashlib
import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, cast

SEAL: Final = "answers.sha256"  # beside the recordings


class SealError(Exception):
    """Answers are not those that were sealed."""


@dataclass(frozen=True, slots=True)
class Sealed:
    """Answers by file name, unread."""

    answers: Mapping[str, bytes]
    recordings: Path


def sealed(answers: Path, recordings: Path) -> Sealed:
    """Take all answers into memory, write their hash beside the recordings, delete their folder."""
    taken = {path.name: path.read_bytes() for path in sorted(answers.iterdir())}
    if not taken:
        raise SealError(f"{answers}: expected answers to seal, came none")
    (recordings / SEAL).write_text(digest(taken) + "\n", encoding="ascii")
    shutil.rmtree(answers)
    return Sealed(taken, recordings)


def opened(seal: Sealed) -> list[dict[str, Any]]:
    """The answers by recording, once the diagnosis is over. Raises SealError where they are not those of the seal."""
    written, now = (seal.recordings / SEAL).read_text(encoding="ascii").strip(), digest(seal.answers)
    if written != now:
        raise SealError(f"expected answers of the seal {written[:16]}..., came answers of {now[:16]}...")
    names = sorted(name for name in seal.answers if name[0].isdigit())
    return [cast(dict[str, Any], json.loads(seal.answers[name])) for name in names]


def publish(seal: Sealed, folder: Path) -> None:
    """Put the answers back on disk, in a new folder, for who wants to check them against the seal."""
    folder.mkdir(parents=True)
    for name, content in seal.answers.items():
        (folder / name).write_bytes(content)


def digest(answers: Mapping[str, bytes]) -> str:
    """SHA-256 over names, lengths and contents, in the order of names."""
    whole = hashlib.sha256()
    for name in sorted(answers):
        whole.update(f"{name} {len(answers[name])}\n".encode() + answers[name])
    return whole.hexdigest()
