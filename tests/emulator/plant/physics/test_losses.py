"""Windings, iron and heat against closed forms: imbalance, shorted turns, skin effect, iron loss, temperatures."""

import math

import numpy as np
import pytest

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.dynamics import advanced, motor_current
from emulator.plant.machine import Machine
from emulator.plant.physics.imbalance import Imbalance
from emulator.plant.physics.iron_loss import IronLoss
from emulator.plant.physics.legs import vector as held
from emulator.plant.physics.skin import Skin
from emulator.plant.physics.thermal import REFERENCE, Thermal
from emulator.plant.physics.turn_short import TurnShort
from tests.emulator.plant.physics.effect_runs import (
    ROUND,
    SALIENT,
    T_S,
    at,
    currents,
    line,
    middle,
    states,
    steady,
    voltage_error,
    with_effects,
)

TURN = 2.0 * math.pi


@pytest.mark.parametrize(("phase", "degrees"), [("a", 0.0), ("b", -120.0), ("c", 120.0)])
def test_a_phase_with_more_resistance_gives_a_voltage_that_turns_backwards(phase: str, degrees: float) -> None:
    """R_s share / 3 of the current both ways: forwards as resistance, backwards turned by the phase's axis twice."""
    share, i = 0.3, 5.0
    imbalance = Imbalance(**{phase: share})
    scenario = with_effects(i_dq=complex(i), run=at(50.0), drive={"bandwidth": 4e3}, imbalance=imbalance)
    r = steady(scenario, 0.1, 0.0401)
    error = voltage_error(r, SALIENT)
    expected = SALIENT.R_s * share / 3.0 * i
    assert abs(line(error, middle(r), 0)) == pytest.approx(expected, rel=0.01)
    assert abs(line(error, middle(r), -2) - expected * np.exp(1j * math.radians(degrees))) < 0.02 * expected


def test_shorted_turns_carry_their_back_emf_over_their_impedance_and_brake_with_its_loss() -> None:
    """mu omega psi_f / |R_t + mu R_s + j omega (L_t + 2/3 mu^2 L)|, the stator's own current being held at zero."""
    mu, R_t, omega = 0.1, 0.5, TURN * 50.0
    short = TurnShort(mu, R_t)
    drive = VirtualDrive(with_effects(motor=ROUND, run=at(50.0), drive={"bandwidth": 4e3}, turn_short=short))
    drive.run(1000)
    seen = states(drive, 400)
    i_t = np.array([s.i_t for s in seen[:-1]])
    R = R_t + mu * ROUND.R_s
    Z = R + 1j * omega * (1e-4 * R + 2.0 / 3.0 * mu**2 * ROUND.L_d)
    amplitude = abs(2.0 * line(i_t, omega * T_S * np.arange(400.0), 1))
    assert amplitude == pytest.approx(mu * omega * ROUND.psi_f / abs(Z), rel=0.02)
    taken = (seen[-1].W_load - seen[0].W_load) / (400 * T_S)
    assert taken == pytest.approx(-0.5 * R * amplitude**2, rel=0.05)


def impedance(motor: Machine, skin: Skin, frequency: float) -> complex:
    """Of a locked rotor along the d axis, ohm, by a sine of voltage, once it has settled."""
    T = 1.0 / (frequency * 400.0)
    drive = VirtualDrive(with_effects(motor=motor, skin=skin))
    plant, state = drive.plant_now(), drive.plant
    i: list[float] = []
    for n in range(400 * 25):
        u = complex(math.cos(TURN * (n + 0.5) / 400.0))
        state = advanced(plant, held(u, 310.0), n * T, T, 2, state)
        i.append(motor_current(plant, state).real)
    angle = TURN * (np.arange(400 * 5) + 1.0) / 400.0  # after each period
    hold = math.sin(math.pi / 400.0) / (math.pi / 400.0)
    return hold / (2.0 * line(np.array(i[-400 * 5 :]), angle, 1))


def test_skin_effect_raises_the_resistance_at_its_frequency_as_told_and_not_at_dc() -> None:
    skin = Skin(rise=0.5, frequency=400.0)
    motor = ROUND._replace(L_d=2e-4, L_q=2e-4)  # so that it settles soon
    assert impedance(motor, Skin(), 400.0).real == pytest.approx(motor.R_s, rel=1e-3)
    assert impedance(motor, skin, 400.0).real == pytest.approx(1.5 * motor.R_s, rel=1e-3)
    assert impedance(motor, skin, 4000.0).real == pytest.approx((1.0 + 2.0 * 0.5 * 100.0 / 101.0) * motor.R_s, rel=2e-3)
    r = steady(with_effects(motor=motor, i_dq=5.0 + 0j, skin=skin), 0.1, 0.01)
    assert r["u_d"].mean() / r["i_d"].mean() == pytest.approx(motor.R_s, rel=1e-4)


