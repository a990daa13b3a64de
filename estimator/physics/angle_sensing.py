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

HIGHER_ORDERS: Final = ("thrice_cos", "thrice_sin", "fourth_cos", "fourth_sin")
"""Of one that comes three and four times."""

_TOLD: Final = tuple(name.removesuffix("_cos") for name in (*ORDERS, *HIGHER_ORDERS)[::2])


def told_orders(_rows: Rows, sizes: Sizes) -> dict[str, tuple[float, str]]:
    """Sizes by `ORDERS`, or by those and `HIGHER_ORDERS`, as amplitudes and phases."""
    told = dict[str, tuple[float, str]]()
    for name, cos, sin in zip(_TOLD, sizes[::2], sizes[1::2], strict=False):
        told[name], told[f"{name}_phase"] = (math.hypot(cos, sin), "rad"), (math.atan2(cos, sin), "rad")
    return told


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
