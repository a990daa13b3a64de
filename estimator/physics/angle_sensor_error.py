"""A sensor with one period a pole pair, sin/cos, resolver or linear Hall: an angle wrong one to four times its turn.

Whatever offsets, amplitudes, phases and harmonics its two signals have, they are, up to a factor that turns the angle
by a constant,

    z = exp(j theta_e) + sum_n c_n exp(-j (n-1) theta_e)        theta_measured = arg z        n = 1 .. 4

    c_n = -sin_n + j cos_n
    theta_measured = theta_e + sum_n (cos_n cos n theta_e + sin_n sin n theta_e) + squares of these

Offsets of the signals make order 1; unequal amplitudes, by half their difference, and a wrong quadrature, by half of
what it is off, order 2; a second harmonic h of both, h/sqrt(2) of orders 1 and 3; a third one h, h of order 4. What
turns forwards in z besides is of the same orders, but for its squares. R. Hoseinnezhad, "Position sensing in
brake-by-wire callipers using resolvers", IEEE Trans. Vehicular Technology 55(3), 2006, doi 10.1109/TVT.2006.874576.
"""

import numpy as np

from estimator.arrays import Array, Vector
from estimator.physics.angle_sensing import HIGHER_ORDERS, ORDERS, AngleError, told_orders
from estimator.physics.effect import DEGREE, Parameter, Sizes, constant
from estimator.physics.rows import Rows


def error(rows: Rows, sizes: Sizes) -> Array:
    """Of the angle, rad electrical."""
    return _error_at(rows.rotor, sizes)


def _error_at(turn: Vector, sizes: Sizes) -> Array:
    back, beside = turn.conj(), np.zeros_like(turn)
    for cos, sin in zip(sizes[-2::-2], sizes[::-2], strict=True):  # of the highest order first
        beside = (beside + complex(-sin, cos)) * back
    return np.angle(1.0 + beside)


def error_as_measured(rows: Rows, sizes: Sizes) -> Array:
    """Of the measured angle, rad electrical: it is the true one that tells how far off it is."""
    off = error(rows, sizes)
    for _ in range(4):
        off = _error_at(rows.rotor * np.exp(-1j * off), sizes)
    return off


def _shapes(rows: Rows) -> tuple[tuple[float, ...], ...]:
    """An angle that goes through edges has no signals."""
    return ((),) if rows.hall_place is None else ()


def _misses_more(sizes: Sizes) -> float:
    """An order 1 may turn forwards in z, and its product with order 4 is of order 3 then, not 5."""
    squares = [a * a + b * b for a, b in zip(sizes[::2], sizes[1::2], strict=True)]
    return 4.0 * squares[0] * squares[-1] / sum(squares) if len(squares) == 4 and sum(squares) > 0.0 else 0.0


_ANGLE = constant(2.0 * DEGREE), constant(-0.3), constant(0.3)

EFFECT = AngleError(
    "angle_sensor_error", "errors of the angle sensor's signals",
    tuple(Parameter(name, "rad", *_ANGLE) for name in (*ORDERS, *HIGHER_ORDERS)),
    _shapes,
    "u_d and speed that swing one to four times an electrical turn",
    ("current_sensor_offset", "current_sensor_gain", "encoder_eccentricity", "hall_displacement"),
    error=error,
    error_as_measured=error_as_measured,
    told=told_orders,
    discrepancy=1e-8,
    misses_more=_misses_more,
)
