"""Voltage that a bridge's legs lose in one control period, from the currents at its ends.

The equations of `inverter_voltage_error`, period by period, so that a simulation can ask for one.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.kernel import kernel
from estimator.physics.rows import AXES, Real, Rows, Vector

_A, _B, _C = AXES


class Legs(NamedTuple):
    """What the legs do in each period, whatever the currents."""

    u_dc: Real  # V; of no length where it is not known: then each end's current counts for half a period
    duties: Real  # (n, 3)
    edges: Real  # (n, 3): 1 where a leg rises at the period's start, -1 where it falls
    order: NDArray[np.int8]  # (n, 3): the legs as they rise
    ripple: Vector  # (n, 3): A, stationary, when each leg rises
    middle: Vector  # exp(j theta_e) in the middle
    T_s: float  # s


def legs_of(rows: Rows) -> Legs:
    """The legs of a recording's periods."""
    u_dc, middle = rows.u_dc, rows.middle
    if u_dc is None:
        none = np.zeros((0, 3))
        return Legs(np.zeros(0), none, none, none.astype(np.int8), none.astype(np.complex128), middle, rows.T_s)
    L_d, L_q = float(rows.machine.L_d), float(rows.machine.L_q)
    edges = rows.once("edges at start", lambda: _edges_at_start(rows))
    order = rows.once("order", lambda: _orders(rows.duties))
    ripple = rows.once("ripple", lambda: _ripples(u_dc, rows.duties, rows.u * middle, middle, rows.T_s, L_d, L_q))
    return Legs(u_dc, rows.duties, edges, order, ripple, middle, rows.T_s)


def _edges_at_start(rows: Rows) -> Real:
    stays_high = rows.duties >= 1.0
    before = np.concatenate((stays_high[:1], stays_high[:-1]))
    return (stays_high & ~before).astype(float) - (before & ~stays_high)


@kernel
def lost_voltages(legs: Legs, i_s: Vector, dead_time: float, u_drop: float, width: float) -> Vector:
    """Lost voltage (V) of each period, from currents (A) at samples; both in the stationary frame."""
    lost = np.empty(len(legs.middle), np.complex128)
    for k in range(len(lost)):
        lost[k] = lost_voltage(legs, k, i_s[k], i_s[k + 1], dead_time, u_drop, width)
    return lost


@kernel
def lost_voltage(
    legs: Legs, k: int, i_0: complex, i_1: complex, dead_time: float, u_drop: float, width: float
) -> complex:
    """Lost voltage (V) of period k, from the currents (A) at its ends; both in the stationary frame."""
    axes = (_A, _B, _C)
    lost = 0j
    if len(legs.u_dc) == 0:
        for axis in axes:
            start, end = _phase(i_0, axis), _phase(i_1, axis)
            lost += axis * u_drop * 0.5 * (start / _soft(start, width) + end / _soft(end, width))
        return 2.0 / 3.0 * lost
    u_dc = legs.u_dc[k]
    per_time = u_dc / legs.T_s
    for leg in range(3):
        axis = axes[leg]
        start, end = _phase(i_0, axis), _phase(i_1, axis)
        slope = end - start
        volts = 0.0
        if dead_time != 0.0:
            d = legs.duties[k, leg]
            high, low = d * legs.T_s, (1.0 - d) * legs.T_s
            if high > 0.0 and low > 0.0:
                away = slope * _rise(d) + _phase(legs.ripple[k, leg], axis)
                at_rise, at_fall = start + away, end - away
                # A pulse shorter than the dead time is lost whole
                volts += per_time * 0.5 * min(high, dead_time) * (1.0 + at_rise / _soft(at_rise, width))
                volts -= per_time * 0.5 * min(low, dead_time) * (1.0 - at_fall / _soft(at_fall, width))
            edge = legs.edges[k, leg]
            if edge != 0.0:  # a leg that leaves a rail has an edge at the period's start
                volts += per_time * 0.5 * dead_time * (edge + start / _soft(start, width))
        if u_drop != 0.0:
            # Mean of the sign over the period, piece by piece between the edges, from both ends to the middle
            total, early = 0.0, 0.0
            was_up, was_down, soft_was_up, soft_was_down = start, end, _soft(start, width), _soft(end, width)
            for part in range(4):
                late, away = 0.5, 0.0
                if part < 3:
                    other = legs.order[k, part]
                    late, away = _rise(legs.duties[k, other]), _phase(legs.ripple[k, other], axis)
                up, down = start + slope * late + away, end - slope * late - away
                soft_up, soft_down = _soft(up, width), _soft(down, width)
                mean = (was_up + up) / (soft_was_up + soft_up) + (was_down + down) / (soft_was_down + soft_down)
                total += (late - early) * mean
                early, was_up, was_down, soft_was_up, soft_was_down = late, up, down, soft_up, soft_down
            volts += u_drop * total
        lost += axis * volts
    return 2.0 / 3.0 * lost


@kernel
def _phase(i: complex, axis: complex) -> float:
    return i.real * axis.real + i.imag * axis.imag


@kernel
def _soft(i: float, width: float) -> float:
    return math.sqrt(i * i + width * width)


@kernel
def _rise(duty: float) -> float:
    """When a leg rises, as a share of the period; it falls at 1 less that."""
    return 0.5 * (1.0 - duty)


@kernel
def _orders(duties: Real) -> NDArray[np.int8]:
    """Legs in the order in which they rise."""
    order = np.empty(duties.shape, np.int8)
    for k in range(len(duties)):
        a, b, c = 0, 1, 2
        if duties[k, a] < duties[k, b]:
            a, b = b, a
        if duties[k, b] < duties[k, c]:
            b, c = c, b
        if duties[k, a] < duties[k, b]:
            a, b = b, a
        order[k, 0], order[k, 1], order[k, 2] = a, b, c
    return order


@kernel
def _ripples(u_dc: Real, duties: Real, u_s: Vector, middle: Vector, T_s: float, L_d: float, L_q: float) -> Vector:
    """The current's ripple (A, stationary) when each leg rises: the integral of the voltage less its mean."""
    ripple = np.empty(duties.shape, np.complex128)
    for k in range(len(duties)):
        a, b, c = _rise(duties[k, 0]), _rise(duties[k, 1]), _rise(duties[k, 2])
        for leg in range(3):
            when = _rise(duties[k, leg])
            area = -u_s[k] * when
            area += 2.0 / 3.0 * u_dc[k] * (
                _A * max(0.0, when - a) + _B * max(0.0, when - b) + _C * max(0.0, when - c)
            )
            area *= middle[k].conjugate() * T_s
            ripple[k, leg] = complex(area.real / L_d, area.imag / L_q) * middle[k]
    return ripple
