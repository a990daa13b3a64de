"""Saturation that bends psi_d alike for both signs of i_d, beside closed forms and the drive that has it."""

from dataclasses import replace

import numpy as np
import pytest

from emulator.plant.physics.saturation import Saturation
from estimator.physics.library import BY_NAME
from estimator.physics.saturation import SYMMETRIC, curve_of, flux_of
from estimator.twin.model import Model
from tests.estimator.physics.equations import left_of, rows_without_noise, with_effect


def test_an_inductance_is_lower_by_its_drop_at_rated_current_of_either_sign() -> None:
    machine = rows_without_noise(with_effect("none", "baldor_ecs101m")).machine
    i_rated = machine.i_rated or 1.0
    curve = curve_of(machine, i_rated, (0.0, 0.0, 0.0), 0.1)
    added = flux_of(curve, machine, i_rated * np.array([-1.0, 0.0, 1.0], np.complex128)).real - machine.psi_f
    assert added / (machine.L_d * i_rated) == pytest.approx([-0.9, 0.0, 0.9])


@pytest.mark.parametrize("motor", ["baldor_ecs101m", "aalto_2k2"])
def test_the_equation_misses_little_of_the_drives(motor: str) -> None:
    scenario = with_effect("none", motor)
    saturation = Saturation(symmetric_drop=0.2, L_q_drop=0.1)
    rows = rows_without_noise(replace(scenario, effects=scenario.effects._replace(saturation=saturation)))
    before = left_of(rows, Model(rows.machine, {"q_axis_saturation": (0.1,)}))
    after = left_of(rows, Model(rows.machine, {"q_axis_saturation": (0.1,), SYMMETRIC: (0.2,)}))
    print(f"{motor}: {before:.3g} per mille of rated current, {after:.3g} with the effect")
    assert after < 0.02 * before
    assert BY_NAME[SYMMETRIC].other_form_of == "d_axis_saturation"
