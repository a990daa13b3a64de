"""Unequal gains of the current channels.

    i_k,measured = (1 + gain_k) i_k        gain_a + gain_b + gain_c = 0

A common gain scales every impedance and cannot be told from another machine. Unequal gains show at twice the electrical
frequency, and as a sum of the three currents that is not zero. D.-W. Chung, S.-K. Sul, "Analysis and compensation of
current measurement error in vector-controlled AC motor drives", IEEE Trans. Industry Applications 34(2), 1998,
doi 10.1109/28.663477.
"""

from estimator.arrays import Array, Vector
from estimator.physics.current_sensing import CurrentError
from estimator.physics.effect import Parameter, Sizes, constant, no_shapes
from estimator.physics.rows import Rows
from estimator.physics.vectors import by_phase


def zero(rows: Rows, sizes: Sizes) -> Array:
    """Mean of the three channels' errors, A, for true currents."""
    alpha, beta = sizes
    return 0.5 * (alpha * rows.i_s.real + beta * rows.i_s.imag)  # a third of the sum of gain_k i_k


def error(rows: Rows, sizes: Sizes) -> Vector:
    """Vector of the channels' errors, A, for measured currents."""
    alpha, beta = sizes
    # Clarke of gain_k i_k with a zero sum: i + c conj(i) is measured, of which this is what is not i
    c = 0.5 * complex(alpha, -beta)
    return (c * rows.i_s.conj() - abs(c) ** 2 * rows.i_s) / (1.0 - abs(c) ** 2)


EFFECT = CurrentError(
    "current_sensor_gain", "unequal gains of the current sensors",
    tuple(Parameter(name, "1", constant(0.02), constant(-0.3), constant(0.3)) for name in ("gain_alpha", "gain_beta")),
    no_shapes,
    "flux of twice the electrical frequency in the rotor frame, in proportion to current",
    ("phase_resistance_imbalance", "current_sampling_skew"),
    error=error,
    zero=zero,
    told=lambda _rows, p: {f"gain_{k}": (1.0 + x, "1") for k, x in zip("abc", by_phase(*p), strict=True)},
    discrepancy=1e-5,
)
