"""Digital Hall sensors beside closed forms: what a drive's angle is off, between edges and at them."""

import math

import numpy as np
import pytest

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.hall import BY_SECTOR, BY_TURN, MIDDLE, Hall
from emulator.scenario.scenarios import Run
from tests.emulator.plant.physics.effect_runs import ROUND, Column, at, free, with_effects

F = 37.3  # Hz, electrical
SECTOR = math.pi / 3.0
DISPLACED = Hall(BY_TURN, displaced_a=0.05, displaced_b=-0.03, displaced_c=-0.02)
EDGES = (0.05, -0.02, -0.03)  # by which they are displaced, one sector after another: a, c, b


def off(hall: Hall, run: Run) -> tuple[Column, Column]:
    """The true angle, and by how much that of a drive is further; rad, electrical."""
    true, told = (
        VirtualDrive(with_effects(motor=ROUND, i_dq=2j, run=run, hall=each)).record(4000)["theta_e"]
        for each in (Hall(), hall)
    )
    return true, np.angle(np.exp(1j * (told - true)))


def at_edges(true: Column, place: float) -> tuple[Column, Column]:
    """Of each sample the sector by displaced edges, 0 to 5, and how far it is behind its edge (rad)."""
    x = (true - place) % math.tau
    edges = np.array([n * SECTOR + EDGES[n % 3] for n in range(-1, 8)])
    n = np.searchsorted(edges, x, side="right") - 1
    return ((n - 1) % 6).astype(float), x - edges[n]


@pytest.mark.parametrize("place", [0.0, math.radians(30.0)])
def test_by_the_rate_of_a_turn_an_angle_is_off_by_what_the_last_edge_is_and_waits_for_the_next(place: float) -> None:
    true, wrong = off(DISPLACED._replace(place=place), at(F, ROUND))
    sector, behind = at_edges(true, place)
    last = np.array(EDGES)[sector.astype(int) % 3]
    assert wrong == pytest.approx(np.minimum(behind, SECTOR) - behind - last, abs=1e-9)


def test_by_the_rate_of_a_sector_it_also_turns_too_fast_behind_a_narrow_one() -> None:
    true, wrong = off(DISPLACED._replace(rate=BY_SECTOR), at(F, ROUND))
    sector, behind = at_edges(true, 0.0)
    last, before = (np.array(EDGES)[(sector.astype(int) - n) % 3] for n in (0, 1))
    gone = np.minimum(behind * SECTOR / (SECTOR + last - before), SECTOR)
    assert wrong == pytest.approx(gone - behind - last, abs=1e-9)


@pytest.mark.parametrize("f", [F, -F])
def test_sensors_in_their_places_are_right_at_a_steady_speed_both_ways(f: float) -> None:
    _, wrong = off(Hall(rate=BY_TURN), at(f, ROUND))
    assert np.max(np.abs(wrong)) < 1e-9


def test_an_edge_comes_half_a_hysteresis_late_either_way() -> None:
    for f in (F, -F):
        _, wrong = off(Hall(rate=BY_TURN, hysteresis=0.04), at(f, ROUND))
        assert wrong == pytest.approx(np.full(len(wrong), -0.02 * math.copysign(1.0, f)), abs=1e-9)


def test_the_middle_of_a_sector_stands_until_the_next_edge() -> None:
    true, wrong = off(Hall(rate=MIDDLE), at(F, ROUND))
    assert wrong == pytest.approx(0.5 * SECTOR - true % SECTOR, abs=1e-9)


def test_a_raw_angle_is_recorded_beside_a_drive_that_turns_by_a_better_one() -> None:
    raw, plain = (
        VirtualDrive(with_effects(motor=ROUND, i_dq=2j, run=at(F, ROUND), hall=Hall(rate=BY_TURN, raw=n))).record(4000)
        for n in (1, 0)
    )
    assert len(np.unique(np.round(raw["theta_e"], 6))) == 6
    assert all(np.array_equal(raw[name], plain[name]) for name in ("u_d", "u_q", "i_d", "i_q", "omega_e"))


def test_a_motor_starts_by_its_edges_and_turns_round() -> None:
    """From rest the middle of a sector stands in until edges have come; the loop stays closed."""
    drive = VirtualDrive(with_effects(motor=ROUND, i_dq=2j, run=free(0.0, ROUND), hall=Hall(rate=BY_SECTOR)))
    drive.run(20_000)
    assert drive.read("error_code") == 0.0
    assert drive.plant.omega_m > 10.0
