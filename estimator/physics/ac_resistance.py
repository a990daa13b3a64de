"""Skin and proximity effect: a resistance that rises with frequency.

    u = R_s i + R_x (i - i_x)        L_x d(i_x)/dt = R_x (i - i_x)        R_x = rise R_s,  L_x = R_x / (2 pi corner)

one rung of a ladder in the stationary frame: none at dc, half of `rise` at the corner. P. L. Dowell, "Effects of eddy
currents in transformer windings", Proc. IEE 113, 1966, doi 10.1049/piee.1966.0236.
"""

import math

import numpy as np

from estimator.kernel import kernel
from estimator.physics.effect import Effect, Parameter, Sizes, constant
from estimator.physics.rows import Rows, Vector


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Added voltage, V."""
    return sizes[0] * rows.machine.R_s * rows.stationary(_passed(rows, sizes))


def _passed(rows: Rows, sizes: Sizes) -> Vector:
    corner = float(sizes[1])
    return rows.once(f"passed {corner!r}", lambda: _high_passed(rows.i_s, rows.T_s, corner))


@kernel
def rung(T_s: float, corner: float) -> tuple[float, float, float]:
    """Angle of the corner in a period; the shares of i - i_x at its start and of i's change in it that i_x follows."""
    x = 2.0 * math.pi * corner * T_s
    share = 1.0 - math.exp(-x)
    return x, share, 1.0 - share / x


@kernel
def _high_passed(i: Vector, T_s: float, corner: float) -> Vector:
    """Means over the periods of i - i_x, for a current that runs straight from sample to sample."""
    x, share, late = rung(T_s, corner)
    left = np.empty(len(i) - 1, np.complex128)
    i_x = i[0]
    for k in range(len(i) - 1):
        step = share * (i[k] - i_x) + late * (i[k + 1] - i[k])
        i_x += step
        left[k] = step / x
    return left


EFFECT = Effect(
    "ac_resistance", "a resistance that rises with frequency",
    (
        Parameter("rise", "1", constant(1.0), constant(0.0), constant(6.0)),
        Parameter("corner", "Hz", constant(400.0), constant(50.0), constant(2500.0), shape=True),
    ),
    voltage,
    lambda _rows: ((120.0,), (330.0,), (900.0,)),
    "R_s that rises with speed and with how fast current is excited",
    ("iron_loss", "winding_resistance_drift"),
    missed=3e-4,
    remembers=_passed,
)
