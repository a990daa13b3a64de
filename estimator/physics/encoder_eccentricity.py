"""An encoder off its centre, or bent: an angle that is wrong once or twice a mechanical turn.

    theta_measured = theta_e + once_cos cos theta_m + once_sin sin theta_m
                     + twice_cos cos 2 theta_m + twice_sin sin 2 theta_m

Plain geometry; the order tells the cause: once an offset of the centre, twice a tilted or oval disc.
"""

import numpy as np

from estimator.arrays import Array, Vector
from estimator.physics.angle_sensing import ORDERS, AngleError, told_orders
from estimator.physics.effect import DEGREE, Parameter, Sizes, constant, no_shapes
from estimator.physics.rows import Rows


def error(rows: Rows, sizes: Sizes) -> Array:
    """Of the angle, rad electrical."""
    return _eccentricity_at(rows.turn, sizes)


def _eccentricity_at(once: Vector, sizes: Sizes) -> Array:
    once_cos, once_sin, twice_cos, twice_sin = sizes
    twice = once * once
    return once_cos * once.real + once_sin * once.imag + twice_cos * twice.real + twice_sin * twice.imag


def error_as_measured(rows: Rows, sizes: Sizes) -> Array:
    """Of the measured angle, rad electrical: it is the true one that tells how far off it is."""
    off = error(rows, sizes)
    for _ in range(3):
        off = _eccentricity_at(np.exp(1j * (rows.theta_m - off / rows.machine.n_p)), sizes)
    return off


_ONCE_ANGLE = constant(2.0 * DEGREE), constant(-0.6), constant(0.6)

EFFECT = AngleError(
    "encoder_eccentricity", "an eccentric encoder",
    tuple(Parameter(name, "rad", *_ONCE_ANGLE) for name in ORDERS),
    no_shapes,
    "u_d and speed that swing once or twice a mechanical turn",
    ("magnet_flux_drift",),
    error=error,
    error_as_measured=error_as_measured,
    told=told_orders,
    discrepancy=1e-5,
)
