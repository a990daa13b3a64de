"""Warmth from outside, beside closed forms."""

import cmath

import numpy as np
import pytest

from emulator.bounds import ScenarioError
from emulator.conceal.outside_warmth import points_of, rise, rise_and_fall
from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.warming import Warming
from emulator.scenario.scenarios import parse
from emulator.scenario.text import text_of
from tests.emulator.plant.physics.effect_runs import ROUND, SALIENT, at, currents, steady, voltages, with_effects

POINTS = ((0.0, 0.0), (0.1, 0.3), (0.2, 0.1))
FALLS = ((0.05, 0.0), (0.15, -0.04))


def test_a_winding_takes_the_voltage_of_its_resistance_at_that_time_whatever_its_current() -> None:
    for i in (2.0, 5.0):
        warmed = with_effects(motor=ROUND, i_dq=1j * i, warming=Warming(winding=POINTS))
        r = steady(warmed, 0.02, 0.2)
        share = np.interp(r["t"] + 0.5e-4, [0.0, 0.1, 0.2], [0.0, 0.3, 0.1])
        told = voltages(r).imag / currents(r).imag
        assert told == pytest.approx(ROUND.R_s * (1.0 + share), rel=4e-3)  # corners move the current


def test_magnets_take_their_back_emf_with_them() -> None:
    r = steady(with_effects(run=at(60.0), warming=Warming(magnets=FALLS)), 0.02, 0.2)
    turn = r["omega_e"] * 1e-4
    psi = voltages(r).imag / (2e4 * np.sin(0.5 * turn))
    share = np.interp(r["t"] + 0.5e-4, [0.05, 0.15], [0.0, -0.04])
    assert psi == pytest.approx(SALIENT.psi_f * (1.0 + share), rel=1e-3)


def test_the_truth_tells_both_before_and_after() -> None:
    drive = VirtualDrive(with_effects(run=at(30.0), warming=Warming(POINTS, FALLS)))
    told = drive.truth_at(np.array([0.05, 0.1, 0.3]))
    assert told["R_s"] == pytest.approx(SALIENT.R_s * np.array([1.15, 1.3, 1.1]))
    assert told["psi_f"] == pytest.approx(SALIENT.psi_f * np.array([1.0, 0.98, 0.96]))
    drive.run(1500)
    assert drive.truth.R_s == pytest.approx(SALIENT.R_s * 1.2)


def test_moving_magnets_give_or_take_energy_that_the_balance_knows() -> None:
    """A current that is held while the magnets lose flux: no voltage beyond the change of the flux linkage."""
    r = steady(with_effects(i_dq=-3.0 + 0j, warming=Warming(magnets=((0.0, 0.0), (0.1, -0.1)))), 0.02, 0.05)
    u = voltages(r).mean() - SALIENT.R_s * currents(r).mean()
    assert u == pytest.approx(-SALIENT.psi_f + 0j, rel=0.02)  # 10 % in 0.1 s
    assert abs(cmath.phase(-u)) < 0.02


def test_points_survive_the_scenarios_text_and_are_bounded() -> None:
    scenario = with_effects(warming=Warming(POINTS, FALLS))
    assert parse(text_of(scenario), "test.toml").effects == scenario.effects
    text = text_of(with_effects()) + "\n[effects.warming]\nwinding = "
    for given, said in (
        ("3", r"effects\.warming\.winding takes a list of points \[s, 1\], got 3"),
        ("[[0, 3]]", r"effects\.warming\.winding\[0\]\[1\] takes at least -0\.5 and at most 2, got 3"),
        ("[[1, 0], [0, 0]]", r"effects\.warming\.winding\[1\]\[0\] takes above 1, the one before, got 0"),
    ):
        with pytest.raises(ScenarioError, match=said):
            parse(text + given, "test.toml")


def test_courses_begin_at_none_and_reach_their_most() -> None:
    for course in (rise(0.3), rise_and_fall(0.4, 0.7), rise_and_fall(0.6, 1.0)):
        shares = np.array([share for _, share in points_of(course, 0.2, 3.0)])
        assert shares[0] == 0.0
        assert shares.max() == pytest.approx(0.2, rel=0.01)
    assert rise_and_fall(0.4, 0.7)(1.0) == pytest.approx(0.3)
