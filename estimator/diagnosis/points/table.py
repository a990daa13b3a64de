"""Steady points: speed, current and voltage of one steady state a row. Knows nothing of files and effects."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array, Vector

Places = NDArray[np.intp]

FEWEST_POINTS: Final = 12  # points
STEADY: Final = 0.03  # of a quantity's largest, that it may change by from row to row
_JUMPS: Final = 0.1  # of it, that half of the rows change by where every row is an operating point of its own
_AT_REST_SHARE: Final = 0.02  # of the largest speed and current: the drive stands without current
_SIX_STEP: Final = 0.9  # of the six-step voltage: from there on (0.907) a modulator no longer gives what is asked
_PILED, _TOP, _PILE = 0.97, 0.995, 0.1  # of the largest voltage; of the rows
_SAME_LEVEL: Final = 0.02  # of a quantity's largest: one level
_BLOCKS, _A_BLOCK = 20, 6  # stretches of time that are left out one by one; rows each has at least
_LASTING: Final = 7  # stretches over which what is missed may stay alike


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """Steady points, peak dq quantities in the rotor frame."""

    omega_e: Array  # rad/s, electrical
    i: Vector  # A, i_d + j i_q
    u: Vector  # V, u_d + j u_q
    t: Array | None = None  # s, where the rows are a log in time

    def __len__(self) -> int:
        return len(self.omega_e)

    def at(self, places: Places) -> "Points":
        """Some of them."""
        return Points(self.omega_e[places], self.i[places], self.u[places], None if self.t is None else self.t[places])


@dataclass(frozen=True, slots=True, eq=False)
class Kept:
    """Points that are steady states, which rows they were, and what was left out."""

    points: Points
    places: Places
    remarks: tuple[str, ...]


def steady(points: Points) -> Kept:
    """Leave out a stopped drive, the voltage limit and, in a log, what moves from row to row."""
    speed, current, voltage = np.abs(points.omega_e), np.abs(points.i), np.abs(points.u)
    keep = np.ones(len(points), np.bool_)
    remarks: list[str] = []
    stands = (speed <= _AT_REST_SHARE * _most(speed)) & (current <= _AT_REST_SHARE * _most(current))
    if stands.any():
        keep &= ~stands
        remarks.append(f"rows left out where the drive stands without current: {int(stands.sum())}")
    limit = _voltage_limit(voltage[keep])
    if limit is not None and int(np.sum(keep & (voltage <= limit))) >= FEWEST_POINTS:
        beyond = keep & (voltage > limit)
        keep &= ~beyond
        remarks.append(
            f"rows left out at the voltage limit: {int(beyond.sum())}; the voltages pile up below "
            f"{_most(voltage):.3g} V, and above {limit:.3g} V a modulator need not give what it is asked for"
        )
    change = _change_to_next(points)
    if points.t is not None and len(points) and float(np.median(change)) > _JUMPS:
        remarks.append("rows jump from one to the next: each is taken for a steady state of its own")
    elif points.t is not None:
        still = keep & (change <= STEADY)
        # What stands beside a row that is left out has seen some of it
        still[1:-1] &= still[2:] & still[:-2]
        moves = keep & ~still
        keep = still
        if moves.any():
            remarks.append(
                f"rows left out that are no steady state: {int(moves.sum())}; a quantity changes by more than "
                f"{100 * STEADY:.0f} % of its largest from row to row"
            )
    places = np.flatnonzero(keep)
    return Kept(points.at(places), places, tuple(remarks))


def groups_of(points: Points) -> Places:
    """What is left out together: a stretch of time of a log, rows at one operating point of a table."""
    if points.t is not None:
        return _log_stretches(points, _BLOCKS)
    return _combined(_level_numbers(points.omega_e, _most(np.abs(points.omega_e))), kin_of(points))


def kin_of(points: Points) -> Places:
    """Rows at one current, whatever the speed; of a log longer stretches."""
    if points.t is not None:
        return _log_stretches(points, _LASTING)
    most = _most(np.abs(points.i))
    return _combined(_level_numbers(points.i.real, most), _level_numbers(points.i.imag, most))


def speed_groups(level: Places, omega_e: Array) -> Places:
    """Groups of rows where every level has its own speeds: those of one level within 2 % are one."""
    group = np.zeros(len(level), np.intp)
    count = 0
    for one in np.unique(level):
        own = np.flatnonzero(level == one)
        steps = _level_numbers(omega_e[own], _most(np.abs(omega_e[own])))
        group[own] = count + steps
        count += int(steps.max()) + 1
    return group


def _log_stretches(points: Points, most: int) -> Places:
    """Stretches of a log with equally many rows."""
    n = len(points)
    count = max(2, min(most, n // _A_BLOCK))
    return (np.arange(n) * count // max(n, 1)).astype(np.intp)


def _combined(*levels: Places) -> Places:
    """One number for every combination."""
    return np.unique(np.column_stack(levels), axis=0, return_inverse=True)[1].reshape(-1).astype(np.intp)


def _level_numbers(x: Array, scale: float) -> Places:
    """Numbers of levels: sorted values that lie within 2 % of the scale of the first of theirs are one."""
    order = np.argsort(x, kind="stable")
    level = np.zeros(len(x), np.intp)
    at, number = -np.inf, -1
    for k in order:
        if x[k] - at > _SAME_LEVEL * scale:
            at, number = float(x[k]), number + 1
        level[k] = number
    return level


def _voltage_limit(voltage: Array) -> float | None:
    """The voltage from which on the inverter's limit shows, where many rows lie at it."""
    if len(voltage) < 20:
        return None
    top = float(np.quantile(voltage, _TOP))
    piled = float(np.mean(voltage > _PILED * top))
    below = float(np.mean((voltage > (2.0 * _PILED - 1.0) * top) & (voltage <= _PILED * top)))
    spread = len(np.unique(np.round(voltage / top, 3)))
    if piled < _PILE or piled < 3.0 * below or spread < 20 or piled > 0.8:
        return None
    return _SIX_STEP * top


def _change_to_next(points: Points) -> Array:
    """Largest change to a neighbouring row, as a share of each quantity's largest."""
    worst = np.zeros(len(points))
    for quantity, x in ((q, x) for q in (points.omega_e, points.i, points.u) for x in (q.real, q.imag)):
        step = np.abs(np.diff(x)) / _most(np.abs(quantity))
        worst = np.maximum(worst, np.maximum(np.append(0.0, step), np.append(step, 0.0)))
    return worst


def _most(x: Array) -> float:
    return float(np.max(x, initial=1e-12))
