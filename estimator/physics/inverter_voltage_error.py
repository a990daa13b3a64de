"""The inverter's voltage error: dead time and the drops of transistors and diodes.

A leg loses dead_time / T_s u_dc where its current flows out of it at the rising edge, and gains as much where it flows
into it at the falling edge. Its switches and diodes drop u_drop against the current, all period long. Away from zero
crossings

    u_k = d_k u_dc - sign(i_k) (dead_time / T_s u_dc + u_drop)

u_drop is the mean of what transistor and diode drop. What the diode drops more than the transistor raises all voltages
by its share of u_dc, as a dc link that is higher than measured: a recording does not tell, so that all parameters are
uncertain by that.

Near them the current's ripple has both signs within a period, and comes to zero and stays there within a dead time: the
period is followed from edge to edge. Currents are known within zero_crossing_width, over which a dead time's loss is
averaged; drops soften below knee, i / sqrt(i^2 + knee^2), as those of semiconductors do. With one width for both, 0.43
us of dead time beside 1.2 V of drops came out as 0.50 us and 0.6 V, and R_s 2.5 % off.

S.-G. Jeong, M.-H. Park, "The analysis and compensation of dead-time effects in PWM inverters", IEEE Trans. Industrial
Electronics 38(2), 1991; R. B. Sepe, J. H. Lang, "Inverter nonlinearities and discrete-time vector current control",
IEEE Trans. Industry Applications, 1994.
"""

import numpy as np

from estimator.arrays import Vector
from estimator.physics.bridge.legs import legs_of
from estimator.physics.bridge.lost_voltage import lost_between
from estimator.physics.effect import BridgeError, Parameter, Sizes
from estimator.physics.rows import Rows

_ANY_WIDTH = 1.0  # A, of what is not there
_DIODE_UNLIKE = 0.3  # of u_drop, standard deviation of the diode's less the transistor's


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Lost voltage, V."""
    dead_time, u_drop, width, knee = map(float, sizes)
    if u_drop == 0.0:  # whatever the knee
        return rows.stationary(rows.once(_lost, dead_time, 0.0, width, _ANY_WIDTH))
    if dead_time == 0.0:  # whatever the width
        return rows.stationary(rows.once(_lost, 0.0, u_drop, _ANY_WIDTH, knee))
    return rows.stationary(_lost(rows, dead_time, u_drop, width, knee))


def _lost(rows: Rows, dead_time: float, u_drop: float, width: float, knee: float) -> Vector:
    """V, stationary frame."""
    return lost_between(legs_of(rows), rows.i_s[:-1], rows.i_s[1:], dead_time, u_drop, width, knee)


def bus(rows: Rows) -> float:
    """The dc link's voltage, V, or one that suits the recording where it is not known."""
    return float(np.mean(rows.u_dc)) if rows.u_dc is not None else 2.0 * float(np.max(np.abs(rows.u), initial=1e-3))


def _scales(rows: Rows, sizes: Sizes) -> float:
    return _DIODE_UNLIKE * sizes[1] / bus(rows)


EFFECT = BridgeError(
    "inverter_voltage_error", "the inverter's voltage error",
    (
        Parameter("dead_time", "s", lambda rows: 0.01 * rows.T_s, lambda _: 0.0, lambda rows: 0.06 * rows.T_s),
        Parameter("u_drop", "V", lambda rows: 0.003 * bus(rows), lambda _: 0.0, lambda rows: 0.03 * bus(rows)),
        Parameter("zero_crossing_width", "A", lambda rows: 0.02 * rows.i_rated, lambda rows: 3e-4 * rows.i_rated,
                  lambda rows: 0.2 * rows.i_rated, shape=True, smooths=True),
        Parameter("knee", "A", lambda rows: 0.02 * rows.i_rated, lambda rows: 1e-3 * rows.i_rated,
                  lambda rows: 0.2 * rows.i_rated, shape=True),
    ),
    lambda rows: tuple((width * rows.i_rated, 0.01 * rows.i_rated) for width in (0.001, 0.01)),
    "steps of voltage where a phase current changes sign, six per electrical turn in the rotor frame",
    ("winding_resistance_drift", "flux_harmonics"),
    adds=voltage,
    discrepancy=1e-4,
    remembers=lambda rows, _sizes: None if rows.u_dc is None else legs_of(rows),
    scales=_scales,
)  # fmt: skip
