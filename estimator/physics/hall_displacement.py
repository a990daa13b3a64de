"""Digital Hall sensors that are displaced: a drive takes each of their edges for where it should be.

    edge s, which should be at n_s = place + 60 deg s, is at p_s = n_s + displaced_x     x = a, c, b, a, c, b

Each of three sensors switches twice an electrical turn, half a turn apart, so that one that is displaced moves two
edges. All three by as much are an offset of the angle: the sizes are what is beside it, and add up to none. Between
edges the angle is known by their times alone: it is the smoothest course through n_s at p_s, a cubic with the slopes of
parabolas through three edges, exact for a rotor that accelerates evenly. The error is that course less the true angle.
It repeats every half turn: orders 2, 4, 8 and 10, and none of order 1 or 3. Derived here.
"""

import math
from typing import Final

import numpy as np

from estimator.arrays import Array
from estimator.kernel import kernel
from estimator.physics.angle_sensing import AngleError
from estimator.physics.effect import DEGREE, Parameter, Sizes, constant
from estimator.physics.rows import Rows

SECTOR: Final = math.tau / 6.0


@kernel
def course_between(
    x: float, x_0: float, x_1: float, x_2: float, x_3: float, y: tuple[float, float, float, float]
) -> float:
    """Between the second and the third of four knots."""
    before, h, after = x_1 - x_0, x_2 - x_1, x_3 - x_2
    rise = (y[2] - y[1]) / h
    s_1 = ((y[1] - y[0]) / before * h + rise * before) / (before + h)
    s_2 = (rise * after + (y[3] - y[2]) / after * h) / (h + after)
    along = (x - x_1) / h
    back = 1.0 - along
    bend = h * along * back * ((s_1 - rise) * back - (s_2 - rise) * along)
    return y[1] + along * (y[2] - y[1]) + bend


@kernel
def _edge(s: int, a: float, b: float) -> float:
    """Where an edge is (rad) from the place on."""
    n = s % 3
    return s * SECTOR + (a if n == 0 else -a - b if n == 1 else b)


@kernel
def _errors(theta: Array, place: float, a: float, b: float) -> Array:
    off = np.empty(len(theta))
    for k in range(len(theta)):
        x = float(theta[k] - place)
        s = math.floor(x / SECTOR)
        while x < _edge(s, a, b):
            s -= 1
        while x >= _edge(s + 1, a, b):
            s += 1
        y = (s - 1) * SECTOR, s * SECTOR, (s + 1) * SECTOR, (s + 2) * SECTOR
        p_0, p_1, p_2, p_3 = _edge(s - 1, a, b), _edge(s, a, b), _edge(s + 1, a, b), _edge(s + 2, a, b)
        off[k] = course_between(x, p_0, p_1, p_2, p_3, y) - x
    return off


def error(rows: Rows, sizes: Sizes) -> Array:
    """Of the angle, rad electrical."""
    return _errors(rows.theta_e, sizes[2], sizes[0], sizes[1])


def error_as_measured(rows: Rows, sizes: Sizes) -> Array:
    """Of the measured angle, rad electrical: it is the true one that tells how far off it is."""
    off = error(rows, sizes)
    for _ in range(4):
        off = _errors(rows.theta_e - off, sizes[2], sizes[0], sizes[1])
    return off


def _told(_rows: Rows, sizes: Sizes) -> dict[str, tuple[float, str]]:
    a, b, _ = sizes
    return {"displaced_a": (a, "rad"), "displaced_b": (b, "rad"), "displaced_c": (-a - b, "rad")}


def _shapes(rows: Rows) -> tuple[tuple[float, ...], ...]:
    """Where the edges are that the recorded angle shows; an angle without any is no Hall sensors'."""
    return () if rows.hall_place is None else ((rows.hall_place,),)


_ANGLE: Final = constant(2.0 * DEGREE), constant(-0.3), constant(0.3)

EFFECT = AngleError(
    "hall_displacement", "displaced Hall sensors",
    (
        Parameter("displaced_a", "rad", *_ANGLE), Parameter("displaced_b", "rad", *_ANGLE),
        Parameter("place", "rad", constant(0.1), constant(-SECTOR), constant(SECTOR), shape=True, discrete=True),
    ),
    _shapes,
    "u_d and speed that swing twice and four times an electrical turn, with kinks every 60 deg",
    ("angle_sensor_error", "current_sensor_gain", "encoder_eccentricity"),
    error=error,
    error_as_measured=error_as_measured,
    told=_told,
    discrepancy=1e-4,
)
