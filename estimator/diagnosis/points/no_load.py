"""Steady points without load, of which the current i_q is not known: y = u_q - R i_q at levels of i_d.

    y = omega_e psi_d(i_d) + u_0 + V i_q / |i|        |i| = sqrt(i_d^2 + i_q^2)

psi_d of every level is free, so that saturation is no matter. u_0 = (R_s - R) i_q is what a wrong R leaves. The
inverter loses V along the current: all of it on the q axis where i_d is zero, next to nothing where i_d is much larger
than the little i_q that friction takes. i_q is taken as one value, which the fit finds with V. What else could leave a
voltage that does not go with speed: an offset of the angle, offset R_s i_d; a resistance that rises with frequency, or
another loss, rise (omega_e / omega_max)^2.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from estimator.arrays import Array
from estimator.diagnosis.points.model import VOLTAGE_ERROR
from estimator.diagnosis.points.problem import MACHINE, PointSizes, Problem, Size
from estimator.diagnosis.points.table import Places, speed_groups

OFFSET: Final = "u_0"
_NO_LOAD_GOOD: Final = 3e-4  # of the largest voltage; gains are taken up by every level's flux linkage


@dataclass(frozen=True, slots=True, eq=False)
class NoLoad:
    """Steady points of a motor that turns freely."""

    omega_e: Array  # rad/s, electrical
    y: Array  # V, u_q - R_s i_q
    i_d: Array  # A
    R_s: float  # ohm, that y was made with

    @property
    def level(self) -> Places:
        """Number of each point's level of i_d, by size."""
        return np.unique(self.i_d, return_inverse=True)[1].reshape(-1).astype(np.intp)


def flux_name(place: int) -> str:
    """The flux linkage of a level."""
    return f"psi_{place}"


def no_load_problem(points: NoLoad, offsets: str = "one") -> Problem:
    """The question that such points ask, with "one" voltage u_0, with "none", or with one of "each" level."""
    level, levels = points.level, np.unique(points.i_d)
    fastest = float(np.max(np.abs(points.omega_e)))
    most = max(float(np.max(np.abs(levels))), 1e-6)
    # Of one level proportional to speed: where a fit begins
    flux = [float(points.omega_e[level == k] @ points.y[level == k] / np.sum(points.omega_e[level == k] ** 2))
            for k in range(len(levels))]  # fmt: skip
    typical = 0.05 * float(np.max(np.abs(points.y)))

    def predict(sizes: PointSizes) -> Array:
        return voltage(points, level, fastest, sizes)

    effects = {
        VOLTAGE_ERROR: (
            Size(VOLTAGE_ERROR, "voltage", "V", typical, 0.0, float(np.max(np.abs(points.y)))),
            Size(VOLTAGE_ERROR, "i_q", "A", 0.05 * most, 1e-3 * most, most, (0.02 * most, 0.2 * most), shape=True),
        ),
        "angle_offset": (Size("angle_offset", "offset", "rad", 0.05, -0.6, 0.6),),
        "ac_resistance": (Size("ac_resistance", "rise", "V", typical),),
    }
    names = {"one": (OFFSET,), "none": (), "each": tuple(f"{OFFSET}_{k}" for k in range(len(levels)))}[offsets]
    machine = (
        *(Size(MACHINE, flux_name(k), "Vs", abs(psi) or 1e-6, starts=(psi,)) for k, psi in enumerate(flux)),
        *(Size(MACHINE, name, "V", typical) for name in names),
    )
    group = speed_groups(level, points.omega_e)
    nothing = np.zeros((len(level), 0))
    return Problem(
        points.y, np.zeros(len(level), np.intp), group, group, machine, effects, predict, _NO_LOAD_GOOD, nothing
    )


def voltage(points: NoLoad, level: Places, fastest: float, sizes: PointSizes) -> Array:
    """y (V) that a machine with effects makes."""

    def of(owner: str, name: str) -> float:
        return sizes.get((owner, name), 0.0)

    levels = range(int(level.max()) + 1)
    psi_d = np.array([of(MACHINE, flux_name(k)) for k in levels])[level]
    each = np.array([of(MACHINE, f"{OFFSET}_{k}") for k in levels])[level]
    way = np.sign(points.omega_e)  # a freely turning motor is driven the way it turns
    y = points.omega_e * psi_d + way * (of(MACHINE, OFFSET) + each)
    if (lost := of(VOLTAGE_ERROR, "voltage")) != 0.0:
        i_q = of(VOLTAGE_ERROR, "i_q")
        y = y + way * lost * i_q / np.hypot(points.i_d, i_q)
    y = y + of("angle_offset", "offset") * points.R_s * points.i_d
    return y + way * of("ac_resistance", "rise") * (points.omega_e / fastest) ** 2
