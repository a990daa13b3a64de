"""Our emulated drive beside motulator's simulation of the same machine; `make peers` shows all the numbers."""

from dataclasses import replace

import numpy as np
import pytest

from tests.peers.cases import AVERAGED, BAR, REFERENCES, SWITCHED, Case, errors, recorded
from tests.peers.speed import real_time_factors
from tests.peers.with_motulator import under_references, under_voltages

pytestmark = pytest.mark.slow

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
