"""The machine: a PMSM with flux linkage as state. Knows nothing of its supply, its load or its control.

Equations in the rotor frame, d axis on the magnet flux, motor sign convention, peak values:

    psi_d = L_d i_d + psi_f        psi_q = L_q i_q        tau_e = 3/2 n_p (psi_d i_q - psi_q i_d)

The relation of flux linkage and current, with what may bend it, is told in `magnetics`.
"""

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from emulator.bounds import Bound

COLDEST, HOTTEST = 23.4, 80.0  # degC, ends of the temperature table

# Temperature in degC, R_s in ohm, L_d and L_q in mH of a servo motor: S. Wang, "Windowed Least Square
# Algorithm Based PMSM Parameters Estimation", Mathematical Problems in Engineering, 2013,
# doi 10.1155/2013/131268, table 1.
_TABLE: NDArray[np.float64] = np.array(
    [
        (23.4, 0.9664, 4.24, 6.21),
        (30.0, 1.0008, 4.26, 6.26),
        (40.0, 1.0373, 4.28, 6.30),
        (50.0, 1.0770, 4.30, 6.34),
        (60.0, 1.1245, 4.31, 6.40),
        (70.0, 1.1592, 4.34, 6.44),
        (80.0, 1.1751, 4.36, 6.48),
    ]
)
TABLE_TEMPERATURES = tuple(float(row[0]) for row in _TABLE)  # degC, where the parameters' lines bend


class Machine(NamedTuple):
    """Parameters per phase, peak dq, at 23.4 degC. A named tuple because numba reads it."""

    R_s: Annotated[float, Bound("ohm", above=0.0)]
    L_d: Annotated[float, Bound("H", above=0.0)]
    L_q: Annotated[float, Bound("H", above=0.0)]
    psi_f: Annotated[float, Bound("Vs", above=0.0)]
    n_p: Annotated[int, Bound("1", low=1, high=100)]
    i_rated: Annotated[float, Bound("A", above=0.0)]
    J: Annotated[float, Bound("kg m2", above=0.0)] = 8e-4
    B: Annotated[float, Bound("Nm s/rad", low=0.0)] = 1e-4


def at_temperature(machine: Machine, temperature: float) -> Machine:
    """The machine at a winding temperature (degC), R_s, L_d and L_q scaled as the table's motor does.

    Linear between the table's rows. For other motors the ratios serve too: the table's R_s rises by
    0.38 % per kelvin, copper by 0.39 %. Raises ValueError outside the table.
    """
    if not COLDEST <= temperature <= HOTTEST:
        raise ValueError(f"the winding takes {COLDEST} to {HOTTEST} degC, got {temperature}")
    degC = _TABLE[:, 0]
    R_s, L_d, L_q = (float(np.interp(temperature, degC, _TABLE[:, n]) / _TABLE[0, n]) for n in (1, 2, 3))
    return machine._replace(R_s=machine.R_s * R_s, L_d=machine.L_d * L_d, L_q=machine.L_q * L_q)
