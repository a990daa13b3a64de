"""Harmonics of the inductances: slots let them change with the rotor's angle.

    1/L(theta_e) = 1/L + inverse_6 / L_q cos 6 theta_e    on both axes

so that the flux linkage of a current is L i / (1 + inverse_6 L/L_q cos 6 theta_e). D. Hanselman, "Brushless Permanent
Magnet Motor Design", 2nd ed., 2003, chapter 10.
"""

from estimator.physics.effect import Effect, Parameter, Sizes, constant, no_shapes
from estimator.physics.rows import Rows, Vector


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Added voltage, V."""
    (inverse_6,) = sizes
    m, i = rows.machine, rows.i
    x = inverse_6 * rows.six.real
    d, q = x * (m.L_d / m.L_q), x
    return -rows.balance(m.L_d * i.real * d / (1.0 + d) + 1j * m.L_q * i.imag * q / (1.0 + q))


EFFECT = Effect(
    "inductance_harmonics", "harmonics of the inductances",
    (Parameter("inverse_6", "1", constant(0.05), constant(-0.3), constant(0.3)),),
    voltage,
    no_shapes,
    "ripple at 6 times the electrical frequency in proportion to current, with speed and with how fast current changes",
    ("flux_harmonics",),
    missed=1e-4,
)
