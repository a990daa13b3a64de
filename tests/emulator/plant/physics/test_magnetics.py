"""The magnetics against closed forms and a measured map: saturation, reciprocity, demagnetisation, harmonics."""

import math
from pathlib import Path

import numpy as np
import pytest

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.demagnetisation import Demagnetisation
from emulator.plant.physics.flux_map import gradient, loaded, misfit
from emulator.plant.physics.harmonics import Harmonics
from emulator.plant.physics.saturation import Saturation
from emulator.scenario.effects import MapFile
from emulator.scenario.motors import MOTORS
from tests.emulator.plant.physics.effect_runs import (
    ROUND,
    SALIENT,
    T_S,
    Recording,
    T_S_of,
    Vectors,
    at,
    currents,
    flux_linkage,
    free,
    line,
    states,
    steady,
    switched,
    vector,
    voltages,
    with_effects,
)

I_RATED = SALIENT.i_rated
SATURATION = Saturation(L_d_drop=0.1, L_q_drop=0.3, cross_drop=0.08)


def flux_at(i_dq: complex, saturation: Saturation = SATURATION) -> complex:
    """psi_dq (Vs) at a current, from the steady state's voltage: u = R_s i + j omega_e psi."""
    r = steady(with_effects(i_dq=i_dq, run=at(10.0), saturation=saturation), 0.1, 0.01)
    turn = float(r["omega_e"].mean()) * T_S
    back_emf = complex(voltages(r).mean()) - SALIENT.R_s * math.cos(turn / 2.0) * complex(currents(r).mean())
    return back_emf * T_S / (2j * math.sin(turn / 2.0))


def test_the_inductances_at_rated_current_have_fallen_by_what_the_sizes_say() -> None:
    alone = SATURATION._replace(cross_drop=0.0)
    L_d = (flux_at(complex(I_RATED), alone).real - SALIENT.psi_f) / I_RATED
    L_q = flux_at(1j * I_RATED, alone).imag / I_RATED
    crossed = flux_at(I_RATED + 0.5j, SATURATION._replace(L_q_drop=0.0)).imag / 0.5
    assert L_d == pytest.approx(SALIENT.L_d * 0.9, rel=1e-3)
    assert L_q == pytest.approx(SALIENT.L_q * 0.7, rel=1e-3)
    assert crossed == pytest.approx(SALIENT.L_q * 0.92, rel=2e-3)


def test_without_current_the_inductances_are_the_motors() -> None:
    psi = flux_at(0.2 + 0.2j)
    assert (psi.real - SALIENT.psi_f) / 0.2 == pytest.approx(SALIENT.L_d, rel=0.01)
    assert psi.imag / 0.2 == pytest.approx(SALIENT.L_q, rel=0.01)


def test_a_negative_i_d_relieves_what_a_positive_one_saturates() -> None:
    minus, plus = flux_at(complex(-I_RATED)), flux_at(complex(I_RATED))
    assert SALIENT.psi_f - minus.real > 1.05 * (plus.real - SALIENT.psi_f)


def test_cross_saturation_is_reciprocal() -> None:
    """d(psi_d)/d(i_q) = d(psi_q)/d(i_d), or the field would be a source of energy."""
    i, step = 3.0 + 4.0j, 0.5
    d_by_q = (flux_at(i + 1j * step) - flux_at(i - 1j * step)).real
    q_by_d = (flux_at(i + step) - flux_at(i - step)).imag
    assert d_by_q < -1e-4
    assert d_by_q == pytest.approx(q_by_d, rel=0.01)


def test_a_measured_map_reproduces_its_points(shared_recordings: Path) -> None:
    file = shared_recordings / "baldor_flux_map" / "baldor_400rpm_map.npz"
    flux_map = loaded(file)
    with np.load(file) as points:
        i, psi = points["i_s_dq"].ravel(), points["psi_s_dq"].ravel()
    assert np.abs(i).max() > 30.0
    assert misfit(flux_map, i, psi) < 0.05
    step = 1e-6  # Vs
    for point in psi[::17]:  # reciprocal everywhere, whatever was measured
        by_d = (gradient(flux_map, point + step) - gradient(flux_map, point - step)) / (2.0 * step)
        by_q = (gradient(flux_map, point + 1j * step) - gradient(flux_map, point - 1j * step)) / (2.0 * step)
        assert by_d.imag == pytest.approx(by_q.real, abs=1e-4 * abs(by_d))


