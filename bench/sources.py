"""Where each quantity of a recording comes from: a column, a constant, or an integral. Knows nothing of formats."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.errors import ConfigError, RecordingError
from bench.table import quoted

NEEDED: tuple[str, ...] = ("t", "u_d", "u_q", "i_d", "i_q", "omega_e")  # s, V, A, rad/s
MEANS: tuple[str, ...] = ("i_d_mean", "i_q_mean")  # A, needed where a row covers several control periods
KNOWN: tuple[str, ...] = (
    *NEEDED, "theta_e", *MEANS, "periods",
    "u_dc", "i_a", "i_b", "i_c", "temp_winding", "temp_magnet",  # may be there, are not read
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
    path: Path, present: Sequence[str], mapping: Mapping[str, str], constants: Mapping[str, float]
) -> Sources:
    """Match what a recording needs with what is there. A constant wins over a column of the same name."""
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
        raise RecordingError(
            f"{path}: missing columns: {', '.join(missing)}; present: {_list(present)}; "
            "map a column to each of them or set it to a constant"
        )
    wanted += [name for name in ("theta_e", "periods") if is_there(name)]
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
