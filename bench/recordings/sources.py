"""Where each quantity of a recording comes from: a column, a constant, or an integral. Knows nothing of formats."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from bench.errors import ConfigError, RecordingError
from bench.recordings.table import quoted

NEEDED: tuple[str, ...] = ("t", "u_d", "u_q", "i_d", "i_q", "omega_e")  # s, V, A, rad/s
MEANS: tuple[str, ...] = ("i_d_mean", "i_q_mean")  # A, needed where a row covers several control periods
PHASES: tuple[str, ...] = ("i_a", "i_b", "i_c")  # A, read where all three are there
OPTIONAL: tuple[str, ...] = ("u_dc", *PHASES)  # V, A
KNOWN: tuple[str, ...] = (
    *NEEDED, "theta_e", *MEANS, "periods", *OPTIONAL,
    "temp_winding", "temp_magnet",  # may be there, are not read
)
MAX_PERIODS = 1_000_000  # control periods a row covers
ALIGNABLE: tuple[str, ...] = ("u",)


@dataclass(frozen=True, slots=True)
class Sources:
    """The file's columns to read and the values to hold, by quantity; `theta_e` in neither is integrated."""

    columns: Mapping[str, str]
    constants: Mapping[str, float]
    told: Mapping[str, str]  # each quantity's source in words
    unused: tuple[str, ...]  # columns present and not read

    def without(self, empty: Sequence[str]) -> "Sources":
        """These sources where optional columns turn out to hold no value; phase currents go together."""
        gone = {*empty, *(PHASES if set(empty) & set(PHASES) else ())} & set(self.columns)
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


def check_options(
    mapping: Mapping[str, str], constants: Mapping[str, float], T_s: float | None, align: Mapping[str, float]
) -> None:
    """Refuse, with a ConfigError, options that no file could satisfy."""
    for name in (*mapping, *constants):
        if name not in KNOWN:
            raise ConfigError(f"no quantity {quoted(name)} in a recording, expected one of {', '.join(KNOWN)}")
    for name, value in constants.items():
        if name in mapping:
            raise ConfigError(f"{name} is given twice: column {quoted(mapping[name])} and constant {value:g}")
        if name == "t":
            raise ConfigError("t cannot be a constant, expected a column of times in s")
        if not math.isfinite(value):
            raise ConfigError(f"constant {name} = {value}: expected a finite number")
    if not 1 <= (periods := constants.get("periods", 1)) <= MAX_PERIODS or periods != int(periods):
        raise ConfigError(f"constant periods = {periods:g}: expected a whole number of control periods, 1 or more")
    if T_s is not None and not 0 < T_s < math.inf:
        raise ConfigError(f"T_s = {T_s} s: expected a finite number above zero")
    for name, rows in align.items():
        if name not in ALIGNABLE:
            raise ConfigError(f"cannot align {quoted(name)}, expected {', '.join(ALIGNABLE)} (both voltages)")
        if not abs(rows) <= 1000:
            raise ConfigError(f"align {name} = {rows} rows: expected -1000 to 1000")


def find_sources(
    path: Path, present: Sequence[str], mapping: Mapping[str, str], constants: Mapping[str, float], *, optional: bool
) -> Sources:
    """Match what a recording needs, and may have, with what is there. A constant wins over a column of its name."""
    for name, column in mapping.items():
        if column not in present:
            raise RecordingError(f"{path}: no column {quoted(column)} for {name}; present: {_list(present)}")

    def is_there(name: str) -> bool:
        return name in constants or mapping.get(name, name) in present

    wanted = list(NEEDED)
    if any(map(is_there, MEANS)):
        wanted += MEANS
    missing = [name for name in wanted if not is_there(name)]
    if missing:
        remedy = "map a column to each of them (--map NAME=COLUMN) or set it to a constant (--set NAME=VALUE); "
        remedy += "the first line of a CSV names its columns"
        if missing == ["t"]:
            remedy = "expected the time of every row in s, map a column to it (--map t=COLUMN)"
        raise RecordingError(f"{path}: missing columns: {', '.join(missing)}; present: {_list(present)}; {remedy}")
    wanted += [name for name in ("theta_e", "periods") if is_there(name)]
    if optional:
        wanted += ["u_dc"] if is_there("u_dc") else []
        wanted += PHASES if all(map(is_there, PHASES)) else ()
    held = {name: float(constants[name]) for name in wanted if name in constants}
    columns = {name: mapping.get(name, name) for name in wanted if name not in held}
    told = {name: f"column {column}" for name, column in columns.items()}
    for name, value in held.items():
        told[name] = f"constant {value:g}" + (", in place of the column" if name in present else "")
    if "theta_e" not in told:
        told["theta_e"] = "integrated from omega_e"
    read = set(columns.values())
    return Sources(columns, held, told, tuple(name for name in present if name not in read))


def _list(names: Sequence[str]) -> str:
    shown = [name if name.isprintable() and 0 < len(name) <= 40 else quoted(name) for name in names[:30]]
    return ", ".join(shown) + (f" and {len(names) - 30} more" if len(names) > 30 else "")
