"""Offsets of the current channels.

    i_k,measured = i_k + offset_k        as a vector: i_measured = i + (offset_alpha + j offset_beta) exp(-j theta_e)

D.-W. Chung, S.-K. Sul, "Analysis and compensation of current measurement error in vector-controlled AC motor drives",
IEEE Trans. Industry Applications 34(2), 1998, doi 10.1109/28.663477.
"""

import numpy as np

from estimator.arrays import Vector
from estimator.physics.current_sensing import CurrentError
from estimator.physics.effect import Parameter, Sizes, no_shapes, rated
from estimator.physics.rows import Rows
from estimator.physics.vectors import by_phase


def error(rows: Rows, sizes: Sizes) -> Vector:
    """Of the stationary current vector, A."""
    return np.full(len(rows) + 1, complex(*sizes))


EFFECT = CurrentError(
    "current_sensor_offset", "offsets of the current sensors",
    tuple(
        Parameter(name, "A", rated(0.01), rated(-0.2), rated(0.2)) for name in ("offset_alpha", "offset_beta")
    ),
    no_shapes,
    "voltage that stands still in the stationary frame: once per electrical turn in the rotor frame",
    ("inverter_voltage_error",),
    error=error,
    zero=lambda rows, _p: np.zeros(len(rows) + 1),  # their mean is the model's own
    told=lambda _rows, p: {f"offset_{k}": (x, "A") for k, x in zip("abc", by_phase(*p), strict=True)},
    without_current=True,
    discrepancy=1e-5,
)
