"""The inverter's voltage error: dead time and the drops of transistors and diodes.

A leg loses dead_time / T_s u_dc where its current flows out of it at the rising edge, and gains as much where it flows
into it at the falling edge. Its switches and diodes drop u_drop against the current, all period long. Away from zero
crossings

    u_k = d_k u_dc - sign(i_k) (dead_time / T_s u_dc + u_drop)

Near them the current's ripple has both signs within a period; it follows from the duties and the inductances. What
switches do around zero current makes the sign pass softly, i / sqrt(i^2 + zero_crossing_width^2). S.-G. Jeong,
M.-H. Park, "The analysis and compensation of dead-time effects in PWM inverters", IEEE Trans. Industrial Electronics
38(2), 1991; R. B. Sepe, J. H. Lang, "Inverter nonlinearities and discrete-time vector current control", IEEE Trans.
Industry Applications, 1994.
"""

import numpy as np

from estimator.physics.effect import Effect, Parameter, Sizes
from estimator.physics.rows import AXES, Real, Rows, Vector


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Lost voltage, V."""
    dead_time, u_drop, width = sizes
    lost = np.zeros((len(rows), 3))
    if dead_time != 0.0 and rows.u_dc is not None:
        lost += (rows.u_dc / rows.T_s)[:, None] * _lost_time(rows, dead_time, width)
    if u_drop != 0.0:
        lost += u_drop * rows.once(f"mean signs {width:.5g}", lambda: _mean_signs(rows, width))
    return rows.stationary(sum((2.0 / 3.0 * axis * lost[:, k] for k, axis in enumerate(AXES)), np.zeros(1, complex)))


def _lost_time(rows: Rows, dead_time: float, width: float) -> Real:
    """Time that each leg is low where it should be high, less the opposite, (n, 3), s.

    A pulse shorter than the dead time is lost whole; a leg that stays on a rail has no edge, and one that leaves it has
    one at the period's start.
    """
    outward = rows.once(f"outward {width:.5g}", lambda: _outward(rows, width))  # 0 to 1, at the rising edge
    inward = rows.once(f"inward {width:.5g}", lambda: _inward(rows, width))  # at the falling one
    high, low = rows.duties * rows.T_s, (1.0 - rows.duties) * rows.T_s
    lost = np.minimum(high, dead_time) * outward - np.minimum(low, dead_time) * inward
    at_start = rows.once("edges at start", lambda: _edges_at_start(rows))  # 1 rises, -1 falls
    for k in np.flatnonzero(np.any((high <= 0.0) | (low <= 0.0) | (at_start != 0.0), axis=0)):
        lost[:, k] *= (high[:, k] > 0.0) & (low[:, k] > 0.0)
        sign = _sign(_ends(rows, k)[0], width)
        lost[:, k] += dead_time * 0.5 * (at_start[:, k] + np.abs(at_start[:, k]) * sign)
    return lost


def _outward(rows: Rows, width: float) -> Real:
    when, ripple = _ripple(rows)
    found = np.empty((len(rows), 3))
    for k in range(3):
        start, end = _ends(rows, k)
        found[:, k] = 0.5 + 0.5 * _sign(start + (end - start) * when[:, k] + ripple[:, k, k], width)
    return found


def _inward(rows: Rows, width: float) -> Real:
    when, ripple = _ripple(rows)
    found = np.empty((len(rows), 3))
    for k in range(3):
        start, end = _ends(rows, k)
        found[:, k] = 0.5 - 0.5 * _sign(end - (end - start) * when[:, k] - ripple[:, k, k], width)
    return found


def _edges_at_start(rows: Rows) -> Real:
    stays_high = rows.duties >= 1.0
    before = np.concatenate((stays_high[:1], stays_high[:-1]))
    return (stays_high & ~before).astype(float) - (before & ~stays_high)


def _mean_signs(rows: Rows, width: float) -> Real:
    """Mean over the period of the sign of each phase's current, (n, 3)."""
    found = np.empty((len(rows), 3))
    if rows.u_dc is None:
        for k in range(3):
            start, end = _ends(rows, k)
            found[:, k] = 0.5 * (_sign(start, width) + _sign(end, width))
        return found
    when, ripple = _ripple(rows)
    order = np.argsort(when, axis=1)
    at = np.take_along_axis(when, order, axis=1)
    span = np.diff(at, axis=1, prepend=0.0, append=0.5)  # of the half period, between edges
    for k in range(3):
        start, end = _ends(rows, k)
        there = np.take_along_axis(ripple[:, k, :], order, axis=1)
        ends = np.pad(there, ((0, 0), (1, 1)))  # none at the period's start and middle
        middle, slope = 0.5 * (start + end), end - start
        total = np.zeros(len(rows))
        for part in range(4):
            early, late = (np.zeros(1) if part == 0 else at[:, part - 1]), (np.full(1, 0.5) if part == 3 else at[:, part])
            a = start + slope * early + ends[:, part]
            b = (start + slope * late if part < 3 else middle) + ends[:, part + 1]
            total += span[:, part] * _mean_sign(a, b, width)
            a, b = end - slope * early - ends[:, part], (end - slope * late if part < 3 else middle) - ends[:, part + 1]
            total += span[:, part] * _mean_sign(a, b, width)
        found[:, k] = total
    return found


