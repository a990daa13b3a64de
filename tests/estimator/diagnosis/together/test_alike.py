"""Numbers of several recordings: one number where chance makes their difference, and how likely that is."""

import math

import numpy as np
import pytest

from estimator.diagnosis.together.alike import FALSE_ALARM, apart, one_number, shared
from estimator.diagnosis.verdict import Quantity


def told(*pairs: tuple[float, float]) -> list[Quantity | None]:
    return [Quantity(value, std, "ohm") for value, std in pairs]


def test_the_joint_number_is_the_weighted_mean() -> None:
    one = shared(told((1.0, 0.1), (1.1, 0.2)), 1)
    assert one.alike
    assert one.joint.value == pytest.approx((1.0 / 0.01 + 1.1 / 0.04) / 125.0)
    assert one.joint.std == pytest.approx(125.0**-0.5)


def test_what_all_recordings_miss_alike_does_not_get_less() -> None:
    one = shared(told(*[(1.0, math.hypot(0.01, 0.05))] * 100), 1, common=0.05)
    assert one.joint.std == pytest.approx(math.hypot(0.001, 0.05))


def test_a_recording_that_tells_nothing_has_no_part() -> None:
    one = shared([None, Quantity(None, None, "ohm"), *told((2.0, 0.1))], 1)
    assert (one.joint.value, one.alike, len(one.each)) == (pytest.approx(2.0), True, 3)
    assert shared([None, None], 1).joint.value is None


def test_alike_recordings_are_said_to_differ_as_often_as_is_said() -> None:
    chance, numbers, tries = np.random.default_rng(1), 5, 4000
    wrong = 0
    for values in chance.normal(3.0, 0.1, (tries, numbers, 3)):
        wrong += not all(shared(told(*((x, 0.1) for x in each)), numbers).alike for each in values)
    assert wrong / tries == pytest.approx(FALSE_ALARM, abs=4.0 * math.sqrt(FALSE_ALARM / tries))


@pytest.mark.parametrize("stds", [[0.1, 0.05], [0.1, 0.02, 0.3]])
def test_that_numbers_are_one_is_the_ratio_of_two_integrals(stds: list[float]) -> None:
    prior = 0.7

    theta = np.linspace(-6.0, 6.0, 400_001)

    def evidence(some: list[float]) -> float:
        exponents = sum(-0.5 * (theta / std) ** 2 for std in [*some, prior])
        return float(np.sum(np.exp(exponents)) * (theta[1] - theta[0])) / (prior * math.sqrt(2.0 * math.pi))

    expected = math.log(evidence(stds)) - sum(math.log(evidence([one])) for one in stds)
    assert one_number(stds, prior) == pytest.approx(expected, rel=1e-6)


def test_values_are_as_far_apart_as_their_chi_square() -> None:
    assert apart([(1.0, 0.1), (1.2, 0.1)]) == pytest.approx(2.0)
    assert apart([(1.0, 0.1)]) == apart([]) == 0.0
