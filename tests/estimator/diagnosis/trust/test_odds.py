"""What evidence is worth, beside integrals over what a size may be."""

import math
from typing import Any, cast

import numpy as np
import pytest

from estimator.diagnosis.likelihood.columns import STRETCHES, Coefficient, Regression
from estimator.diagnosis.likelihood.evidence import Search
from estimator.diagnosis.trust.odds import log_bayes_factor

ONE = ("symmetric_d_axis_saturation", 0)
ENERGY = 400.0  # of a column, by a unit of its size


def search_of(z: float, low: float) -> Search:
    """One effect, of prior 1 and no less than `low`, that the data want z standard errors of."""
    columns = (
        Coefficient("machine", "R_s", 0, -1, (1.0, 0.1), 1.0, (0.3, 3.0)),
        Coefficient(ONE[0], "L_d_drop", 0, 0, (0.0, 1.0), 0.0, (low, math.inf)),
    )
    gram = np.zeros((STRETCHES, 3, 3))
    gram[:, 0, 0], gram[:, 0, 2], gram[:, 2, 2] = 1.0, 1.0, 1000.0
    gram[:, 1, 1] = ENERGY / STRETCHES
    gram[:, 1, 2] = gram[:, 2, 1] = z * math.sqrt(ENERGY) / STRETCHES
    gram[:, 2, 0] = 1.0
    none, count = cast(Any, None), 1000 * STRETCHES
    return Search(Regression(columns, gram, count, (1.0, 1.0, 1.0), none, none, none, 2.0, frozenset()))


@pytest.mark.parametrize("z", [0.0, -0.5, -2.0, -8.0])
def test_a_size_that_is_held_at_none_pays_for_what_it_might_have_been(z: float) -> None:
    x, step = np.linspace(0.0, 1.0, 100_001, retstep=True)
    prior = 2.0 * np.exp(-0.5 * x**2) / math.sqrt(math.tau)
    likely = prior * np.exp(-0.5 * ENERGY * x**2 + z * math.sqrt(ENERGY) * x)
    told = log_bayes_factor(search_of(z, 0.0), (), ONE)
    assert told == pytest.approx(math.log(float(likely.sum() - 0.5 * likely[0]) * float(step)), abs=1e-3)
    assert told < -1.5


def test_a_size_that_is_free_is_worth_what_it_explains_less_what_it_might_have_been() -> None:
    z = 5.0
    told = log_bayes_factor(search_of(z, -math.inf), (), ONE)
    assert told == pytest.approx(0.5 * z * z * ENERGY / (ENERGY + 1.0) - 0.5 * math.log(ENERGY + 1.0), abs=0.1)
