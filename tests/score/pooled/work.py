"""Recordings made anew, checked against their hashes, and diagnosed, in processes; what is done is on disk at once."""

import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Final

from emulator.conceal.files import made_anew, write_recording
from emulator.scenario.scenarios import parse
from tests.score.diagnosed import said_of
from tests.score.pooled.outcome import Outcome, kept_outcomes, line_of, outcome_of
from tests.score.pooled.population import Kept, digest_of

_EVERY: Final = 20  # recordings, between lines of progress


class OtherRecordingError(Exception):
    """A recording that is not the one that was kept; its text is a sentence."""


def outcome(kept: Kept, function: str) -> Outcome:
    """Make one recording, and have it diagnosed. Raises OtherRecordingError."""
    columns = made_anew(kept.answer)
    if (found := digest_of(columns, kept.nominal)) != kept.digest:
        raise OtherRecordingError(
            f"{kept.name}: expected the recording with hash {kept.digest}, the emulator makes one with {found}"
        )
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        write_recording(folder / "one.parquet", parse(kept.answer["scenario"], kept.name), columns)
        (folder / "one.toml").write_text(kept.nominal, encoding="utf-8")
        return outcome_of(kept, said_of(function, folder, "one"))


def outcomes(wanted: Sequence[Kept], done: Path, function: str, jobs: int) -> dict[str, Outcome]:
    """Of all that are wanted; those in the file `done` are not made again, others are added to it as they come.

    Raises OtherRecordingError; ValueError where the file makes no sense.
    """
    digests = {one.name: one.digest for one in wanted}
    found = {name: one for name, one in kept_outcomes(done).items() if digests.get(name) == one.digest}
    left = [one for one in wanted if one.name not in found]
    if len(left) < len(wanted):
        print(f"{len(wanted) - len(left)} of {len(wanted)} were done before: {done}", file=sys.stderr, flush=True)
    done.parent.mkdir(parents=True, exist_ok=True)
    _end_line(done)
    begun = time.monotonic()
    with done.open("a", encoding="utf-8") as file:
        for n, one in enumerate(_all(left, function, jobs), 1):
            found[one.name] = one
            file.write(line_of(one) + "\n")
            file.flush()
            if n % _EVERY == 0 or n == len(left):
                minutes = (time.monotonic() - begun) / 60.0
                print(f"{n} of {len(left)} in {minutes:.1f} min", file=sys.stderr, flush=True)
    return found


def _all(left: Sequence[Kept], function: str, jobs: int) -> Iterator[Outcome]:
    if not left:
        return
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        futures = [pool.submit(outcome, one, function) for one in left]
        try:
            for future in as_completed(futures):
                yield future.result()
        except BaseException:
            pool.shutdown(wait=True, cancel_futures=True)
            raise


def _end_line(done: Path) -> None:
    """Take a last line that was cut off out of a file."""
    if done.exists():
        text = done.read_text(encoding="utf-8")
        if not text.endswith("\n"):
            done.write_text(text[: text.rfind("\n") + 1], encoding="utf-8")
