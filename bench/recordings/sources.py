"""Where each quantity of a recording comes from: a column and its unit, a constant, other quantities, an integral.

A mapping says `COLUMN`, as it stands in the file, or more: `COLUMN[UNIT]`, `COLUMN*NUMBER`, also with `/`, `+` and
`-`, from left to right. Where it says no more, a column's unit is the one in its own name, or in the file's row of
units; without one, numbers are SI. Knows nothing of formats.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from bench.errors import ConfigError, RecordingError
from bench.recordings.foreign.content import LEFT_OUT
from bench.recordings.forms.rotor_frame import RotorFrame, stationary
from bench.recordings.forms.units import UNCHANGED, Scale, name_and_unit, same_micro, scale_of, units_of
from bench.recordings.table import Header, quoted

NEEDED: tuple[str, ...] = ("t", "u_d", "u_q", "i_d", "i_q", "omega_e")  # s, V, A, rad/s
OF_D: tuple[str, ...] = ("u_d", "i_d", "i_d_mean")  # V, A, which whoever takes the q axis alone does without
MEANS: tuple[str, ...] = ("i_d_mean", "i_q_mean")  # A, needed where a row covers several control periods
PHASES: tuple[str, ...] = ("i_a", "i_b", "i_c")  # A, read where all three are there
OPTIONAL: tuple[str, ...] = ("u_dc", *PHASES)  # V, A
TEMPERATURES: tuple[str, ...] = ("temp_winding", "temp_magnet")  # degC; no estimate rests on them
STATIONARY: tuple[str, ...] = ("i_alpha", "i_beta", "u_alpha", "u_beta", "u_a", "u_b", "u_c")  # A, V, where dq are not
KNOWN: tuple[str, ...] = (*NEEDED, "theta_e", *MEANS, "periods", *OPTIONAL, *STATIONARY, *TEMPERATURES)
SETTINGS: tuple[str, ...] = ("T_s", "n_p")  # constants that are no column: s, pole pairs
NOT_RECORDED: Final = "not recorded"
MAX_PERIODS = 1_000_000  # control periods a row covers
ALIGNABLE: tuple[str, ...] = ("u",)
_TIMES: Final = ("t", "time")  # names of a time that tells its unit

_NUMBER: Final = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_AFTER: Final = re.compile(rf"\s*([*/+-])\s*({_NUMBER})\s*$")
_BEFORE: Final = re.compile(rf"^\s*({_NUMBER})\s*\*\s*")
_UNIT: Final = re.compile(r"(.*\S)\s*\[([^\[\]]*)\]")


@dataclass(frozen=True, slots=True)
class Sources:
    """The file's columns to read and the values to hold, by quantity; `theta_e` in neither is integrated."""

    columns: Mapping[str, str]
    constants: Mapping[str, float]
    told: Mapping[str, str]  # each quantity's source in words
    unused: tuple[str, ...]  # columns present and not read
    scales: Mapping[str, Scale] = field(default_factory=dict[str, Scale])  # of columns that are not in SI
    frame: RotorFrame | None = None  # where quantities are made of others
    remarks: tuple[str, ...] = ()  # what was made of the columns, a sentence each
    q_only: bool = False  # the d axis has no voltage

    def without(self, empty: Sequence[str]) -> "Sources":
        """These sources where optional columns turn out to hold no value; phase currents go together."""
        gone = {*empty, *(PHASES if set(empty) & set(PHASES) else ())} & set(self.columns)
        if self.frame is not None:
            gone -= set(self.frame.currents)
        if not gone:
            return self
        kept = {name: column for name, column in self.columns.items() if name not in gone}
        unused = [column for name, column in self.columns.items() if name in gone and column not in kept.values()]
        told = {name: source for name, source in self.told.items() if name not in gone}
        return replace(self, columns=kept, told=told, unused=(*self.unused, *unused))

    def with_u_dc(self, u_dc: float | None) -> "Sources":
        """These sources with a nominal dc-link voltage (V) where the recording has none."""
        if u_dc is None or "u_dc" in self.told:
            return self
        told = {**self.told, "u_dc": f"constant {u_dc:g}, the machine file's"}
        return replace(self, constants={**self.constants, "u_dc": u_dc}, told=told)


