"""What the commands that diagnose share: options, exit codes, files of a result, what is shown while it takes long."""

import os
import sys
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from rich.progress import TextColumn, TimeRemainingColumn

from bench.cli.exit_codes import DOES_NOT, HOLDS, NOT_TOLD, details_kept
from bench.cli.output import as_refusal, check_new, check_output, takes_all, write_whole
from bench.cli.terminal import Terminal, bar
from bench.diagnoses.diagnosis_request import Result, json_text
from bench.diagnoses.worker import Failed
from bench.engineering import words
from bench.errors import ConfigError, shown
from estimator.witness import Witness

STEM: Final = "{stem}"
EXPLAINED: Final = "explained"
FAIL_ON: Final = ("unexplained", EXPLAINED)
_CODES: Final = {
    "no_mismatch": HOLDS, EXPLAINED: HOLDS, "partly_explained": DOES_NOT, "unexplained": DOES_NOT,
    "ambiguous": NOT_TOLD, "not_enough_excitation": NOT_TOLD,
}


@dataclass(frozen=True, slots=True)
class Options:
    """What goes for all recordings of a command."""

    trust: Mapping[str, float]
    mapping: Mapping[str, str]
    constants: Mapping[str, float]
    align: Mapping[str, float]
    format: str  # of `bench.diagnoses.formats`, or "auto"
    jobs: int | None  # processes; None: one per core
    force: bool
    fail_on: str = FAIL_ON[0]
    witnesses: Mapping[str, Witness] = field(default_factory=dict[str, Witness])

    def check(self) -> None:
        """Raise ConfigError for what cannot be asked for."""
        if self.jobs is not None and self.jobs < 1:
            raise ConfigError(f"--jobs: expected at least 1, got {self.jobs}")
        if self.fail_on not in FAIL_ON:
            raise ConfigError(f"--fail-on: expected {' or '.join(FAIL_ON)}, got {shown(self.fail_on)}")

    @property
    def codes(self) -> Mapping[str, int]:
        """Exit codes by verdict."""
        return _CODES | ({EXPLAINED: DOES_NOT} if self.fail_on == EXPLAINED else {})


@dataclass(frozen=True, slots=True)
class Outcome:
    """What has become of a recording."""

    result: Result | None  # None: it was refused
    refusal: str = ""  # in a sentence; with a result, of files that cannot be written
    fault: bool = False  # it was not the recording's fault


def failed(said: Failed) -> Outcome:
    """A sentence, and where the details of a fault lie."""
    where = details_kept(said.details) if said.details else ""
    return Outcome(None, said.why + where, said.fault)


def stem_of(file: Path) -> str:
    """A recording's name without what its format adds to it."""
    name = file.name.removesuffix(".gz")
    for suffix in (".csv", ".parquet", ".pq", ".json"):
        name = name.removesuffix(suffix)
    return name


# --- files


def is_folder(path: Path) -> bool:
    """A folder that is there."""
    try:
        return path.is_dir()
    except OSError:  # a name that cannot be, which whoever reads or writes it will say
        return False


def check_places(taken: Mapping[Path, str], places: Iterable[Mapping[str, Path]], *, force: bool) -> None:
    """Refuse, before any work, outputs that would overwrite what is `taken`, another output, or a file."""
    there = {os.path.realpath(path): whose for path, whose in taken.items()}
    for place in places:
        for option, path in place.items():
            if (whose := there.get(os.path.realpath(path))) is not None:
                raise ConfigError(f"{option}: {path}: expected a file of its own, this is {whose}")
            if not takes_all(path):
                there[os.path.realpath(path)] = "another output"
            if not force:
                check_new(option, path)


def check_writable(place: Mapping[str, Path]) -> None:
    """Refuse a recording before it is worked on where its outputs cannot be written."""
    for path in place.values():
        with as_refusal(path):
            check_output(path)


def written(result: Result, place: Mapping[str, Path], *, force: bool) -> Outcome:
    """The result, its files written; and a sentence where one cannot be."""
    texts = {"--json": json_text(result.content), "--report": result.report, "--machine": result.machine}
    refusals: list[str] = []
    for option, path in place.items():
        if (text := texts[option]) is None:
            continue
        try:
            with as_refusal(path):
                write_whole(path, text, over=force)
        except ConfigError as error:
            refusals.append(str(error))
    return Outcome(result, "; ".join(refusals))


# --- what is shown


@dataclass(frozen=True, slots=True)
class Bar:
    """A bar while it takes long."""

    update: Callable[..., None]
    errors: Terminal
    output: Terminal

    def at(self, done: float, phase: str) -> None:
        """So many are done, and this is being done."""
        self.update(completed=done, description=phase or "diagnosing")

    def compiling(self) -> bool:
        """Say so where no bar does; that it is said."""
        if not self.errors.is_terminal:
            self.errors.print("pmsm-bench: compiling, once: most of a minute", soft_wrap=True)
        return True

    def refuse(self, sentence: str) -> None:
        """A sentence on standard error, above the bar."""
        self.errors.print(f"pmsm-bench: {sentence}", soft_wrap=True)


@contextmanager
def bar_of(total: int) -> Generator[Bar]:
    """Of so many results."""
    errors = Terminal(stderr=True)
    count = TextColumn("{task.completed:.0f}/{task.total:.0f}") if total > 1 else TextColumn("{task.percentage:.0f} %")
    shared = errors.is_terminal and sys.stdout.isatty()  # what is said goes above the bar then
    with bar("diagnosing", total, count, TimeRemainingColumn(), console=errors, redirect_stdout=False) as update:
        yield Bar(update, errors, errors if shared else Terminal())


def doubts_of(ambiguous: Iterable[Mapping[str, Any]]) -> Iterator[tuple[str, str]]:
    """What cannot be told and what would tell, each with what it is said after."""
    for ambiguity in ambiguous:
        yield f"{' or '.join(map(words, ambiguity['effects']))}? ", ambiguity["reason"]
        yield "to tell: ", ambiguity["experiment"]["sentence"]


def not_yet_said(sentence: str, texts: Iterable[tuple[str, str]]) -> Iterator[str]:
    """Texts after their leads, but those that a sentence before says, whose first letter may be a capital."""
    said = [sentence]
    for lead, text in texts:
        if not any(text[1:] in already for already in said):
            said.append(text)
            yield f"{lead}{text}"
