"""What is said of a parameter's temperature: R_s grows with the winding's, psi_f falls with the magnets'.

Beside the value as it was estimated stands what it is at 20 degC, where a temperature is known.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench.errors import ConfigError

COPPER: Final = 0.00393  # 1/K, of a winding's resistance, from 20 degC
MAGNETS: Final = -0.0011  # 1/K, of the flux of NdFeB, from 20 degC: typical
TEMPERATURES: Final = {"R_s": "temp_winding", "psi_f": "temp_magnet"}
"""By parameter: the drive's signal."""
_COLD: Final = 20.0  # degC
_RANGE: Final = (-60.0, 300.0)  # degC, that a motor may have


def at_temperature(parameter: str, value: float, warm: Mapping[str, float], magnets: float | None) -> dict[str, Any]:
    """What an entry says of it: fields of `Entry`. `warm` (degC): by signal; `magnets` (1/K): None: typical.

    Raises ConfigError.
    """
    if (name := TEMPERATURES.get(parameter)) is None:
        return {}
    at, of = warm.get(name), "winding" if parameter == "R_s" else "magnets"
    if at is None or not _RANGE[0] <= at <= _RANGE[1]:
        return {"note": f"no temperature of the {of} was recorded: what it is at 20 degC is not known"}
    if parameter == "R_s":
        per_K, said = COPPER, f"copper, {100.0 * COPPER:.3g} %/K"
    else:
        per_K = MAGNETS if magnets is None else magnets
        said = f"magnets of {100.0 * per_K:.3g} %/K" + (", typical of NdFeB" if magnets is None else "")
    scale = 1.0 + per_K * (at - _COLD)
    if scale <= 0.0:
        raise ConfigError(f"a magnets' coefficient of {per_K:g} 1/K leaves no flux at {at:g} degC")
    return {"note": f"at 20 degC: {said}", "at_degC": at, "at_20_degC": value / scale}
