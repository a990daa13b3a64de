"""One current channel is sampled late.

    i_k,measured(t) = i_k(t + skew)        i_k(t + skew) - i_k(t) = skew (-R_s i - j omega_e psi) / L of the phase

Samples are taken in the middle of the zero vector, where the winding is short and the current falls by back-EMF and
resistance alone, harmonics and a rung's voltage among them; that of a branch beside the machine falls as well. Derived
here.
"""

from typing import Any

from estimator.arrays import Array, Vector
from estimator.physics.current_sensing import SkewError
from estimator.physics.effect import Parameter, Sizes, constant
from estimator.physics.rows import Rows
from estimator.physics.vectors import AXES


def error(rows: Rows, sizes: Sizes) -> Vector:
    """Of the stationary current vector, A."""
    skew, phase = sizes
    axis = AXES[round(phase) % 3]
    along: Any = _of_phase(_slope(rows), axis) * axis
    return 2.0 / 3.0 * skew * along


def halfway(rows: Rows, sizes: Sizes) -> Vector:
    """What the stationary current vector has changed by (A) after half of the skew: its slope there is the mean one."""
    return 0.5 * sizes[0] * _slope(rows)


def zero(rows: Rows, sizes: Sizes) -> Array:
    """Mean of the three channels' errors, A."""
    skew, phase = sizes
    return skew * _of_phase(_slope(rows), AXES[round(phase) % 3]) / 3.0


def _of_phase(x: Vector, axis: complex) -> Array:
    return (x * axis.conjugate()).real


def _slope(rows: Rows) -> Vector:
    """How fast the stationary current vector changes at samples, A/s."""
    psi, g = rows.own_flux
    i, omega = rows.i, rows.speed
    v = -rows.machine.R_s * i - 1j * omega * psi - rows.emf
    slope = g(v) + rows.fast_stiffness * v + 1j * omega * i
    return slope * rows.rotor


EFFECT = SkewError(
    "current_sampling_skew", "a current channel that is sampled late",
    (
        Parameter("skew", "s", constant(3e-6), constant(0.0), constant(2e-5)),
        Parameter("phase", "1", constant(1.0), constant(0.0), constant(2.0), shape=True, discrete=True),
    ),
    lambda _rows: ((0.0,), (1.0,), (2.0,)),
    "an error of one phase's current in proportion to speed",
    ("current_sensor_gain",),
    error=error,
    zero=zero,
    halfway=halfway,
    told=lambda _rows, p: {f"skew_{'abc'[round(p[1])]}": (p[0], "s")},
    discrepancy=2e-4,
)
