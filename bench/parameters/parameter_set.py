"""A parameter set: a drive's writable signals by name, each with what it is from, in a TOML file.

    name = "servo 6 A"
    version = 3
    [drive]                     # whose it is; both may be left out
    layout_id = "0xDE84BEF1"    # of its signals
    serial = 1234
    [parameters]                # SI
    bandwidth = 1250.0
    control_R_s = { value = 0.967, low = 0.965, high = 0.969, status = "ok", source = "estimate" }
    control_psi_f = { value = 0.118, at_degC = 40.0, at_20_degC = 0.1206, note = "a magnet's typical -0.11 %/K" }
    [tables]
    psi_d_table = [0.10, ...]   # all 64 entries

As JSON it is an object of name, version, layout_id, serial and entries, see `as_document`. What is wrong is told all at
once. Set points, and the settings of stream and recorder, are no part of a set. Knows nothing of drives that are
connected.
"""

import math
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final, TypeGuard, cast

from bench.errors import ConfigError, shown
from bench.files import read_bytes
from drivers.wire.codec import check_range
from drivers.wire.dictionary import LEASE_TIMES, SIGNALS, TABLE_SIZE, TABLES, Signal, WireType, signal_named

FLASHED: Final = tuple(
    replace(s, minimum=LEASE_TIMES[0]) if s.name == "watchdog_time" else s  # else nobody could control the drive
    for s in SIGNALS if s.is_parameter and s.is_guarded and not s.is_set_point
)  # fmt: skip
"""What a set may hold."""
OK: Final = "ok"
_BY_NAME: Final = {signal.name: signal for signal in FLASHED}
_KEYS: Final = {"name", "version", "drive", "parameters", "tables"}
_WHOSE: Final = ("layout_id", "serial")
_JSON_KEYS: Final = {"name", "version", *_WHOSE, "entries"}
_NUMBERS: Final = ("low", "high", "at_degC", "at_20_degC")
_TEXTS: Final = ("status", "source", "note")
_ENTRY: Final = {"value", "unit", *_NUMBERS, *_TEXTS}
LONGEST_NAME: Final = 60  # characters
_WORDS: Final = 300  # characters of a status, a source, a note


@dataclass(frozen=True, slots=True)
class Entry:
    """A value, and what is known of it."""

    value: float  # SI
    low: float | None = None  # SI, 95 % interval of what it was identified as
    high: float | None = None
    status: str = OK  # of the estimate or finding that it is from
    source: str = ""  # in words
    note: str = ""  # what else a reader should know of it
    at_degC: float | None = None  # temperature that it holds at
    at_20_degC: float | None = None  # SI, what it is at 20 degC

    @property
    def outside(self) -> bool:
        """The value is not within its interval."""
        return not (self.low is None or self.low <= self.value) or not (self.high is None or self.value <= self.high)


@dataclass(frozen=True, slots=True)
class ParameterSet:
    """Values for a drive."""

    name: str
    entries: Mapping[str, Entry]  # by signal
    version: int = 1
    layout_id: int | None = None  # of whose signals; None: of any drive that has them
    serial: int | None = None  # whose it is; None: anybody's
    unfit: tuple[str, ...] = ()  # why values that were read are not among the entries, a clause each

    @property
    def doubtful(self) -> dict[str, "Entry"]:
        """Entries whose status is not ok."""
        return {name: entry for name, entry in self.entries.items() if entry.status != OK}

    @property
    def values(self) -> dict[str, float]:
        """SI, by signal."""
        return {name: entry.value for name, entry in self.entries.items()}


def set_of(values: Mapping[str, float], name: str, source: str, **whose: Any) -> ParameterSet:
    """A set of plain values, of those that a set may hold."""
    fit = {key: value for key, value in values.items() if key in _BY_NAME and math.isfinite(value)}
    entries = {key: Entry(value, source=source) for key, value in fit.items()}
    return ParameterSet(name, entries, **whose)


def read(path: Path) -> ParameterSet:
    """The set in a file. Raises ConfigError, with all that is wrong, and OSError."""
    return parse(read_bytes(path).decode("utf-8", "replace"), " ".join(str(path).splitlines()))


def parse(text: str, where: str) -> ParameterSet:
    """The set in a TOML text. Raises ConfigError, with all that is wrong."""
    given = of_toml(text, where)
    if given.unfit:
        raise _wrong(where, given.unfit)
    return given


def of_toml(text: str, where: str) -> ParameterSet:
    """The set in a TOML text; what is wrong with single values is in its `unfit`. Raises ConfigError."""
    try:
        document: dict[str, Any] = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError, ValueError) as error:
        raise ConfigError(f"{where}: is not TOML: {error}") from None
    told = _Reader(document, _KEYS)
    drive = told.table(document, "drive")
    told.only(drive, set(_WHOSE), "drive ")
    entries = dict(told.entries(told.table(document, "parameters")))
    for key, listed in told.table(document, "tables").items():
        entries.update(told.list_of(key, listed))
    return told.set_of(entries, drive, where, "[parameters] or [tables]")


