"""Witnesses as users give them: `psi_f=2.478e-3+-1%`, in `--witness` and in a machine file's [witness].

The error is half of a 95 % interval, as everywhere: a share of the value, or in a unit. Knows nothing of fits.
"""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Final

from pydantic import Field

from bench.errors import ConfigError, shown
from bench.expected import Table, by_name
from estimator.interval import Z_95
from estimator.machine import PARAMETERS, PLAUSIBLE, UNITS
from estimator.witness import Witness

_PREFIXES: Final = {"": 1.0, "m": 1e-3, "u": 1e-6, "µ": 1e-6, "n": 1e-9}
_NUMBER: Final = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_FORM: Final = re.compile(rf"\s*({_NUMBER})\s*([^\d\s+±-][^\s+±-]*)?\s*(?:\+-|±)\s*({_NUMBER})\s*(\S*)\s*")
_EXPECTED: Final = "expected a value and its error, such as psi_f=2.478e-3+-1% or R_s=70mohm+-2mohm"

Texts = Annotated[
    dict[str, str], Table("expected an object", "expected {all}, got {key}", dict.fromkeys(PARAMETERS, str)),
    Field(description="values of R_s, L_d, L_q, psi_f measured elsewhere, each with half of a 95 % interval; those of "
                      "the nominal machine stand unless they are here",
          examples=[{"psi_f": "0.1203+-0.5%"}]),
]  # fmt: skip
"""What `from_table` takes, as a description shows it; that tells more of what is wrong."""


def witnesses_of(items: Sequence[str], where: str = "--witness") -> dict[str, Witness]:
    """Of `NAME=VALUE+-ERROR` each, or several with commas. Raises ConfigError."""
    for item in items:
        if not item.strip(" ,"):
            raise ConfigError(f"{where}: {_EXPECTED}, got {shown(item)}")
    return {name: witness_of(name, text, where) for name, text in by_name(items, where).items()}


def from_table(table: Mapping[Any, object], where: str) -> dict[str, Witness]:
    """Of a table of texts by name. Raises ConfigError."""
    found: dict[str, Witness] = {}
    for name, text in table.items():
        if not isinstance(text, str):
            raise ConfigError(f'{where} {name}: expected a text, such as "2.478e-3+-1%", got {shown(text)}')
        found[str(name)] = witness_of(str(name), text, where)
    return found


def text_of(witness: Witness) -> str:
    """As `witness_of` takes it, in SI."""
    return f"{witness.value!r}+-{Z_95 * witness.std:.9g}"


def witness_of(name: str, text: str, where: str) -> Witness:
    """One of them. Raises ConfigError."""
    if name not in PARAMETERS:
        raise ConfigError(f"{where}: no parameter {shown(name)}, expected one of {', '.join(PARAMETERS)}")
    if (found := _FORM.fullmatch(text)) is None:
        raise ConfigError(f"{where}: {name}: {_EXPECTED}, got {shown(text)}")
    number, unit, error, of = found.groups()
    value = float(number) * _unit(name, unit or "", where)
    low, high = PLAUSIBLE[name]
    if not low <= value <= high:
        raise ConfigError(f"{where}: {name}: expected {low:g} to {high:g} {UNITS[name]}, got {value:g} {UNITS[name]}")
    half = value * float(error) / 100.0 if of == "%" else float(error) * _unit(name, of or unit or "", where)
    if not 0.0 < half < math.inf:
        raise ConfigError(f"{where}: {name}: expected an error above zero, got {error}{of}")
    return Witness(value, half / Z_95)


def _unit(name: str, unit: str, where: str) -> float:
    known = {f"{prefix}{UNITS[name]}": factor for prefix, factor in _PREFIXES.items()}
    if unit and unit not in known:
        raise ConfigError(f"{where}: {name} in {shown(unit)}: expected one of {', '.join(known)}")
    return known.get(unit, 1.0)
