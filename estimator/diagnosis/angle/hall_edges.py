"""Hall edges: an angle that a drive makes of six edges an electrical turn and their times, and its course through them.

At an edge such an angle is what the edge should be at; then it goes on by a rate that the drive knows from edges
before. It jumps at edges that are not where they should be, and where the speed has changed. When an edge came, the
angle itself tells: it is extrapolated back to the edge. The smoothest course through these times has no jumps, and is
right but for where the edges are. Knows nothing of effects.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array, Vector
from estimator.kernel import kernel
from estimator.physics.hall_displacement import SECTOR, course_between
from estimator.samples import Edges, Samples, nearest_turns

_JUMPS: Final = 8.0  # times what movements usually change by from period to period, and
_LEAST: Final = 1e-3  # rad
_FEWEST: Final = 24  # jumps, and
_OFTEN: Final = 0.1  # of the edges that the rotor passes, and
_ALL: Final = 1.1
_TOGETHER: Final = 0.6  # resultant of where they are, modulo 60 deg; 1: all at one place
_EARLIEST: Final = 0.02  # quantile of where angles are just behind an edge
_ON_EDGE: Final = 3e-4  # rad: what angles are rounded to
_SAME_PERIOD: Final = 0.01  # of a control period, by which rows that follow each other may be off it
_PAUSE: Final = 10.5  # periods, over which nobody follows a rotor
_KNOTS: Final = 4  # of a course
_HALF_TURN: Final = 3  # sectors
_EVENLY: Final = 0.35  # log, by which the speed changes in it
_AGREE: Final = 4.0  # times what parabolas usually differ by half way between edges, and
_AGREED: Final = 0.003  # rad
_HALF_OF: Final = 0.5  # by which two parabolas differ, a rotor may be off the course that is of both
_SHORTEST: Final = 20  # rows of a stretch
_MOST_MOVES: Final = 0.9  # of a raw angle, that are such steps
_SAME: Final = 0.02  # of a sector, by which the steps of a raw one may be off
_NEAR: Final = 0.02  # rad, from where edges usually are
_REMARK: Final = (
    "theta_e is made of six edges an electrical turn, as Hall sensors give, and of their times: the course through "
    "them is used"
)


class ThroughEdges(NamedTuple):
    """Runs by the course through edges, and what is to be said of it."""

    runs: tuple[Samples, ...]
    remarks: tuple[str, ...]


def through_edges(runs: Sequence[Samples]) -> ThroughEdges:
    """The runs with an angle that goes smoothly through the edges of Hall sensors, where it is made of such.

    Currents and voltages are turned back by what they were turned by. Rows are left out where edges do not tell a
    course: before the first two and after the last two of a run, and where a rotor dwells between two.
    """
    if not runs or any(run.periods != 1 for run in runs):
        return ThroughEdges(tuple(runs), ())
    T = runs[0].T_s
    t = np.concatenate([run.t0 + run.T_s * np.arange(len(run), dtype=np.float64) for run in runs]).astype(np.float64)
    omega, theta = (np.concatenate([getattr(run, name) for run in runs]) for name in ("omega_e", "theta_e"))
    apart = np.diff(t)
    D = nearest_turns(np.diff(theta), apart * 0.5 * (omega[1:] + omega[:-1]))
    theta = theta[0] + np.concatenate(([0.0], np.cumsum(D)))
    place = place_of(theta, D, np.abs(apart / T - 1.0) < _SAME_PERIOD)
    if place is None:
        return ThroughEdges(tuple(runs), ())
    off, known, apart_by = np.zeros(len(t)), np.zeros(len(t), np.bool_), list[Array]()
    seams = (np.flatnonzero(apart > _PAUSE * T) + 1).tolist()
    for part in (slice(*ends) for ends in pairwise([0, *seams, len(t)])):
        times, edges = _edges(t[part], theta[part], place)
        if len(times) >= _KNOTS:
            off[part] = theta[part] - _smooth(t[part], theta[part], times, edges)
            known[part], rough = _known(t[part], times, edges)
            apart_by += rough
    error = _HALF_OF * math.sqrt(float(np.mean(np.concatenate(apart_by) ** 2))) if apart_by else 0.0
    ends = np.cumsum([0, *map(len, runs)]).tolist()
    found = [
        one for run, (begin, end) in zip(runs, pairwise(ends), strict=True)
        for one in _turned_back(run, theta[begin:end], off[begin:end], known[begin:end], Edges(place, error))
    ]
    return ThroughEdges(tuple(found), (_REMARK,))


def _known(t: Array, times: Array, edges: Array) -> tuple[NDArray[np.bool_], list[Array]]:
    """Where a course is sure: the rotor neither turns round nor changes its speed by much within half a turn, which
    displacements leave as it is; and parabolas through the edges before and behind agree, as far as those let them.

    And by how much these differ half way between edges (rad), but for what they do between two edges in the middle:
    that is what displacements make of it.
    """
    h = np.diff(times)
    way, half = np.sign(np.diff(edges)), np.log(h)
    even = np.ones(len(h), np.bool_)
    for ahead in range(1, _HALF_TURN + 1):
        onwards = way[ahead:] == way[:-ahead]
        if ahead == _HALF_TURN:
            onwards &= np.abs(half[ahead:] - half[:-ahead]) < _EVENLY
        even[ahead:] &= onwards
        even[:-ahead] &= onwards
    bend = np.diff(np.diff(edges) / h) / (h[1:] + h[:-1])
    apart: Array = 0.25 * np.diff(bend) * h[1:-1] ** 2
    agreed = _AGREE * float(np.median(np.abs(apart))) + _AGREED
    sure = even & np.concatenate(([False], np.abs(apart) < agreed, [False]))
    which = np.rint((edges[1:-2] - edges[0]) / SECTOR).astype(np.intp) % _HALF_TURN
    sector = np.searchsorted(times, t, side="right") - 1
    inside = (sector >= 0) & (sector < len(sure))
    alike = [apart[sure[1:-1] & (which == one) & (way[1:-1] == turns)] for one in np.unique(which) for turns in (1, -1)]
    rough = [some - np.median(some) for some in alike if len(some) >= _KNOTS]
    return inside & sure[np.clip(sector, 0, len(sure) - 1)], rough


def _turned_back(run: Samples, theta: Array, off: Array, known: NDArray[np.bool_], edges: Edges) -> list[Samples]:
    """Stretches whose course is known."""
    middle = 0.5 * (off + np.append(off[1:], off[-1:]))
    i: Vector = (run.i_d + 1j * run.i_q) * np.exp(1j * off)
    u: Vector = (run.u_d + 1j * run.u_q) * np.exp(1j * middle)
    smooth = replace(
        run, theta_e=theta - off, i_d=i.real.copy(), i_q=i.imag.copy(), u_d=u.real.copy(), u_q=u.imag.copy(),
        resolution=run.resolution._replace(theta_e=0.0, encoder=0.0), edges=edges,
    )  # fmt: skip
    turns = np.flatnonzero(np.diff(np.concatenate(([False], known, [False])).astype(int))).tolist()
    stretches = list(zip(turns[::2], turns[1::2], strict=True))
    return [smooth[begin:end] for begin, end in stretches if end - begin > _SHORTEST]


def steps_of_sectors(moves: Array) -> bool:
    """Whether an angle (its movements, rad) stands, but for steps of 60 deg, as that of Hall sensors as it is does."""
    size = np.abs(moves[np.abs(moves) > _LEAST])
    return len(size) >= _FEWEST and bool(np.mean(np.abs(size - SECTOR) < _SAME * SECTOR) > _MOST_MOVES)


class _Jumps(NamedTuple):
    """Periods, behind even ones, in which an angle jumps to an edge, or begins to wait at one."""

    behind: Array  # rad, after it
    way: Array  # rad, that a period usually turns there


def place_of(theta: Array, D: Array, joined: NDArray[np.bool_]) -> float | None:
    """Where (rad, modulo 60 deg) the edges are, at which an angle jumps; None where it does not."""
    jumps = _jumps(theta, D, joined)
    edges = float(np.sum(np.abs(D))) / SECTOR
    if jumps is None or not max(_FEWEST, _OFTEN * edges) <= len(jumps.way) <= _ALL * edges:
        return None
    where = np.exp(6j * (jumps.behind - 0.5 * jumps.way))
    mean = complex(np.mean(where))
    if abs(mean) < _TOGETHER:
        return None
    about = float(np.angle(mean)) / 6.0
    sign = 1.0 if np.mean(jumps.way > 0.0) > 0.5 else -1.0
    there = sign * jumps.way > 0.0
    behind = sign * (np.angle(np.exp(6j * (jumps.behind[there] - about))) / 6.0)
    found = about + sign * float(np.quantile(behind, _EARLIEST))
    usual = 0.5 * SECTOR * round(found / (0.5 * SECTOR))
    return (usual if abs(found - usual) < _NEAR else found) % SECTOR


def _jumps(theta: Array, D: Array, joined: NDArray[np.bool_]) -> _Jumps | None:
    if len(D) < _FEWEST:
        return None
    change = np.where(joined[1:] & joined[:-1], np.abs(np.diff(D)), np.inf)
    least = max(_JUMPS * float(np.median(change)), _LEAST)
    moves = np.abs(D[1:-1]) > _LEAST
    there = np.flatnonzero(moves & (change[1:] > least) & (change[1:] < np.inf) & (change[:-1] <= least)) + 2
    return _Jumps(theta[there + 1], D[there - 1])


@kernel
def _edges(t: Array, theta: Array, place: float) -> tuple[Array, Array]:
    """Times (s) at which edges came, and what the angle was told to be there (rad)."""
    n = len(t)
    times, edges, count = np.empty(n), np.empty(n), 0
    sector = np.empty(n)
    for k in range(n):
        inside = (theta[k] - place) / SECTOR
        sector[k] = np.floor(inside)
        if k > 0 and abs(inside - np.rint(inside)) * SECTOR < _ON_EDGE:
            sector[k] = sector[k - 1]  # it waits for the edge, or has just passed it
    rate, k = 0.0, 1
    while k < n:
        if sector[k] == sector[k - 1]:
            k += 1
            continue
        forwards = sector[k] > sector[k - 1]
        edge = place + SECTOR * (sector[k] if forwards else sector[k] + 1.0)
        last = k
        while last + 1 < n and sector[last + 1] == sector[k] and abs(theta[last + 1] - edge) < SECTOR - _ON_EDGE:
            last += 1
        if last > k:
            rate = (theta[last] - theta[k]) / (t[last] - t[k])
        if rate != 0.0 and (rate > 0.0) == forwards:
            ago = (theta[k] - edge) / rate
            came = t[k] - min(max(ago, 0.0), t[k] - t[k - 1])
            if count == 0 or came > times[count - 1]:
                times[count], edges[count] = came, edge
                count += 1
        k += 1
    return times[:count], edges[:count]


@kernel
def _smooth(t: Array, theta: Array, times: Array, edges: Array) -> Array:
    course, j, m = theta.copy(), 1, len(times)
    for k in range(len(t)):
        if t[k] < times[1] or t[k] >= times[m - 2]:
            continue
        while t[k] >= times[j + 1]:
            j += 1
        y = (edges[j - 1], edges[j], edges[j + 1], edges[j + 2])
        course[k] = course_between(t[k], times[j - 1], times[j], times[j + 1], times[j + 2], y)
    return course
