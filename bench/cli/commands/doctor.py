"""`pmsm-bench doctor`: every check a line, with what to do; or all as JSON."""

from pathlib import Path
from typing import Final

from rich.text import Text

from bench.cli.doctor.check import Check, Verdict
from bench.cli.doctor.examination import examined
from bench.cli.doctor.machine import version_line
from bench.cli.exit_codes import DOES_NOT, HOLDS
from bench.cli.output import print_json
from bench.cli.terminal import Terminal, one_line

_STYLES: Final = {Verdict.OK: "green", Verdict.WARNING: "yellow", Verdict.FAILED: "bold red"}


def run(config: Path | None, port: int | None, *, as_json: bool) -> int:
    """Check, print, and the exit code: 1 where something failed."""
    console, found = Terminal(soft_wrap=True), list[Check]()
    for check in examined(config, port):
        found.append(check)
        if not as_json:
            said = one_line(f"{check.what}: {check.found}" + (f"; {check.advice}" if check.advice else ""))
            console.print(Text(f"{check.verdict:8} ", style=_STYLES[check.verdict]) + Text(said, style="default"))
    worst = max((check.verdict for check in found), key=list(Verdict).index)
    if as_json:
        print_json({"version": version_line(), "verdict": worst, "checks": found})
    return DOES_NOT if worst is Verdict.FAILED else HOLDS
