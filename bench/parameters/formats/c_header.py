"""A C header of a parameter set: a `#define` for each value and a `const struct`, floats or fixed point.

In fixed point a value is a count of its base: value = count / 2^n * base, where n is 15 (Q15), 31 (Q31) or what an IQ
format of TI's IQmath has (IQ24: values up to 128 bases, 2^-24 fine). The base of a unit is the smallest power of ten
that the values of that unit in the set do not reach, unless it is given; a scalar that it would round by more than a
hundredth, as a dead time beside times of seconds, has a base of its own. What rounding does is told beside each. All
names begin with a prefix, not with the set's own: code that includes the header need not change with it.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from bench.errors import ConfigError, shown
from bench.parameters.parameter_set import FLASHED, OK, ParameterSet
from drivers.wire.dictionary import TABLE_SIZE, TABLES, Signal, WireType

_BY_NAME: Final = {signal.name: signal for signal in FLASHED}
_COARSE: Final = 0.01  # of a value
PREFIX: Final = "pmsm"
_FIXED: Final = {"q15": (15, 16), "q31": (31, 32)}  # bits after the point, and of all


@dataclass(frozen=True, slots=True)
class Form:
    """How numbers are written."""

    name: str
    fraction: int = 0  # bits after the point; 0: a float
    bits: int = 32

    @classmethod
    def of(cls, name: str) -> "Form":
        """float, q15, q31, or iq1 to iq30. Raises ConfigError."""
        if name == "float":
            return cls(name)
        if name in _FIXED:
            return cls(name, *_FIXED[name])
        match = re.fullmatch(r"iq([1-9]|[12][0-9]|30)", name)
        if match is None:
            raise ConfigError(f"type: expected float, q15, q31 or iq1 to iq30, got {name!r}")
        return cls(name, int(match[1]), 32)

    @property
    def most(self) -> float:
        """Of a value, in bases."""
        return 2.0 ** (self.bits - 1 - self.fraction)

    def holds(self, value: float, base: float) -> bool:
        """A value's count is one that there is, when it is rounded."""
        return abs(round(value / base * 2.0**self.fraction)) < 2 ** (self.bits - 1)


def as_c_header(
    given: ParameterSet, form: str = "float", bases: Mapping[str, float] | None = None, prefix: str = PREFIX
) -> str:
    """A set as a header. Raises ConfigError where a value is beyond its base, or the prefix no name in C."""
    if not re.fullmatch(r"[A-Za-z](_?[A-Za-z0-9]){0,30}", prefix):
        raise ConfigError(f"prefix: expected letters, digits and single _ between them, got {shown(prefix)}")
    how = Form.of(form)
    base_of = _bases(given, how, bases or {})
    held, macro = f"{prefix.lower()}_parameters", prefix.upper()
    guard = f"{held.upper()}_H"
    scalars = [_BY_NAME[key] for key in given.entries if not _BY_NAME[key].table]
    tables = [table for table in TABLES if f"{table}_1" in given.entries]
    whose = f"{_plain(given.name)}, version {given.version}"
    lines = [
        f"/* Parameters {whose}. SI; currents and voltages are peak dq values. */",
        f"#ifndef {guard}", f"#define {guard}", "", "#include <stdint.h>", "",
    ]  # fmt: skip
    for whose, base in base_of.items():
        unit = _BY_NAME[whose].unit if whose in _BY_NAME else whose
        rule = f"value = count / 2^{how.fraction} * base"
        lines.append(f"#define {macro}_BASE_{_identifier(whose)} {base!r}  /* {unit}: {rule} */")
    for signal in scalars:
        value = given.entries[signal.name].value
        text, error = _number(signal, value, how, base_of)
        unit = "" if signal.unit == "1" else f" {signal.unit}"
        off = f", {value!r}{unit} rounded by {error:.2g}{unit}" if error else ""
        status = given.entries[signal.name].status
        doubt = "" if status == OK else f", {_plain(status)}"
        lines.append(f"#define {macro}_{signal.name.upper()} {text}  /*{unit} {signal.summary}{off}{doubt} */")
    for table in tables:
        signals = [_BY_NAME[f"{table}_{k}"] for k in range(1, TABLE_SIZE + 1)]
        texts, errors = zip(*(_number(s, given.entries[s.name].value, how, base_of) for s in signals), strict=True)
        off = f", rounded by {max(errors, key=abs):.2g} at most" if any(errors) else ""
        lines += ["", f"/* {TABLES[table][1]}: {TABLES[table][2]}{off} */", f"#define {macro}_{table.upper()} {{ \\"]
        lines += [f"    {', '.join(texts[k : k + 8])}, \\" for k in range(0, TABLE_SIZE, 8)]
        lines.append("}")
    lines += ["", "typedef struct {"]
    lines += [f"    {_c_type(signal, how)} {signal.name};" for signal in scalars]
    lines += [f"    {_c_type(_BY_NAME[f'{table}_1'], how)} {table}[{TABLE_SIZE}];" for table in tables]
    members = ", ".join(f"{macro}_{name.upper()}" for name in (*(signal.name for signal in scalars), *tables))
    lines += [f"}} {held}_t;", "", f"static const {held}_t {held} = {{"]
    lines += [f"    {members}", "};", "", f"#endif /* {guard} */", ""]
    return "\n".join(lines)


