"""A sin/cos sensor or a resolver with one period a pole pair: an angle that is wrong once or twice an electrical turn.

Whatever offsets, amplitudes and phases its two signals have, they are, up to a factor that turns the angle by a
constant,

    z = exp(j theta_e) + delta + epsilon exp(-j theta_e)        theta_measured = arg z

    delta = -once_sin + j once_cos      epsilon = -twice_sin + j twice_cos
    theta_measured = theta_e + once_cos cos theta_e + once_sin sin theta_e
                     + twice_cos cos 2 theta_e + twice_sin sin 2 theta_e + squares of these

Offsets of the signals make delta; unequal amplitudes, by half their difference, and a wrong quadrature, by half of what
it is off, epsilon. R. Hoseinnezhad, "Position sensing in brake-by-wire callipers using resolvers", IEEE Trans.
Vehicular Technology 55(3), 2006, doi 10.1109/TVT.2006.874576.
"""

import numpy as np

from estimator.arrays import Array, Vector
from estimator.physics.angle_sensing import ORDERS, AngleError, told_orders
from estimator.physics.effect import DEGREE, Parameter, Sizes, constant, no_shapes
from estimator.physics.rows import Rows


def error(rows: Rows, sizes: Sizes) -> Array:
    """Of the angle, rad electrical."""
    return _error_at(rows.rotor, sizes)


def _error_at(turn: Vector, sizes: Sizes) -> Array:
    once_cos, once_sin, twice_cos, twice_sin = sizes
    delta, epsilon = complex(-once_sin, once_cos), complex(-twice_sin, twice_cos)
    back = turn.conj()
    return np.angle(1.0 + delta * back + epsilon * back * back)


def error_as_measured(rows: Rows, sizes: Sizes) -> Array:
    """Of the measured angle, rad electrical: it is the true one that tells how far off it is."""
    off = error(rows, sizes)
    for _ in range(4):
        off = _error_at(rows.rotor * np.exp(-1j * off), sizes)
    return off


_ANGLE = constant(2.0 * DEGREE), constant(-0.3), constant(0.3)

EFFECT = AngleError(
    "angle_sensor_error", "errors of the angle sensor's signals",
    tuple(Parameter(name, "rad", *_ANGLE) for name in ORDERS),
    no_shapes,
    "u_d and speed that swing once or twice an electrical turn",
    ("current_sensor_offset", "current_sensor_gain", "encoder_eccentricity"),
    error=error,
    error_as_measured=error_as_measured,
    told=told_orders,
    discrepancy=1e-4,
)
