"""`pmsm-bench diagnose --together`: recordings of one machine to one diagnosis; what it says, and files of it."""

import contextlib
import filecmp
import os
from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

from rich.table import Table

from bench.cli.commands.files.diagnosing import (
    STEM,
    Options,
    Outcome,
    bar_of,
    check_places,
    check_writable,
    doubts_of,
    failed,
    is_folder,
    not_yet_said,
    stem_of,
    written,
)
from bench.cli.exit_codes import FAULT, REFUSED, worst
from bench.cli.output import STANDARD_OUTPUT, print_json
from bench.cli.terminal import Terminal
from bench.diagnoses.diagnosis_request import COMPILING, Request, Result
from bench.diagnoses.together.request import WORK, Several
from bench.diagnoses.worker import Failed, Progress, each
from bench.engineering import odds, quantity, words
from bench.errors import ConfigError
from bench.machine_file import Nominal, load_machine

_JOINT = "all as one"


def run(files: Sequence[Path], nominal: Path | None, outputs: Mapping[str, str | None], options: Options) -> int:
    """Diagnose recordings together, print and write what is said of them; the exit code.

    Raises ConfigError before any work. An output is a file.
    """
    options.check()
    _check(files, options)
    machine_file, machine = _machine(nominal)
    as_json = outputs.get("--json") == str(STANDARD_OUTPUT)
    place = {
        option: _file(option, out) for option, out in outputs.items()
        if out is not None and not (as_json and option == "--json")
    }
    taken = {**dict.fromkeys(files, "a recording"), machine_file: "the machine file"}
    check_places(taken, [place], force=options.force)
    check_writable(place)
    requests = {
        name: Request(
            file, machine, options.trust, options.mapping, options.constants, options.align, "--report" in place,
            options.format, {**machine.witnesses, **options.witnesses},
        )
        for name, file in zip(names_of(files), files, strict=True)
    }  # fmt: skip
    outcome = _worked(Several(requests), place, force=options.force)
    result = outcome.result
    if result is None:
        return FAULT if outcome.fault else REFUSED
    if as_json:
        print_json(result.content)
    else:
        _show(result, machine=outputs.get("--machine") is not None)
    return worst([options.codes[result.content["verdict"]], *([REFUSED] if outcome.refusal else [])])


def _check(files: Sequence[Path], options: Options) -> None:
    """Raise ConfigError for what is asked for and cannot be of one diagnosis."""
    if len(files) < 2:
        raise ConfigError(f"--together: expected two recordings or more, got {len(files)}")
    if options.jobs is not None:
        raise ConfigError("--jobs: one diagnosis has one process, expected no number of them with --together")
    there = set[str]()
    for file in files:
        if (path := os.path.realpath(file)) in there:
            raise ConfigError(f"--together: {file}: expected each recording once")
        there.add(path)
    for one, other in combinations(files, 2):
        with contextlib.suppress(OSError):  # what cannot be read is told where it is read
            if filecmp.cmp(one, other, shallow=False):
                raise ConfigError(f"--together: {other} has all bytes of {one}: expected each recording once")


def _machine(nominal: Path | None) -> tuple[Path, Nominal]:
    """The one of all recordings, and where it stands. Raises ConfigError."""
    if nominal is None:
        raise ConfigError("--together: recordings of one machine need its data, expected --nominal MACHINE.toml")
    if STEM in str(nominal) or is_folder(nominal):
        got = f"a name with {STEM}" if STEM in str(nominal) else "a folder"
        raise ConfigError(f"--nominal: expected one machine file for all recordings with --together, got {got}")
    return nominal, load_machine(nominal)


def _file(option: str, out: str) -> Path:
    """Raises ConfigError."""
    if STEM in out or out.endswith(os.sep) or is_folder(Path(out)):
        got = f"a name with {STEM}" if STEM in out else "a folder"
        raise ConfigError(f"{option}: expected one file for all recordings with --together, got {got}")
    return Path(out)


