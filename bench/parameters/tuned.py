"""A set with gains by the rules of `tuning`, from what the set takes the machine for. Knows nothing of files."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from bench.errors import LimitError
from bench.parameters.made import DOUBTFUL, Made, Making, Size
from bench.parameters.parameter_set import OK, ParameterSet
from bench.parameters.tuning import Tuned, current_loop, speed_loop

_CURRENT: Final = ("control_R_s", "control_L_d", "control_L_q")
_SPEED: Final = ("control_psi_f", "n_p", "speed_filter")


def tuned_set(
    given: ParameterSet, drive: Mapping[str, float], T_s: float | None, *, bandwidth: float | None = None,
    J: float | None = None, a: float = 2.0,
) -> Made:
    """The set with gains of the current control and, where the inertia (kg m2) is given, of the speed control.

    What the set does not hold is the drive's (SI, by signal); `T_s` (s) is its control period; of `bandwidth` (rad/s)
    or the fastest one; `a`: see `tuning`. Remarks tell what the gains promise. Raises LimitError.
    """
    values = {**drive, **given.values}
    missing = [name for name in (*_CURRENT, *(_SPEED if J is not None else ())) if name not in values]
    needed = [f"gains need {', '.join(missing)}: expected in the set, or of the drive"] if missing else []
    needed += ["gains need the control period: expected of the drive, or told (--T-s)"] if T_s is None else []
    if needed or T_s is None:
        raise LimitError("\n".join(needed))
    if not (math.isfinite(T_s) and T_s > 0.0):
        raise LimitError(f"expected a control period above zero, got {T_s:g} s")
    making = Making(dict(given.entries))
    R_s, L_d, L_q = (values[name] for name in _CURRENT)
    current = current_loop(R_s, L_d, L_q, T_s, bandwidth)
    _take(making, given, current, _CURRENT, "current control")
    if J is not None:
        psi_f, n_p, speed_filter = (values[name] for name in _SPEED)
        delays = 1.0 / current.bandwidth + speed_filter + 0.5 * T_s
        _take(making, given, speed_loop(J, psi_f, int(n_p), delays, a=a), _SPEED, "speed control")
    if values.get("saturation_correction"):
        making.remark("the gains are for the inductances at no current: where tables say less, the loop is faster")
    return Made(replace(given, entries=making.entries), tuple(making.remarks))


def _take(making: Making, given: ParameterSet, tuned: Tuned, of: tuple[str, ...], what: str) -> None:
    doubtful = [name for name in of if name in given.entries and given.entries[name].status != OK]
    source = "tuned by rule" + (f" from doubtful {', '.join(doubtful)}" if doubtful else "")
    sizes = {name: Size(value) for name, value in tuned.values.items()}
    if problem := making.take_all(sizes, DOUBTFUL if doubtful else OK, source):
        raise LimitError(f"{what}: {problem}")
    promised = f"{tuned.bandwidth:.4g} rad/s, phase margin {math.degrees(tuned.phase_margin):.3g} deg"
    making.remark(f"{what}: {promised}")
