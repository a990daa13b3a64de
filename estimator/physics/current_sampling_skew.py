"""One current channel is sampled late.

    i_k,measured(t) = i_k(t + skew)        i_k(t + skew) - i_k(t) = skew (-R_s i - j omega_e psi) / L of the phase

Samples are taken in the middle of the zero vector, where the winding is short and the current falls by back-EMF and
resistance alone. Derived here.
"""

from typing import Any

import numpy as np

from estimator.physics.current_sensing import voltage_of_error
from estimator.physics.effect import Effect, Parameter, Sizes, constant
from estimator.physics.rows import AXES, Real, Rows, Vector


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Added voltage, V."""
    return voltage_of_error(rows, error(rows, sizes) * rows.rotor.conj())


def error(rows: Rows, sizes: Sizes) -> Vector:
    """Of the stationary current vector, A."""
    skew, phase = sizes
    axis = AXES[round(phase) % 3]
    along: Any = _slope(rows, axis) * axis
    return 2.0 / 3.0 * skew * along


def zero(rows: Rows, sizes: Sizes) -> Real:
    """Mean of the three channels' errors, A."""
    skew, phase = sizes
    return skew * _slope(rows, AXES[round(phase) % 3]) / 3.0


def _slope(rows: Rows, axis: complex) -> Real:
    """How fast the phase's current changes at samples, A/s."""
    psi, g = rows.own_flux
    i, there = rows.i, rows.apart == 1  # over a gap no speed is known
    omega = np.where(there, rows.omega_e, 0.0)
    both = np.concatenate((there[:1], there)).astype(int) + np.concatenate((there, there[-1:]))
    omega = (np.concatenate((omega[:1], omega)) + np.concatenate((omega, omega[-1:]))) / np.maximum(both, 1)
    slope = g(-rows.machine.R_s * i - 1j * omega * psi) + 1j * omega * i
    return (slope * rows.rotor * axis.conjugate()).real


EFFECT = Effect(
    "current_sampling_skew", "a current channel that is sampled late",
    (
        Parameter("skew", "s", constant(3e-6), constant(0.0), constant(2e-5)),
        Parameter("phase", "1", constant(1.0), constant(0.0), constant(2.0), shape=True, discrete=True),
    ),
    voltage,
    lambda _rows: ((0.0,), (1.0,), (2.0,)),
    "an error of one phase's current in proportion to speed",
    ("current_sensor_gain",),
    zero,
    current_error=error,
    told=lambda _rows, p: {f"skew_{'abc'[round(p[1])]}": (p[0], "s")},
    missed=2e-4,
)
