"""A set from estimates: of a replay's JSON, or of what REST says of a drive, with intervals, statuses, temperatures.

R_s grows with the winding's temperature, and psi_f falls with the magnets': beside each stands what it is at 20 degC,
where a temperature is known. Knows nothing of how estimates are made.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from bench.errors import ConfigError, shown
from bench.parameters.made import DOUBTFUL, Made, Making, name_of, number, part, size_of
from bench.parameters.parameter_set import OK, ParameterSet
from bench.parameters.temperature import TEMPERATURES, at_temperature
from estimator.machine import PARAMETERS
from estimator.online.estimate import Status

_ESTIMATED: Final = (Status.OK, Status.DOUBTFUL, Status.STALE)
_WORDS: Final = 100  # characters of a reason


def set_from_estimates(
    content: Mapping[str, Any], *, name: str = "", version: int = 1, temperatures: Mapping[str, float] | None = None,
    magnets: float | None = None, **whose: int | None,
) -> Made:
    """The set, and what was left out. Raises ConfigError where the content holds no estimates.

    `temperatures` (degC): temp_winding and temp_magnet, where the content does not tell; `magnets` (1/K): how their
    flux changes, None: a typical value; `whose`: `layout_id` and `serial` of the set.
    """
    told = part(content, "estimates")
    inner = part(told, "estimates") or told  # a snapshot has those of the drive inside
    if not any(parameter in inner for parameter in PARAMETERS):
        expected = f"expected estimates of {', '.join(PARAMETERS)}, as replay --json and REST tell them"
        raise ConfigError(f"{expected}, got {shown(list(content))}")
    source = _source(content, told)
    warm = dict(temperatures or {}) | _temperatures(content)
    making = Making()
    for parameter in PARAMETERS:
        signal, estimate = f"control_{parameter}", part(inner, parameter)
        size, status = size_of(estimate), estimate.get("status")
        reason = str(estimate.get("reason") or "")[:_WORDS]
        if size is None:
            making.remark(f"{signal} is left out: {reason or f'{parameter} is not told'}")
            continue
        known = Status(status) if status in list(Status) else Status.DOUBTFUL
        said = OK if known is Status.OK else known.value
        if known is Status.OK and size.std is None:
            said, reason = DOUBTFUL, "no interval is told"
        more = at_temperature(parameter, size.value, warm, magnets) if known in _ESTIMATED else {}
        making.take(signal, size, said, f"{source}; {reason}" if reason else source, **more)
    layout_id, serial = (whose.get(key) for key in ("layout_id", "serial"))
    given = ParameterSet(name_of(name or source), making.entries, version, layout_id, serial)
    return Made(given, tuple(making.remarks))


def _source(content: Mapping[str, Any], told: Mapping[str, Any]) -> str:
    file = Path(str(part(content, "recording").get("path", ""))).name
    drive = next((one for one in (content.get("drive"), told.get("drive")) if isinstance(one, str)), "")
    return name_of(f"estimates of {file or drive}" if file or drive else "estimates")


def _temperatures(content: Mapping[str, Any]) -> dict[str, float]:
    """degC: of a replay, or what the drive says beside its estimates."""
    told = part(content, "temperatures_degC") or part(part(content, "drive"), "latest")
    return {name: value for name in TEMPERATURES.values() if (value := number(told.get(name))) is not None}