@dataclass(frozen=True, slots=True)
class Source:
    """A column and what its numbers are."""

    column: str
    scale: Scale = UNCHANGED
    unit: str = ""  # as it is written, where that is what the scale comes from

    def told(self) -> str:
        """In words."""
        return f"column {self.column}{self._made()}"

    def remark(self, quantity: str) -> str:
        """A sentence where numbers are changed, else none."""
        made = self._made()
        return "" if self.scale == UNCHANGED else f"{quantity} is column {quoted(self.column)}{made}"

    def _made(self) -> str:
        if self.unit:
            return "" if self.scale == UNCHANGED else f", in {self.unit}: times {self.scale.factor:.6g}"
        factor = f", times {self.scale.factor:.9g}" if self.scale.factor != 1.0 else ""
        return f"{factor}, {self.scale.offset:+.9g}" if self.scale.offset else factor


def check_options(
    mapping: Mapping[str, str], constants: Mapping[str, float], T_s: float | None, align: Mapping[str, float]
) -> None:
    """Refuse, with a ConfigError, options that no file could satisfy."""
    for name in (*mapping, *(name for name in constants if name not in SETTINGS)):
        if name not in KNOWN:
            raise ConfigError(f"no quantity {quoted(name)} in a recording, expected one of {', '.join(KNOWN)}")
    for name, value in constants.items():
        if name in mapping:
            raise ConfigError(f"{name} is given twice: column {quoted(mapping[name])} and constant {value:g}")
        if name == "t":
            raise ConfigError(
                "t cannot be a constant, expected a column of times in s; where there is none, the control period: "
                "--set T_s=..."
            )
        if not math.isfinite(value):
            raise ConfigError(f"constant {name} = {value}: expected a finite number")
    _check_whole("periods", constants, MAX_PERIODS, "control periods, 1 or more")
    _check_whole("n_p", constants, 200, "pole pairs, 1 to 200")
    for given in (T_s, constants.get("T_s")):
        if given is not None and not 0 < given < math.inf:
            raise ConfigError(f"T_s = {given} s: expected a finite number above zero")
    for name, rows in align.items():
        if name not in ALIGNABLE:
            raise ConfigError(f"cannot align {quoted(name)}, expected {', '.join(ALIGNABLE)} (both voltages)")
        if not abs(rows) <= 1000:
            raise ConfigError(f"align {name} = {rows} rows: expected -1000 to 1000")


def _check_whole(name: str, constants: Mapping[str, float], most: int, expected: str) -> None:
    value = constants.get(name, 1)
    if not 1 <= value <= most or value != int(value):
        raise ConfigError(f"constant {name} = {value:g}: expected a whole number of {expected}")


# --- a quantity's column


def bare_names(present: Sequence[str]) -> frozenset[str]:
    """The columns' names, with and without the units that they tell."""
    told = (name_and_unit(name) for name in present)
    return frozenset((*present, *(found[0] for found in told if found is not None)))


def source_of(path: Path, header: Header, quantity: str, said: str | None, n_p: float | None) -> Source | None:
    """The column of a quantity: as a mapping has `said`, or the one of its name. None where there is none.

    Raises RecordingError where a mapping names no column, or a name or unit can be taken in two ways; ConfigError where
    a unit needs the pole pairs `n_p`.
    """
    if said is not None:
        return _mapped(path, header, quantity, said, n_p)
    if quantity in header.names:
        return _in_own_unit(path, header, quantity, quantity, n_p)
    names = _TIMES if quantity == "t" else (quantity,)
    found = {
        column: source for column in header.names
        if (told := name_and_unit(column)) is not None and (told[0] in names or told[0].lower() in names[1:])
        and (source := _in_own_unit(path, header, quantity, column, n_p)).unit
    }  # fmt: skip
    if len(found) > 1:
        raise RecordingError(
            f"{path}: expected one column for {quantity}, came {' and '.join(map(quoted, found))}; choose by "
            f"--map {quantity}=COLUMN"
        )
    return next(iter(found.values()), None)


def _mapped(path: Path, header: Header, quantity: str, said: str, n_p: float | None) -> Source:
    """What a mapping says: the longest beginning of it that is a column, and what follows."""
    rest, unit, scale = said.strip(), "", UNCHANGED
    while (column := _column(header.names, rest)) is None:
        if found := _UNIT.fullmatch(rest):
            rest, outer = found[1], _unit_of(path, quantity, found[2], n_p, where="--map")
            unit = unit or found[2]
        elif found := _AFTER.search(rest):
            rest, outer = rest[: found.start()], _operation(quantity, found[1], float(found[2]))
        elif found := _BEFORE.match(rest):
            rest, outer = rest[found.end() :], Scale(float(found[1]))
        else:
            raise RecordingError(
                f"{path}: no column {quoted(said)} for {quantity}; present: {listed(header.names)}"
            )
        scale = outer.then(scale)
    if rest == said.strip():
        return _in_own_unit(path, header, quantity, column, n_p)
    only_unit = _UNIT.fullmatch(said.strip()) is not None
    return Source(column, scale, unit if only_unit else "")


