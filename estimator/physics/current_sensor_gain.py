"""Unequal gains of the current channels.

    i_k,measured = (1 + gain_k) i_k        gain_a + gain_b + gain_c = 0

A common gain scales every impedance and cannot be told from another machine. Unequal gains show at twice the electrical
frequency, and as a sum of the three currents that is not zero. D.-W. Chung, S.-K. Sul, "Analysis and compensation of
current measurement error in vector-controlled AC motor drives", IEEE Trans. Industry Applications 34(2), 1998,
doi 10.1109/28.663477.

Where two channels are measured and the third phase is what they leave, gains of g and -g make, as a vector,

    i_measured = i + c conj(i) + j |c|/2 i        |c| = 2 g/sqrt(3), along 30 deg less two thirds of a turn a phase

which turns it as well. Derived here.
"""

import cmath
import math

from estimator.arrays import Array, Vector
from estimator.physics.current_sensing import CurrentError
from estimator.physics.effect import Parameter, Sizes, constant
from estimator.physics.rows import Rows
from estimator.physics.vectors import by_phase


def zero(rows: Rows, sizes: Sizes) -> Array:
    """Mean of the three channels' errors, A, for true currents."""
    alpha, beta, _ = sizes
    return 0.5 * (alpha * rows.i_s.real + beta * rows.i_s.imag)  # a third of the sum of gain_k i_k


def error(rows: Rows, sizes: Sizes) -> Vector:
    """Vector of the channels' errors, A, for measured currents."""
    # (1 + j turn) i + c conj(i) is measured, of which this is what is not i
    c, turn = _as_vector(sizes)
    i = ((1.0 - 1j * turn) * rows.i_s - c * rows.i_s.conj()) / (1.0 + turn * turn - abs(c) ** 2)
    return rows.i_s - i


def _as_vector(sizes: Sizes) -> tuple[complex, float]:
    alpha, beta, left = sizes
    c = 0.5 * complex(alpha, -beta)
    if not left:
        return c, 0.0
    along = cmath.exp(1j * math.radians(30.0 + 240.0 * left))
    size = (c * along.conjugate()).real
    return size * along, 0.5 * size


def forms(rows: Rows) -> tuple[tuple[float, ...], ...]:
    """All channels are measured, or all but one, 1 to 3 for a to c, where no sum of three bears witness."""
    return ((0.0,),) if rows.zero is not None else ((0.0,), (1.0,), (2.0,), (3.0,))


def _told(_rows: Rows, sizes: Sizes) -> dict[str, tuple[float, str]]:
    alpha, beta, left = sizes
    if not left:
        return {f"gain_{k}": (1.0 + x, "1") for k, x in zip("abc", by_phase(alpha, beta), strict=True)}
    g, (one, other) = math.sqrt(3.0) * _as_vector(sizes)[1], ("bc", "ca", "ab")[round(left) - 1]
    return {f"gain_{one}": (1.0 + g, "1"), f"gain_{other}": (1.0 - g, "1")}


EFFECT = CurrentError(
    "current_sensor_gain", "unequal gains of the current sensors",
    (
        *(Parameter(name, "1", constant(0.02), constant(-0.3), constant(0.3)) for name in ("gain_alpha", "gain_beta")),
        Parameter("left", "1", constant(1.0), constant(0.0), constant(3.0), shape=True, discrete=True),
    ),
    forms,
    "flux of twice the electrical frequency in the rotor frame, in proportion to current",
    ("phase_resistance_imbalance", "current_sampling_skew"),
    error=error,
    zero=zero,
    told=_told,
    discrepancy=1e-5,
)
