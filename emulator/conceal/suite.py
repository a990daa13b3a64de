"""A suite: many concealed recordings, drawn and written by as many processes as there are cores.

What a recording holds does not depend on which process makes it, nor on how many there are.
"""

import json
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import emulator
from emulator.bounds import ScenarioError
from emulator.conceal.files import MANIFEST, date_alike, write
from emulator.conceal.populations import FAMILIES, KINDS, POPULATIONS
from emulator.conceal.recording import Choice, drawn
from emulator.drive.virtual_drive import VirtualDrive
from emulator.kernel import source_hash
from emulator.scenario.motors import MOTORS
from emulator.scenario.scenarios import PAPER

MOST = 100_000  # recordings
SHORTEST, LONGEST = 0.2, 600.0  # s, so that a winding can warm up within and files can be handled


@dataclass(frozen=True, slots=True)
class Suite:
    """What to make, and where."""

    choice: Choice
    count: int
    out: Path
    answers: Path
    workers: int = 0  # 0: one per core


def check_suite(suite: Suite) -> None:
    """Raise ScenarioError, in a sentence, where a suite cannot be; nothing is written."""
    choice = suite.choice
    if not 1 <= suite.count <= MOST:
        raise ScenarioError(f"--count takes 1 to {MOST}, got {suite.count}")
    if suite.workers < 0:
        raise ScenarioError(f"--workers takes at least 1, or 0 for one per core, got {suite.workers}")
    for kind in choice.kinds:
        known = (*KINDS, *FAMILIES, *POPULATIONS)
        if kind not in known:
            classes = ", ".join(known)
            raise ScenarioError(f"--class takes out of {classes}; got {kind!r}")
    for name in choice.motors:
        if name not in MOTORS:
            raise ScenarioError(f"--motor takes motors of the catalogue, {', '.join(MOTORS)}; got {name!r}")
    low, high = choice.window
    if not 0.0 <= low <= high <= 1.0:
        raise ScenarioError(f"--size takes two numbers from 0 to 1, the lower one first, got {low:g} {high:g}")
    if not SHORTEST <= choice.length <= LONGEST:
        raise ScenarioError(f"--length takes {SHORTEST:g} to {LONGEST:g} s, got {choice.length:g} s")
    out, answers = suite.out.resolve(), suite.answers.resolve()
    if answers.is_relative_to(out):
        raise ScenarioError(f"--answers takes a folder outside --out, {suite.out}, got {suite.answers}")
    for option, folder in (("--out", suite.out), ("--answers", suite.answers)):
        if folder.exists() and not folder.is_dir():
            raise ScenarioError(f"{option} takes a folder, {folder} is a file")
        if folder.is_dir() and any(entry.resolve() != out for entry in folder.iterdir()):
            raise ScenarioError(f"{option} takes a new or an empty folder, {folder} has something in it")


def make(suite: Suite, done: Callable[[int], object]) -> int:
    """Make a suite; `done` hears how many recordings there are so far, 0 once it begins. How many there are at the end.

    Ended by KeyboardInterrupt, it leaves whole recordings only, with their answers and a manifest of them. Raises
    ScenarioError, OSError.
    """
    check_suite(suite)
    for folder in (suite.out, suite.answers):
        folder.mkdir(parents=True, exist_ok=True)
    VirtualDrive(PAPER).warm_up()  # compiled once for all
    entries: list[dict[str, Any]] = []
    done(0)
    try:
        for entry in _made(suite, entries):
            entries.append(entry)
            done(len(entries))
    finally:
        _finish(suite, sorted(entries, key=lambda entry: entry["recording"]))
    return len(entries)


def _made(suite: Suite, entries: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Lines of the manifest, as recordings become whole; on the way out, those still under way go to `entries`."""
    numbers, workers = range(1, suite.count + 1), min(suite.workers or os.cpu_count() or 1, suite.count)
    if workers == 1:
        yield from (_one(suite, number) for number in numbers)
        return
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _end_with_parent) as pool:
        with _undisturbed():
            futures = [pool.submit(_one, suite, number) for number in numbers]
        heard = set[Future[dict[str, Any]]]()
        try:
            for future in as_completed(futures):
                heard.add(future)
                yield future.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            left = (future for future in futures if future not in heard and not future.cancelled())
            entries.extend(future.result() for future in left if future.exception() is None)
            raise


def _one(suite: Suite, number: int) -> dict[str, Any]:
    """Draw, run and write one recording; its line of the manifest."""
    name = f"{number:0{max(4, len(str(suite.count)))}d}"
    concealed, columns = drawn(suite.choice, number)
    write(concealed, columns, suite.choice, name, suite.out, suite.answers)
    return {
        "recording": name, "kind": concealed.kind, "classes": list(concealed.classes),
        "motor": concealed.drawn.motor, "redrawn": concealed.redrawn,
    }  # fmt: skip


def _end_with_parent() -> None:
    """Have this process end when the one that started it is gone, however it went."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=lambda: (parent.join(), os._exit(1)), daemon=True).start()


def _finish(suite: Suite, entries: list[dict[str, Any]]) -> None:
    """Nothing is left that is not whole; dates in the order of names, which tell nothing of how long each took."""
    names = {entry["recording"] for entry in entries}
    for folder in (suite.out, suite.answers):
        for path in list(folder.iterdir()):
            name = path.name.lstrip(".").partition(".")[0]
            if name.isdigit() and name not in names:
                path.unlink()
    for name in sorted(names):
        date_alike(suite.out, name)
    manifest = {
        **asdict(suite.choice), "count": suite.count, "made": len(entries),
        "sources": source_hash(Path(emulator.__file__).parent),  # other ones may make other numbers of an answer
        "recordings": entries,
    }  # fmt: skip
    text = json.dumps(manifest, indent=2) + "\n"
    (suite.answers / MANIFEST).write_text(text, encoding="utf-8")


@contextmanager
def _undisturbed() -> Generator[None]:
    """Processes started meanwhile do not hear Ctrl-C, which a terminal sends to all; this one hears it afterwards."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
