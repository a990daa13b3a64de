"""Skin and proximity effect: a resistance that rises with frequency.

    u = R_s i + R_x (i - i_x)        L_x d(i_x)/dt = R_x (i - i_x)        R_x = rise R_s,  L_x = R_x / (2 pi corner)

one rung of a ladder in the stationary frame: none at dc, half of `rise` at the corner, all of it within a period. P. L.
Dowell, "Effects of eddy currents in transformer windings", Proc. IEE 113, 1966, doi 10.1049/piee.1966.0236.
"""

import cmath
import math

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array, Vector
from estimator.kernel import kernel
from estimator.physics.effect import Branch, Parameter, Sizes, constant
from estimator.physics.rows import Rows


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Added voltage, V."""
    rise, corner = sizes
    currents = rows.once(_currents, corner)
    return rise * rows.machine.R_s * (currents[:, 0] + rise * currents[:, 1])


def emf(rows: Rows, sizes: Sizes) -> Vector:
    """What the rung takes at samples, V."""
    return sizes[0] * rows.machine.R_s * _through(rows, sizes[1]) * rows.rotor.conj()


def _rung_heat(rows: Rows, sizes: Sizes) -> Array:
    """What of the rung's loss R_s would make of a current's square, A^2."""
    return sizes[0] * np.abs(_through(rows, sizes[1])) ** 2


def _through(rows: Rows, corner: float) -> Vector:
    """i - i_x at samples, A, in the stationary frame."""
    return _rung_lag(rows.i_s, rows, corner, _beside_straight(rows, corner))


def _currents(rows: Rows, corner: float) -> Vector:
    """Mean currents (A, n x 2) of each period through a rung's resistance: its own, and what a rung of `rise` 1 adds.

    A rung's voltage bends the machine's current within the period, which the mean of its ends does not see.
    """
    x = 2.0 * math.pi * corner * rows.T_s
    over = _through(rows, corner)
    bent = _rung_mean(rows, over)
    more = -_rung_lag(0.0 * rows.i_s, rows, corner, bent * rows.middle)
    return np.stack((rows.stationary(np.diff(rows.i_s - over) / x) + bent, rows.stationary(np.diff(more) / x)), axis=1)


@kernel
def rung(T_s: float, corner: float) -> tuple[float, float, float]:
    """Angle of the corner in a period; the shares of i - i_x at its start and of i's change in it that i_x follows."""
    x = 2.0 * math.pi * corner * T_s
    share = 1.0 - math.exp(-x)
    return x, share, 1.0 - share / x


def _beside_straight(rows: Rows, corner: float) -> Vector:
    """Mean current (A, stationary) of each period beside that of a straight course, as i_x follows it."""
    beside: Vector = rows.i_mean * rows.middle - 0.5 * (rows.i_s[1:] + rows.i_s[:-1])
    if rows.u_dc is not None:  # late pulses count more
        x, share, _ = rung(rows.T_s, corner)
        ripple = rows.stiffness[:-1](rows.moment_of_pulses) * rows.middle
        beside = beside + 2.0 * math.pi * corner * x / share * ripple
    return beside


def _rung_mean(rows: Rows, over: Vector) -> Vector:
    """Mean current (A) of each period that a rung of R_s, with i - i_x at samples, adds."""
    g, drop = rows.stiffness[:-1], rows.machine.R_s * over * rows.rotor.conj()
    bent = rows.bent(drop[:-1], drop[1:])
    return bent if rows.u_dc is None else bent + rows.machine.R_s * g(g(rows.moment_of_pulses))


def _rung_lag(i: Vector, rows: Rows, corner: float, beside: Vector) -> Vector:
    """i - i_x at samples, for a current that goes straight from sample to sample but for what is `beside`.

    Over periods that are not there it goes straight in the rotor frame; after a pause the rung begins anew.
    """
    periods = np.where(rows.pauses, 0, rows.apart)
    return _rung_course(i, beside, periods, rows.D, *rung(rows.T_s, corner)[1:])


@kernel
def _rung_course(
    i: Vector, beside: Vector, periods: NDArray[np.intp], D: Array, share: float, late: float
) -> Vector:
    over = np.empty(len(i), np.complex128)
    i_x = i[0]
    over[0] = 0.0
    for k in range(len(i) - 1):
        m = periods[k]
        if m == 1:
            i_x += share * (i[k] - i_x + beside[k]) + late * (i[k + 1] - i[k])
        elif m == 0:
            i_x = i[k + 1]
        else:
            turn, begin = cmath.exp(1j * D[k] / m), i[k]
            step = (i[k + 1] * cmath.exp(-1j * D[k]) - i[k]) / m
            for n in range(m):
                end = (i[k] + (n + 1) * step) * turn ** (n + 1)
                i_x += share * (begin - i_x) + late * (end - begin)
                begin = end
        over[k + 1] = i[k + 1] - i_x
    return over


EFFECT = Branch(
    "ac_resistance", "a resistance that rises with frequency",
    (
        Parameter("rise", "1", constant(1.0), constant(0.0), constant(6.0)),
        Parameter("corner", "Hz", constant(400.0), constant(50.0), constant(2500.0), shape=True, ends=True),
    ),
    lambda _rows: tuple((corner,) for corner in (80.0, 140.0, 250.0, 430.0, 750.0, 1300.0)),
    "R_s that rises with speed and with how fast current is excited",
    ("iron_loss", "winding_resistance_drift"),
    adds=voltage,
    in_proportion_to="R_s",
    discrepancy=1e-5,
    remembers=voltage,
    emf=emf,
    heats=_rung_heat,
    fast_resistance=lambda rows, p: p[0] * rows.machine.R_s,
)
