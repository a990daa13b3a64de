"""Doubts: what a fit leaves of the torque, beyond noise.

Where a suspect explains most of it, it is that. What is left then, beyond what the angle's noise explains, is of none:
a shaft, a coupling or a belt that gives way, backlash, friction of another kind. It shows over short stretches, where
long ones agree with any inertia.
"""

from typing import Final

import numpy as np

from estimator.arrays import Array
from estimator.mechanics.regression import Fit, without
from estimator.mechanics.suspects import SUSPECTS, Suspect, columns_of

_MOST_OF: Final = 0.5  # share of the residual's energy, from which on a suspect is one
_MATTERS: Final = 0.01  # share of the torque, rms
_PER_COLUMN: Final = 8  # stretches
_ROUNDING: Final = 3.0  # times the energy of independent errors: an encoder's are none at steady speeds


def suspects_of(fit: Fit) -> dict[Suspect, float]:
    """Suspects that explain most of what is left, one after the other, and the torque (Nm rms) that each explains."""
    found: dict[Suspect, float] = {}
    rms = float(np.sqrt(np.mean(fit.tau**2)))
    columns, left = fit.every, fit.residual
    for _ in SUSPECTS:
        energy = float(np.sum(left**2))
        rivals = {s: without(fit.tau, np.vstack((columns, own))) for s, own in _allowed(fit, columns) if s not in found}
        if not rivals:
            break
        suspect = min(rivals, key=lambda s: float(np.sum(rivals[s] ** 2)))
        taken = energy - float(np.sum(rivals[suspect] ** 2))
        torque = float(np.sqrt(max(taken, 0.0) / len(left)))
        if taken < _MOST_OF * energy or torque < _MATTERS * rms:
            break
        found[suspect], left = torque, rivals[suspect]
        columns = np.vstack((columns, columns_of(suspect, fit.stretches)))
    return found


def unexplained(fit: Fit) -> float:
    """Share of the torque beside friction, load and suspects that neither acceleration nor noise explains."""
    return 1.0 - fit.explained - _ROUNDING * fit.noise


def _allowed(fit: Fit, columns: Array) -> list[tuple[Suspect, Array]]:
    """Suspects with their columns, as many as there are stretches for."""
    room = len(fit.stretches) // _PER_COLUMN - len(columns)
    allowed: list[tuple[Suspect, Array]] = []
    for suspect in SUSPECTS:
        own = columns_of(suspect, fit.stretches)
        if 0 < len(own) <= room:
            allowed.append((suspect, own))
            room -= len(own)
    return allowed
