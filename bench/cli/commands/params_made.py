"""`pmsm-bench params`: sets made of diagnoses, of estimates, and of rules."""

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, cast

from bench.cli.exit_codes import HOLDS, NOT_TOLD
from bench.cli.output import STANDARD_OUTPUT, as_refusal, check_new, write_whole
from bench.errors import BenchError, ConfigError
from bench.files import json_of, read_bytes
from bench.parameters.flash import parameters
from bench.parameters.from_diagnosis import set_from_diagnosis
from bench.parameters.from_estimates import set_from_estimates
from bench.parameters.link import OwnLink
from bench.parameters.made import Made
from bench.parameters.parameter_set import OK, ParameterSet, as_toml, read
from bench.parameters.tuned import tuned_set

_TEMPERATURES: Final = ("temp_winding", "temp_magnet")
_NOTHING: Final = "no value is told: there is no set to write"


@dataclass(frozen=True, slots=True)
class Gains:
    """What is asked of the current control."""

    own: bool
    bandwidth: float | None  # rad/s
    T_s: float | None  # s, control period


@dataclass(frozen=True, slots=True)
class _Image:
    """A drive's parameters, and whose they are."""

    values: Mapping[str, float] | None  # None: not known
    T_s: float | None = None
    layout_id: int | None = None
    serial: int | None = None
    temperatures: Mapping[str, float] = field(default_factory=dict[str, float])  # degC, now


def diagnosed(
    file: Path, drive: str | None, image: Path | None, out: Path, name: str, version: int, gains: Gains,
    electrical_turn: int | None,
) -> int:
    """Write the set of a diagnosis; the exit code."""
    if drive is not None and image is not None:
        raise ConfigError("expected --drive or --image, got both")
    if gains.bandwidth is not None and not gains.own:
        raise ConfigError("--bandwidth goes with --own-gains")
    content = _content(file)
    was = _of_drive(drive) if drive is not None else _of_file(image) if image is not None else _Image(None)
    try:
        made = set_from_diagnosis(
            content, was.values, name=name, version=version, T_s=gains.T_s or was.T_s, own_gains=gains.own,
            bandwidth=gains.bandwidth, electrical_turn=electrical_turn, layout_id=was.layout_id, serial=was.serial,
        )
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from None
    return _written(made, out)


def estimated(
    file: Path, drive: str | None, out: Path, name: str, version: int, temperatures: Mapping[str, float],
    magnets: float | None,
) -> int:
    """Write the set of estimates; the exit code."""
    content = _content(file)
    was = _of_drive(drive, warm=True) if drive is not None else _Image(None)
    try:
        made = set_from_estimates(
            content, name=name, version=version, temperatures={**temperatures, **was.temperatures}, magnets=magnets,
            layout_id=was.layout_id, serial=was.serial,
        )
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from None
    return _written(made, out)


def tuned(
    path: Path, drive: str | None, out: Path, bandwidth: float | None, T_s: float | None, J: float | None, a: float
) -> None:
    """Write a set with gains by rule."""
    was = _of_drive(drive) if drive is not None else _Image({})
    try:
        made = tuned_set(_set(path), was.values or {}, T_s or was.T_s, bandwidth=bandwidth, J=J, a=a)
    except BenchError as error:
        raise ConfigError(f"{path}: {error}") from None
    _written(made, out)


def _written(made: Made, out: Path) -> int:
    to = sys.stderr if out == STANDARD_OUTPUT else sys.stdout
    for remark in made.remarks:
        print(remark, file=to)
    if not made.set.entries:
        print(_NOTHING, file=sys.stderr)
        return NOT_TOLD
    doubtful = sum(entry.status != OK for entry in made.set.entries.values())
    if doubtful:
        print(f"{doubtful} values are not ok: a flash asks for a reason", file=to)
    if out == STANDARD_OUTPUT:
        print(as_toml(made.set), end="")
        return HOLDS
    check_new("--out", out)
    with as_refusal(out):
        write_whole(out, as_toml(made.set), over=False)
    print(f"{out}: written")
    return HOLDS


def _content(file: Path) -> Mapping[str, Any]:
    try:
        content = json_of(read_bytes(file))
    except OSError as error:
        raise ConfigError(f"{file}: cannot be read: {error.strerror or error}") from None
    except ValueError as error:
        raise ConfigError(f"{file}: is not JSON: {error}") from None
    if not isinstance(content, dict):
        raise ConfigError(f"{file}: expected a JSON object")
    return cast(dict[str, Any], content)


def _of_drive(url: str, *, warm: bool = False) -> _Image:
    """As it is now; with its temperatures where they are asked for."""
    try:
        link = OwnLink(url)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    with link:
        drive = link()
        identity = drive.identity
        now = {name: drive.read(name) for name in _TEMPERATURES} if warm else {}
        return _Image(parameters(drive), identity.T_s, identity.layout_id, identity.serial, now)


def _of_file(path: Path) -> _Image:
    given = _set(path)
    return _Image(given.values, None, given.layout_id, given.serial)


def _set(path: Path) -> ParameterSet:
    try:
        return read(path)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror or error}") from None
