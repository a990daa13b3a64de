"""The winding warms up: R_s rises within the recording.

    R_s(t) = R_s ((1 + heating)^(h(t) / h(end)) - cooling (1 - exp(-t / time_constant)))
    dh/dt = |i|^2 - h / time_constant

Copper loss heats the winding, which cools to the housing with its time constant; copper gains 0.39 % of its resistance
per kelvin. What other effects of a model lose in the winding (shorted turns, eddies) adds to |i|^2. R_s is that
at the start. The loss rises with R_s, so the warmer, the faster: a power of h is exact where nothing cools, and else as
good as 1 + heating h / h(end) where that is small. Cooling is for a winding that is warmer than its housing when the
recording begins. J. R. Hendershot, T. J. E. Miller, "Design of Brushless Permanent-Magnet Machines", 2010, chapter 15.
"""

import math

import numpy as np

from estimator.arrays import Array, Vector
from estimator.physics.effect import Parameter, ResistanceChange, Sizes, constant
from estimator.physics.rows import Rows


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Added voltage, V."""
    return rows.machine.R_s * rise(rows, sizes) * rows.i_mean


def rise(rows: Rows, sizes: Sizes) -> Array:
    """Of R_s in each period, as a share of that at the start."""
    (heating, time_constant, cooling), share = sizes, np.zeros(len(rows))  # to 1e-16, sooner than by expm1
    if heating != 0.0:
        share += np.exp(np.log1p(heating) * _heat_course(rows, sizes)[:-1]) - 1.0
    if cooling != 0.0:
        share += cooling * (np.exp((rows.span[0] - rows.t[:-1]) / (time_constant * rows.span[1])) - 1.0)
    return share


def _heat_course(rows: Rows, sizes: Sizes) -> Array:
    """h(t)/h(end) at samples."""
    tau = sizes[1] * rows.span[1]
    return rows.once(_heated_by, tau)


def _heated_by(rows: Rows, tau: float) -> Array:
    t, heat = (rows.t - rows.span[0]) / tau, rows.heat + rows.heat_beside
    more = np.diff(heat, prepend=heat[:1])
    came = np.exp(t - 0.5 * np.diff(t, prepend=t[:1]))  # midway since the sample before
    h: Array = np.cumsum(came * more) * np.exp(-t)
    return h / max(float(h[-1]), 1e-300)


EFFECT = ResistanceChange(
    "winding_resistance_drift", "drift of the winding's resistance",
    (
        Parameter("heating", "1", constant(0.1), constant(0.0), constant(1.0)),
        Parameter("time_constant", "1", constant(1.0), constant(0.1), constant(50.0), shape=True),
        Parameter("cooling", "1", constant(0.05), constant(0.0), constant(1.0)),
    ),
    lambda _rows: ((0.5,), (5.0,)),
    "R_s that moves with time, as the losses so far",
    ("winding_temperature", "magnet_flux_drift", "ac_resistance"),
    adds=voltage,
    told=lambda rows, p: {
        "rise": (p[0] + p[2] * math.expm1(-1.0 / p[1]), "1"), "time_constant": (p[1] * rows.span[1], "s"),
    },
    remembers=_heat_course,
    raises=lambda rows, p: (rise(rows, p), 0.0),
    in_proportion_to="R_s",
    discrepancy=5e-4,
)