def coarse(given: ParameterSet, form: str) -> list[str]:
    """Values that a form rounds by more than a hundredth of themselves, a clause each. Raises ConfigError."""
    how = Form.of(form)
    base_of, found = _bases(given, how, {}), list[str]()
    for name, entry in given.entries.items():
        error = _number(_BY_NAME[name], entry.value, how, base_of)[1]
        if abs(error) > _COARSE * abs(entry.value):
            found.append(f"{name} = {entry.value:.4g} is rounded by {error:.2g}")
    return found


def _bases(given: ParameterSet, how: Form, told: Mapping[str, float]) -> dict[str, float]:
    """Of each unit of real numbers, and of scalars that it would be too coarse for; empty for floats."""
    if not how.fraction:
        return {}
    largest: dict[str, float] = {}
    for name, entry in given.entries.items():
        signal = _BY_NAME[name]
        if signal.type is WireType.F32:
            largest[signal.unit] = max(largest.get(signal.unit, 0.0), abs(entry.value))
    found = {unit: told.get(unit, _base_for(value, how)) for unit, value in largest.items()}
    for unit, base in found.items():
        if not base > 0.0 or not how.holds(largest[unit], base):
            raise ConfigError(
                f"base of {unit}: expected more than {largest[unit] / how.most:.4g}, the set's largest in {how.name}, "
                f"got {base:g}"
            )
    too_coarse = {
        name: _base_for(abs(entry.value), how) for name, entry in given.entries.items()
        if not (signal := _BY_NAME[name]).table and signal.unit not in told
        and abs(_number(signal, entry.value, how, found)[1]) > _COARSE * abs(entry.value)
    }  # fmt: skip
    return found | too_coarse


def _base_for(value: float, how: Form) -> float:
    """The smallest power of ten above a value, of which its count is one that there is."""
    power = 0 if value <= 0.0 else math.floor(math.log10(value)) + 1
    return next(base for k in range(3) if how.holds(value, base := float(f"1e{power + k}")))


def _number(signal: Signal, value: float, how: Form, bases: Mapping[str, float]) -> tuple[str, float]:
    """A value as C has it, and by how much that is off, SI."""
    if signal.type is not WireType.F32:
        return str(int(value)), 0.0
    if not how.fraction:
        return f"{float(value)!r}f", 0.0
    one = bases.get(signal.name, bases[signal.unit]) / 2.0**how.fraction
    count = round(value / one)
    return str(count), count * one - value


def _c_type(signal: Signal, how: Form) -> str:
    if signal.type is WireType.F32:
        return f"int{how.bits}_t" if how.fraction else "float"
    return {"U16": "uint16_t", "U32": "uint32_t", "I16": "int16_t", "I32": "int32_t", "U8": "uint8_t"}[signal.type.name]


def _plain(text: str) -> str:
    """A text that ends no comment, and begins none."""
    return re.sub(r"[^A-Za-z0-9 .,:;()+_-]", "?", text)


def _identifier(unit: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "_", unit.replace("/", "_PER_")).strip("_").upper() or "ONE"
