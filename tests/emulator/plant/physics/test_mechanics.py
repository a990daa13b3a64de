"""The shaft against closed forms: Coulomb's friction, the breakaway, a compliant shaft's resonance."""

import math

import numpy as np
import pytest

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.compliance import Compliance
from emulator.plant.physics.friction import Friction
from emulator.scenario.scenarios import Run
from tests.emulator.plant.physics.effect_runs import SALIENT, T_S, at, free, states, switched, with_effects

COASTING = SALIENT._replace(B=0.0)
OFF = {"enabled": False}  # the bridge: no current flows where the back-EMF stays below the dc link


def test_under_coulombs_friction_a_rotor_runs_down_in_a_straight_line() -> None:
    coulomb, f = 0.2, 20.0
    friction = Friction(coulomb, omega_0=0.05)
    drive = VirtualDrive(switched(with_effects(motor=COASTING, run=free(f), drive=OFF, friction=friction)))
    omega_m = np.array([s.omega_m for s in states(drive, 2000)])
    t = T_S * np.arange(len(omega_m))
    start = 2.0 * math.pi * f / COASTING.n_p
    turning = t < 0.95 * start * COASTING.J / coulomb
    assert omega_m[turning] == pytest.approx((start - coulomb / COASTING.J * t)[turning], abs=1e-3)
    assert abs(omega_m[t > 1.05 * start * COASTING.J / coulomb]).max() < 1e-2


@pytest.mark.parametrize(("share", "breaks"), [(0.9, False), (1.1, True)])
def test_a_rotor_at_rest_breaks_away_above_the_static_friction_only(share: float, breaks: bool) -> None:
    """Below it creeps, slowly; above it goes off with what the load has over Coulomb's friction."""
    friction = Friction(coulomb=0.1, static=0.2, omega_s=1.0, omega_0=0.02)
    load = -share * friction.static  # a negative one drives
    run = free(tau_L=load)
    drive = VirtualDrive(switched(with_effects(motor=COASTING, run=run, drive=OFF, friction=friction)))
    drive.run(2000)
    before = drive.plant.omega_m
    drive.run(1000)
    gained = (drive.plant.omega_m - before) / (1000 * T_S)
    if breaks:
        assert gained == pytest.approx((-load - friction.coulomb) / COASTING.J, rel=0.01)
    else:
        assert 0.0 < before < 0.05
        assert abs(gained) < 1e-3


def test_friction_takes_its_torque_times_the_way_from_the_shaft() -> None:
    drive = VirtualDrive(switched(with_effects(motor=COASTING, run=free(20.0), drive=OFF, friction=Friction(0.1))))
    drive.run(500)
    state = drive.plant
    lost = 0.5 * COASTING.J * ((2.0 * math.pi * 20.0 / COASTING.n_p) ** 2 - state.omega_m**2)
    assert state.W_friction == pytest.approx(lost, rel=1e-6)


def ringing(run: Run, compliance: Compliance) -> tuple[float, float]:
    """Frequency (rad/s) and decay (1/s) of the twist once the torque has gone, by a fit to a decaying sine."""
    drive = VirtualDrive(switched(with_effects(motor=COASTING, i_dq=3j, run=run, compliance=compliance)))
    drive.run(100)
    drive.write("control_word", 0)
    drive.run(30)
    x = np.array([s.twist for s in states(drive, 1000)])
    # x[n + 1] + x[n - 1] e^(-2 d T) = 2 e^(-d T) cos(w T) x[n]
    (a, b), *_ = np.linalg.lstsq(np.column_stack([x[10:-10], -x[:-20]]), x[20:], rcond=None)
    decay = -math.log(b) / 2.0 / (10 * T_S)
    return math.acos(a / 2.0 / math.sqrt(b)) / (10 * T_S), decay


def test_a_compliant_shaft_rings_at_the_resonance_of_its_two_inertias() -> None:
    stiffness, damping, J_L = 100.0, 0.02, 1.6e-3
    J = 1.0 / (1.0 / COASTING.J + 1.0 / J_L)
    omega, decay = ringing(free(), Compliance(stiffness, damping, J_L))
    assert decay == pytest.approx(damping / (2.0 * J), rel=0.001)
    assert omega == pytest.approx(math.sqrt(stiffness / J - decay**2), rel=1e-4)


def test_behind_a_compliant_shaft_a_dynamometer_holds_the_loads_end() -> None:
    stiffness, damping = 100.0, 0.02
    omega, decay = ringing(at(20.0), Compliance(stiffness, damping))
    assert decay == pytest.approx(damping / (2.0 * COASTING.J), rel=0.001)
    assert omega == pytest.approx(math.sqrt(stiffness / COASTING.J - decay**2), rel=1e-4)
