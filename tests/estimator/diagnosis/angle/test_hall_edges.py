"""Hall edges: they are found in an angle that is made of them, the course through them is smooth, and nothing else is
taken for such."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.angle_signal import AngleSignal
from emulator.plant.physics.hall import BY_SECTOR, BY_TURN, Hall
from emulator.plant.physics.sensing import AngleSensing
from emulator.scenario.scenarios import Run, Scenario
from estimator.diagnosis.angle.hall_edges import steps_of_sectors, through_edges
from estimator.physics.hall_displacement import EFFECT
from estimator.physics.rows import rows_of
from estimator.samples import nearest_turns
from tests.emulator.plant.physics.effect_runs import ROUND, at, with_effects
from tests.support.samples import machine_of, recorded

DISPLACED = Hall(BY_TURN, displaced_a=0.05, displaced_b=-0.03, displaced_c=-0.02)
SWINGS = Run(speed_rpm=900.0, swing_rpm=200.0, swing_frequency=3.0)
F = 37.3  # Hz, electrical
MACHINE = machine_of(ROUND)


def scenario(run: Run, **effects: Any) -> Scenario:
    return with_effects(motor=ROUND, i_dq=2j, run=run, **effects)


@pytest.mark.parametrize("place", [0.0, math.radians(30.0)])
@pytest.mark.parametrize("rate", [BY_TURN, BY_SECTOR])
@pytest.mark.parametrize(("run", "within"), [(at(F, ROUND), 5e-4), (at(-F, ROUND), 5e-4), (SWINGS, 2e-3)])
def test_the_course_through_displaced_edges_is_off_by_the_effects_equation(
    run: Run, within: float, rate: int, place: float
) -> None:
    true = recorded(VirtualDrive(scenario(run)), 5000)
    (found, *others), _ = through_edges([
        recorded(VirtualDrive(scenario(run, hall=DISPLACED._replace(rate=rate, place=place))), 5000)
    ])  # fmt: skip
    assert not others
    assert found.edges is not None
    assert found.edges.place == pytest.approx(place, abs=1e-9)
    assert found.edges.error < within
    begin = round(found.t0 / found.T_s)
    there = rows_of([true[begin : begin + len(found)]], MACHINE, 3.0)
    off = np.angle(np.exp(1j * (found.theta_e - there.theta_e)))
    sizes = (0.05, -0.03, place)
    assert off == pytest.approx(EFFECT.error(there, sizes), abs=within)
    measured = rows_of([found], MACHINE, 3.0)
    assert off == pytest.approx(EFFECT.error_as_measured(measured, sizes), abs=within)
    i = (found.i_d + 1j * found.i_q) * np.exp(1j * found.theta_e)
    assert i == pytest.approx(i_stationary(run, rate, place)[begin : begin + len(found)], abs=1e-9)


def i_stationary(run: Run, rate: int, place: float) -> NDArray[Any]:
    """As it flowed, in the drive that has the sensors."""
    r = VirtualDrive(scenario(run, hall=DISPLACED._replace(rate=rate, place=place))).record(5000)
    return (r["i_d"] + 1j * r["i_q"]) * np.exp(1j * r["theta_e"])


def test_what_no_hall_sensors_make_is_left_as_it_is() -> None:
    encoder = scenario(SWINGS)
    for other in (
        scenario(SWINGS), scenario(SWINGS, angle_signal=AngleSignal(quadrature=0.1, second=0.1)),
        scenario(SWINGS, angle_sensing=AngleSensing(once=0.02)), scenario(at(F, ROUND), hall=Hall(rate=BY_TURN)),
        *(replace(encoder, drive=replace(encoder.drive, encoder_counts=n)) for n in (24, 360, 1024, 65_536)),
    ):  # fmt: skip
        runs = [recorded(VirtualDrive(other), 5000)]
        assert through_edges(runs) == (tuple(runs), ())


def test_a_raw_angle_moves_in_steps_of_sectors_and_no_other_does() -> None:
    def moves(other: Scenario) -> NDArray[Any]:
        r = VirtualDrive(other).record(5000)
        return nearest_turns(np.diff(r["theta_e"]), 1e-4 * r["omega_e"][:-1])

    raw = DISPLACED._replace(raw=1)
    assert steps_of_sectors(moves(scenario(SWINGS, hall=raw)))
    assert steps_of_sectors(moves(scenario(at(-F, ROUND), hall=raw)))
    assert not steps_of_sectors(moves(scenario(SWINGS, hall=raw._replace(raw=0))))
    assert not steps_of_sectors(moves(scenario(SWINGS)))
    assert not steps_of_sectors(np.zeros(1000))