def _column(names: Sequence[str], said: str) -> str | None:
    """The column that is called so, or, where it tells its unit besides, the only one."""
    wanted = same_micro(said)
    exact = [name for name in names if same_micro(name) == wanted]
    bare = [name for name in names if (told := name_and_unit(name)) is not None and told[0] == said.strip()]
    return exact[0] if exact else bare[0] if len(bare) == 1 else None


def _operation(quantity: str, sign: str, number: float) -> Scale:
    if sign == "/" and not number:
        raise ConfigError(f"--map {quantity}: cannot divide by zero")
    return {"*": Scale(number), "+": Scale(1.0, number), "-": Scale(1.0, -number)}.get(sign) or Scale(1.0 / number)


def _in_own_unit(path: Path, header: Header, quantity: str, column: str, n_p: float | None) -> Source:
    """A column in the unit that its name tells, or the file's row of units."""
    told = name_and_unit(column)
    if told is not None and (scale := scale_of(quantity, told[1], n_p)) is not None:
        return Source(column, scale, told[1])
    unit = header.units[header.names.index(column)] if column in header.names[: len(header.units)] else ""
    if not unit or unit in ("-", "1"):
        return Source(column)
    return Source(column, _unit_of(path, quantity, unit, n_p, where="the row of units"), unit)


def _unit_of(path: Path, quantity: str, unit: str, n_p: float | None, *, where: str) -> Scale:
    scale = scale_of(quantity, unit, n_p)
    if scale is not None:
        return scale
    if not (known := units_of(quantity)):
        return UNCHANGED
    said = f"{where}: {quantity} in {quoted(unit)}: expected one of {', '.join(known)}"
    if where == "--map":
        raise ConfigError(said)
    raise RecordingError(f"{path}: {said}, or what makes SI of it: --map {quantity}=COLUMN*NUMBER")


# --- all of them


def find_sources(
    path: Path, header: Header, mapping: Mapping[str, str], constants: Mapping[str, float], *, optional: bool,
    temperatures: bool = False, phases: bool = False, n_p: float | None = None, q_alone: bool = False,
) -> Sources:
    """Match what a recording needs, and may have, with what is there. A constant wins over a column of its name.

    `q_alone`: whether the q axis alone is enough.
    """
    given, n_p = {k: float(v) for k, v in constants.items() if k not in SETTINGS}, constants.get("n_p", n_p)
    found = _Found(path, header, mapping, given, n_p)
    for name in mapping:
        found.of(name)
    wanted = list(NEEDED)
    if any(map(found.is_there, MEANS)):
        wanted += MEANS
    frame, made = _frame(found)
    missing = [name for name in wanted if not (found.is_there(name) or name in made)]
    lacking = q_alone and "u_d" in missing and set(missing) <= {"t", *OF_D} and found.is_there("i_q")
    if lacking:
        given = given | dict.fromkeys((name for name in missing if name in OF_D), 0.0)
        missing = [name for name in missing if name not in OF_D]
    if missing == ["t"] and "T_s" in constants:
        missing, wanted = [], [name for name in wanted if name != "t"]
    if missing:
        raise RecordingError(_missing(path, header, missing, made))
    wanted += [name for name in ("theta_e", "periods") if found.is_there(name)]
    beside = (*(("u_dc",) * optional), *(TEMPERATURES if temperatures else ()))
    wanted += [name for name in beside if found.is_there(name)]
    if (optional or phases) and all(map(found.is_there, PHASES)):
        wanted += PHASES
    wanted = [name for name in wanted if name not in made]
    if frame is not None:
        frame = replace(frame, keep=("t", *wanted, *made))
        wanted += [name for name in (*frame.currents, *frame.voltages) if name not in wanted]
    held = {name: value for name, value in given.items() if name in wanted}
    read = {name: source for name in wanted if name not in held and (source := found.of(name)) is not None}
    told = {name: source.told() for name, source in read.items()}
    for name, value in held.items():
        told[name] = f"constant {value:g}" + (", in place of the column" if name in header.names else "")
    if lacking:
        told |= {name: NOT_RECORDED for name in OF_D if name in held and not found.is_there(name)}
    told |= made
    if "t" not in told:
        told["t"] = f"the row's number times {constants['T_s'] * constants.get('periods', 1):g} s"
    if "theta_e" not in told:
        told["theta_e"] = "integrated from omega_e"
    columns = {name: source.column for name, source in read.items()}
    return Sources(
        columns, held, told, tuple(name for name in header.names if name not in columns.values()),
        {name: source.scale for name, source in read.items() if source.scale != UNCHANGED}, frame,
        (*(said for name, source in read.items() if (said := source.remark(name))), *_remarks(made, told)),
        lacking,
    )


