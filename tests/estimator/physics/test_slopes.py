"""The machine's columns are slopes: of what a model leaves, by R_s, L_d, L_q and psi_f."""

from dataclasses import replace

import numpy as np
import pytest

from estimator.arrays import Vector
from estimator.diagnosis.likelihood.columns import regression
from estimator.diagnosis.likelihood.given import Given
from estimator.diagnosis.likelihood.noise import filter_of, whitened
from estimator.machine import PARAMETERS
from estimator.physics.rows import Rows
from estimator.twin.model import Model, residual
from tests.estimator.physics.equations import rows_without_noise, with_effect

_STEP = 1e-3  # of a parameter
_NOISE = 1e-4, 1e-4, 1e-3
MISSED = {  # share of a slope; 2e-3 where not told
    ("interturn_short", "R_s"): 0.2,  # what the loop spares the phase's resistance
    ("inductance_harmonics", "L_d"): 0.02,
}


@pytest.fixture(scope="module")
def rows() -> Rows:
    return rows_without_noise(with_effect("none", "servo_4nm"))


def left(rows: Rows, model: Model) -> Vector:
    """Vs, by the filter of the rows' machine: how it whitens is no part of a slope."""
    there = rows.with_machine(model.machine)
    return whitened(residual(there, there, model), filter_of(rows, rows.machine))


@pytest.mark.parametrize(("name", "sizes"), [
    ("interturn_short", (5e-3, 1.0, 1e-4, 0.5)), ("q_axis_saturation", (0.2,)),
    ("flux_harmonics", (0.01, 0.01, 0.0, 0.0)), ("inductance_harmonics", (0.05,)),
    ("winding_resistance_drift", (0.1, 1.0, 0.0)), ("phase_resistance_imbalance", (0.05, 0.0)),
    ("magnet_flux_drift", (-0.03, 0.5, 0.02)),
    ("winding_temperature", (0.1, 0.15, 0.2, 0.15, 0.1, 0.05, 0.5)),
    ("magnet_temperature", (-0.01, -0.02, -0.03, -0.02, -0.01, 0.0, 0.5)),
])  # fmt: skip
def test_a_column_is_the_slope_of_what_a_model_with_an_effect_leaves(
    rows: Rows, name: str, sizes: tuple[float, ...]
) -> None:
    model = Model(rows.machine, {name: sizes})
    given = Given(rows.machine, dict.fromkeys(PARAMETERS, 0.1), 1e-6)
    sums = regression(rows, rows, model, given, _NOISE, ())
    gram, noise = sums.gram.sum(axis=0), np.array(_NOISE[:2])
    before = left(rows, model)
    for place, parameter in enumerate(PARAMETERS):
        h = _STEP * getattr(rows.machine, parameter)
        machine = replace(rows.machine, **{parameter: getattr(rows.machine, parameter) + h})
        slope = (before - left(rows, replace(model, machine=machine))) / h
        energy = float(np.sum((slope.real / noise[0]) ** 2 + (slope.imag / noise[1]) ** 2))
        missed = MISSED.get((name, parameter), 2e-3)
        assert gram[place, place] == pytest.approx(energy, rel=missed), parameter
