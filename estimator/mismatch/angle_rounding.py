"""The angle's rounding: what an encoder's counts leave between the recorded angle and one that turns smoothly.

A rotor has inertia, so what of its angle is gone after a dozen periods is no movement. Knows nothing of effects.
"""

from typing import Final

import numpy as np

from estimator.physics.rows import Real, Rows, Vector

_HALF: Final = 8  # periods, of the mean on either side
_STILL: Final = 1e-9  # rad in a period: no count


def rounding(rows: Rows) -> Real:
    """Recorded angle less the smooth one, rad, at samples; zero near the ends of runs."""
    theta, w, n = rows.theta_e, _HALF, len(rows.theta_e)
    moved = np.flatnonzero(np.abs(rows.D) > _STILL)
    if n < 6 * w or len(moved) < 2:
        return np.zeros(n)
    # Where it moves on, it is between two counts
    x = np.interp(np.arange(n), moved + 0.5, 0.5 * (theta[moved] + theta[moved + 1]))
    bend = np.zeros(n)
    smooth = _mean(x, w)
    bend[1:-1] = np.diff(smooth, 2)
    off = theta - smooth + w * (w + 1) / 6.0 * _mean(bend, 2 * w)  # a mean lies inside of its curve
    for end in (0, *(np.flatnonzero(~rows.joined) + 1), n):
        off[max(end - 4 * w, 0) : end + 4 * w] = 0.0
    return off


def _mean(x: Real, w: int) -> Real:
    """Moving mean over 2 w + 1 values; as it is at the ends."""
    trend = x[0] + np.arange(len(x)) * ((x[-1] - x[0]) / (len(x) - 1))  # for sums that keep their digits
    total = np.concatenate((np.zeros(1), np.cumsum(x - trend)))
    out = x.copy()
    inner = slice(w, len(x) - w)
    out[inner] = trend[inner] + (total[2 * w + 1 :] - total[: len(x) - 2 * w]) / (2 * w + 1)
    return out


def flux_of_rounding(rows: Rows) -> tuple[Vector, float]:
    """The flux error (Vs, rotor frame) at the end of each period that the rounding makes.

    And how much energy (Vs^2, summed) rounding has, of which the slow part cannot be told from movement.
    """
    m, i, off = rows.machine, rows.i[1:], rounding(rows)[1:]
    per_angle = -(1j * m.psi_f + (m.L_d - m.L_q) * (i.imag + 1j * i.real))  # Vs/rad
    more = np.abs(np.diff(rows.D))[rows.joined[1:] & rows.joined[:-1]]
    step = float(np.quantile(more, 0.99)) if len(more) else 0.0  # one count more, or less
    return per_angle * off, float(np.sum(np.abs(per_angle) ** 2)) * step**2 / 12.0
