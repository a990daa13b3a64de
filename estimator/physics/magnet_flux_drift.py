"""The magnets warm up: psi_f falls within the recording.

    psi_f(t) = psi_f (1 + change (1 - exp(-t / time_constant)) / (1 - exp(-length / time_constant)))

NdFeB loses 0.11 % of its flux per kelvin. psi_f is that at the start, `change` the share by which it is different at
the end. J. R. Hendershot, T. J. E. Miller, "Design of Brushless Permanent-Magnet Machines", 2010, chapter 15.
"""

import math

import numpy as np

from estimator.physics.effect import Effect, Parameter, Sizes, constant
from estimator.physics.rows import Rows, Vector


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Added voltage, V."""
    change, time_constant = sizes
    t = (rows.t - rows.span[0]) / rows.span[1]
    course = (1.0 - np.exp(-t / time_constant)) / (1.0 - math.exp(-1.0 / time_constant))
    return rows.balance(change * rows.machine.psi_f * course)


EFFECT = Effect(
    "magnet_flux_drift", "drift of the magnets' flux",
    (
        Parameter("change", "1", constant(0.03), constant(-0.3), constant(0.0)),
        Parameter("time_constant", "1", constant(0.6), constant(0.05), constant(5.0), shape=True),
    ),
    voltage,
    lambda _rows: ((0.25,), (0.8,)),
    "back-EMF that falls with time at the same speed",
    ("magnet_flux_step", "d_axis_saturation"),
    told=lambda rows, p: {"change": (p[0], "1"), "time_constant": (p[1] * rows.span[1], "s")},
    in_proportion_to="psi_f",
    missed=2e-4,
)
