"""The device configuration file (CiA 306): the data sheet of the drive with a value for each parameter of the set.

A REAL32 value is written as a decimal number; on reading, one in hex is taken for its bits, as some tools write it.
"""

import configparser
import struct
from typing import Final

from bench.errors import ConfigError, shown
from bench.parameters.parameter_set import FLASHED, ParameterSet, problem_of, set_of
from drivers.wire.canopen_od import eds
from drivers.wire.dictionary import Signal, WireType

_AT: Final = {(signal.index, signal.subindex): signal for signal in FLASHED}
_NODE: Final = 5


def as_dcf(given: ParameterSet, node: int = _NODE) -> str:
    """A set as a DCF, for a node."""
    lines, value = list[str](), ""
    for line in eds().splitlines():
        if line.startswith("["):
            value = _value_of(line, given)
        if line.startswith("PDOMapping=") and value:
            lines.append(f"ParameterValue={value}")
            value = ""
        lines.append(line.replace("FileName=pmsm-bench.eds", "FileName=pmsm-bench.dcf"))
    name = "".join(c if c.isprintable() else "?" for c in given.name)
    commissioned = ["[DeviceComissioning]", f"NodeID={node}", f"NodeName={name}", "Baudrate=1000", "NetNumber=0", ""]
    return "\n".join([*lines, *commissioned])


def from_dcf(text: str, name: str, where: str) -> ParameterSet:
    """The set in a DCF: its values of what a set may hold. Raises ConfigError, with all that is wrong."""
    parser = configparser.ConfigParser(interpolation=None, strict=False)
    try:
        parser.read_string(text)
    except configparser.Error as error:
        raise ConfigError(f"{where}: is no DCF: {error.message.splitlines()[0]}") from None
    values, problems = dict[str, float](), list[str]()
    for section in parser.sections():
        signal, told = _signal_at(section), parser.get(section, "ParameterValue", fallback="").strip()
        if signal is None or not told:
            continue
        try:
            value = _number(signal, told)
        except ValueError:
            problems.append(f"[{section}] {signal.name}: expected a number as ParameterValue, got {shown(told)}")
            continue
        if problem := problem_of(signal.name, value):
            problems.append(problem)
        values[signal.name] = value
    if not values and not problems:
        problems.append("expected ParameterValue entries of this drive's parameters, got none")
    if problems:
        raise ConfigError("\n".join(f"{where}: {problem}" for problem in problems))
    return set_of(values, name, f"imported from {where}")


def _value_of(line: str, given: ParameterSet) -> str:
    signal = _signal_at(line.strip("[]"))
    entry = given.entries.get(signal.name) if signal else None
    if signal is None or entry is None:
        return ""
    return repr(entry.value) if signal.type is WireType.F32 else f"{int(entry.value)}"


def _signal_at(section: str) -> Signal | None:
    index, _, subindex = section.lower().partition("sub")
    try:
        return _AT.get((int(index, 16), int(subindex or "0", 16)))
    except ValueError:
        return None


def _number(signal: Signal, text: str) -> float:
    if not text.lower().startswith("0x"):
        return float(text)
    bits = int(text, 16)
    if signal.type is not WireType.F32:
        return float(bits)
    if bits >= 1 << 32:
        raise ValueError
    return float(struct.unpack("<f", struct.pack("<I", bits))[0])
