"""A sin/cos sensor or a resolver with one period a pole pair: an angle that is wrong once or twice an electrical turn.

    theta_measured = theta_e + once_cos cos theta_e + once_sin sin theta_e
                     + twice_cos cos 2 theta_e + twice_sin sin 2 theta_e

Offsets of its two signals show once, unequal amplitudes and a wrong quadrature twice: of unequal ones by half their
difference, of a quadrature by half of what it is off. R. Hoseinnezhad, "Position sensing in brake-by-wire callipers
using resolvers", IEEE Trans. Vehicular Technology 55(3), 2006, doi 10.1109/TVT.2006.874576. What it is the first order
of is plain trigonometry.
"""

import math

import numpy as np

from estimator.arrays import Array, Vector
from estimator.physics.angle_sensing import AngleError
from estimator.physics.effect import DEGREE, Parameter, Sizes, constant, no_shapes
from estimator.physics.rows import Rows


def error(rows: Rows, sizes: Sizes) -> Array:
    """Of the angle, rad electrical."""
    return _error_at(rows.rotor, sizes)


def _error_at(turn: Vector, sizes: Sizes) -> Array:
    once_cos, once_sin, twice_cos, twice_sin = sizes
    twice = turn * turn
    return once_cos * turn.real + once_sin * turn.imag + twice_cos * twice.real + twice_sin * twice.imag


def error_as_measured(rows: Rows, sizes: Sizes) -> Array:
    """Of the measured angle, rad electrical: it is the true one that tells how far off it is."""
    off = error(rows, sizes)
    for _ in range(3):
        off = _error_at(rows.rotor * np.exp(-1j * off), sizes)
    return off


def _told_sizes(_rows: Rows, sizes: Sizes) -> dict[str, tuple[float, str]]:
    once_cos, once_sin, twice_cos, twice_sin = sizes
    return {
        "once": (math.hypot(once_cos, once_sin), "rad"), "once_phase": (math.atan2(once_cos, once_sin), "rad"),
        "twice": (math.hypot(twice_cos, twice_sin), "rad"), "twice_phase": (math.atan2(twice_cos, twice_sin), "rad"),
    }  # fmt: skip


_ANGLE = constant(2.0 * DEGREE), constant(-0.3), constant(0.3)

EFFECT = AngleError(
    "angle_sensor_error", "errors of the angle sensor's signals",
    tuple(Parameter(name, "rad", *_ANGLE) for name in ("once_cos", "once_sin", "twice_cos", "twice_sin")),
    no_shapes,
    "u_d and speed that swing once or twice an electrical turn",
    ("current_sensor_offset", "current_sensor_gain", "encoder_eccentricity"),
    error=error,
    error_as_measured=error_as_measured,
    told=_told_sizes,
    discrepancy=1e-4,
)
