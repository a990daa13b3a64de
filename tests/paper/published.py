"""Facts of the publication, as printed. Knows nothing of our estimators.

S. Wang, Windowed Least Square Algorithm Based PMSM Parameters Estimation, Mathematical Problems in Engineering, 2013,
article 131268, doi 10.1155/2013/131268.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DOI: Final = "10.1155/2013/131268"
NAMES: Final = ("R_s", "L_d", "L_q")
UNITS: Final = {"R_s": "ohm", "L_d": "mH", "L_q": "mH"}
TEMPERATURES: Final = (23.4, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0)  # degC
FIXED_WINDOWS: Final = (100, 200, 300, 400, 500)  # figures 2 to 4
VARYING_WINDOWS: Final = (50, 100, 150, 200, 250, 300, 350, 400, 450, 500)  # figures 5 to 7
BEST_WINDOWS: Final = (300, 400)  # on the varying run

TRUE: Final[Array] = np.array([
    [0.9664, 1.0008, 1.0373, 1.0770, 1.1245, 1.1592, 1.1751],  # ohm
    [4.24, 4.26, 4.28, 4.30, 4.31, 4.34, 4.36],  # mH
    [6.21, 6.26, 6.30, 6.34, 6.40, 6.44, 6.48],  # mH
])
"""Table 1, true values: rows as in `NAMES`, columns as in `TEMPERATURES`."""

TABLE_1: Final[dict[str, Array]] = {
    "EKF": np.array([
        [0.9694, 1.0036, 1.0400, 1.0795, 1.1266, 1.1612, 1.1611],
        [4.2368, 4.2882, 4.2475, 4.2941, 4.3331, 4.3755, 4.3595],
        [6.2095, 6.2604, 6.3001, 6.3400, 6.4012, 6.4395, 6.4800],
    ]),
    "RLS": np.array([
        [0.9607, 1.0077, 1.0271, 1.0712, 1.1216, 1.1451, 1.1771],
        [4.1602, 4.3210, 4.3506, 4.2611, 4.2814, 4.2021, 4.3807],
        [6.2531, 6.2551, 6.5172, 6.3703, 6.4118, 6.4658, 6.4727],
    ]),
    "WLS": np.array([
        [0.9653, 0.9997, 1.0362, 1.0760, 1.1235, 1.1583, 1.1742],
        [4.2465, 4.2664, 4.2861, 4.3058, 4.3157, 4.345, 4.4365],
        [6.2089, 6.2581, 6.2982, 6.3387, 6.3981, 6.4384, 6.4780],
    ]),
}
MISPRINT: Final = (1, 6)  # the WLS cell for L_d at 80 degC


def per_cent(values: Array) -> Array:
    """Relative errors of a table's 21 cells in per cent."""
    return 100.0 * (values / TRUE - 1.0)


def without_misprint(errors: Array) -> Array:
    """The errors of the published WLS but for the cell that looks like a misprint: not a number there."""
    cleaned = errors.copy()
    cleaned[MISPRINT] = np.nan
    return cleaned
