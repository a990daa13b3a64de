"""R_s, L_d, L_q, psi_f with intervals, of recordings that do not tell all of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.legs import Inverter
from emulator.scenario.effects import NONE
from emulator.scenario.motors import MOTORS
from emulator.scenario.scenarios import Excitation, Run, Scenario, drive_for
from estimator.diagnosis.diagnose import TOLERANCE, diagnose
from estimator.diagnosis.intake.prepared import prepared
from estimator.diagnosis.likelihood.evidence import Search
from estimator.diagnosis.search.fitting import of_model, searched
from estimator.diagnosis.verdict import Diagnosis, Verdict
from estimator.machine import PARAMETERS
from estimator.samples import Samples
from estimator.twin.model import Model
from tests.estimator.diagnosis.concealed_runs import population, recording_of
from tests.support.samples import machine_of, recorded

pytestmark = pytest.mark.thorough

MOTOR = MOTORS["beckhoff_am8141"]
TRUE = machine_of(MOTOR.machine)
NOMINAL = replace(TRUE, R_s=1.02 * TRUE.R_s, L_d=0.94 * TRUE.L_d, L_q=1.06 * TRUE.L_q, psi_f=1.02 * TRUE.psi_f)


def at_one_level(dead_time: float, seed: int) -> Samples:
    """2 s at 400 rpm and 3.6 A, where the voltage answers little but noise."""
    drive = drive_for(MOTOR.machine, MOTOR.u_dc, T_s=1e-4, bridge="switched")
    effects = NONE._replace(inverter=Inverter(dead_time=dead_time))
    run, level = Run(speed_rpm=400.0, seed=seed), Excitation(-1.6, 3.2)
    scenario = Scenario("level.toml", MOTOR.machine, drive, run, level, effects)
    emulated = VirtualDrive(scenario)
    emulated.run(2000)
    samples = recorded(emulated, 20_000)
    return replace(samples, u_dc=np.full(len(samples), MOTOR.u_dc))


def diagnosed_at_one_level(dead_time: float, seed: int) -> Diagnosis:
    return diagnose([at_one_level(dead_time, seed)], NOMINAL)


@pytest.mark.slow
@pytest.mark.parametrize(("dead_time", "seed"), [(0.0, 1), (0.0, 2), (400e-9, 1), (400e-9, 2)])
def test_what_one_level_does_not_tell_is_as_uncertain_as_its_tolerance(dead_time: float, seed: int) -> None:
    """L_d and L_q are fits of noise there. R_s and psi_f trade with them: 5 % of R_s had an interval of 0.3 %."""
    told = diagnosed_at_one_level(dead_time, seed).machine_after
    for name in PARAMETERS:
        value, std = told[name].value, told[name].std
        assert value is not None
        assert std is not None
        off = value - getattr(TRUE, name)
        print(f"{dead_time} s, {name}: off by {off / getattr(TRUE, name):.1%}, {off / std:.1f} standard errors")
        assert abs(off) < 2.5 * std
        if name in ("L_d", "L_q"):
            assert std > 0.5 * TOLERANCE * getattr(NOMINAL, name)


def test_a_dead_time_that_one_level_does_not_tell_gets_no_name() -> None:
    """It looks like R_s, or like drops."""
    said = diagnosed_at_one_level(54e-9, 1)
    assert not said.findings
    assert said.verdict is Verdict.AMBIGUOUS
    assert not any(doubt.machine_holds for doubt in said.ambiguous)


def test_a_machine_that_is_another_without_what_is_in_doubt_does_not_hold(tmp_path: Path) -> None:
    """Nothing is concealed there; L_q beside a saturation that may be there is off by nine standard errors."""
    concealed, runs, nominal = recording_of(population(987), 47, tmp_path)
    said = diagnose(runs, nominal)
    assert said.findings == ()
    assert not any(doubt.machine_holds for doubt in said.ambiguous)
    if not said.ambiguous:
        true = concealed.scenario.motor.L_q
        assert said.machine_after["L_q"].value == pytest.approx(true, rel=1e-4)


def test_how_far_an_effect_lies_from_none_counts_inductances_that_are_not_told() -> None:
    """Effects trade with these at one level: offsets of current sensors, two standard errors from none, were named."""
    rows, given = prepared([at_one_level(0.0, 1)], NOMINAL, dict.fromkeys(PARAMETERS, TOLERANCE))
    search, _, _ = searched(rows, of_model(rows, Model(given.machine), given).model, given, "angle_offset")
    one = next(each for each in search.candidates() if each[0] == "angle_offset")

    def distance(*unidentified: str) -> float:
        with_these = Search(replace(search.regression, unidentified=frozenset(unidentified)))
        return with_these.distance(with_these.fit((one,)), one)

    print(f"{distance():.3g} where all are told, {distance('L_d', 'L_q'):.3g} where inductances are not")
    assert 0.0 < distance("L_d", "L_q") < 0.9 * distance()
