"""Steady points of the emulated drive: a short run per operating point, averaged over whole electrical turns.

Nothing of the estimator's equations is used: what is recorded is what the drive sets and measures.
"""

import math
from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np

from emulator.plant.machine import Machine
from estimator.diagnosis.points.no_load import NoLoad
from estimator.diagnosis.points.table import Points
from tests.emulator.plant.physics.effect_runs import SALIENT, at, steady, switched, with_effects

SETTLE, TURNS = 0.12, 8  # s; electrical turns
NOISY: dict[str, Any] = {"noise_i": 0.01, "adc_bits": 12}
FREQUENCIES = (15.0, 40.0, 70.0, 100.0)  # Hz, electrical
CURRENTS = (*product((0.0, -2.0, -4.0), (-4.0, -1.0, 1.0, 4.0)), (2.0, 1.0), (-1.0, 0.3), (0.0, 5.5))  # A
LEVELS = (0.0, -1.0, -2.0, -3.0, -4.0, -5.0)  # A, i_d without load
SPEEDS = (20.0, 40.0, 60.0, 80.0, 100.0)  # Hz, electrical


def operating_points(
    frequencies: Sequence[float] = FREQUENCIES, currents: Sequence[tuple[float, float]] = CURRENTS
) -> list[tuple[float, complex]]:
    """Electrical frequencies (Hz) and currents (A)."""
    return [(f, complex(*i)) for f in frequencies for i in currents]


def steady_points(
    where: Sequence[tuple[float, complex]], motor: Machine = SALIENT, drive: dict[str, Any] | None = None,
    **effects: Any,
) -> Points:  # fmt: skip
    """Means of speed, current and voltage at operating points."""
    rows = [_mean(f, i, motor, NOISY | (drive or {}), effects) for f, i in where]
    omega_e, current, voltage = zip(*rows, strict=True)
    return Points(np.array(omega_e), np.array(current), np.array(voltage))


def _mean(
    frequency: float, i: complex, motor: Machine, drive: dict[str, Any], effects: dict[str, Any]
) -> tuple[float, complex, complex]:
    scenario = with_effects(motor=motor, i_dq=i, run=at(frequency, motor), drive=drive, **effects)
    if "inverter" in effects:
        scenario = switched(scenario)
    r = steady(scenario, SETTLE, TURNS / abs(frequency) if frequency else SETTLE)
    means = {name: float(np.mean(r[name])) for name in ("omega_e", "i_d", "i_q", "u_d", "u_q")}
    assert math.isfinite(means["u_q"])
    return means["omega_e"], complex(means["i_d"], means["i_q"]), complex(means["u_d"], means["u_q"])


def without_load(
    i_q: float = 0.4, *, R_s: float = 1.15 * SALIENT.R_s, **effects: Any
) -> NoLoad:
    """u_q - R_s i_q at levels of i_d of a motor whose friction takes some i_q (A), with a resistance that is off."""
    points = steady_points([(f, complex(i_d, i_q * (1.0 + 0.004 * f))) for i_d in LEVELS for f in SPEEDS], **effects)
    return NoLoad(points.omega_e, points.u.imag - R_s * points.i.imag, np.repeat(LEVELS, len(SPEEDS)), R_s)