def names_of(files: Sequence[Path]) -> list[str]:
    """A name for each: its stem, or as much of the end of its path as no other one has."""
    paths = [Path(os.path.abspath(file)).parts for file in files]  # noqa: PTH100 - a link keeps its name
    names, parts = [stem_of(file) for file in files], 1
    while len(set(names)) < len(names):
        names = [
            str(Path(*path[-parts:])) if names.count(name) > 1 else name
            for name, path in zip(names, paths, strict=True)
        ]
        parts += 1
    return names


def _worked(several: Several, place: Mapping[str, Path], *, force: bool) -> Outcome:
    """What a process makes of it, its files written; a refusal is shown."""
    outcome, compiling = Outcome(None), False
    with bar_of(1) as progress, contextlib.closing(each(WORK, [several], 1)) as heard:
        for _, said in heard:
            if isinstance(said, Progress):
                compiling = compiling or (said.phase == COMPILING and progress.compiling())
                progress.at(said.share, said.phase)
                continue
            outcome = failed(said) if isinstance(said, Failed) else written(said.result, place, force=force)
        if outcome.refusal:
            progress.refuse(outcome.refusal)
    return outcome


# --- what is shown


def _show(result: Result, *, machine: bool) -> None:
    console, content = Terminal(), result.content

    def say(text: str) -> None:
        console.print(text, soft_wrap=True)

    say(f"{', '.join(content['recordings'])}: {words(content['verdict'])}")
    say(content["sentence"])
    console.print(_of_machine(content))
    if content["findings"]:
        console.print(_findings(content))
    if content["differences"]:
        console.print(_differences(content["differences"]))
    for text in not_yet_said(content["sentence"], doubts_of(content["ambiguous"])):
        say(text)
    for remark in content["remarks"]:
        say(remark)
    if machine and result.machine is None:
        say("no machine file: nothing could be fitted")


def _of_machine(content: Mapping[str, Any]) -> Table:
    """A row a recording, and one of all."""
    table = Table("± 95 %")
    for name in content["machine"]:
        table.add_column(name, justify="right")
    numbers = content["machine"].values()
    for k, recording in enumerate(content["recordings"]):
        table.add_row(recording, *(_told(number["each"][k], number) for number in numbers))
    table.add_section()
    table.add_row(_JOINT, *(_joint(number) for number in numbers))
    return table


def _findings(content: Mapping[str, Any]) -> Table:
    table, recordings = Table("what was left out", "recording", "size ± 95 %", "odds"), content["recordings"]
    for finding in content["findings"]:
        parameters = finding["parameters"].items()
        for k, recording in enumerate(recordings):
            sizes = "\n".join(f"{words(name)} {_told(number['each'][k], number)}" for name, number in parameters)
            table.add_row("" if k else words(finding["effect"]), recording, sizes, "")
        joint = "\n".join(f"{words(name)} {_joint(number)}" for name, number in parameters)
        table.add_row("", _JOINT, joint, odds(finding["odds"]), end_section=True)
    return table


def _differences(differences: Sequence[Mapping[str, Any]]) -> Table:
    table = Table("what differs", "from", "to", "change ± 95 %", "share ± 95 %")
    for one in differences:
        what = " ".join(words(part) for part in (one["what"], one["parameter"]) if part)
        change, share = one["change"], one["share"]
        table.add_row(
            what, *one["between"], quantity(change["value"], change["unit"], change["std"]),
            "" if share is None else quantity(share["value"], share["unit"], share["std"]),
        )  # fmt: skip
    return table


def _told(size: Mapping[str, Any] | None, number: Mapping[str, Any]) -> str:
    """One recording's number, scaled as all are."""
    return "–" if size is None else quantity(size["value"], size["unit"], size["std"], _like(number))


def _joint(number: Mapping[str, Any]) -> str:
    return _told(number["joint"], number) if number["alike"] else "differs"


def _like(number: Mapping[str, Any]) -> float | None:
    """The largest of a number's sizes."""
    each = [abs(one["value"]) for one in number["each"] if one is not None and one["value"] is not None]
    return max(each, default=None)
