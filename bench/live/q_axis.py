"""The q axis alone: what estimates there are of samples that have no voltage of the d axis.

    u_q = R_s i_q + L_q di_q/dt + omega_e (psi_f + L_d i_d)

Without i_d, which a drive that controls it to zero makes no matter, L_d is not in it. Knows nothing of files.
"""

from dataclasses import replace
from typing import Final

from bench.errors import ConfigError
from bench.live import method
from bench.live.method import Running
from bench.live.window import Window
from estimator.diagnosis.words import number
from estimator.machine import UNITS
from estimator.online.estimate import Estimate, Status, WindowEstimate

_NONE: Final = 0.0  # H: an L_d that is in no equation
_LONG: Final = 0.5  # of L_q/R_s, that a row may take: what the voltage does within it is not known


def window_on_q(window: Window, *, i_d: bool) -> Window:
    """The settings as far as the q axis goes. `i_d`: whether it was recorded. Raises ConfigError where it cannot."""
    if window.method != "wls":
        raise ConfigError(f"--method {window.method} needs u_d and i_d; expected wls for the q axis alone")
    if i_d:
        return window
    estimated = _without(window.estimated, "L_d")
    if not estimated:
        raise ConfigError("L_d is not in the equation of u_q without i_d: expected R_s, L_q or psi_f to estimate")
    return replace(window, estimated=estimated, held={**window.held, "L_d": _NONE})


def estimate_on_q(running: Running, T: float, *, i_d: bool) -> WindowEstimate:
    """What the q axis tells. T: s, of a row. `i_d`: whether it was recorded.

    A current that changes too slowly for L_q tells R_s and psi_f by an L_q that is held.
    """
    window, result = running.window, method.estimate(running)
    L_q = result.estimates["L_q"]
    others = _without(window.estimated, "L_q")
    if L_q.status is Status.NOT_TOLD and "L_q" in window.held and others:
        result = method.estimate(replace(running, window=replace(window, estimated=others)))
        result = replace(result, estimates={**result.estimates, "L_q": L_q})
    told = dict(result.estimates)
    if not i_d:
        told["L_d"] = Estimate("L_d", None, None, UNITS["L_d"], Status.NOT_TOLD, "not asked for: no i_d, u_d")
    R_s = told["R_s"].value
    if L_q.status is Status.OK and R_s is not None and L_q.value is not None and T * R_s > _LONG * L_q.value:
        long = f"rows of {number(1e3 * T)} ms are long beside L_q/R_s = {number(1e3 * L_q.value / R_s)} ms"
        told["L_q"] = replace(L_q, status=Status.DOUBTFUL, reason=long)
    return replace(result, estimates=told)


def _without(names: tuple[str, ...], one: str) -> tuple[str, ...]:
    return tuple(name for name in names if name != one)
