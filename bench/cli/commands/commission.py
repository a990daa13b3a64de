"""`pmsm-bench commission`: from a motor that nobody knows to parameters in its drive, by the running service.

A first start where it is asked for, an identification, a set that is flashed when that is confirmed, and the loops
tried again. Each is a job of the service that ends with the drive off.
"""

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from rich.progress import TimeElapsedColumn
from rich.table import Table

from bench.cli.exit_codes import DOES_NOT, HOLDS
from bench.cli.flashing import Flashed, drive_at
from bench.cli.output import as_refusal, check_new, check_output, write_whole
from bench.cli.plans import ask_to_flash, check_asked, show_plan
from bench.cli.rest import Job, Rest, rest_at
from bench.cli.terminal import Terminal, bar
from bench.commissioning.report import NAMES, report, share, time
from bench.engineering import quantity, words
from bench.errors import BenchError
from bench.parameters.flash import End
from bench.parameters.parameter_set import of_toml
from estimator.machine import PARAMETERS

_TIMEOUT: Final = 60.0  # s for one answer
_console: Final = Terminal(soft_wrap=True)


def commissioned(
    name: str, service: str | None, first: Mapping[str, Any] | None, bandwidth: float | None, override: str,
    out: Path | None, *, ask: bool,
) -> int:  # fmt: skip
    """Do it; `first`: what a first start takes, None for none. Raises BenchError."""
    if out is not None:
        check_new("--report", out)
        with as_refusal(out):
            check_output(out)
    if ask:
        check_asked()
    with rest_at(service, _TIMEOUT) as rest, drive_at(name, service) as drive:
        started = last = None
        if first is not None:
            started, last = _done(rest, name, {"kind": "first_start", **first})
            _console.print(f"{started['said']}.")
            if not _flashed(drive, started["set"], override, ask=ask):
                return DOES_NOT
        found, last = _done(rest, name, {"kind": "identify", "bandwidth": bandwidth, "follows": last})
        _tell(found)
        flashed = _flashed(drive, found["set"], override, ask=ask)
        after = None
        if flashed and found["machine"] is not None:
            try:
                after, _ = _done(rest, name, {"kind": "verify", "follows": last})
            except BenchError as error:
                _console.print(f"the loops were not tried again: {error}")
    _tell_loops(found["loops"], [] if after is None else after["loops"])
    if out is not None:
        at = f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC"
        when = f"{at}: the set was {'flashed, stored, and read back after a reset' if flashed else 'not flashed'}."
        with as_refusal(out):
            write_whole(out, report(name, when, found, after, started), over=False)
        _console.print(f"{out}: written")
    return HOLDS if flashed else DOES_NOT


def _done(rest: Rest, name: str, asked: Mapping[str, Any]) -> tuple[Mapping[str, Any], str]:
    """What comes of one job, and its id; Ctrl-C cancels it, and stops the drive. Raises BenchError where it is not
    done, or the drive was stopped since the one that it `follows`.
    """
    job = Job(rest, name, "commissionings", dict(asked))
    with bar("", None, TimeElapsedColumn()) as update:
        job.follow(lambda said: update(description=said["phase"]), lambda why: update(description=why))
    if job.said["state"] != "done":
        raise BenchError(f"{words(asked['kind'])} {job.said['state']}: {job.said['reason']}")
    return job.said["result"], job.id


def _flashed(drive: Flashed, text: str, override: str, *, ask: bool) -> bool:
    """Whether a proposed set came to be in the drive's memory."""
    given = of_toml(text, "the set")
    to_do = drive.plan(given)
    show_plan(to_do)
    if to_do.problems or (to_do.doubts and not override):
        _console.print("nothing is flashed" + ("" if to_do.problems else "; --override REASON says why it may be"))
        return False
    if ask:
        ask_to_flash()
    done = drive.flash(given, override, lambda _: None)
    _console.print(f"{done.end}: {done.said}")
    return done.end is End.FLASHED


def _tell(found: Mapping[str, Any]) -> None:
    diagnosis = found["diagnosis"]
    verdict, sentence = words(diagnosis["verdict"]), str(diagnosis["sentence"])
    _console.print(sentence if sentence.lower().startswith(verdict) else f"{verdict}: {sentence}")
    for name in PARAMETERS if found["machine"] else ():
        one = found["machine"][name]
        _console.print(f"  {name} = {quantity(one['value'], one['unit'], one['std'])}")
    if shaft := found["shaft"]:
        for name, one in shaft["estimates"].items():
            if one["value"] is not None:
                _console.print(f"  {name} = {quantity(one['value'], one['unit'], one['std'])}")
        if shaft["sentence"]:
            _console.print(f"  the shaft: {shaft['sentence']}")
    for remark in found["remarks"]:
        _console.print(remark)
    _console.print(f"recorded: {', '.join(found['recordings'])}")


def _tell_loops(before: list[dict[str, Any]], after: list[dict[str, Any]]) -> None:
    table = Table()
    for heading in ("loop", "", "overshoot", "promised", "settles in", "promised"):
        table.add_column(heading, justify="left" if heading in ("loop", "") else "right")
    for word, loops in (("before", before), ("after", after)):
        for one in loops:
            table.add_row(
                NAMES[one["name"]], word, share(one["overshoot"]), share(one["promised_overshoot"]),
                "–" if one["tracking"] is None else time(one["settling"]), time(one["promised_settling"]),
            )  # fmt: skip
    _console.print(table)
    for one in (*before, *after):
        if one["sentence"]:
            _console.print(f"{NAMES[one['name']]}: {one['sentence']}")