def of_document(document: Mapping[str, Any], where: str) -> ParameterSet:
    """The set in a JSON object; as `of_toml`."""
    told = _Reader(document, _JSON_KEYS)
    return told.set_of(dict(told.entries(told.table(document, "entries"))), document, where, "entries")


def as_document(given: ParameterSet) -> dict[str, Any]:
    """A set as plain values: `of_document` gives it back."""
    entries = {name: asdict(entry) | {"unit": signal_named(name).unit} for name, entry in given.entries.items()}
    whose = {"layout_id": given.layout_id, "serial": given.serial}
    return {"name": given.name, "version": given.version, **whose, "entries": entries}


def _wrong(where: str, problems: Iterable[str]) -> ConfigError:
    return ConfigError("\n".join(f"{where}: {problem}" for problem in problems))


def problem_of(name: str, value: object) -> str:
    """Why a signal cannot have a value, a clause; empty where it can."""
    signal = _BY_NAME.get(name)
    if signal is None:
        return _no_parameter(name)
    if not _is_number(value):
        return f"{_called(name)} takes a number, got {shown(value)}"
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        return f"{signal} takes a finite number, got {shown(value)}"
    if signal.type is not WireType.F32 and number != int(number):
        return f"{signal} takes a whole number, got {shown(value)}"
    try:
        check_range(signal, number)
    except ValueError as error:
        return str(error)
    return ""


def as_toml(given: ParameterSet) -> str:
    """A set as its file: `parse` gives it back."""
    lines = [f"name = {_text(given.name)}", f"version = {given.version}"]
    whose = dict(zip(_WHOSE, (given.layout_id, given.serial), strict=True))
    if any(value is not None for value in whose.values()):
        lines.append("[drive]")
        lines += [f'{key} = "0x{value:08X}"' for key, value in whose.items() if value is not None]
    lines.append("[parameters]")
    lines += [_line(_BY_NAME[name], entry) for name, entry in given.entries.items() if not _BY_NAME[name].table]
    tables = {table: _entries_of(table, given.entries) for table in TABLES}
    if any(tables.values()):
        lines.append("[tables]")
        for table, values in tables.items():
            if values:
                lines.append(f"{table} = [  # {TABLES[table][1]}: {TABLES[table][2]}")
                lines += [f"    {', '.join(map(repr, values[k : k + 8]))}," for k in range(0, TABLE_SIZE, 8)]
                lines.append("]")
    return "\n".join(lines) + "\n"


def _entries_of(table: str, entries: Mapping[str, Entry]) -> list[float]:
    names = [f"{table}_{k}" for k in range(1, TABLE_SIZE + 1)]
    return [entries[name].value for name in names] if all(name in entries for name in names) else []


def _line(signal: Signal, entry: Entry) -> str:
    value = repr(entry.value) if signal.type is WireType.F32 else str(int(entry.value))
    unit = "" if signal.unit == "1" else f" {signal.unit}"
    told = {key: getattr(entry, key) for key in (*_NUMBERS, *_TEXTS)}
    more = {key: one for key, one in told.items() if one not in (None, "") and (key, one) != ("status", OK)}
    if more:
        parts = (f"{key} = {_text(one) if isinstance(one, str) else repr(one)}" for key, one in more.items())
        value = f"{{ value = {value}, {', '.join(parts)} }}"
    return f"{signal.name} = {value}  #{unit} {signal.summary}{_limits(signal)}"


def _limits(signal: Signal) -> str:
    low, high = signal.minimum, signal.maximum
    if low is None:
        return "" if high is None else f"; up to {high:g}"
    return f"; from {low:g}" if high is None else f"; {low:g} to {high:g}"


