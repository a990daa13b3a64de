"""What an error of the measured angle does to the voltage; shared by offset and eccentricity.

With theta_measured = theta_e + error the machine's flux linkage, seen in the measured frame, is
exp(-j error) psi(exp(j error) i).
"""

import numpy as np

from estimator.arrays import Array, Vector
from estimator.physics.rows import Rows


def voltage_of_angle_error(rows: Rows, error: Array | float) -> Vector:
    """What an error (rad electrical, at samples; measured less true) adds to the implied voltage, V."""
    back = np.exp(1j * np.asarray(error))
    return rows.balance(back.conj() * rows.flux(back * rows.i) - rows.flux(rows.i))
