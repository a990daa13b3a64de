"""What errors of measured currents do to the voltage that they imply; shared by offset, gain and skew.

With the truth i = measured - error, the machine's equation in the measured current is short of

    - R_s error - balance of L error
"""

from collections.abc import Callable
from dataclasses import dataclass

from estimator.arrays import Array, Vector
from estimator.physics.effect import SensorError, Sizes
from estimator.physics.rows import Rows


def voltage_of_current_error(rows: Rows, error: Vector) -> Vector:
    """What an error (A, at samples, rotor frame; measured less true) adds to the implied voltage, V."""
    m = rows.machine
    mean = 0.5 * (rows.half * error[1:] + rows.half.conj() * error[:-1])
    return -m.R_s * mean - rows.balance(rows.flux_of_little(error))


@dataclass(frozen=True, slots=True, kw_only=True)
class CurrentError(SensorError):
    """The measured currents are off by this, at samples; measured less true."""

    error: Callable[[Rows, Sizes], Vector]  # A, stationary frame
    zero: Callable[[Rows, Sizes], Array]  # A, mean of the three channels' errors

    def voltage(self, rows: Rows, sizes: Sizes) -> Vector:
        """V of each period."""
        return voltage_of_current_error(rows, self.error(rows, sizes) * rows.rotor.conj())


@dataclass(frozen=True, slots=True, kw_only=True)
class SkewError(CurrentError):
    """It goes by the slope of true currents."""

    halfway: Callable[[Rows, Sizes], Vector]  # A, stationary, by which true currents then have changed
