"""Voltage that a bridge's legs lose in one control period, from the currents at its ends.

The equations of `inverter_voltage_error`, period by period, so that a simulation can ask for one.
"""

import math
from typing import NamedTuple

import numpy as np

from estimator.kernel import kernel
from estimator.physics.rows import AXES, Real, Rows, Vector

_A, _B, _C = AXES


class Legs(NamedTuple):
    """What the legs do in each period, whatever the currents."""

    u_dc: Real  # V; of no length where it is not known: then each end's current counts for half a period
    duties: Real  # (n, 3)
    edges: Real  # (n, 3): 1 where a leg rises at the period's start, -1 where it falls
    u_s: Vector  # V, stationary
    middle: Vector  # exp(j theta_e) in the middle
    T_s: float  # s
    L_d: float  # H
    L_q: float  # H


def legs_of(rows: Rows) -> Legs:
    """The legs of a recording's periods."""
    m, middle = rows.machine, rows.middle
    known = rows.u_dc is not None
    none = np.zeros((0, 3))
    edges = rows.once("edges at start", lambda: _edges_at_start(rows)) if known else none
    return Legs(
        np.zeros(0) if rows.u_dc is None else rows.u_dc, rows.duties if known else none, edges,
        rows.u * middle, middle, rows.T_s, float(m.L_d), float(m.L_q),
    )  # fmt: skip


def _edges_at_start(rows: Rows) -> Real:
    stays_high = rows.duties >= 1.0
    before = np.concatenate((stays_high[:1], stays_high[:-1]))
    return (stays_high & ~before).astype(float) - (before & ~stays_high)


@kernel
def lost_voltages(legs: Legs, i_s: Vector, dead_time: float, u_drop: float, width: float) -> Vector:
    """Lost voltage (V) of each period, from currents (A) at samples; both in the stationary frame."""
    lost = np.empty(len(legs.u_s), np.complex128)
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
    d_a, d_b, d_c = legs.duties[k, 0], legs.duties[k, 1], legs.duties[k, 2]
    rises = (0.5 * (1.0 - d_a), 0.5 * (1.0 - d_b), 0.5 * (1.0 - d_c))  # share of the period; falls at 1 less that
    ripple = (_ripple(legs, k, rises, 0), _ripple(legs, k, rises, 1), _ripple(legs, k, rises, 2))
    first, second, third = _order(rises)
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
                away = slope * rises[leg] + _phase(ripple[leg], axis)
                at_rise, at_fall = start + away, end - away
                # A pulse shorter than the dead time is lost whole
                volts += per_time * 0.5 * min(high, dead_time) * (1.0 + at_rise / _soft(at_rise, width))
                volts -= per_time * 0.5 * min(low, dead_time) * (1.0 - at_fall / _soft(at_fall, width))
            edge = legs.edges[k, leg]
            if edge != 0.0:  # a leg that leaves a rail has an edge at the period's start
                volts += per_time * 0.5 * dead_time * (edge + start / _soft(start, width))
        if u_drop != 0.0:
            # Mean of the sign over the period, piece by piece between the edges, from both ends to the middle
            total, early, was_up, was_down = 0.0, 0.0, start, end
            for part in range(4):
                late, away = 0.5, 0.0
                if part < 3:
                    other = first if part == 0 else second if part == 1 else third
                    late, away = rises[other], _phase(ripple[other], axis)
                up, down = start + slope * late + away, end - slope * late - away
                mean = (was_up + up) / (_soft(was_up, width) + _soft(up, width))
                mean += (was_down + down) / (_soft(was_down, width) + _soft(down, width))
                total += (late - early) * mean
                early, was_up, was_down = late, up, down
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
def _order(rises: tuple[float, float, float]) -> tuple[int, int, int]:
    """Legs in the order in which they rise."""
    a, b, c = 0, 1, 2
    if rises[a] > rises[b]:
        a, b = b, a
    if rises[b] > rises[c]:
        b, c = c, b
    if rises[a] > rises[b]:
        a, b = b, a
    return a, b, c


@kernel
def _ripple(legs: Legs, k: int, rises: tuple[float, float, float], leg: int) -> complex:
    """The current's ripple (A, stationary) when a leg rises: the integral of the voltage less its mean."""
    when = rises[leg]
    area = -legs.u_s[k] * when
    area += 2.0 / 3.0 * legs.u_dc[k] * (
        _A * max(0.0, when - rises[0]) + _B * max(0.0, when - rises[1]) + _C * max(0.0, when - rises[2])
    )
    area *= legs.middle[k].conjugate() * legs.T_s
    return complex(area.real / legs.L_d, area.imag / legs.L_q) * legs.middle[k]
