"""Unequal phase resistances: a bad contact, a warm joint.

    u_k = ... + excess_k i_k        excess_a + excess_b + excess_c = 0

R_s is the mean of the three; an excess rises with it, as the winding warms up. In the rotor frame the excess turns with
twice the electrical frequency, in proportion to current. Symmetrical components: C. L. Fortescue, "Method of
symmetrical co-ordinates applied to the solution of polyphase networks", Trans. AIEE 37, 1918.
"""

from estimator.arrays import Vector
from estimator.physics.effect import Parameter, ResistanceChange, Sizes, no_shapes
from estimator.physics.rows import Rows
from estimator.physics.vectors import by_phase


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Added voltage, V."""
    alpha, beta = sizes
    i_s = rows.i_mean * rows.middle * rows.R_s_ratio
    # Clarke of excess_k i_k with a zero sum: the excesses' vector conjugate times the conjugate current, halved
    return rows.stationary(0.5 * (alpha - 1j * beta) * i_s.conj())


EFFECT = ResistanceChange(
    "phase_resistance_imbalance", "unequal phase resistances",
    tuple(Parameter(name, "ohm", lambda rows: 0.1 * rows.machine.R_s) for name in ("excess_alpha", "excess_beta")),
    no_shapes,
    "voltage of twice the electrical frequency in the rotor frame, in proportion to current, at any speed",
    ("current_sensor_gain", "interturn_short"),
    adds=voltage,
    told=lambda _rows, p: {f"excess_{k}": (x, "ohm") for k, x in zip("abc", by_phase(*p), strict=True)},
    raises=lambda _rows, p: (0.0, complex(*p)),
    discrepancy=3e-5,
)
