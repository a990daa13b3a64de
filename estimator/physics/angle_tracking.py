"""An angle through a tracking loop of second order (a resolver's converter, a PLL): it lags as the rotor speeds up.

    d(theta_t)/dt = omega_t + 2 damping omega_n e      d(omega_t)/dt = omega_n^2 e      e = theta_e - theta_t

With a = d2(theta_t)/dt2: e + (2 damping/omega_n) de/dt = a/omega_n^2. At steady speed it does not lag. G. Ellis,
"Observers in Control Systems", 2002, chapter 8.
"""

import math
from collections.abc import Callable

import numpy as np

from estimator.arrays import Array, Bools
from estimator.kernel import kernel
from estimator.physics.angle_latency import accelerates
from estimator.physics.angle_sensing import AngleError
from estimator.physics.effect import Parameter, Sizes, constant, periods
from estimator.physics.rows import Rows


def error(rows: Rows, sizes: Sizes) -> Array:
    """Of the angle, rad electrical: by measured angles; by true ones of a small lag."""
    lag, settling = sizes
    return -lag * _first_order(accelerates(rows), _begins(rows), math.exp(-rows.T_s / settling))


def _begins(rows: Rows) -> Bools:
    return np.concatenate(([True], rows.apart != 1))


@kernel
def _first_order(x: Array, begins: Bools, decay: float) -> Array:
    found = np.empty_like(x)
    for k in range(len(x)):
        found[k] = x[k] if begins[k] else decay * found[k - 1] + (1.0 - decay) * 0.5 * (x[k] + x[k - 1])
    return found


def _square(times: float) -> Callable[[Rows], float]:
    return lambda rows: (times * rows.T_s) ** 2


def _told(_rows: Rows, sizes: Sizes) -> dict[str, tuple[float, str]]:
    lag, settling = sizes
    omega = math.sqrt(1.0 / max(lag, 1e-12))
    return {"bandwidth": (omega / math.tau, "Hz"), "damping": (0.5 * settling * omega, "1")}


EFFECT = AngleError(
    "angle_tracking", "a tracking loop of the angle",
    (
        Parameter("lag", "s2", _square(10.0), constant(0.0), _square(300.0)),
        Parameter("settling", "s", periods(10.0), periods(1.0), periods(600.0), shape=True),
    ),
    lambda rows: tuple((times * rows.T_s,) for times in (5.0, 20.0, 80.0)),
    "voltages of a turned frame while the speed changes",
    ("angle_latency",),
    error=error,
    error_as_measured=error,
    told=_told,
    discrepancy=1e-4,
)
