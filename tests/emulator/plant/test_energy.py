"""The power balance: what comes in is heat, what is stored and what the shaft gets, whatever the effects."""

import random
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.dynamics import mechanical_energy, stored_energy
from emulator.scenario.effects import NONE, Effects, MapFile
from emulator.scenario.motors import MOTORS
from emulator.scenario.scenarios import PAPER_RUN, Excitation, Run, Scenario, drive_for
from tests.emulator.plant.physics.effects import ALL, only, scenario_with

BAR = 1e-3  # of the energy that comes in
NAMES = [name for name in Effects._fields if getattr(ALL, name) != getattr(NONE, name)]


def imbalances(drive: VirtualDrive, periods: int) -> tuple[float, float, float]:
    """By how much the electrical and the mechanical balance are off, and the energy (J) that went in or to heat."""
    drive.run(1)
    start, before, given = drive.plant_now(), drive.plant, drive.energy_given
    drive.run(periods)
    end, after = drive.plant_now(), drive.plant
    came = {name: getattr(after, name) - getattr(before, name) for name in after._fields if name.startswith("W_")}
    stored = stored_energy(end, after) - stored_energy(start, before)
    moved = mechanical_energy(end, after) - mechanical_energy(start, before)
    electrical = came["W_dc"] + came["W_stray"] + drive.energy_given - given
    electrical -= came["W_inverter"] + came["W_copper"] + came["W_iron"] + came["W_shaft"] + stored
    mechanical = came["W_shaft"] - came["W_friction"] - came["W_load"] - moved
    return electrical, mechanical, abs(came["W_dc"]) + came["W_copper"] + came["W_iron"] + came["W_inverter"]


@pytest.mark.parametrize("name", ["none", "all", *NAMES])
def test_energy_is_balanced_with_every_effect_and_with_all(name: str) -> None:
    effects = ALL if name == "all" else NONE if name == "none" else only(name)
    electrical, mechanical, turned_over = imbalances(VirtualDrive(scenario_with(effects)), 3000)
    assert turned_over > 10.0  # J
    assert abs(electrical) < BAR * turned_over
    assert abs(mechanical) < BAR * turned_over


@pytest.mark.parametrize("seed", range(24))
def test_energy_is_balanced_for_any_combination_of_effects(seed: int) -> None:
    drawn = random.Random(seed)
    effects = only(*(name for name in NAMES if drawn.random() < 0.5))
    run = drawn.choice([PAPER_RUN.run, Run(speed_rpm=drawn.uniform(-1500.0, 1500.0))])
    scenario = replace(scenario_with(effects), run=replace(run, seed=seed + 1))
    electrical, mechanical, turned_over = imbalances(VirtualDrive(scenario), 2000)
    assert abs(electrical) < BAR * turned_over
    assert abs(mechanical) < BAR * turned_over


@pytest.mark.parametrize("enabled", [True, False])
def test_energy_is_balanced_when_the_bridge_is_off_and_its_diodes_rectify(enabled: bool) -> None:
    # Above the speed at which the back-EMF reaches through the diodes the machine feeds the dc link
    effects = only("inverter", "iron_loss", "saturation")
    run = Run(speed_rpm=4500.0)
    scenario = replace(scenario_with(effects, enabled=enabled, field_weakening=True), run=run, excitation=Excitation())
    drive = VirtualDrive(scenario)
    electrical, mechanical, turned_over = imbalances(drive, 2000)
    assert abs(electrical) < BAR * turned_over
    assert abs(mechanical) < BAR * turned_over
    if not enabled:
        assert drive.plant.W_dc < -10.0  # J, into the link
        assert drive.plant.W_inverter > 0.0


def test_energy_is_balanced_on_a_measured_flux_map(shared_recordings: Path) -> None:
    measured = shared_recordings / "baldor_flux_map" / "baldor_400rpm_map.npz"
    motor = MOTORS["baldor_ecs101m"]
    scenario = Scenario(
        "map", motor.machine, drive_for(motor.machine, motor.u_dc, T_s=1e-4, bridge="switched"),
        Run(speed_rpm=600.0), Excitation(i_d_ref=2.0, i_q_ref=3.0, i_d_step=2.0, i_q_step=2.0),
        only("harmonics", "demagnetisation", "iron_loss")._replace(flux_map=MapFile(str(measured))),
    )  # fmt: skip
    electrical, mechanical, turned_over = imbalances(VirtualDrive(scenario), 3000)
    assert turned_over > 10.0
    assert abs(electrical) < BAR * turned_over
    assert abs(mechanical) < BAR * turned_over


def test_all_effects_give_the_same_bits_for_a_seed_however_the_run_is_cut() -> None:
    def recorded(cuts: tuple[int, ...], seed: int = 3) -> dict[str, np.ndarray]:
        scenario = scenario_with(ALL)
        drive = VirtualDrive(replace(scenario, run=replace(scenario.run, seed=seed)))
        parts = [drive.record(n) for n in cuts]
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    whole, pieces, other = recorded((1500,)), recorded((1, 0, 7, 300, 2, 1190)), recorded((1500,), 4)
    for name, column in whole.items():
        assert np.array_equal(column, pieces[name]), name
    assert len(other["i_d"]) != len(whole["i_d"]) or not np.array_equal(other["i_d"], whole["i_d"])