def _text(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\u{ord(c):04X}" for c in escaped) + '"'


def _no_parameter(name: str) -> str:
    try:
        signal = signal_named(name)
    except KeyError:
        return f"no signal {shown(name)}"
    return f"{signal} is no parameter that is flashed"


def _wrong_entry(name: str, parts: Mapping[str, Any]) -> list[str]:
    """Why an entry cannot be read as one, a clause each."""
    expected = ", ".join(sorted(_ENTRY))
    wrong = [f"{shown(name)} {shown(key)}: expected one of {expected}" for key in parts if key not in _ENTRY]
    if not _is_number(parts.get("value")):
        wrong.append(f"{_called(name)} takes a number, got {shown(parts.get('value'))}")
    wrong += [
        f"{shown(name)}: expected a number as {key}, got {shown(parts[key])}"
        for key in _NUMBERS if parts.get(key) is not None and not _is_finite(parts[key])
    ]  # fmt: skip
    texts = [parts.get("status", OK), *(parts.get(key, "") for key in ("source", "note")), parts.get("unit") or ""]
    if not all(map(_is_text, texts)):
        wrong.append(f"{shown(name)}: expected texts of up to {_WORDS} characters as {', '.join(_TEXTS)} and unit")
    return wrong


def _unfit_entry(name: str, parts: Mapping[str, Any]) -> list[str]:
    """Why its signal cannot have what an entry says, a clause each."""
    value, unit, signal = parts.get("value"), parts.get("unit"), _BY_NAME.get(name)
    problem = problem_of(name, value) if _is_number(value) else ""
    unfit = [problem] if problem else []
    if signal is not None and isinstance(unit, str) and unit != signal.unit:
        unfit.append(f"{signal} is in {signal.unit}, got {shown(unit)}")
    return unfit


def _called(name: str) -> str:
    return str(_BY_NAME[name]) if name in _BY_NAME else shown(name)


def _is_number(value: object) -> TypeGuard[int | float]:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_finite(end: object) -> bool:
    try:
        return _is_number(end) and math.isfinite(end)
    except OverflowError:
        return False


def _is_text(text: object) -> bool:
    return isinstance(text, str) and len(text) <= _WORDS and text.isprintable()


class _Reader:
    """Takes a document apart. What is wrong with it goes to one list, what is with single values to another."""

    def __init__(self, document: Mapping[str, Any], keys: set[str]) -> None:
        self._document, self._problems, self._unfit = document, list[str](), list[str]()
        self.only(document, keys)

    def only(self, table: Mapping[str, Any], keys: set[str], of: str = "") -> None:
        """Other keys are told."""
        known = ", ".join(sorted(keys))
        self._problems += [f"{of}{shown(key)} is none of {known}" for key in table if key not in keys]

    def set_of(
        self, entries: dict[str, Entry], whose: Mapping[str, Any], where: str, expected: str
    ) -> ParameterSet:
        """The set. Raises ConfigError, with all that is wrong, where it cannot be read as one."""
        name, version = self._document.get("name", ""), self._document.get("version", 1)
        if not isinstance(name, str) or not 0 < len(name) <= LONGEST_NAME or not name.isprintable():
            self._problems.append(f"name: expected 1 to {LONGEST_NAME} characters, got {shown(name)}")
        if not isinstance(version, int) or isinstance(version, bool) or not 1 <= version < 1 << 31:
            self._problems.append(f"version: expected a whole number from 1 on, got {shown(version)}")
        layout_id, serial = (self.number(whose, key) for key in _WHOSE)
        if not entries and not self._problems and not self._unfit:
            self._problems.append(f"expected values in {expected}, got none")
        if self._problems:
            raise _wrong(where, (*self._problems, *self._unfit))
        return ParameterSet(name, entries, version, layout_id, serial, tuple(self._unfit))

    def table(self, document: Mapping[str, Any], key: str) -> dict[str, Any]:
        """A section, empty where there is none."""
        found = document.get(key, {})
        if isinstance(found, dict):
            return cast(dict[str, Any], found)
        self._problems.append(f"{key}: expected a section, got {shown(found)}")
        return {}

    def number(self, table: Mapping[str, Any], key: str) -> int | None:
        """A number of 32 bits, in hex as a text or plain; None where there is none."""
        given = table.get(key)
        if given is None:
            return None
        try:
            value = int(given, 0) if isinstance(given, str) else given
        except ValueError:
            value = None
        if isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 1 << 32:
            return value
        self._problems.append(f"{key}: expected a number of 32 bits such as 0xDE84BEF1, got {shown(given)}")
        return None

    def entries(self, table: Mapping[str, Any]) -> Iterator[tuple[str, Entry]]:
        """Values with what is known of them."""
        for name, given in table.items():
            parts = cast(dict[str, Any], given) if isinstance(given, dict) else {"value": given}
            wrong, unfit = _wrong_entry(name, parts), _unfit_entry(name, parts)
            self._problems += wrong
            self._unfit += unfit
            if not wrong and not unfit:
                known = {key: float(one) for key in _NUMBERS if (one := parts.get(key)) is not None}
                texts = {key: parts[key] for key in _TEXTS if key in parts}
                yield name, Entry(float(parts["value"]), **known, **texts)

    def list_of(self, table: str, given: object) -> Iterable[tuple[str, Entry]]:
        """All entries of a table."""
        if table not in TABLES:
            self._unfit.append(f"no table {shown(table)}; there are {', '.join(TABLES)}")
            return []
        values = cast(list[object], given) if isinstance(given, list) else []
        if len(values) != TABLE_SIZE:
            self._unfit.append(f"{table}: expected a list of {TABLE_SIZE} numbers, got {shown(cast(object, given))}")
            return []
        wrong = [problem for k, one in enumerate(values, start=1) if (problem := problem_of(f"{table}_{k}", one))]
        self._unfit += wrong
        numbers = cast(list[float], values)
        return [] if wrong else [(f"{table}_{k}", Entry(float(one))) for k, one in enumerate(numbers, start=1)]
