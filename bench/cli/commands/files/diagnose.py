"""`pmsm-bench diagnose`: recordings to diagnoses, several at a time; what each says, and files of it."""

import contextlib
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from rich.table import Table

from bench.cli.commands.files.diagnosing import (
    STEM,
    Bar,
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
from bench.cli.output import STANDARD_OUTPUT, as_refusal, print_json
from bench.cli.terminal import Terminal
from bench.diagnoses.diagnosis_request import COMPILING, WORK, Request, Result
from bench.diagnoses.worker import Failed, each
from bench.diagnoses.worker import Progress as Under
from bench.engineering import odds, quantity, words
from bench.errors import BenchError, ConfigError
from bench.machine_file import Nominal, load_machine

_SUFFIXES: Final = {"--json": ".json", "--report": ".html", "--machine": ".toml"}


def run(files: Sequence[Path], nominal: Path | None, outputs: Mapping[str, str | None], options: Options) -> int:
    """Diagnose recordings, print and write what is said of them; the exit code. Raises ConfigError before any work.

    An output is a file, a name with {stem}, or a folder: one that is there, or a name that ends with a slash.
    """
    options.check()
    json_shown = outputs.get("--json") == str(STANDARD_OUTPUT)
    if json_shown and len(files) > 1:
        raise ConfigError(f"--json -: expected one recording, got {len(files)}; of several a folder takes them")
    if json_shown:
        outputs = {**outputs, "--json": None}
    places = _places(files, outputs)
    check_places(_taken(files, nominal), places, force=options.force)
    shared = _shared(nominal)
    show = _Shown(len(files), options.codes, machine=outputs.get("--machine") is not None, as_json=json_shown)
    wanted = outputs.get("--report") is not None
    requests: list[Request] = []
    told: list[int] = []  # place among the files of each request
    outcomes: dict[int, Outcome] = {}
    for k, file in enumerate(files):
        try:
            machine = shared or (Nominal({}) if nominal is None else load_machine(_nominal_of(nominal, file)))
            check_writable(places[k])
        except BenchError as error:
            outcomes[k] = Outcome(None, str(error))
        else:
            requests.append(Request(
                file, machine, options.trust, options.mapping, options.constants, options.align, wanted, options.format,
                {**machine.witnesses, **options.witnesses},
            ))  # fmt: skip
            told.append(k)
    shares, compiling = [0.0] * len(requests), False
    with bar_of(len(files)) as progress, contextlib.closing(each(WORK, requests, options.jobs or _cores())) as heard:
        for k, said in heard:
            if isinstance(said, Under):
                shares[k] = said.share
                compiling = compiling or (said.phase == COMPILING and progress.compiling())
                progress.at(len(outcomes) + sum(s for n, s in enumerate(shares) if told[n] not in outcomes), said.phase)
                continue
            place = told[k]
            outcomes[place] = (
                failed(said) if isinstance(said, Failed)
                else written(said.result, places[place], force=options.force)
            )  # fmt: skip
            progress.at(len(outcomes), "")
            show.as_far_as(files, outcomes, progress)
        show.as_far_as(files, outcomes, progress)
    return show.end()


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _shared(nominal: Path | None) -> Nominal | None:
    """The machine of all recordings, where it is one."""
    return None if nominal is None or STEM in str(nominal) or is_folder(nominal) else load_machine(nominal)


def _nominal_of(nominal: Path, file: Path) -> Path:
    if STEM in str(nominal):
        return Path(str(nominal).replace(STEM, stem_of(file)))
    return nominal / f"{stem_of(file)}.toml"


# --- files


def _places(files: Sequence[Path], outputs: Mapping[str, str | None]) -> list[dict[str, Path]]:
    """Where each recording's outputs go, by option."""
    places = [dict[str, Path]() for _ in files]
    for option, out in outputs.items():
        if out is None:
            continue
        suffix, folder = _SUFFIXES[option], Path(out)
        pattern = out
        meant = out.endswith(os.sep) or is_folder(folder)
        if STEM not in out and (len(files) > 1 or meant):
            if not meant and (folder.suffix == suffix or os.path.lexists(folder)):
                raise ConfigError(f"{option}: several recordings need a folder or a name with {STEM}, got {out}")
            pattern = str(folder / f"{STEM}{suffix}")
            with as_refusal(folder):
                folder.mkdir(parents=True, exist_ok=True)
        for place, file in zip(places, files, strict=True):
            place[option] = Path(pattern.replace(STEM, stem_of(file)))
    return places


def _taken(files: Sequence[Path], nominal: Path | None) -> dict[Path, str]:
    """What no output may overwrite: recordings and their machine files."""
    taken = dict.fromkeys(files, "a recording")
    if nominal is not None:
        taken |= {_nominal_of(nominal, file): "its machine file" for file in files}
        taken[nominal] = "the machine file"
    return taken


# --- what is shown


class _Shown:
    """Outcomes on standard output, in the order of the files."""

    def __init__(self, total: int, codes: Mapping[str, int], *, machine: bool, as_json: bool) -> None:
        self._total, self._machine, self._as_json, self._next = total, machine, as_json, 0
        self._codes = codes
        self._verdicts = Counter[str]()
        self._faults = 0
        self._unwritten = 0
        self._console = Terminal()

    def as_far_as(self, files: Sequence[Path], outcomes: Mapping[int, Outcome], progress: Bar) -> None:
        """Show those whose turn has come."""
        self._console = progress.output
        while self._next in outcomes:
            file, outcome = files[self._next], outcomes[self._next]
            self._next += 1
            if outcome.result is None:
                self._verdicts["refused"] += 1
                self._faults += outcome.fault
            else:
                self._verdict(file, outcome.result)
                self._unwritten += bool(outcome.refusal)
            if why := outcome.refusal:
                progress.refuse(why if why.startswith(str(file)) else f"{file}: {why}")

    def _verdict(self, file: Path, result: Result) -> None:
        content = result.content
        self._verdicts[content["verdict"]] += 1
        if self._as_json:
            print_json(content)
            return
        self._say(f"{file}: {words(content['verdict'])}")
        self._say(content["sentence"])
        if self._total == 1:
            self._details(content)
        if self._machine and result.machine is None:
            self._say("no machine file: nothing could be fitted")

    def end(self) -> int:
        """The exit code; in words, too, where there were several. After the bar."""
        self._console = Terminal()
        if self._total > 1:
            counts = ", ".join(f"{count} {words(verdict)}" for verdict, count in self._verdicts.most_common())
            unwritten = f"; outputs of {self._unwritten} cannot be written" if self._unwritten else ""
            self._say(f"{self._total} recordings: {counts}{unwritten}")
        codes = [self._codes[verdict] for verdict in self._verdicts if verdict in self._codes]
        if self._verdicts["refused"] > self._faults or self._unwritten:
            codes.append(REFUSED)
        return worst([*codes, *([FAULT] if self._faults else [])])

    def _details(self, content: Mapping[str, Any]) -> None:
        if content["findings"]:
            self._console.print(_findings(content["findings"]))
        if content["fit"] is not None:
            self._console.print(_before_and_after(content))
        doubts = list(doubts_of(content["ambiguous"]))
        if content["experiment"] is not None:
            doubts.append(("", content["experiment"]["sentence"]))
        for text in not_yet_said(content["sentence"], doubts):
            self._say(text)
        for remark in content["remarks"]:
            self._say(remark)

    def _say(self, text: str) -> None:
        self._console.print(text, soft_wrap=True)


def _findings(findings: Sequence[Mapping[str, Any]]) -> Table:
    table = Table("what was left out", "size ± 95 %", "odds", "where")
    for finding in findings:
        sizes = [
            f"{words(name)} {quantity(size['value'], size['unit'], size['std'])}"
            for name, size in finding["parameters"].items()
        ]
        table.add_row(
            words(finding["effect"]), "\n".join(sizes), odds(finding["odds_against_next"]), finding["where"]["sentence"]
        )
    return table


def _before_and_after(content: Mapping[str, Any]) -> Table:
    fit = content["fit"]
    loo = fit.get("leave_one_out")
    table = Table(caption=_caption(fit, loo))
    for heading in ("", "before ± 95 %", "after ± 95 %", "noise floor"):
        table.add_column(heading, justify="left" if not heading else "right")
    voltage, current = fit["one_step_rms_V"], fit["free_run_rms_A"]
    what = "u, one step" if loo is None else "u"
    compared = _compared(content)
    table.add_row(what, *_errors(voltage, "V", compared=compared))
    if current["before"] is not None:
        table.add_row("i, free run", *_errors(current, "A", compared=compared))
    before, after = content["machine"]["before"], content["machine"]["after"]
    for name in {**before, **after}:
        sizes = [machine.get(name) for machine in (before, after)]
        like = next((size["value"] for size in sizes[::-1] if size is not None), None)
        table.add_row(name, *("–" if s is None else quantity(s["value"], s["unit"], s["std"], like) for s in sizes))
    return table


def _errors(rms: Mapping[str, float | None], unit: str, *, compared: bool) -> list[str]:
    told = [quantity(value, unit, like=rms["before"]) for value in rms.values()]
    return told if compared else ["–", *told[1:]]


def _compared(content: Mapping[str, Any]) -> bool:
    """Before and after are of two models; see `estimator.diagnosis.answer.sentences.compares`."""
    named = {finding["effect"] for finding in content["findings"]}
    named |= {name for ambiguity in content["ambiguous"] for name in ambiguity["effects"]}
    voltage = content["fit"]["one_step_rms_V"]
    return "convention_error" not in named or voltage["before"] != voltage["after"]


def _caption(fit: Mapping[str, Any], loo: Mapping[str, Any] | None) -> str:
    """What the errors are of; and those of other models, where they were tried."""
    if loo is None:
        return f"errors on {'stretches that took no part in' if fit['held_out'] else 'the rows of'} the fit"
    said = f"left out: one {loo['left_out']} at a time"
    rms = {words(name): quantity(value, loo["unit"], like=loo["before"]) for name, value in loo["alternatives"].items()}
    return "\n".join((said, *(f"with {name} {value}" for name, value in rms.items())))
