"""Samples that try the module: a simulated drive whose currents step, with gaps, a bad value and a standstill.

The machine's flux linkages are integrated in the stationary frame, in which a period's voltage stands still. They serve
to compare two programs on the same samples, not to say how accurate an estimate is. Knows nothing of C.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from estimator.arrays import Array, Integers
from estimator.machine import Machine

MACHINE: Final = Machine(R_s=0.9664, L_d=4.24e-3, L_q=6.21e-3, psi_f=0.12, n_p=4)
T_S: Final = 1e-4  # s
_OMEGA: Final = 502.65  # rad/s, electrical
_NOISE: Final = 0.01  # A
_HELD: Final = 37  # samples between steps of the currents
_STEPS: Final = 20  # of integration, a period
_FOLLOWED: Final = 8.0  # periods in which the currents come near to what they should be
_LONGEST: Final = 1000  # samples: a longer window is not filled


@dataclass(frozen=True, slots=True, eq=False)
class Stream:
    """Samples (n, 6): sine and cosine of the angle, i_d, i_q (A), u_d, u_q (V); their angle, and their ticks."""

    samples: Array
    theta_e: Array  # rad
    ticks: Integers
    moments: tuple[int, ...]  # numbers of samples after which an estimate is worth a look


def stream_for(window: int) -> Stream:
    """A stream that fills a window of so many samples, if it is not too long."""
    n = min(window, _LONGEST)
    running, apart, still = n + 150, 60, n + 40
    theta_e, columns = _simulated(running + 2 * apart, still)
    ticks = np.arange(1, len(theta_e) + 1)
    ticks[running:] += 7
    columns[running + apart, 2] = math.nan
    samples = np.column_stack((np.sin(theta_e), np.cos(theta_e), columns))
    moments = (1, 2, n // 2 + 2, n + 1, running, running + apart, running + 2 * apart, len(ticks))
    return Stream(samples, theta_e, ticks, moments)


def _simulated(running: int, still: int) -> tuple[Array, Array]:
    """Angle, currents and voltages of a motor that turns, and then stands with a constant current."""
    random, m = np.random.default_rng(7), MACHINE
    L = 0.5 * (m.L_d + m.L_q)
    angle, psi, wanted = 0.3, complex(m.psi_f), 0j
    theta_e, columns = np.empty(running + still), np.empty((running + still, 4))
    for k in range(running + still):
        turns = k < running
        omega = _OMEGA if turns else 0.0
        if turns and k % _HELD == 0:
            wanted = complex(*(random.uniform(-3.0, 3.0), random.uniform(-4.0, 4.0)))
        i = _current(psi)
        read = i + _NOISE * complex(*random.standard_normal(2))
        emf = 1j * omega * psi
        u = m.R_s * wanted + emf + L * (wanted - read) / (_FOLLOWED * T_S) if turns else m.R_s * wanted
        theta_e[k], columns[k] = angle, (read.real, read.imag, u.real, u.imag)
        psi = _after(psi, u, omega)
        angle = math.remainder(angle + omega * T_S, math.tau)
    return theta_e, columns


def _current(psi: complex) -> complex:
    return complex((psi.real - MACHINE.psi_f) / MACHINE.L_d, psi.imag / MACHINE.L_q)


def _after(psi: complex, u: complex, omega: float) -> complex:
    """The rotor frame's flux linkage a period later, by midpoint steps; u is given in the frame of its middle."""
    h = T_S / _STEPS

    def slope(t: float, psi: complex) -> complex:
        turned = omega * (0.5 * T_S - t)
        return u * complex(math.cos(turned), math.sin(turned)) - MACHINE.R_s * _current(psi) - 1j * omega * psi

    for j in range(_STEPS):
        middle = psi + 0.5 * h * slope(j * h, psi)
        psi += h * slope((j + 0.5) * h, middle)
    return psi
