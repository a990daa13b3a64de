"""What an error of the measured angle does to the voltage; shared by all such errors.

With theta_measured = theta_e + error the machine's flux linkage, seen in the measured frame, is
exp(-j error) psi(exp(j error) i).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from estimator.arrays import Array, Vector
from estimator.physics.effect import SensorError, Sizes
from estimator.physics.rows import Rows


def voltage_of_angle_error(rows: Rows, error: Array | float) -> Vector:
    """What an error (rad electrical, at samples; measured less true) adds to the implied voltage, V."""
    back = np.exp(1j * np.asarray(error))
    return rows.balance(back.conj() * rows.flux(back * rows.i) - rows.flux(rows.i))


ORDERS: Final = ("once_cos", "once_sin", "twice_cos", "twice_sin")
"""Sizes of an error, rad electrical, that comes once and twice a turn."""


def told_orders(_rows: Rows, sizes: Sizes) -> dict[str, tuple[float, str]]:
    """Sizes by `ORDERS` as amplitudes and phases."""
    once_cos, once_sin, twice_cos, twice_sin = sizes
    return {
        "once": (math.hypot(once_cos, once_sin), "rad"), "once_phase": (math.atan2(once_cos, once_sin), "rad"),
        "twice": (math.hypot(twice_cos, twice_sin), "rad"), "twice_phase": (math.atan2(twice_cos, twice_sin), "rad"),
    }  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class AngleError(SensorError):
    """The measured angle is off by this, rad electrical at samples; measured less true."""

    error: Callable[[Rows, Sizes], Array | float]  # of rows by true angles
    error_as_measured: Callable[[Rows, Sizes], Array | float]  # of rows by measured ones

    change: Callable[[Rows, Sizes, Sizes], Array] | None = None
    """Of an error that is no line: its change (rad) from the last sizes to the first, as measured angles stay."""

    def voltage(self, rows: Rows, sizes: Sizes) -> Vector:
        """V of each period."""
        return voltage_of_angle_error(rows, self.error(rows, sizes))