def _ends(rows: Rows, k: int) -> tuple[Real, Real]:
    i = rows.phase(k)
    return i[:-1], i[1:]


def _ripple(rows: Rows) -> tuple[Real, Real]:
    """When each leg rises, (n, 3), as a share of the period, and each phase's ripple then, (n, phase, leg), A.

    The ripple is the integral of the voltage less its mean, and odd about the period's middle.
    """
    when = rows.once("rises", lambda: 0.5 * (1.0 - rows.duties))
    return when, rows.once("ripple", lambda: _ripple_at(rows, when))


def _ripple_at(rows: Rows, when: Real) -> Real:
    m, middle = rows.machine, rows.middle
    assert rows.u_dc is not None
    u_s = rows.u * middle
    found = np.empty((len(rows), 3, 3))
    for leg in range(3):
        area = -u_s * when[:, leg]
        for j, axis in enumerate(AXES):
            area += 2.0 / 3.0 * axis * rows.u_dc * np.maximum(0.0, when[:, leg] - when[:, j])
        area *= middle.conj() * rows.T_s
        i = (area.real / m.L_d + 1j * area.imag / m.L_q) * middle
        for k, axis in enumerate(AXES):
            found[:, k, leg] = (i * axis.conjugate()).real
    return found


def _sign(i: Real, width: float) -> Real:
    return i / np.sqrt(i * i + width * width)


def _mean_sign(a: Real, b: Real, width: float) -> Real:
    """Mean of the soft sign while the current moves from a to b."""
    return (a + b) / (np.sqrt(a * a + width * width) + np.sqrt(b * b + width * width))


EFFECT = Effect(
    "inverter_voltage_error", "the inverter's voltage error",
    (
        Parameter("dead_time", "s", lambda rows: 0.01 * rows.T_s, lambda _: 0.0, lambda rows: 0.06 * rows.T_s),
        Parameter("u_drop", "V", lambda rows: 0.003 * bus(rows), lambda _: 0.0, lambda rows: 0.03 * bus(rows)),
        Parameter("zero_crossing_width", "A", lambda rows: 0.02 * rows.i_rated, lambda rows: 1e-3 * rows.i_rated,
                  lambda rows: 0.2 * rows.i_rated, shape=True),
    ),
    voltage,
    lambda rows: ((0.004 * rows.i_rated,), (0.03 * rows.i_rated,)),
    "steps of voltage where a phase current changes sign, six per electrical turn in the rotor frame",
    ("winding resistance", "flux_harmonics"),
    missed=3e-3,
)  # fmt: skip


def bus(rows: Rows) -> float:
    """The dc link's voltage, V, or one that suits the recording where it is not known."""
    return float(np.mean(rows.u_dc)) if rows.u_dc is not None else 2.0 * float(np.max(np.abs(rows.u), initial=1e-3))
