"""Temperatures from outside, beside closed forms and the drive that has them."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from emulator.conceal.outside_warmth import late, points_of, rise, rise_and_fall
from emulator.plant.physics.warming import Warming
from estimator.arrays import Array
from estimator.physics.library import BY_NAME
from estimator.physics.rows import Rows
from estimator.physics.temperature_course import share_at
from estimator.twin.model import Model
from tests.estimator.physics.equations import SECONDS, fitted_to, left_of, rows_without_noise, with_effect


def of_recording(**warming: Any) -> Rows:
    scenario = with_effect("none", "servo_4nm")
    effects = scenario.effects._replace(warming=Warming(**warming))
    return rows_without_noise(replace(scenario, effects=effects))


def test_a_course_is_a_cubic_before_and_one_after_its_turn() -> None:
    rows = of_recording()
    begin, length = rows.span
    x, at = np.linspace(0.0, 1.0, 50), np.array([0.4 / 3.0, 0.8 / 3.0, 0.4, 0.6, 0.8, 1.0])

    def course(x: Array) -> Array:
        return x - 2.0 * x**2 + 0.5 * x**3 - 3.0 * np.maximum(x - 0.4, 0.0) + 0.7 * np.maximum(x - 0.4, 0.0) ** 3

    sizes = (*course(at).tolist(), 0.4)
    assert share_at(rows, sizes, begin + x * length) == pytest.approx(course(x), abs=1e-12)


def test_what_is_told_of_a_course() -> None:
    rows = of_recording()
    begin, length = rows.span
    sizes = tuple(0.2 - 0.8 * (k / 6.0 - 0.5) ** 2 for k in range(1, 7))  # most halfway, none at either end
    told = BY_NAME["winding_temperature"].told
    assert told is not None
    said = {name: value for name, (value, _) in told(rows, (*sizes, 0.5)).items()}
    assert said["rise"] == pytest.approx(0.2)
    assert said["time"] == pytest.approx(begin + 0.5 * length)
    R_s = rows.machine.R_s
    assert [said[f"at_{x}"] / R_s for x in ("start", "quarter", "half", "three_quarters", "end")] == pytest.approx(
        [1.0, 1.15, 1.2, 1.15, 1.0]
    )


@pytest.mark.parametrize(("part", "most", "name"), [
    ("winding", 0.3, "winding_temperature"), ("magnets", -0.04, "magnet_temperature"),
])  # fmt: skip
@pytest.mark.parametrize("course", [rise(0.4), rise_and_fall(0.4, 0.7), rise_and_fall(0.6, 1.0), late(0.2, 0.9)])
def test_the_equation_misses_little_of_a_course_from_outside(part: str, most: float, name: str, course: Any) -> None:
    rows = of_recording(**{part: points_of(course, most, SECONDS)})
    left = fitted_to(rows, [name])
    print(f"{part}: {left.before:.3g} per mille of rated current, {left.after:.3g}; missed {left.missed:.2g}")
    assert left.missed < BY_NAME[name].discrepancy
    assert left_of(rows, Model(rows.machine)) > left.after