@dataclass(slots=True)
class _Found:
    """Sources, looked for once."""

    path: Path
    header: Header
    mapping: Mapping[str, str]
    constants: Mapping[str, float]
    n_p: float | None
    known: dict[str, Source | None] = field(default_factory=dict[str, "Source | None"])

    def of(self, name: str) -> Source | None:
        if name not in self.known:
            self.known[name] = source_of(self.path, self.header, name, self.mapping.get(name), self.n_p)
        return self.known[name]

    def is_there(self, name: str) -> bool:
        return name in self.constants or self.of(name) is not None


def _frame(found: _Found) -> tuple[RotorFrame | None, dict[str, str]]:
    """What is made of other quantities, and how in words, by quantity; the angle is needed for it."""
    there = [name for name in (*PHASES, *STATIONARY) if found.is_there(name)]
    made: dict[str, str] = {}
    parts: dict[str, tuple[str, ...]] = {"i": (), "u": ()}
    angle = found.is_there("theta_e")
    for letter in parts:
        pair = (f"{letter}_d", f"{letter}_q")
        if angle and not any(map(found.is_there, pair)) and (names := stationary(letter, there)):
            parts[letter] = names
            made |= dict.fromkeys(pair, f"of {', '.join(names)} by theta_e (Park transform)")
    speed = angle and not found.is_there("omega_e")
    if speed:
        made["omega_e"] = "the derivative of theta_e"
    return (RotorFrame(parts["i"], parts["u"], speed, found.constants, ()) if made else None), made


def _remarks(made: Mapping[str, str], told: Mapping[str, str]) -> Sequence[str]:
    said = [f"{letter}_d and {letter}_q are made {made[f'{letter}_d']}" for letter in "iu" if f"{letter}_d" in made]
    said += [f"omega_e is {made['omega_e']}"] if "omega_e" in made else []
    if told["u_d"] == NOT_RECORDED:
        zero = ", no i_d, which is taken for zero, as a drive controls it to zero"
        said.append(f"the q axis alone: no u_d{zero if told['i_d'] == NOT_RECORDED else ''}")
    if told["t"].startswith("the row's number"):
        said.append(f"no times are read: t is {told['t']}; rows that are not in the file do not show")
    return said


def _missing(path: Path, header: Header, missing: Sequence[str], made: Mapping[str, str]) -> str:
    """What is missing, and what would help."""
    remedy = "map a column to each of them (--map NAME=COLUMN) or set it to a constant (--set NAME=VALUE); "
    remedy += "a unit may follow a column's name: COLUMN[mA]"
    if missing == ["t"]:
        remedy = "expected the time of every row in s, map a column to it (--map t=COLUMN, --map t=COLUMN[us]), or, "
        remedy += "where a row is a control period, say how long that is (--set T_s=1e-4)"
    elif set(missing) == {"u_d", "u_q"} and made:
        remedy = "map a column to each of them (--map NAME=COLUMN), or u_alpha and u_beta, or u_a, u_b and u_c"
        remedy += f"; i_d and i_q are made {made['i_d']}" if "i_d" in made else ""
    elif (bare := bare_names(header.names) & {*PHASES, *STATIONARY}) and "theta_e" not in bare_names(header.names):
        remedy = f"to make them of {', '.join(sorted(bare))}, theta_e is needed; else " + remedy
    left_out = f"; {header.remark}" if header.remark.startswith(LEFT_OUT) else ""
    return f"{path}: missing columns: {', '.join(missing)}; present: {listed(header.names)}{left_out}; {remedy}"


def listed(names: Sequence[str]) -> str:
    """Columns for a sentence."""
    shown = [name if name.isprintable() and 0 < len(name) <= 40 else quoted(name) for name in names[:30]]
    return ", ".join(shown) + (f" and {len(names) - 30} more" if len(names) > 30 else "")
