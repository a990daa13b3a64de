"""What effects add to the heat that a winding warms up by."""

import numpy as np
import pytest

from estimator.diagnosis.likelihood.thinning import thinned
from estimator.twin.model import Model, in_truth, with_local_course
from tests.estimator.physics.equations import rows_without_noise, with_effect

WARMER = {"winding_resistance_drift": (0.1, 1.0, 0.0)}


@pytest.mark.parametrize(("kind", "effect"), [
    ("turn_short", {"interturn_short": (0.01, 0.0, 1e-4, 0.5)}), ("skin", {"ac_resistance": (1.0, 400.0)}),
])  # fmt: skip
def test_heat_beside_is_the_same_again_and_of_blocks_of_rows(
    kind: str, effect: dict[str, tuple[float, ...]]
) -> None:
    rows = rows_without_noise(with_effect(kind, "servo_4nm"))
    model = Model(rows.machine, WARMER | effect)
    truth = in_truth(rows, model)
    beside = np.asarray(truth.heat_beside)
    assert beside[-1] > 1e-3 * rows.heat[-1]
    np.testing.assert_array_equal(with_local_course(truth, model).heat_beside, beside)
    part = in_truth(thinned(rows, len(rows) // 4, 20), model)
    at = np.searchsorted(rows.t, part.t)
    assert np.max(np.abs(part.heat_beside - beside[at])) < 0.15 * beside[-1]  # three quarters of the time are gaps


def test_no_heat_is_added_where_the_winding_does_not_warm_up() -> None:
    rows = rows_without_noise(with_effect("turn_short", "servo_4nm"))
    assert in_truth(rows, Model(rows.machine, {"interturn_short": (0.01, 0.0, 1e-4, 0.5)})).heat_beside == 0.0
