"""One current channel is sampled late.

    i_k,measured(t) = i_k(t + skew)        i_k(t + skew) - i_k(t) = skew (-R_s i - j omega_e psi) / L of the phase

Samples are taken in the middle of the zero vector, where the winding is short and the current falls by back-EMF and
resistance alone, harmonics and a rung's voltage among them; that of a branch beside the machine falls as well. Where
two channels are measured, the third phase is what they leave and off by as much the other way. Derived here.
"""

from typing import Any, Final

from estimator.arrays import Array, Vector
from estimator.physics.current_sensing import SkewError
from estimator.physics.effect import Parameter, Sizes, constant
from estimator.physics.rows import Rows
from estimator.physics.vectors import AXES

_FORMS: Final = (*((k, None) for k in range(3)), *((k, m) for k in range(3) for m in range(3) if m != k))
"""The phase that is sampled late, and the one that is not measured."""


def error(rows: Rows, sizes: Sizes) -> Vector:
    """Of the stationary current vector, A."""
    skew, form = sizes
    phase, left = _FORMS[round(form)]
    by: Any = _of_phase(_slope(rows), AXES[phase])
    return 2.0 / 3.0 * skew * by * (AXES[phase] - (0.0 if left is None else AXES[left]))


def halfway(rows: Rows, sizes: Sizes) -> Vector:
    """What the stationary current vector has changed by (A) after half of the skew: its slope there is the mean one."""
    return 0.5 * sizes[0] * _slope(rows)


def zero(rows: Rows, sizes: Sizes) -> Array:
    """Mean of the three channels' errors, A."""
    skew, form = sizes
    return skew * _of_phase(_slope(rows), AXES[_FORMS[round(form)][0]]) / 3.0


def forms(rows: Rows) -> tuple[tuple[float, ...], ...]:
    """Of three channels; of two as well where no sum of three bears witness."""
    return tuple((float(form),) for form in range(3 if rows.zero is not None else len(_FORMS)))


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
        Parameter("form", "1", constant(1.0), constant(0.0), constant(8.0), shape=True, discrete=True),
    ),
    forms,
    "an error of one phase's current in proportion to speed",
    ("current_sensor_gain",),
    error=error,
    zero=zero,
    halfway=halfway,
    told=lambda _rows, p: {f"skew_{'abc'[_FORMS[round(p[1])][0]]}": (p[0], "s")},
    discrepancy=2e-4,
)
