"""Our emulated drive beside motulator's simulation of the same machine; `make peers` shows all the numbers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from emulator.drive.virtual_drive import VirtualDrive
from tests.peers.cases import AVERAGED, BAR, REFERENCES, SWITCHED, Case, errors, recorded, switched
from tests.peers.saturated import by_curve, by_map, under_control
from tests.peers.speed import real_time_factors
from tests.peers.with_motulator import under_references, under_voltages

pytestmark = pytest.mark.peers

SOME = 2000  # control periods


@pytest.mark.parametrize("case", [AVERAGED, SWITCHED], ids=["averaged", "edges"])
def test_under_the_same_voltages_both_machines_do_the_same(case: Case) -> None:
    """Far below the bar: the equations are the same, and either side integrates them closely."""
    ours, voltages = recorded(case)
    found = errors(ours, under_voltages(case, voltages))
    assert max(found.values()) < 1e-4 * BAR, found


def test_under_the_same_references_both_drives_do_the_same() -> None:
    ours, _ = recorded(REFERENCES)
    found = errors(ours, under_references(REFERENCES, len(ours.t)))
    assert max(found.values()) < BAR, found


@pytest.mark.parametrize("edges", [False, True], ids=["averaged", "edges"])
def test_our_saturated_machine_does_the_same_when_it_is_told_to_the_peer(edges: bool) -> None:
    case = switched(by_curve()) if edges else by_curve()
    ours, voltages = recorded(case)
    found = errors(ours, under_voltages(case, voltages))
    assert max(found.values()) < 1e-4 * BAR, found


@pytest.mark.parametrize("edges", [False, True], ids=["averaged", "edges"])
def test_the_peers_saturated_machine_does_the_same_here_by_a_table_of_it(edges: bool, tmp_path: Path) -> None:
    """What remains is the map's misfit."""
    case = switched(by_map(tmp_path)) if edges else by_map(tmp_path)
    ours, voltages = recorded(case)
    found = errors(ours, under_voltages(case, voltages))
    assert max(found.values()) < 0.1 * BAR, found


def test_under_the_same_references_both_drives_do_the_same_with_the_peers_saturated_machine(tmp_path: Path) -> None:
    case = under_control(tmp_path)
    ours, _ = recorded(case)
    found = errors(ours, under_references(case, len(ours.t)))
    assert max(found.values()) < BAR, found


@pytest.mark.parametrize("by", ["curve", "map"])
def test_a_peer_without_the_saturation_misses_the_bar(by: str, tmp_path: Path) -> None:
    """With the inductances that the machine has without current."""
    case = by_curve() if by == "curve" else by_map(tmp_path)
    ours, voltages = recorded(case, SOME)
    unsaturated = VirtualDrive(case.scenario).plant_now().machine
    linear = replace(case, scenario=replace(case.scenario, motor=unsaturated), current=None, psi_0=None)
    found = errors(ours, under_voltages(linear, voltages))
    assert min(found.values()) > BAR, found


def test_a_machine_told_to_the_peer_by_its_map_is_the_same_machine() -> None:
    """With constant inductances; the way for one that saturates."""
    motor = AVERAGED.scenario.motor

    def current(psi: complex) -> complex:
        return complex((psi.real - motor.psi_f) / motor.L_d, psi.imag / motor.L_q)

    ours, voltages = recorded(AVERAGED, SOME)
    told = replace(AVERAGED, current=np.vectorize(current), psi_0=complex(motor.psi_f))
    assert max(errors(ours, under_voltages(told, voltages)).values()) < 1e-4 * BAR


@pytest.mark.parametrize("other", [{"L_q": 0.98}, {"R_s": 1.2}, {"psi_f": 0.99}, {"J": 1.05}])
def test_a_machine_that_differs_by_a_few_per_cent_misses_the_bar(other: dict[str, float]) -> None:
    """Else agreement would prove nothing."""
    ours, voltages = recorded(AVERAGED, SOME)
    motor = AVERAGED.scenario.motor
    changed = motor._replace(**{name: factor * getattr(motor, name) for name, factor in other.items()})
    wrong = replace(AVERAGED, scenario=replace(AVERAGED.scenario, motor=changed))
    assert max(errors(ours, under_voltages(wrong, voltages)).values()) > BAR


def test_voltages_a_control_period_late_miss_the_bar() -> None:
    ours, voltages = recorded(AVERAGED, SOME)
    u = voltages.u.copy()
    u[1:] = voltages.u[:-1]
    assert max(errors(ours, under_voltages(AVERAGED, replace(voltages, u=u))).values()) > BAR


def test_every_simulator_is_timed() -> None:
    factors = real_time_factors(200)
    assert set(factors) == {
        "ours, averaged", "ours, edges", "motulator, averaged", "motulator, edges", "gym-electric-motor, averaged",
    }
    assert all(factor > 0.0 for factor in factors.values())
    assert factors["ours, averaged"] > 10.0 * factors["motulator, averaged"]
