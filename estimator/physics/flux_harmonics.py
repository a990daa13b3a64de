"""Harmonics of the magnets' flux: the back-EMF is no sine.

    psi_m(theta_e) = psi_f (1 + d_6 cos 6 theta_e + d_12 cos 12 theta_e)
                     + j psi_f (q_6 sin 6 theta_e + q_12 sin 12 theta_e)

The 5th and 7th harmonic of a phase's back-EMF are the 6th in the rotor frame, the 11th and 13th the 12th; a rotor that
looks alike from both sides has cosines on d and sines on q. D. Hanselman, "Brushless Permanent Magnet Motor Design",
2nd ed., 2003, chapter 6.
"""

from estimator.physics.effect import Effect, Parameter, Sizes, constant, no_shapes
from estimator.physics.rows import Rows, Vector


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Added voltage, V."""
    d_6, q_6, d_12, q_12 = sizes
    six = rows.six
    psi = d_6 * six.real + 1j * q_6 * six.imag
    if d_12 != 0.0 or q_12 != 0.0:
        twelve = six * six
        psi = psi + d_12 * twelve.real + 1j * q_12 * twelve.imag
    return rows.balance(rows.machine.psi_f * psi)


_SHARES = constant(0.02), constant(-0.2), constant(0.2)

EFFECT = Effect(
    "flux_harmonics", "harmonics of the magnets' flux",
    tuple(Parameter(name, "1", *_SHARES) for name in ("d_6", "q_6", "d_12", "q_12")),
    voltage,
    no_shapes,
    "ripple at 6 and 12 times the electrical frequency that grows with speed and does not depend on current",
    ("inductance_harmonics", "inverter_voltage_error"),
    missed=1e-4,
)
