"""Speed factor: times what it is, as which a speed was recorded that the angle is the integral of.

The flux balance tells it by itself, with no nominal machine: whatever R_s, L_d, L_q and psi_f are, currents that change
show inductances by their rate, and the speed shows the same ones. Knows no effect.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from estimator.diagnosis.intake.causes import MOST_POLE_PAIRS, speed_as
from estimator.diagnosis.intake.correction import Correction
from estimator.diagnosis.intake.rough_fit import RoughFit, RoughStretches, angle_by_speed, rough_fit, stretches_of
from estimator.machine import Machine
from estimator.online.flux_balance import TURN
from estimator.samples import Samples

_BY_FAR: Final = 0.25  # of what the flux balance leaves, that is left at most, and
_CLOSED: Final = 0.007  # of the largest current, as which it is left
_SAME_SPEED: Final = 0.015  # log
_LARGEST: Final = 400.0  # as an electrical speed in degrees/s, and more
_QUARTER: Final = 0.25 * TURN  # rad, that a rotor turns in a row at most
_STEP: Final = 0.05  # log, in which factors are looked at: the flux balance's valley is no narrower
_FINER: Final = (0.1 * _STEP, 0.01 * _STEP)  # and around the best
_ANY: Final = Machine(0.0, 1.0, 1.0, 1.0, 1)  # sets the whitening only: noise of the currents is white as a flux


@dataclass(frozen=True, slots=True)
class SpeedFactor:
    """What the speed was multiplied by, and what it is then."""

    factor: float  # recorded over expected; that of the unit, where it is one
    left: float  # of the share of the voltages' mean square that the flux balance leaves as recorded
    unit: str = ""  # in words; empty where it is none that is known
    n_p: int | None = None  # pole pairs, where the unit tells them


def speed_factor(runs: Sequence[Samples], n_p: int | None) -> SpeedFactor | None:
    """The factor, where it closes the flux balance by far; None where it does not, or the angle is one of its own.

    n_p: pole pairs, where they are known; else the unit may tell them.
    """
    stretches = stretches_of(runs) if runs else None
    if stretches is None or not angle_by_speed(stretches):
        return None
    recorded, fastest = _left(stretches, 1.0), float(np.max(np.abs(np.diff(stretches.theta_e))))
    if fastest > _QUARTER * _LARGEST:
        return None
    sizes = np.exp(np.arange(math.log(fastest / _QUARTER), math.log(_LARGEST), _STEP))
    least = min((sign * size for size in sizes.tolist() for sign in (1.0, -1.0)), key=lambda f: _left(stretches, f))
    factor, left = _best(stretches, least)
    if not (left < _BY_FAR * recorded and _closed(stretches, _fit(stretches, factor))):
        return None
    known = range(1, MOST_POLE_PAIRS + 1) if n_p is None else (n_p,)
    each = ((speed_as(factor, n, _SAME_SPEED), n) for n in known)
    units = [(found, n) for found, n in each if found is not None and found[0] != 1.0]
    if not units:
        return SpeedFactor(factor, left / recorded)
    (exact, unit), n = min(units, key=lambda one: abs(math.log(factor / one[0][0])))
    return SpeedFactor(exact, left / recorded, unit, n if unit.startswith("mechanical") else None)


def _fit(stretches: RoughStretches, factor: float) -> RoughFit:
    return rough_fit(stretches, Correction(theta=factor, omega=factor, whole=True), _ANY)


def _left(stretches: RoughStretches, factor: float) -> float:
    """Share of the voltages' mean square that the flux balance leaves."""
    return 1.0 - _fit(stretches, factor).share


def _closed(stretches: RoughStretches, fit: RoughFit) -> bool:
    """Whether this is a machine that leaves nothing beside its currents."""
    R_s, L_d, L_q, psi_f = fit.value.tolist()
    left = math.sqrt(fit.left) * stretches.T_s / max(0.5 * (L_d + L_q), 1e-12)
    return min(R_s, L_d, L_q, psi_f) > 0.0 and left < _CLOSED * float(np.quantile(np.abs(stretches.i), 0.999))


def _best(stretches: RoughStretches, near: float) -> tuple[float, float]:
    """The factor near to this one that leaves least, and what it leaves."""
    left = math.inf
    for step in _FINER:
        around = (near * math.exp(step * k) for k in range(-10, 11))
        left, near = min((_left(stretches, factor), factor) for factor in around)
    return near, left
