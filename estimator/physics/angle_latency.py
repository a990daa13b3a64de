"""An angle that is of a while ago: a resolver's converter, a bus to the encoder, a register read before its time.

    theta_measured(t) = theta_e(t - latency)

So it is off by the speed times that, and in the other direction of turning to the other side; an offset is the same at
every speed. Derived here.
"""

import numpy as np

from estimator.arrays import Array
from estimator.physics.angle_sensing import AngleError
from estimator.physics.effect import Parameter, Sizes, no_shapes, periods
from estimator.physics.rows import Rows


def error(rows: Rows, sizes: Sizes) -> Array:
    """Of the angle, rad electrical, by true angles."""
    return -sizes[0] * (rows.speed_of_rotor - 0.5 * sizes[0] * accelerates(rows))


def error_as_measured(rows: Rows, sizes: Sizes) -> Array:
    """The same by measured angles, which come later."""
    return -sizes[0] * (rows.speed_of_rotor + 0.5 * sizes[0] * accelerates(rows))


def accelerates(rows: Rows) -> Array:
    """Electrical acceleration at samples, rad/s2: of the periods before and after; 0 at either side of a gap."""
    there = (rows.apart[1:] == 1) & (rows.apart[:-1] == 1)
    found = np.zeros(len(rows.theta_e))
    found[1:-1] = np.where(there, np.diff(rows.omega_of_rotor), 0.0) / rows.T_s
    return found


EFFECT = AngleError(
    "angle_latency", "a latency of the angle",
    (Parameter("latency", "s", periods(1.0), periods(-4.0), periods(20.0)),),
    no_shapes,
    "u_d in proportion to the square of the speed, and an angle's offset in proportion to it",
    ("angle_offset", "iron_loss", "voltage_delay"),
    error=error,
    error_as_measured=error_as_measured,
    discrepancy=1e-8,
)
