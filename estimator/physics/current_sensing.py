"""What errors of measured currents do to the voltage that they imply; shared by offset, gain and skew.

With the truth i = measured - error, the machine's equation in the measured current is short of

    - R_s error - balance of L error
"""

from estimator.arrays import Vector
from estimator.physics.rows import Rows


def voltage_of_current_error(rows: Rows, error: Vector) -> Vector:
    """What an error (A, at samples, rotor frame; measured less true) adds to the implied voltage, V."""
    m = rows.machine
    mean = 0.5 * (rows.half * error[1:] + rows.half.conj() * error[:-1])
    return -m.R_s * mean - rows.balance(rows.flux_of_little(error))