def test_a_drive_with_a_measured_map_has_the_measured_flux_linkages(shared_recordings: Path) -> None:
    """At points of the measurement that it can hold, from its voltage at steady state."""
    file = shared_recordings / "baldor_flux_map" / "baldor_400rpm_map.npz"
    motor = MOTORS["baldor_ecs101m"].machine
    with np.load(file) as points:
        i_all, psi_all = points["i_s_dq"].ravel(), points["psi_s_dq"].ravel()
    inside = np.flatnonzero((np.abs(i_all) < 15.0) & (np.abs(i_all) > 5.0))
    for n in inside[:: len(inside) // 6]:
        i, psi = complex(i_all[n]), complex(psi_all[n])
        scenario = with_effects(
            motor=motor, i_dq=i, run=at(20.0, motor), drive={"u_dc": 540.0, "bandwidth": 400.0},
            flux_map=MapFile(str(file)),
        )  # fmt: skip
        r = steady(scenario, 1.0, 0.05)
        assert complex(currents(r).mean()) == pytest.approx(i, abs=0.02)
        turn = float(r["omega_e"].mean()) * T_S
        back_emf = complex(voltages(r).mean()) - motor.R_s * math.cos(turn / 2.0) * i
        assert back_emf * T_S / (2j * math.sin(turn / 2.0)) == pytest.approx(psi, abs=0.01)


def test_current_and_flux_linkage_of_a_map_lead_to_one_another(shared_recordings: Path) -> None:
    """A drive at rest whose flux linkage is found by inversion carries the current that was asked for."""
    file = shared_recordings / "baldor_flux_map" / "baldor_400rpm_map.npz"
    motor = MOTORS["baldor_ecs101m"].machine
    drive = VirtualDrive(with_effects(motor=motor, drive={"u_dc": 540.0}, flux_map=MapFile(str(file))))
    assert abs(gradient(drive.plant_now().flux_map, drive.plant.psi)) < 1e-9  # it starts without current
    assert drive.truth.psi_f == pytest.approx(drive.plant.psi.real, abs=1e-12)


def test_demagnetisation_leaves_the_flux_linkage_and_kicks_the_current() -> None:
    share, when = 0.1, 100 * T_S
    scenario = with_effects(
        run=at(50.0), drive={"bandwidth": 100.0}, demagnetisation=Demagnetisation(share, when + 0.4 * T_S, 1e-9)
    )
    drive = VirtualDrive(scenario)
    drive.run(100)
    before, after = states(drive, 1)[-2:]
    kick = currents(drive.record(1))[0].real
    assert kick == pytest.approx(share * SALIENT.psi_f / SALIENT.L_d, rel=0.03)
    assert abs(before.psi) - abs(after.psi) == pytest.approx(SALIENT.R_s * kick * T_S, rel=0.05)  # no more than that


def test_demagnetisation_takes_its_share_of_the_back_emf() -> None:
    share = 0.1
    r = steady(with_effects(run=at(100.0), demagnetisation=Demagnetisation(share, 0.05)), 0.0, 0.2)
    before, after = voltages(r)[300:400].mean(), voltages(r)[-100:].mean()
    assert after.imag / before.imag == pytest.approx(1.0 - share, rel=1e-4)


def rippling(harmonics: Harmonics, i_dq: complex = 0j) -> tuple[Recording, Vectors]:
    """Two turns at 25 Hz, and the magnets' flux in the rotor frame they tell: psi - L i."""
    r = steady(with_effects(motor=ROUND, i_dq=i_dq, run=at(25.0), harmonics=harmonics), 0.2, 0.0801)
    turned = np.exp(-1j * r["theta_e"])
    return r, flux_linkage(r, ROUND.R_s) * turned - ROUND.L_d * currents(r)


def test_the_back_emfs_fifth_and_seventh_are_the_sixth_of_the_rotor_frame() -> None:
    """psi_d, psi_q rippling by d, q: (d - q)/2 turns at -5, (d + q)/2 at +7; its voltage is 5 and 7 times as much."""
    d, q = 0.03, 0.01
    r, psi_m = rippling(Harmonics(d_6=d, q_6=q))
    x, theta = psi_m[:-1] * np.exp(1j * r["theta_e"][:-1]), r["theta_e"][:-1]
    fundamental = line(x, theta, 1)
    assert fundamental == pytest.approx(ROUND.psi_f, rel=2e-3)
    assert 5.0 * line(x, theta, -5) / fundamental == pytest.approx(5.0 * (d - q) / 2.0, abs=1e-3)
    assert 7.0 * line(x, theta, 7) / fundamental == pytest.approx(7.0 * (d + q) / 2.0, abs=1e-3)


def test_the_twelfth_of_the_rotor_frame_is_the_eleventh_and_thirteenth() -> None:
    r, psi_m = rippling(Harmonics(d_12=0.01, q_12=0.004))
    x, theta = psi_m[:-1] * np.exp(1j * r["theta_e"][:-1]), r["theta_e"][:-1]
    assert line(x, theta, -11) / ROUND.psi_f == pytest.approx(0.003, abs=2e-4)
    assert line(x, theta, 13) / ROUND.psi_f == pytest.approx(0.007, abs=2e-4)


def test_torque_ripples_by_what_the_back_emf_gives_the_current() -> None:
    """3/2 n_p Re(conj(i) (j psi_m + d(psi_m)/d(theta))): its sixth with i_q alone is 3/2 n_p i_q psi_f (d + 6 q)."""
    d, q, i_q = 0.02, 0.01, 8.0
    harmonics = Harmonics(d_6=d, q_6=q)
    scenario = with_effects(motor=ROUND, i_dq=1j * i_q, run=at(2.0), drive={"bandwidth": 4e3}, harmonics=harmonics)
    drive = VirtualDrive(scenario)
    drive.run(1000)
    seen: list[tuple[float, float]] = []
    for _ in range(500):
        before = drive.plant
        drive.run(10)
        after = drive.plant
        turned = (after.theta_m - before.theta_m) % (2.0 * math.pi)
        middle = ROUND.n_p * (before.theta_m + 0.5 * turned)
        seen.append((middle, (after.W_shaft - before.W_shaft) / turned))
    theta, tau = np.array(seen).T
    k_t = 1.5 * ROUND.n_p * ROUND.psi_f * i_q
    assert line(tau, theta, 0).real == pytest.approx(k_t, rel=1e-3)
    assert 2.0 * line(tau, theta, 6) == pytest.approx(k_t * (d + 6.0 * q), rel=0.02)


def test_cogging_trades_speed_for_the_energy_of_its_detents() -> None:
    """A free rotor without friction and current: J omega^2 / 2 - cogging cos(6 theta_e) / (6 n_p) stays."""
    cogging = 0.3
    motor = SALIENT._replace(B=0.0)
    scenario = switched(with_effects(motor=motor, run=free(10.0), drive={"enabled": False},
                                     harmonics=Harmonics(cogging=cogging)))  # fmt: skip
    seen = states(VirtualDrive(scenario), 2000)
    omega_m = np.array([s.omega_m for s in seen])
    height = cogging / (6.0 * motor.n_p)  # J
    assert 0.5 * motor.J * (omega_m.max() ** 2 - omega_m.min() ** 2) == pytest.approx(2.0 * height, rel=1e-3)
    total = [0.5 * motor.J * s.omega_m**2 - height * math.cos(6.0 * motor.n_p * s.theta_m) for s in seen]
    assert np.ptp(total) < 1e-4 * height


def test_the_inductances_harmonic_opens_and_closes_the_inductance_six_times_a_turn() -> None:
    """1/L(theta_e) = 1/L + share/L_q cos 6 theta_e, from the flux linkage that i_d adds."""
    share, i_d = 0.1, 8.0
    scenario = with_effects(motor=ROUND, i_dq=complex(i_d), run=at(25.0), drive={"bandwidth": 4e3},
                            harmonics=Harmonics(inductance=share))  # fmt: skip
    r = steady(scenario, 0.2, 0.0801)
    psi = flux_linkage(r, ROUND.R_s) * np.exp(-1j * r["theta_e"]) - ROUND.psi_f
    told = currents(r).real / psi.real  # 1/L
    theta = r["theta_e"]
    assert line(told[:-1], theta[:-1], 0).real == pytest.approx(1.0 / ROUND.L_d, rel=2e-3)
    assert 2.0 * line(told[:-1], theta[:-1], 6) == pytest.approx(share / ROUND.L_q, rel=0.03)


def test_recordings_are_cut_as_they_are_used() -> None:
    """What these tests take for whole turns are some."""
    r, _ = rippling(Harmonics())
    turned = float(np.sum(r["omega_e"][:-1])) * T_S_of(r) / (2.0 * math.pi)
    assert turned == pytest.approx(2.0, abs=1e-9)
    assert vector(r["i_d"], r["i_q"]).shape == (801,)
