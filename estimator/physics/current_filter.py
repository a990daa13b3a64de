"""Currents behind a low-pass filter of first order: an RC before the converter, a filter in firmware.

    tau d(i_measured)/dt = i - i_measured        each phase's, so of the vector in the stationary frame

Filtered voltage and filtered current obey the machine's equation as these do themselves, but for the flux that turns
with the rotor, m = psi_f exp(j theta) + (L_d - L_q)/2 exp(2j theta) conj(i). With F the filter, recorded voltages and
what measured currents imply of them differ by

    u - F u + change over the period of (F m(i) - m(F i))

A filtered current is bent within a period, by which the resistance sees R_s T (coth(T/2 tau)/2 - tau/T) d(i)/dt of
that less. A mean that reaches back by tau looks alike at slow changes; they part where currents step. Derived here.
"""

import math

import numpy as np

from estimator.arrays import Array, Bools, Vector
from estimator.kernel import kernel
from estimator.physics.current_averaging import beyond_ends, driven, misses_more, slope
from estimator.physics.effect import AddedVoltage, Parameter, Sizes, Smoothing, constant, periods
from estimator.physics.rows import Rows
from estimator.physics.vectors import AXES


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Added voltage, V."""
    share, tau = sizes
    return share * rows.latest(_whole, float(tau))


def _whole(rows: Rows, tau: float) -> Vector:
    """Where all of the currents comes through the filter; none over a gap."""
    m, r, T = rows.machine, rows.rotor, rows.T_s
    begins, decay = np.concatenate(([True], rows.apart[:-1] != 1)), math.exp(-T / tau)
    lags: Vector = np.asarray(1.0 + 1j * rows.omega_e * tau, np.complex128)
    u, turning = rows.u * rows.middle, m.psi_f * rows.rotor
    pulses = _of_pulses(rows, tau)
    left = u - _steps_through(u, rows.half.conj() / lags, pulses / tau, begins, decay, tau / T)
    flux = _lines_through(turning, rows.half, lags, begins, decay, tau / T) - turning
    before = _before(rows, tau)
    if m.L_d != m.L_q:
        i = before.conj()
        flux += 0.5 * (m.L_d - m.L_q) * (
            _lines_through(r * r * i, rows.half, lags, begins, decay, tau / T)
            - r * r * _lines_through(i, rows.half.conj(), lags.conj(), begins, decay, tau / T)
        )
    found = rows.stationary((left + np.diff(flux) / T) * (rows.apart == 1))
    held = before - rows.i_s
    drives = found - 0.5 * m.R_s * rows.stationary(held[1:] + held[:-1])
    bend = (0.5 / math.tanh(0.5 * T / tau) - tau / T) * T * slope(rows, drives)
    new = math.exp(-0.5 * T / tau) * T / tau * beyond_ends(rows) + slope(rows, rows.stationary(pulses))
    return found - m.R_s * (bend + rows.stationary(_left_of(new * rows.middle, begins, decay, tau / T)))


def _through(rows: Rows, sizes: Sizes, v: Vector) -> Vector:
    """What the filter makes of a voltage (V of each period, stationary) that turns with the rotor."""
    tau = float(sizes[1])
    begins, decay = np.concatenate(([True], rows.apart[:-1] != 1)), math.exp(-rows.T_s / tau)
    settled: Vector = np.asarray(rows.half.conj() / (1.0 + 1j * rows.omega_e * tau), np.complex128)
    return _steps_through(v, settled, np.zeros_like(v), begins, decay, tau / rows.T_s)


def _before(rows: Rows, tau: float) -> Vector:
    """Currents (A at samples, stationary) before the filter: by what has driven them since."""
    begins, decay = np.concatenate(([True], rows.apart != 1)), math.exp(-rows.T_s / tau)
    return rows.i_s + _high_pass(rows.once(driven), begins, decay, tau / rows.T_s)


@kernel
def _high_pass(change: Vector, begins: Bools, decay: float, lag: float) -> Vector:
    """What a filter holds back, at samples, of a vector that changes by so much on straight lines."""
    found = np.empty(len(change) + 1, np.complex128)
    found[0] = lag * change[0]
    for k in range(len(change)):
        at = lag * change[k] if begins[k] else found[k]
        found[k + 1] = decay * at + (1.0 - decay) * lag * change[k]
    return found


def _of_pulses(rows: Rows, tau: float) -> Vector:
    """What a filter sees (Vs, stationary) at the end of a period of its pulses beside their mean."""
    if rows.u_dc is None:
        return np.zeros(len(rows), np.complex128)
    return tau * rows.u_dc * 2.0 / 3.0 * _pulses_through(rows.duties, 0.5 * rows.T_s / tau, np.array(AXES))


@kernel
def _pulses_through(duties: Array, half: float, axes: Vector) -> Vector:
    """Of legs that are high around the middle of a period of 2 `half` time constants, each along its axis."""
    found = np.empty(len(duties), np.complex128)
    through, end = -math.expm1(-2.0 * half), math.exp(-half)
    for k in range(len(duties)):
        whole = 0j
        for leg in range(3):
            on = math.exp(half * duties[k, leg])
            whole += (duties[k, leg] * through - end * (on - 1.0 / on)) * axes[leg]
        found[k] = whole
    return found


@kernel
def _steps_through(u: Vector, settled: Vector, less: Vector, begins: Bools, decay: float, lag: float) -> Vector:
    """Means over periods of what a filter makes of values that stand for a period each."""
    found = np.empty_like(u)
    state = 0j
    for k in range(len(u)):
        if begins[k]:
            state = u[k] * settled[k]
        after = decay * state + (1.0 - decay) * u[k] - less[k]
        found[k] = u[k] - lag * (after - state)
        state = after
    return found


@kernel
def _left_of(new: Vector, begins: Bools, decay: float, lag: float) -> Vector:
    """What is new at the end of each period, and decays, takes from its mean less that of its ends."""
    found = np.empty_like(new)
    state = 0j
    for k in range(len(new)):
        if begins[k]:
            state = new[k] / (1.0 - decay)
        after = decay * state + new[k]
        found[k] = (lag + 0.5) * after - (lag - 0.5) * state
        state = after
    return found


@kernel
def _lines_through(x: Vector, half: Vector, lags: Vector, begins: Bools, decay: float, lag: float) -> Vector:
    """What a filter makes, at samples, of a vector that turns with the rotor, and changes on straight lines there."""
    found = np.empty_like(x)
    found[0] = x[0] / lags[0]
    for k in range(len(half)):
        turn = half[k] * half[k]
        along = lag / lags[k] * (x[k + 1] * turn.conjugate() - x[k])
        if begins[k]:
            found[k] = (x[k] - along) / lags[k]
        found[k + 1] = decay * (found[k] - (x[k] - along) / lags[k]) + (x[k + 1] - along * turn) / lags[k]
    return found


EFFECT = AddedVoltage(
    "current_filter", "a low-pass filter of the measured currents",
    (
        Parameter("share", "1", constant(1.0), constant(0.8), constant(1.2)),
        Parameter("tau", "s", periods(1.0), periods(0.05), periods(20.0), shape=True),
    ),
    lambda rows: tuple((times * rows.T_s,) for times in (0.05, 0.2, 0.6, 1.5, 4.0)),
    "currents that turn behind with speed, and steps that come late",
    ("current_averaging", "voltage_delay"),
    adds=voltage,
    smooths=Smoothing(_through, lambda rows, p: _before(rows, float(p[1])), lambda p: p[0]),
    told=lambda _rows, p: {"tau": (p[0] * p[1], "s")},
    other_form_of="current_averaging",
    discrepancy=3e-5,
    misses_more=misses_more,
)
