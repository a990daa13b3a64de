"""Currents that are means over control periods: sigma-delta converters with sinc filters, firmware that averages.

    i measured = 1/(n T_s) integral of i over the n periods before        or the mean of the last n samples

In the stationary frame. With F for the mean: those of voltage and current obey the machine's equation as these do
themselves, but for the flux that turns with the rotor, m = psi_f exp(j theta) + (L_d - L_q)/2 exp(2j theta) conj(i).
What recorded voltages have beyond those that measured currents imply is

    u - F u + change over the period of (F m(i) - m(F i))

with i, before the mean, as what is measured and what has driven it meanwhile: the machine's equation tells that without
the noise that an inverse of F would make. A mean over time is bent where currents step, so that the resistance sees,
besides, R_s T_s/(12 n) d(i)/dt by which the last and the first of its periods differ. What a filter does to a machine's
linear part is plain algebra; derived here.
"""

from typing import Final, NamedTuple

import numpy as np

from estimator.arrays import Array, Vector
from estimator.physics.effect import AddedVoltage, Parameter, Sizes, Smoothing, constant
from estimator.physics.rows import Rows


class _Mean(NamedTuple):
    """A form of mean."""

    weights: tuple[float, ...]  # of voltages now and 1, 2, ... periods before
    periods: int = 0  # that it is over, as a mean over time; 0: one of samples

    @property
    def lag(self) -> float:
        """Periods, by which it comes late."""
        return 0.5 * (len(self.weights) - 1)


