"""The angle's rounding: what an encoder's counts leave between the recorded angle and one that turns smoothly.

A rotor has inertia, so what of its angle is gone after a dozen periods is no movement. Knows nothing of effects.
"""

from typing import Final

import numpy as np

from estimator.physics.rows import Real, Rows, Vector

_HALF: Final = 8  # periods, of the mean on either side


def rounding(rows: Rows) -> Real:
    """Recorded angle less the smooth one, rad, at samples; zero near the ends of runs."""
    n, w = len(rows.theta_e), _HALF
    off = np.zeros(n)
    if n < 6 * w:
        return off
    trend = rows.theta_e[0] + np.arange(n) * ((rows.theta_e[-1] - rows.theta_e[0]) / (n - 1))
    x = rows.theta_e - trend
    smooth = _mean(x, w)
    bend = np.zeros(n)
    bend[1:-1] = np.diff(smooth, 2)
    off = x - (smooth - w * (w + 1) / 6.0 * _mean(bend, 2 * w))  # a mean lies inside of its curve
    ends = np.concatenate(([0], np.flatnonzero(~rows.joined) + 1, [n]))
    for end in ends:
        off[max(end - 4 * w, 0) : end + 4 * w] = 0.0
    return off


def _mean(x: Real, w: int) -> Real:
    """Moving mean over 2 w + 1 values."""
    total = np.concatenate((np.zeros(1), np.cumsum(x)))
    out = x.copy()
    out[w : len(x) - w] = (total[2 * w + 1 :] - total[: len(x) - 2 * w]) / (2 * w + 1)
    return out


def flux_of_rounding(rows: Rows) -> tuple[Vector, float]:
    """The flux error (Vs, rotor frame) at the end of each period that the rounding makes.

    And the energy (Vs^2, summed) of what it makes where the rotor is too slow to tell rounding from movement.
    """
    m, i, off = rows.machine, rows.i[1:], rounding(rows)[1:]
    per_angle = -(1j * m.psi_f + (m.L_d - m.L_q) * (i.imag + 1j * i.real))  # Vs/rad
    step = 2.0 * float(np.quantile(np.abs(off), 0.98)) if len(off) else 0.0
    slow = np.abs(rows.D) < step
    return per_angle * off, float(np.sum(np.abs(per_angle[slow]) ** 2)) * step**2 / 12.0
