"""What a drive is delivered with: parameters by their signals' names, tables as lists of their entries.

    [settings]
    n_p = 3
    control_L_q = 5.0e-3
    angle_table = [0.0, 0.001, ...]     # all 64
"""

from collections.abc import Mapping
from typing import Final, cast

from drivers.wire.codec import check_range
from drivers.wire.dictionary import SIGNALS, TABLE_SIZE, TABLES, signal_named
from emulator.bounds import ScenarioError
from emulator.input_file import shown

_NAMES: Final = frozenset(signal.name for signal in SIGNALS if signal.is_parameter and not signal.is_set_point)


def settings_from_table(table: Mapping[str, object], where: str) -> dict[str, float]:
    """Settings from the TOML table `settings`. Raises ScenarioError."""
    found: dict[str, float] = {}
    for name, value in table.items():
        if name in TABLES:
            if not isinstance(value, list) or len(entries := cast(list[object], value)) != TABLE_SIZE:
                came = shown(cast(object, value))
                raise ScenarioError(f"{where}{name} takes a list of {TABLE_SIZE} numbers, got {came}")
            found |= {f"{name}_{k}": _number(f"{name}_{k}", one, where) for k, one in enumerate(entries, start=1)}
        else:
            found[name] = _number(name, value, where)
    return found


def _number(name: str, value: object, where: str) -> float:
    if name not in _NAMES:
        raise ScenarioError(f"{where}{shown(name)[1:-1]} is no parameter of a drive; `pmsm-bench registers` has them")
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ScenarioError(f"{where}{name} takes a number, got {shown(value)}")
    try:
        check_range(signal_named(name), float(value))
    except ValueError as error:
        raise ScenarioError(f"{where}{error}") from None
    return float(value)