def iron_power(iron: IronLoss, frequency: float) -> tuple[float, float]:
    """Loss in the iron and power from the dynamometer, W, without stator current."""
    drive = VirtualDrive(with_effects(run=at(frequency), drive={"u_dc": 1000.0, "sub_steps": 40}, iron_loss=iron))
    drive.run(2000)
    before = drive.plant
    drive.run(1000)
    after = drive.plant
    return (after.W_iron - before.W_iron) / (1000 * T_S), -(after.W_load - before.W_load) / (1000 * T_S)


def test_eddy_currents_take_three_halves_of_the_square_of_the_back_emf_over_their_resistance_from_the_shaft() -> None:
    R_c, lag, omega = 200.0, 2e-5, TURN * 100.0
    loss, drag = iron_power(IronLoss(R_c, 0.0, lag), 100.0)
    eddy = 1.5 * (omega * SALIENT.psi_f) ** 2 / R_c
    assert loss == pytest.approx(eddy, rel=0.02)
    assert drag == pytest.approx(loss, rel=0.01)


def test_hysteresis_adds_a_loss_that_grows_with_the_first_power_of_speed() -> None:
    R_c, omega_h, lag = 400.0, 400.0, 2e-5
    both, eddy = IronLoss(R_c, omega_h, lag), IronLoss(R_c, 0.0, lag)
    added = [iron_power(both, f)[0] - iron_power(eddy, f)[0] for f in (100.0, 200.0)]
    assert added[1] / added[0] == pytest.approx(2.0, rel=0.03)
    assert added[0] == pytest.approx(1.5 * SALIENT.psi_f**2 * omega_h * TURN * 100.0 / R_c, rel=0.03)


def test_the_irons_current_makes_no_flux_and_is_missed_in_the_voltage() -> None:
    """R_c (1 + j omega lag) i_i = j omega psi with psi = psi_f - L i_i, as the stator's current is held at zero."""
    R_c, omega, lag = 200.0, TURN * 100.0, 2e-5
    scenario = with_effects(run=at(100.0), drive={"T_s": 2.5e-5}, iron_loss=IronLoss(R_c, 0.0, lag))
    u = complex(voltage_error(steady(scenario, 0.2, 0.0201), SALIENT).mean())
    along, across = R_c / omega, R_c * lag
    i_d, i_q = np.linalg.solve([[along, -across - SALIENT.L_q], [across + SALIENT.L_d, along]], [0.0, SALIENT.psi_f])
    assert u == pytest.approx(omega * complex(SALIENT.L_q * i_q, -SALIENT.L_d * i_d), rel=0.01)
    assert u == pytest.approx(omega**2 * SALIENT.L_q * SALIENT.psi_f / R_c, rel=0.05)


def test_the_winding_warms_up_as_a_first_order_with_the_rise_of_its_own_resistance_in_it() -> None:
    """C dT/dt = P_0 (1 + alpha T) - T / R for T above 23.4 degC, the housing being large."""
    i, C, R, alpha = 6.0, 0.5, 0.8, 0.00393
    thermal = Thermal(C_w=C, R_wh=R, C_h=1e9, alpha=alpha)
    r = steady(with_effects(i_dq=complex(i), thermal=thermal, drive={"bandwidth": 500.0}), 0.0, 1.5)
    P_0 = 1.5 * SALIENT.R_s * i**2
    rate = (1.0 / R - P_0 * alpha) / C
    late = slice(1000, None)  # the current has been there for long
    T = P_0 / C / rate * (1.0 - np.exp(-rate * r["t"][late]))
    assert r["u_d"][late] / r["i_d"][late] == pytest.approx(SALIENT.R_s * (1.0 + alpha * T), rel=2e-3)
    assert T[-1] > 30.0


def test_at_last_every_node_is_where_its_losses_hold_it_and_the_magnets_have_lost_flux() -> None:
    i, ambient, R_wh, R_ha, beta = 6.0, 30.0, 0.3, 0.5, -0.0011
    thermal = Thermal(0.4, 0.2, 0.5, R_wh, 1.0, R_ha, ambient, 0.00393, beta)
    drive = VirtualDrive(with_effects(i_dq=complex(i), run=at(25.0), thermal=thermal))
    drive.run(90000)
    truth, r = drive.truth, drive.record(400)
    P = 1.5 * truth.R_s * i**2
    housing = ambient + P * R_ha
    assert truth.temp_magnet == pytest.approx(housing, abs=0.05)
    assert truth.temp_winding == pytest.approx(housing + P * R_wh, abs=0.05)
    assert truth.R_s == pytest.approx(SALIENT.R_s * (1.0 + 0.00393 * (truth.temp_winding - REFERENCE)), rel=1e-9)
    psi_d = (r["u_q"].mean() - truth.R_s * r["i_q"].mean()) / r["omega_e"].mean()
    psi_f = SALIENT.psi_f * (1.0 + beta * (housing - REFERENCE))
    assert psi_d - SALIENT.L_d * currents(r).mean().real == pytest.approx(psi_f, rel=1e-3)
