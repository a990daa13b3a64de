"""What an error of the measured angle does to the voltage; shared by offset and eccentricity.

With theta_measured = theta_e + error the machine's flux linkage, seen in the measured frame, is
exp(-j error) psi(exp(j error) i).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from estimator.arrays import Array, Vector
from estimator.physics.effect import SensorError, Sizes
from estimator.physics.rows import Rows


def voltage_of_angle_error(rows: Rows, error: Array | float) -> Vector:
    """What an error (rad electrical, at samples; measured less true) adds to the implied voltage, V."""
    back = np.exp(1j * np.asarray(error))
    return rows.balance(back.conj() * rows.flux(back * rows.i) - rows.flux(rows.i))


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
