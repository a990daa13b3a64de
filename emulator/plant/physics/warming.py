"""Warming: winding and magnets follow temperatures from outside, whatever the losses.

    R_s(t) = R_s0 (1 + winding(t))        psi_f(t) = psi_f0 (1 + magnets(t))

Points of time and share, straight lines between them; before the first and after the last the share stands still. A
neighbour's heat, a cooling circuit, an oven, a load of hours that a recording sees a part of. Copper gains 0.39 % of
its resistance per kelvin, NdFeB loses 0.11 % of its flux: J. R. Hendershot, T. J. E. Miller, "Design of Brushless
Permanent-Magnet Machines", 2010, chapter 15.

Shows as R_s and psi_f that move with time alone; a winding that its own losses warm moves as these do.
"""

from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from emulator.bounds import Bound, Points, PointsBound
from emulator.kernel import kernel

_TIME = Bound("s", low=0.0)


class Warming(NamedTuple):
    """Sizes; none where there are no points."""

    winding: Annotated[Points, PointsBound(_TIME, Bound(low=-0.5, high=2.0))] = ()  # R_s over R_s0, less 1
    magnets: Annotated[Points, PointsBound(_TIME, Bound(low=-0.5, high=0.5))] = ()  # psi_f over psi_f0, less 1


class Courses(NamedTuple):
    """The same as arrays, points x 2, for numba compiles tuples anew for each number of points."""

    winding: NDArray[np.float64]
    magnets: NDArray[np.float64]


def courses_of(warming: Warming) -> Courses:
    """As numba reads them."""
    return Courses(*(np.array(points, np.float64).reshape(-1, 2) for points in warming))


def factors_at(course: NDArray[np.float64], t: NDArray[np.floating[Any]]) -> NDArray[np.float64] | float:
    """A parameter over that without warming, at times (s)."""
    return np.asarray(1.0 + np.interp(t, course[:, 0], course[:, 1]), np.float64) if len(course) else 1.0


@kernel
def factor_at(course: NDArray[np.float64], t: float) -> float:
    """A parameter over that without warming, at a time (s)."""
    after = np.searchsorted(course[:, 0], t, side="right")
    if after == 0 or after == len(course):
        return 1.0 + course[max(after - 1, 0), 1]
    t_0, x = course[after - 1]
    t_1, y = course[after]
    return 1.0 + x + (y - x) * (t - t_0) / (t_1 - t_0)
