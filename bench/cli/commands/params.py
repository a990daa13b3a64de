"""`pmsm-bench params`: sets as files, and flashed into drives, by their bus or by the running service."""

import json
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.table import Table

from bench.cli.exit_codes import DOES_NOT, HOLDS
from bench.cli.flashing import Before, Given, drive_at, is_url
from bench.cli.output import STANDARD_OUTPUT, as_refusal, check_new, write_whole
from bench.cli.plans import ask_to_flash, number_of, show_plan, unit_of
from bench.cli.terminal import Terminal
from bench.errors import ConfigError
from bench.files import read_bytes
from bench.parameters.flash import End, Verdict
from bench.parameters.formats.a2l import as_a2l
from bench.parameters.formats.c_header import as_c_header, coarse
from bench.parameters.formats.dcf import as_dcf, from_dcf
from bench.parameters.parameter_set import LONGEST_NAME, ParameterSet, as_document, as_toml, of_toml, read
from bench.parameters.plan import Plan, different
from drivers.wire.dictionary import Signal, signal_named


def pulled(drive: str, service: str | None, out: Path, name: str) -> None:
    """Write a drive's parameters as a set."""
    with drive_at(drive, service) as one:
        _write(out, as_toml(one.present(name)))


def shown(path: Path, *, as_json: bool) -> None:
    """Print a set."""
    given = _read(path)
    if as_json:
        print(json.dumps(as_document(given), indent=2))
        return
    table = Table(title=f"{given.name}, version {given.version}")
    for heading in ("", "value", "unit", "95 % interval", "status", "from"):
        table.add_column(heading, justify="right" if heading == "value" else "left")
    for name, entry in given.entries.items():
        signal = signal_named(name)
        if signal.table:
            continue
        ends = "" if entry.low is None and entry.high is None else f"{entry.low} to {entry.high}"
        cold = "" if entry.at_20_degC is None else f"{entry.at_20_degC:.9g} at 20 degC"
        said = "; ".join(filter(None, (entry.source, cold, entry.note)))
        table.add_row(name, number_of(signal, entry.value), unit_of(signal), ends, entry.status, said)
    terminal = Terminal()
    terminal.print(table)
    for name in dict.fromkeys(signal_named(name).table for name in given.entries):
        if name:
            terminal.print(f"table {name}: 64 entries")


def differences(path: Path, other: str, service: str | None, *, of_drive: bool = False) -> int:
    """Print where a set differs from another, or from a drive."""
    given = _read(path)
    if of_drive or is_url(other) or not _is_file(other):
        with drive_at(other, service) as one:
            found = one.present(other[:LONGEST_NAME]).values
    else:
        found = _read(Path(other)).values
    names = different(given.values, found)
    for name in names:
        signal = signal_named(name)
        there = number_of(signal, found[name]) if name in found else "not there"
        print(f"{name}: {number_of(signal, given.values[name])} here, {there} there{_behind(signal)}")
    if not names:
        print(f"all {len(given.entries)} values are the same")
    return DOES_NOT if names else HOLDS


def planned(path: Path, drive: str, service: str | None, *, as_json: bool) -> int:
    """Print what a set would change."""
    given = _read(path, whole=False)
    with drive_at(drive, service) as one:
        to_do = one.plan(given)
    if as_json:
        print(json.dumps(_as_json(to_do), indent=2))
    else:
        show_plan(to_do)
    return DOES_NOT if to_do.problems or to_do.doubts else HOLDS


def flashed(path: Path, drive: str, service: str | None, override: str, *, ask: bool) -> int:
    """Flash a set."""
    return _flashed(_read(path), drive, service, override, ask=ask)


def rolled_back(drive: str, service: str | None, before: str | None, *, ask: bool) -> int:
    """Flash what was before the flash of that time, or else the latest."""
    return _flashed(Before(before), drive, service, "", ask=ask)


def _flashed(given: Given, drive: str, service: str | None, override: str, *, ask: bool) -> int:
    with drive_at(drive, service) as one:
        show = show_plan
        if ask:
            to_do = one.plan(given)
            show_plan(to_do)
            if not to_do.problems and (override or not to_do.doubts):
                ask_to_flash()
            show = _nothing
        done = one.flash(given, override, show)
    return _told(done, End.FLASHED)


