"""An encoder off its centre, or bent: an angle that is wrong once or twice a mechanical turn.

    theta_measured = theta_e + once_cos cos theta_m + once_sin sin theta_m
                     + twice_cos cos 2 theta_m + twice_sin sin 2 theta_m

Plain geometry; the order tells the cause: once an offset of the centre, twice a tilted or oval disc.
"""

import math

from estimator.physics.angle_sensing import voltage_of_error
from estimator.physics.effect import DEGREE, Effect, Parameter, Sizes, constant, no_shapes
from estimator.physics.rows import Real, Rows, Vector


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Added voltage, V."""
    return voltage_of_error(rows, error(rows, sizes))


def error(rows: Rows, sizes: Sizes) -> Real:
    """Of the angle, rad electrical."""
    once = rows.turn
    once_cos, once_sin, twice_cos, twice_sin = sizes
    twice = once * once
    return once_cos * once.real + once_sin * once.imag + twice_cos * twice.real + twice_sin * twice.imag


def _told(_rows: Rows, sizes: Sizes) -> dict[str, tuple[float, str]]:
    once_cos, once_sin, twice_cos, twice_sin = sizes
    return {
        "once": (math.hypot(once_cos, once_sin), "rad"), "once_phase": (math.atan2(once_cos, once_sin), "rad"),
        "twice": (math.hypot(twice_cos, twice_sin), "rad"), "twice_phase": (math.atan2(twice_cos, twice_sin), "rad"),
    }  # fmt: skip


_ANGLE = constant(2.0 * DEGREE), constant(-0.6), constant(0.6)

EFFECT = Effect(
    "encoder_eccentricity", "an eccentric encoder",
    tuple(Parameter(name, "rad", *_ANGLE) for name in ("once_cos", "once_sin", "twice_cos", "twice_sin")),
    voltage,
    no_shapes,
    "u_d and speed that swing once or twice a mechanical turn",
    ("magnet_flux_drift",),
    angle_error=error,
    told=_told,
    missed=5e-5,
)
