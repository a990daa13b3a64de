"""The winding's temperature follows something outside: R_s rises, or rises and falls, whatever the current.

    R_s(t) = R_s (1 + share(t))        share: see `temperature_course`

A neighbour's heat, a cooling circuit, an oven, losses of hours before. R_s is that at the start. Copper gains 0.39 % of
its resistance per kelvin: J. R. Hendershot, T. J. E. Miller, "Design of Brushless Permanent-Magnet Machines", 2010,
chapter 15. A winding that its own losses warm, see `winding_resistance_drift`, has fewer sizes and is named where it
explains as much.
"""

from estimator.arrays import Array, Vector
from estimator.physics.effect import ResistanceChange, Sizes
from estimator.physics.rows import Rows
from estimator.physics.temperature_course import parameters_of, shapes, share_at, told_as


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Added voltage, V."""
    return rows.machine.R_s * rise(rows, sizes) * rows.i_mean


def rise(rows: Rows, sizes: Sizes) -> Array:
    """Of R_s in each period, as a share of that at the start."""
    return share_at(rows, sizes, rows.t[:-1] + 0.5 * rows.T_s)


EFFECT = ResistanceChange(
    "winding_temperature", "a course of the winding's temperature",
    parameters_of(0.1, -0.5, 1.5),
    shapes,
    "R_s that moves with time, whatever the losses",
    ("winding_resistance_drift", "magnet_temperature", "ac_resistance"),
    adds=voltage,
    told=told_as("rise", "ohm", lambda rows: rows.machine.R_s),
    raises=lambda rows, p: (rise(rows, p), 0.0),
    in_proportion_to="R_s",
    other_form_of="winding_resistance_drift",
    discrepancy=2e-3,
)