def resumed(drive: str, service: str | None, *, finish: bool) -> int:
    """Finish a flash, or roll it back."""
    with drive_at(drive, service) as one:
        done = one.resume(finish=finish)
    return _told(done, End.FLASHED if finish else End.ROLLED_BACK)


def past(drive: str, service: str | None, *, as_json: bool) -> None:
    """Print what was flashed."""
    with drive_at(drive, service) as one:
        ended, left = one.history()
    if as_json:
        print(json.dumps({"flashes": ended, "cut": left}, indent=2))
        return
    for each in ended:
        print(f"{_begun(each)}, by {each['whom']}: {each['state']}: {each['said']}")
    if any(each["state"] == End.FLASHED for each in ended):
        way = f"`pmsm-bench params rollback {drive} --before TIME`"
        print(f"back to before one that was flashed: {way}, TIME as its line begins")
    if not ended:
        print("nothing was flashed into this drive from here")
    if left:
        print(f"{_begun(left)} was cut: `pmsm-bench params resume {drive} --finish|--roll-back`")


def _begun(told: Mapping[str, Any]) -> str:
    return f"{told['since'][:19]}Z  {told['name']!r}, version {told['version']}"


def exported(path: Path, form: str, kind: str, prefix: str, out: Path) -> None:
    """Write a set for other tools."""
    given = _read(path)
    forms = {
        "dcf": lambda: as_dcf(given), "c": lambda: as_c_header(given, kind, prefix=prefix),
        "a2l": lambda: as_a2l(given), "json": lambda: json.dumps(as_document(given), indent=2) + "\n",
    }  # fmt: skip
    if form not in forms:
        raise ConfigError(f"--form: expected {', '.join(forms)}, got {form!r}")
    _write(out, forms[form]())
    said = coarse(given, kind) if form == "c" else []
    if form in ("dcf", "a2l"):
        said = [f"{name} is {one.status}, which this form does not tell" for name, one in given.doubtful.items()]
    for line in said:
        print(f"remark: {line}", file=sys.stderr)


def imported(path: Path, out: Path, name: str) -> None:
    """Make a set of a DCF."""
    try:
        text = read_bytes(path).decode("utf-8", "replace")
    except OSError as error:
        raise _unreadable(path, error) from None
    _write(out, as_toml(from_dcf(text, name, str(path))))


def _told(done: Verdict, wanted: End) -> int:
    print(f"{done.end}: {done.said}")
    return HOLDS if done.end is wanted else DOES_NOT


def _as_json(to_do: Plan) -> dict[str, Any]:
    changes = [
        {
            "signal": one.signal.name, "unit": one.signal.unit, "old": one.old, "new": one.new, "held": one.held,
            "bits_old": one.counts[0], "bits_new": one.counts[1],
        } for one in to_do.changes
    ]  # fmt: skip
    told = {"problems": to_do.problems, "doubts": to_do.doubts, "remarks": to_do.remarks}
    return {"changes": changes, "same": to_do.same, **told}


def _nothing(_: Plan) -> None:
    """It has been shown."""


def _is_file(named: str) -> bool:
    """A set's file: one that is there, or is called so."""
    return named.endswith(".toml") or os.sep in named or Path(named).exists()


def _read(path: Path, *, whole: bool = True) -> ParameterSet:
    """A set; where it need not be `whole`, values that no drive can have are left for a plan to tell."""
    try:
        return read(path) if whole else of_toml(read_bytes(path).decode("utf-8", "replace"), str(path))
    except OSError as error:
        raise _unreadable(path, error) from None


def _unreadable(path: Path, error: OSError) -> ConfigError:
    return ConfigError(f"{path}: cannot be read: {error.strerror or error}")


def _write(out: Path, text: str) -> None:
    if out == STANDARD_OUTPUT:
        print(text, end="")
        return
    check_new("--out", out)
    with as_refusal(out):
        write_whole(out, text, over=False)
    print(f"{out}: written")


def _behind(signal: Signal) -> str:
    return f" ({unit_of(signal)})" if unit_of(signal) else ""