_FORMS: Final = (
    _Mean((0.5, 0.5), 1), _Mean((0.25, 0.5, 0.25), 2), _Mean((1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0), 3),
    _Mean((0.5, 0.5)), _Mean((1.0 / 3.0,) * 3), _Mean((0.25,) * 4),
)  # fmt: skip


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Added voltage, V."""
    share, form = sizes
    return share * rows.once(_whole, round(form))


def _whole(rows: Rows, form: int) -> Vector:
    """Where all of the currents is such a mean; none where the periods before are not known."""
    mean, m, r, u = _FORMS[form], rows.machine, rows.rotor, rows.u * rows.middle
    back, turning = len(mean.weights) - 1, m.psi_f * rows.rotor
    flux, i_s = _through(rows, turning, mean) - turning, _before(rows, mean)
    if m.L_d != m.L_q:
        i = i_s.conj()
        flux += 0.5 * (m.L_d - m.L_q) * (_through(rows, r * r * i, mean) - r * r * _through(rows, i, mean))
        if mean.periods:
            flux += 0.5 * (m.L_d - m.L_q) * _of_changes(rows, i * r, mean.periods)
    found = rows.stationary(u - _weighted(u, mean.weights) + np.diff(flux) / rows.T_s)
    if mean.periods:
        T, n = rows.T_s, mean.periods
        driving = u - np.diff(turning) / T - 0.5 * m.R_s * (i_s[1:] + i_s[:-1])
        bend = _earlier(driving, n) - driving
        if rows.u_dc is not None:
            moment = rows.moment_of_pulses * rows.middle
            bend += 12.0 / T**2 * (_earlier(moment, n) - moment)
        found += m.R_s * (T / (12.0 * n) * slope(rows, rows.stationary(bend)) - beyond_ends(rows))
    else:
        beyond = beyond_ends(rows)
        found += m.R_s * (rows.stationary(_weighted(beyond * rows.middle, mean.weights)) - beyond)
    known = np.zeros(len(rows), np.bool_)
    if len(rows) > back:
        known[back:] = np.lib.stride_tricks.sliding_window_view(rows.apart == 1, back + 1).all(axis=1)
    return found * known


def _through(rows: Rows, x: Vector, mean: _Mean) -> Vector:
    """What a mean makes, at samples, of a stationary vector that turns with the rotor between them."""
    if not mean.periods:
        return _weighted(x, mean.weights)
    over_periods = 0.5 * (x[1:] + x[:-1]) * _arc(rows)
    over_periods = np.concatenate((over_periods[:1], over_periods))  # up to each sample
    return _weighted(over_periods, (1.0 / mean.periods,) * mean.periods)


def _of_changes(rows: Rows, i: Vector, periods: int) -> Vector:
    """What `_through` leaves out of both terms of i, conj, rotor frame: on an arc its changes come early, or late; and
    the ripple of the pulses has a first moment, which a vector that turns besides makes a mean.
    """
    early, r = rows.D / 6.0 * 1j * np.diff(i), rows.rotor[1:]
    on, back = -early * rows.middle, early * rows.middle.conj()
    if rows.u_dc is not None:
        on += 2j * rows.D / rows.T_s * rows.stiffness[:-1](rows.moment_of_pulses).conj() * rows.middle
    alike = (1.0 / periods,) * periods
    found: Vector = _weighted(on, alike) - r * r * _weighted(back, alike)
    return np.concatenate((found[:1], found))


def _arc(rows: Rows) -> Array:
    """Mean along the arc that a vector turns by in each period, over the mean of its ends: tan(D/2) / (D/2)."""
    half = 0.5 * rows.D
    return np.divide(np.tan(half), half, out=np.ones_like(half), where=np.abs(half) > 1e-6)


def _weighted(x: Vector, weights: tuple[float, ...]) -> Vector:
    return sum((w * _earlier(x, j) for j, w in enumerate(weights)), np.zeros_like(x))


def _earlier(x: Vector, places: int) -> Vector:
    """What was so many places before; at the start the first one."""
    return x[np.maximum(np.arange(len(x)) - places, 0)]


def _before(rows: Rows, mean: _Mean) -> Vector:
    """Currents (A at samples, stationary) of which measured ones are such a mean: by what has driven them since.

    What drives them depends on themselves where L_d and L_q differ: worked out once more by what was found.
    """

    def by(change: Vector) -> Vector:
        since: Vector = np.concatenate((np.zeros(1, np.complex128), np.cumsum(change)))
        return rows.i_s + since - _weighted(since, mean.weights)

    i_s = by(rows.once(driven))
    if rows.machine.L_d == rows.machine.L_q:
        return i_s
    return by(driven(rows.with_currents(i_s * rows.rotor.conj())))


def driven(rows: Rows) -> Vector:
    """Change of the current (A, stationary) over each period, by the voltage that drives it; none over a gap."""
    i, i_s, rotor, psi, g = rows.i, rows.i_s, rows.rotor, rows.own_flux[0], rows.local_line[0]
    by = rows.u * rows.middle - 0.5 * rows.machine.R_s * (i_s[1:] + i_s[:-1])
    then = (rotor[:-1] * psi[:-1] + rows.T_s * by) * rotor[1:].conj()
    return (rotor[1:] * (i[:-1] + g(then - psi[:-1])) - i_s[:-1]) * (rows.apart == 1)


def beyond_ends(rows: Rows) -> Vector:
    """By how much the mean current (A) of each period is beyond that of its ends, where nothing smooths it."""
    return rows.i_mean - 0.5 * (rows.half * rows.i[1:] + rows.half.conj() * rows.i[:-1])


def misses_more(sizes: Sizes) -> float:
    """All of the currents come through one way: a share that is off one says how unlike the real one this form is."""
    return (sizes[0] - 1.0) ** 2


def slope(rows: Rows, v: Vector) -> Vector:
    """How fast a voltage (V of each period, rotor frame) lets the current change, A/s."""
    m = rows.machine
    return v.real / m.L_d + 1j * v.imag / m.L_q


EFFECT = AddedVoltage(
    "current_averaging", "an averaging of the measured currents",
    (
        Parameter("share", "1", constant(1.0), constant(0.8), constant(1.2)),
        Parameter("form", "1", constant(1.0), constant(0.0), constant(5.0), shape=True, discrete=True),
    ),
    lambda _rows: tuple((float(form),) for form in range(len(_FORMS))),
    "currents that turn behind with speed, and smeared steps",
    ("voltage_delay",),
    adds=voltage,
    smooths=Smoothing(
        lambda _rows, p, v: _weighted(v, _FORMS[round(p[1])].weights),
        lambda rows, p: _before(rows, _FORMS[round(p[1])]),
        lambda p: p[0],
        lambda p: 1 if _FORMS[round(p[1])].periods else len(_FORMS[round(p[1])].weights),
    ),
    told=lambda rows, p: {"lag": (p[0] * _FORMS[round(p[1])].lag * rows.T_s, "s")},
    discrepancy=2e-5,
    misses_more=misses_more,
)
