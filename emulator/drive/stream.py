"""The stream: rows that cover several control periods each, so formed that nothing is lost for an estimator.

A row of N periods from tick k on holds the angle and the current sampled at k, the mean of the applied
voltage (each period in the rotor frame at its middle), and the mean current by the trapezoidal rule over the
samples k to k + N. The flux balance summed over the row then holds as exactly as one of N single periods.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from emulator.kernel import kernel

COLUMNS: Final = ("theta_e", "i_d", "i_q", "omega_e", "u_d", "u_q", "i_d_mean", "i_q_mean", "u_dc")


class Period(NamedTuple):
    """What the drive knows of one control period when it has taken the next sample."""

    theta_e: float  # rad, at its start
    turn: float  # rad, from its start to its end
    i: complex  # A, rotor frame, sampled at its start
    i_end: complex  # A, rotor frame at its end, sampled there
    u: complex  # V, applied, in the rotor frame at its middle
    u_dc: float  # V


class Row(NamedTuple):
    """A row under way: sums over the periods it has."""

    periods: int  # that it will cover
    taken: int  # that it has
    tick: int  # at its start
    theta_e: float  # rad, at its start
    i: complex  # A, at its start
    turn: float  # rad
    u_sum: complex  # V
    i_sum: complex  # A
    u_dc_sum: float  # V


NO_ROW: Final = Row(0, 0, 0, 0.0, 0j, 0.0, 0j, 0j, 0.0)


@kernel
def extended(row: Row, tick: int, period: Period, stream_periods: int) -> Row:
    """The row with one period more; where the row was complete, a new one of `stream_periods`."""
    i_mean = 0.5 * (period.i + period.i_end)
    if row.taken == row.periods:
        return Row(stream_periods, 1, tick, period.theta_e, period.i, period.turn, period.u, i_mean, period.u_dc)
    return Row(
        row.periods,
        row.taken + 1,
        row.tick,
        row.theta_e,
        row.i,
        row.turn + period.turn,
        row.u_sum + period.u,
        row.i_sum + i_mean,
        row.u_dc_sum + period.u_dc,
    )


@kernel
def write_row(row: Row, T_s: float, ticks: NDArray[np.int64], rows: NDArray[np.float64], n: int) -> None:
    """Write a complete row to line n of `ticks` (m) and `rows` (m x len(COLUMNS))."""
    N = row.periods
    ticks[n] = row.tick
    line = rows[n]
    line[0] = row.theta_e
    line[1], line[2] = row.i.real, row.i.imag
    line[3] = row.turn / (N * T_s)
    line[4], line[5] = row.u_sum.real / N, row.u_sum.imag / N
    line[6], line[7] = row.i_sum.real / N, row.i_sum.imag / N
    line[8] = row.u_dc_sum / N
