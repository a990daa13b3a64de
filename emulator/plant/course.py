"""The course: winding temperature over time, and the parameters that follow it.

Straight lines between knots. Besides the points that are given there is a knot wherever the temperature passes a
row of the machine's table, so between two knots temperature, R_s, L_d and L_q all move in straight lines. Before
the first knot and after the last they stand still. Two knots at one time are a jump: there the later one counts.
Knows nothing of flux: what a moving inductance does to a current is the machine's matter.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emulator.kernel import kernel
from emulator.plant.machine import TABLE_TEMPERATURES, Machine, at_temperature


class Course(NamedTuple):
    """Knots; a named tuple of arrays because numba reads it."""

    t: NDArray[np.float64]  # s, never falling
    rows: NDArray[np.float64]  # knots x 4: temperature in degC, R_s in ohm, L_d and L_q in H


def course_of(machine: Machine, points: Sequence[tuple[float, float]]) -> Course:
    """The course of a machine through points of time (s) and temperature (degC).

    `machine` is that at 23.4 degC. Raises ValueError outside the machine's table.
    """
    knots = [points[0]]
    for (t_0, from_), (t_1, to) in pairwise(points):
        passed = sorted((T for T in TABLE_TEMPERATURES if min(from_, to) < T < max(from_, to)), reverse=to < from_)
        knots += [(t_0 + (t_1 - t_0) * (T - from_) / (to - from_), T) for T in passed]
        knots.append((t_1, to))
    warm = [at_temperature(machine, temperature) for _, temperature in knots]
    rows = [(temperature, m.R_s, m.L_d, m.L_q) for (_, temperature), m in zip(knots, warm, strict=True)]
    return Course(np.array([t for t, _ in knots]), np.array(rows))


def continued(course: Course, t: float, machine: Machine, temperature: float) -> Course:
    """The course until a time t (s), and from then on a temperature (degC) that stays."""
    past = course.t < t
    until, after = row_at(course, np.nextafter(t, -np.inf)), course_of(machine, [(t, temperature)])
    return Course(
        np.concatenate([course.t[past], [t], after.t]),
        np.concatenate([course.rows[past], [until], after.rows]),
    )


@kernel
def row_at(course: Course, t: float) -> tuple[float, float, float, float]:
    """Temperature (degC), R_s (ohm), L_d and L_q (H) at a time (s)."""
    after = np.searchsorted(course.t, t, side="right")
    if after == 0 or after == len(course.t):
        row = course.rows[max(after - 1, 0)]
        return row[0], row[1], row[2], row[3]
    t_0, t_1 = course.t[after - 1], course.t[after]
    x, y, w = course.rows[after - 1], course.rows[after], (t - t_0) / (t_1 - t_0)
    return (
        x[0] + w * (y[0] - x[0]),
        x[1] + w * (y[1] - x[1]),
        x[2] + w * (y[2] - x[2]),
        x[3] + w * (y[3] - x[3]),
    )


@kernel
def rows_at(course: Course, t: NDArray[np.float64]) -> NDArray[np.float64]:
    """`row_at` for many times: n x 4."""
    rows = np.empty((len(t), 4))
    for n in range(len(t)):
        rows[n, 0], rows[n, 1], rows[n, 2], rows[n, 3] = row_at(course, t[n])
    return rows


@kernel
def machine_at(machine: Machine, course: Course, t: float) -> Machine:
    """The machine as it is at a time (s)."""
    _, R_s, L_d, L_q = row_at(course, t)
    return Machine(R_s, L_d, L_q, machine.psi_f, machine.n_p, machine.i_rated, machine.J, machine.B)
