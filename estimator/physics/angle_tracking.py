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
from estimator.physics.effect import Parameter, Sizes, constant
from estimator.physics.rows import Rows


def error(rows: Rows, sizes: Sizes) -> Array:
    """Of the angle, rad electrical, by true angles."""
    lag, settling = _constants(sizes)
    if lag <= 0.0:
        return np.zeros(len(rows.theta_e))
    return -_second_order(lag * accelerates(rows), _begins(rows), *_decays(lag, settling, rows.T_s))


def error_as_measured(rows: Rows, sizes: Sizes) -> Array:
    """The same by measured angles, which the loop has smoothed already."""
    lag, settling = _constants(sizes)
    if lag <= 0.0:
        return np.zeros(len(rows.theta_e))
    return -lag * _first_order(accelerates(rows), _begins(rows), math.exp(-rows.T_s / settling))


def change(rows: Rows, to: Sizes, since: Sizes) -> Array:
    """Of the error from sizes to others, rad electrical, with the loop's own angle as it is."""
    begins, there = _begins(rows), accelerates(rows)
    ends = begins[1:-1] | begins[2:]
    there[1:-1] += np.where(ends, 0.0, np.diff(error(rows, since), 2) / rows.T_s**2)
    one, other = (
        -lag * _first_order(there, begins, math.exp(-rows.T_s / settling))
        for lag, settling in (_constants(to), _constants(since))
    )
    return one - other


def _decays(lag: float, settling: float, T: float) -> tuple[float, float, float, float]:
    """How the loop's error, and its slope, come to be of themselves (2 x 2) in a period."""
    sigma = 0.5 * settling / lag
    square = 1.0 / lag - sigma * sigma
    if square > 0.0:
        w = math.sqrt(square)
        even, odd = math.exp(-sigma * T) * math.cos(w * T), math.exp(-sigma * T) * math.sin(w * T) / w
    else:
        w = max(math.sqrt(-square), 1e-9 * sigma)
        slow, fast = math.exp(-T / (lag * (sigma + w))), math.exp(-(sigma + w) * T)
        even, odd = 0.5 * (slow + fast), 0.5 * (slow - fast) / w
    return even + sigma * odd, odd, -odd / lag, even - sigma * odd


def _begins(rows: Rows) -> Bools:
    return np.concatenate(([True], rows.apart != 1))


@kernel
def _first_order(x: Array, begins: Bools, decay: float) -> Array:
    found = np.empty_like(x)
    for k in range(len(x)):
        found[k] = x[k] if begins[k] else decay * found[k - 1] + (1.0 - decay) * 0.5 * (x[k] + x[k - 1])
    return found


@kernel
def _second_order(settled: Array, begins: Bools, own: float, by_slope: float, slope_by: float, slope: float) -> Array:
    found = np.empty_like(settled)
    x, v = settled[0], 0.0
    found[0] = x
    for k in range(1, len(settled)):
        if begins[k]:
            x, v = settled[k], 0.0
        else:
            towards = 0.5 * (settled[k] + settled[k - 1])
            x, v = towards + own * (x - towards) + by_slope * v, slope_by * (x - towards) + slope * v
        found[k] = x
    return found


def _constants(sizes: Sizes) -> tuple[float, float]:
    """1/omega_n^2 (s2) and 2 damping/omega_n (s)."""
    lag, damping = sizes
    return lag, 2.0 * damping * math.sqrt(max(lag, 0.0))


def _told(_rows: Rows, sizes: Sizes) -> dict[str, tuple[float, str]]:
    """Its bandwidth; its damping shows where the speed changes fast only, and noise of the angle hides it."""
    lag, _ = _constants(sizes)
    return {"bandwidth": (1.0 / (math.tau * math.sqrt(lag)) if lag > 0.0 else math.inf, "Hz")}


def _of_settling(times: float) -> Callable[[Rows], float]:
    """1/omega_n^2 of a loop that settles with so many control periods, at a damping of 1/sqrt(2)."""
    return lambda rows: 0.5 * (times * rows.T_s) ** 2


EFFECT = AngleError(
    "angle_tracking", "a tracking loop of the angle",
    (
        Parameter("lag", "s2", _of_settling(45.0), _of_settling(2.0), _of_settling(600.0)),
        Parameter("damping", "1", constant(0.3), constant(0.35), constant(1.6), shape=True),
    ),
    lambda _rows: ((math.sqrt(0.5),),),
    "voltages of a turned frame while the speed changes",
    ("angle_latency",),
    error=error,
    error_as_measured=error_as_measured,
    change=change,
    while_speed_changes=True,
    told=_told,
    discrepancy=5e-5,
)
