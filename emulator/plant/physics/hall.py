"""Digital Hall sensors: the angle of a drive that knows six edges an electrical turn, and their times.

    edge s is at  place + 60 deg s + displaced_x     x = a, c, b, a, c, b     half a hysteresis later, either way

Each of three sensors switches twice a turn, half a turn apart, so that one that is displaced moves two edges. At an
edge the drive's angle is what the edge should be at. Between edges it goes on by a rate, no further than the next edge:
that of the last turn, which displacements leave right, or that of the last sector. Or it does not go on: the middle of
the sector stands until the next edge. Plain geometry; derived here.

Edges are timed by a timer, exactly; the rotor turns evenly within a control period.
"""

import math
from typing import Annotated, Final, NamedTuple

from emulator.bounds import Bound
from emulator.frames import nearest, wrapped
from emulator.kernel import kernel

NO_HALL: Final = 0
MIDDLE: Final = 1
BY_TURN: Final = 2
BY_SECTOR: Final = 3
_SECTOR: Final = math.pi / 3.0
_SECTORS: Final = 6
_DISPLACED: Final = Bound("rad", low=-0.3, high=0.3)


class Hall(NamedTuple):
    """Sizes; electrical angles."""

    rate: Annotated[int, Bound(low=NO_HALL, high=BY_SECTOR)] = NO_HALL  # none: there are no such sensors; 1: middles
    displaced_a: Annotated[float, _DISPLACED] = 0.0
    displaced_b: Annotated[float, _DISPLACED] = 0.0
    displaced_c: Annotated[float, _DISPLACED] = 0.0
    hysteresis: Annotated[float, Bound("rad", low=0.0, high=0.2)] = 0.0
    place: Annotated[float, Bound("rad", low=-1.0, high=1.0)] = 0.0
    raw: Annotated[int, Bound(low=0, high=1)] = 0  # 1: recordings have middles, whatever the drive turns by


Times = tuple[float, float, float, float, float, float]


class Edges(NamedTuple):
    """What a drive knows of its sensors at a sample."""

    theta: float  # rad, electrical, where the rotor is; not known to the drive
    sector: int  # between this edge and the next, counted on
    way: int  # 1 or -1, in which it was entered; 0 where no edge has come yet
    since: float  # s, after its edge
    times: Times  # s, of sectors before, the latest first
    whole: int  # of these, that are known


NO_EDGES: Final = Edges(0.0, 0, 0, 0.0, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0)


@kernel
def _displaced(hall: Hall, sector: int) -> float:
    n = sector % 3
    return hall.displaced_a if n == 0 else hall.displaced_c if n == 1 else hall.displaced_b


@kernel
def _nominal(hall: Hall, sector: int) -> float:
    """Where an edge should be (rad)."""
    return hall.place + sector * _SECTOR


@kernel
def _edge(hall: Hall, sector: int) -> float:
    return _nominal(hall, sector) + _displaced(hall, sector)


@kernel
def first_edges(hall: Hall, theta: float, omega: float) -> Edges:
    """Of a rotor at an electrical angle (rad) that has turned by omega (rad/s) all the time."""
    if hall.rate == NO_HALL:
        return NO_EDGES
    late = 0.5 * hall.hysteresis * (1.0 if omega >= 0.0 else -1.0)
    sector = math.floor((theta - hall.place) / _SECTOR) + 1
    while _edge(hall, sector) + late > theta:
        sector -= 1
    if omega == 0.0:
        return Edges(theta, sector, 0, 0.0, NO_EDGES.times, 0)
    way = 1 if omega > 0.0 else -1
    last = sector if way > 0 else sector + 1
    apart = [(_edge(hall, last - way * n) - _edge(hall, last - way * (n + 1))) / omega for n in range(_SECTORS)]
    times = (apart[0], apart[1], apart[2], apart[3], apart[4], apart[5])
    return Edges(theta, sector, way, (theta - _edge(hall, last) - late) / omega, times, _SECTORS)


@kernel
def edges_after(hall: Hall, turned: float, T: float, before: Edges) -> Edges:
    """A sample T (s) after one, of a rotor that has turned evenly since (rad, electrical)."""
    if hall.rate == NO_HALL:
        return before
    theta, sector, way, since, times, whole = before
    theta += turned
    late, since = 0.5 * hall.hysteresis, since + T
    while turned != 0.0:
        if theta >= _edge(hall, sector + 1) + late:
            now, edge = 1, _edge(hall, sector + 1) + late
        elif theta < _edge(hall, sector) - late:
            now, edge = -1, _edge(hall, sector) - late
        else:
            break
        ago = min(max((theta - edge) / turned, 0.0), 1.0) * T
        if now == way:
            times = (since - ago, times[0], times[1], times[2], times[3], times[4])
            whole = min(whole + 1, _SECTORS)
        else:
            whole = 0
        sector, way, since = sector + now, now, ago
    return Edges(theta, sector, way, since, times, whole)


@kernel
def middle(hall: Hall, edges: Edges) -> float:
    """Of the sector (rad, electrical)."""
    return _nominal(hall, edges.sector) + 0.5 * _SECTOR


@kernel
def told_angle(hall: Hall, edges: Edges, theta_e: float) -> float:
    """What a recording has in place of the drive's angle (rad, electrical)."""
    if hall.rate == NO_HALL or hall.raw == 0:
        return theta_e
    return wrapped(middle(hall, edges))


@kernel
def hall_angle(hall: Hall, edges: Edges) -> float:
    """What a drive makes of it (rad, electrical)."""
    if hall.rate == MIDDLE or edges.way == 0:
        return middle(hall, edges)
    rate = 0.0
    if edges.whole > 0:
        rate = _SECTOR / max(edges.times[0], 1e-9)
        if hall.rate == BY_TURN and edges.whole == _SECTORS:
            turn = 0.0
            for n in range(_SECTORS):
                turn += edges.times[n]
            rate = _SECTORS * _SECTOR / max(turn, 1e-9)
    gone = min(rate * edges.since, _SECTOR)
    return _nominal(hall, edges.sector) + gone if edges.way > 0 else _nominal(hall, edges.sector + 1) - gone


@kernel
def hall_read(hall: Hall, n_p: int, theta_m: float, edges: Edges) -> float:
    """The same as a mechanical angle (rad) near to where the rotor is."""
    return theta_m + nearest(hall_angle(hall, edges) - n_p * theta_m) / n_p
