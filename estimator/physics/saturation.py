"""The saturation curve that the three effects of saturation share: current from flux linkage, by one energy.

    i_d = g_d psi_d + a_d psi_d^3 + c psi_d psi_q^2 - i_F        i_q = g_q psi_q + a_q psi_q^3 + c psi_d^2 psi_q

psi_d holds the magnets' flux; i_d is zero at psi_f. Z. Qu, T. Tuovinen, M. Hinkkanen, "Inclusion of magnetic saturation
in dynamic models of synchronous reluctance motors", ICEM 2012, exponents S = T = 2,
U = V = 0. L_d and L_q are those at no current; a drop is the share by which an inductance is lower at rated current.
"""

import numpy as np

from estimator.kernel import kernel
from estimator.machine import Machine
from estimator.physics.rows import Rows, Vector


def saturated_flux(machine: Machine, i_rated: float, i: Vector, drops: tuple[float, float, float]) -> Vector:
    """Flux linkage (Vs) at currents (A), for drops of L_d along i_d, of L_q along i_q, and of L_q along i_d."""
    L_d_drop, L_q_drop, cross_drop = drops
    L_d, L_q, psi_f = machine.L_d, machine.L_q, machine.psi_f
    added_d, added_q = (1.0 - L_d_drop) * L_d * i_rated, (1.0 - L_q_drop) * L_q * i_rated
    a_d = L_d_drop * i_rated / (3.0 * psi_f * added_d**2 + added_d**3)
    a_q = L_q_drop * i_rated / added_q**3
    c = cross_drop / (1.0 - cross_drop) / L_q / (2.0 * psi_f * added_d + added_d**2)
    g_d, g_q = 1.0 / L_d - 3.0 * a_d * psi_f**2, 1.0 / L_q - c * psi_f**2
    i_F = g_d * psi_f + a_d * psi_f**3
    return _on_curve(i, psi_f + L_d * i.real + 1j * L_q * i.imag, (g_d, g_q, a_d, a_q, c, i_F), float(psi_f))


@kernel
def _on_curve(i: Vector, start: Vector, curve: tuple[float, float, float, float, float, float], psi_f: float) -> Vector:
    """Flux linkages at currents by Newton's method."""
    g_d, g_q, a_d, a_q, c, i_F = curve
    psi = np.empty(len(i), np.complex128)
    for k in range(len(i)):
        d, q = start[k].real, start[k].imag
        for _ in range(12):
            miss_d = (g_d + a_d * d * d + c * q * q) * d - i_F - i[k].real
            miss_q = (g_q + a_q * q * q + c * d * d) * q - i[k].imag
            dd, qq, dq = g_d + 3.0 * a_d * d * d + c * q * q, g_q + 3.0 * a_q * q * q + c * d * d, 2.0 * c * d * q
            det = dd * qq - dq * dq
            step_d, step_q = (qq * miss_d - dq * miss_q) / det, (dd * miss_q - dq * miss_d) / det
            # Far out, where the curve bends, a whole step would overshoot
            reach = 0.5 * (abs(d) + abs(q) + psi_f)
            d, q = d - min(max(step_d, -reach), reach), q - min(max(step_q, -reach), reach)
            if max(abs(step_d), abs(step_q)) < 1e-12 * psi_f:
                break
        psi[k] = complex(d, q)
    return psi


def added_voltage(rows: Rows, drops: tuple[float, float, float]) -> Vector:
    """What saturation adds to the voltage of constant inductances, V."""
    return rows.balance(saturated_flux(rows.machine, rows.i_rated, rows.i, drops) - rows.flux(rows.i))
