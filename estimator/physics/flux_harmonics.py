"""Harmonics of the magnets' flux: the back-EMF is no sine.

    psi_m(theta_e) = psi_f (1 + d_6 cos 6 theta_e + d_12 cos 12 theta_e)
                     + j psi_f (q_6 sin 6 theta_e + q_12 sin 12 theta_e)

The 5th and 7th harmonic of a phase's back-EMF are the 6th in the rotor frame, the 11th and 13th the 12th; a rotor that
looks alike from both sides has cosines on d and sines on q. D. Hanselman, "Brushless Permanent Magnet Motor Design",
2nd ed., 2003, chapter 6.
"""

from estimator.arrays import Vector
from estimator.physics.effect import AddedVoltage, Parameter, Sizes, constant, no_shapes
from estimator.physics.rows import Rows


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Added voltage, V."""
    psi, per_angle = _harmonic_flux(rows, sizes)
    v, omega = per_angle + 1j * psi, rows.omega_e
    return rows.balance(psi) + rows.machine.R_s * rows.bent(omega * v[:-1], omega * v[1:])


def emf(rows: Rows, sizes: Sizes) -> Vector:
    """Back-EMF at samples, V."""
    psi, per_angle = _harmonic_flux(rows, sizes)
    return rows.speed * (per_angle + 1j * psi)


def _harmonic_flux(rows: Rows, sizes: Sizes) -> tuple[Vector, Vector]:
    """Flux linkage (Vs) at samples, and its derivative by the angle (Vs)."""
    d_6, q_6, d_12, q_12 = sizes
    psi_f, six = rows.machine.psi_f * rows.psi_f_ratio, rows.six
    psi = psi_f * (d_6 * six.real + 1j * q_6 * six.imag)
    per_angle = 6.0 * psi_f * (-d_6 * six.imag + 1j * q_6 * six.real)
    if d_12 != 0.0 or q_12 != 0.0:
        twelve = six * six
        psi = psi + psi_f * (d_12 * twelve.real + 1j * q_12 * twelve.imag)
        per_angle = per_angle + 12.0 * psi_f * (-d_12 * twelve.imag + 1j * q_12 * twelve.real)
    return psi, per_angle


_SHARE_RANGE = constant(0.02), constant(-0.2), constant(0.2)

EFFECT = AddedVoltage(
    "flux_harmonics", "harmonics of the magnets' flux",
    tuple(Parameter(name, "1", *_SHARE_RANGE) for name in ("d_6", "q_6", "d_12", "q_12")),
    no_shapes,
    "ripple at 6 and 12 times the electrical frequency that grows with speed and does not depend on current",
    ("inductance_harmonics", "inverter_voltage_error"),
    adds=voltage,
    in_proportion_to="psi_f",
    emf=emf,
    discrepancy=2e-5,
)
