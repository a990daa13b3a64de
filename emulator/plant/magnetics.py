"""Magnetics: the relation of flux linkage and current in the rotor frame, from the energy of the field.

With the energy 3/2 w(psi, theta_e) the current and the torque are its derivatives, so that power is kept whatever
shape w has:

    i = grad w        tau_e = 3/2 n_p (psi_d i_q - psi_q i_d - d(w)/d(theta_e))

Here w is a saturation curve or a measured map, shifted by what the harmonics add to the magnets' flux, and a part
that the inductances' harmonic adds. Knows nothing of windings' resistance, supply or shaft.
"""

from typing import NamedTuple

from emulator.kernel import kernel
from emulator.plant.machine import Machine
from emulator.plant.physics.flux_map import FluxMap, energy, gradient
from emulator.plant.physics.harmonics import Harmonics
from emulator.plant.physics.saturation import Curve


class Magnetics(NamedTuple):
    """The relation as it is now: magnets and inductances move with temperature."""

    g_d: float  # 1/H
    g_q: float
    i_f: float  # A, what the magnets are worth in current
    psi_f: float  # Vs
    psi_0: float  # Vs, magnet flux that harmonics are a share of
    kappa: float  # 1/H, amplitude of the inductances' harmonic
    curve: Curve
    harmonics: Harmonics
    ripples: bool  # there are harmonics
    mapped: bool


@kernel
def magnetics_of(
    machine: Machine, psi_0: float, curve: Curve, harmonics: Harmonics, ripples: bool, flux_map: FluxMap
) -> Magnetics:
    """The relation of a machine whose magnets gave psi_0 (Vs) when they were new and cool."""
    mapped = flux_map.w.shape[0] > 0
    psi_f, a_d, kappa = machine.psi_f, curve.a_d, harmonics.inductance / machine.L_q
    if mapped:  # the map holds the magnets as they were
        g_d = 1.0 / machine.L_d
        g_q, i_f = 1.0 / machine.L_q, g_d * (psi_f - psi_0)
        return Magnetics(g_d, g_q, i_f, psi_f, psi_0, kappa, curve, harmonics, ripples, True)
    g_d = 1.0 / machine.L_d - 3.0 * a_d * psi_0**2
    g_q = 1.0 / machine.L_q - curve.c * psi_0**2
    i_f = g_d * psi_f + a_d * psi_f**3
    return Magnetics(g_d, g_q, i_f, psi_f, psi_0, kappa, curve, harmonics, ripples, False)


@kernel
def _smooth_current(m: Magnetics, flux_map: FluxMap, psi: complex) -> complex:
    """Current (A) without harmonics."""
    if m.mapped:
        return gradient(flux_map, psi) - m.i_f
    psi_d, psi_q = psi.real, psi.imag
    a_d, a_q, c, e_d = m.curve
    added = psi_d - m.psi_f
    return complex(
        (m.g_d + a_d * psi_d * psi_d + c * psi_q * psi_q) * psi_d - m.i_f + e_d * added * added * added,
        (m.g_q + a_q * psi_q * psi_q + c * psi_d * psi_d) * psi_q,
    )


@kernel
def _smooth_energy(m: Magnetics, flux_map: FluxMap, psi: complex) -> float:
    """w (Vs A) without harmonics."""
    if m.mapped:
        return energy(flux_map, psi) - m.i_f * psi.real
    d, q = psi.real**2, psi.imag**2
    a_d, a_q, c, e_d = m.curve
    even = 0.25 * e_d * (psi.real - m.psi_f) ** 4
    return 0.5 * (m.g_d * d + m.g_q * q + c * d * q) + 0.25 * (a_d * d * d + a_q * q * q) - m.i_f * psi.real + even


@kernel
def sixth(rotor: complex) -> complex:
    """exp(j 6 theta_e) of exp(j theta_e)."""
    third = rotor * rotor * rotor
    return third * third


@kernel
def _rippling_flux(m: Magnetics, six: complex) -> tuple[complex, complex]:
    """What the harmonics add to the magnets' flux (Vs), and its derivative by theta_e."""
    twelfth = six * six
    h = m.harmonics
    return (
        m.psi_f * complex(h.d_6 * six.real + h.d_12 * twelfth.real, h.q_6 * six.imag + h.q_12 * twelfth.imag),
        m.psi_f
        * complex(
            -6.0 * h.d_6 * six.imag - 12.0 * h.d_12 * twelfth.imag,
            6.0 * h.q_6 * six.real + 12.0 * h.q_12 * twelfth.real,
        ),
    )


@kernel
def current_and_pull(m: Magnetics, flux_map: FluxMap, psi: complex, rotor: complex) -> tuple[complex, float]:
    """i_dq (A) and tau_e / (3/2 n_p) (Vs A) at a flux linkage psi_dq (Vs); rotor = exp(j theta_e)."""
    if not m.ripples:
        i = _smooth_current(m, flux_map, psi)
        return i, psi.real * i.imag - psi.imag * i.real
    six = sixth(rotor)
    h, dh = _rippling_flux(m, six)
    x = psi - h
    y = x - m.psi_f
    i = _smooth_current(m, flux_map, x) + m.kappa * six.real * y
    along = i.real * dh.real + i.imag * dh.imag + 3.0 * m.kappa * six.imag * (y.real**2 + y.imag**2)
    return i, psi.real * i.imag - psi.imag * i.real + along


@kernel
def field_energy(m: Magnetics, flux_map: FluxMap, psi: complex, rotor: complex) -> float:
    """Energy (J) of the field, but for a constant."""
    if not m.ripples:
        return 1.5 * _smooth_energy(m, flux_map, psi)
    six = sixth(rotor)
    x = psi - _rippling_flux(m, six)[0]
    y = x - m.psi_f
    return 1.5 * (_smooth_energy(m, flux_map, x) + 0.5 * m.kappa * six.real * (y.real**2 + y.imag**2))


@kernel
def flux_of(m: Magnetics, flux_map: FluxMap, i: complex, rotor: complex) -> complex:
    """Flux linkage psi_dq (Vs) at which a current i_dq (A) flows, by Newton's method."""
    psi = complex(m.psi_f + i.real / m.g_d, i.imag / m.g_q)
    if m.mapped:
        psi = complex(flux_map.psi_f + i.real / m.g_d, i.imag / m.g_q)
    step = 1e-7 * (abs(m.psi_f) + abs(psi))
    for _ in range(60):
        miss = current_and_pull(m, flux_map, psi, rotor)[0] - i
        by_d = (current_and_pull(m, flux_map, psi + step, rotor)[0] - i - miss) / step
        by_q = (current_and_pull(m, flux_map, psi + 1j * step, rotor)[0] - i - miss) / step
        det = by_d.real * by_q.imag - by_q.real * by_d.imag
        change = complex(
            (miss.real * by_q.imag - by_q.real * miss.imag) / det,
            (by_d.real * miss.imag - miss.real * by_d.imag) / det,
        )
        psi -= change
        if abs(change) < 1e-14:
            break
    return psi
