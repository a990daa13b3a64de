"""A free flux map from a recording of an emulated machine that saturates as no curve of the library does."""

from dataclasses import replace

import numpy as np
import pytest

from emulator.effects import NONE, MapFile
from emulator.motors import MOTORS
from emulator.physics.legs import Inverter
from emulator.scenarios import Excitation, Run, Scenario, drive_for
from emulator.virtual_drive import VirtualDrive
from estimator.machine import Machine
from estimator.mismatch.columns import Model
from estimator.mismatch.flux_map_fit import FluxMap, fitted_map
from estimator.physics.rows import Rows, rows_of
from tests.peers.saturated import baldor_current, tabled
from tests.samples import recorded

BALDOR = MOTORS["baldor_ecs101m"]
NOMINAL = Machine(0.6, 20e-3, 90e-3, 0.45, BALDOR.machine.n_p, BALDOR.machine.i_rated)
DEAD_TIME = 2e-6  # s
HALF = 0.01  # of the rms flux linkage: half of what is asked of a map


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    i, psi = tabled()
    file = tmp_path_factory.mktemp("map") / "map.npz"
    np.savez(file, i_s_dq=i, psi_s_dq=psi)
    drive = drive_for(BALDOR.machine, BALDOR.u_dc, T_s=1e-4, bridge="switched", timer_counts=0)
    excitation = Excitation(-4.0, 0.0, 6.0, 8.0, 0.02, kind="staircase", i_d_levels=7, level_time=0.1)
    run = Run(speed_rpm=300.0, rise_rpm=300.0, ramp_time=2.0)
    return Scenario("map.toml", BALDOR.machine, drive, run, excitation, NONE._replace(flux_map=MapFile(str(file))))


def rows_from(scenario: Scenario) -> Rows:
    samples = recorded(VirtualDrive(scenario), 25_000)
    u_dc = np.full(len(samples), BALDOR.u_dc)
    return rows_of([replace(samples, u_dc=u_dc)], NOMINAL, BALDOR.machine.i_rated)


@pytest.fixture(scope="module")
def found(scenario: Scenario) -> FluxMap:
    return fitted_map(rows_from(scenario), Model(NOMINAL))


def off_by(found: FluxMap) -> tuple[float, float]:
    """Rms and largest error of the flux linkage over its rms, where the recording has been."""
    psi_d, psi_q = np.meshgrid(np.linspace(0.25, 0.5, 31), np.linspace(-0.9, 0.9, 61))
    psi = (psi_d + 1j * psi_q).ravel()
    i = np.asarray(baldor_current(psi), np.complex128)
    seen = found.seen(i)
    assert np.count_nonzero(seen) > 200
    off, whole = np.abs(found.flux(i) - psi)[seen], np.sqrt(np.mean(np.abs(psi[seen]) ** 2))
    return float(np.sqrt(np.mean(off**2)) / whole), float(off.max() / whole)


def test_the_map_is_recovered_where_the_recording_has_been(found: FluxMap) -> None:
    rms, most = off_by(found)
    assert rms < HALF
    assert most < 2.0 * HALF
    assert found.R_s.value == pytest.approx(BALDOR.machine.R_s, rel=0.01)


def test_other_effects_that_were_found_are_taken_off_first(scenario: Scenario) -> None:
    lossy = replace(scenario, effects=scenario.effects._replace(inverter=Inverter(dead_time=DEAD_TIME)))
    rows = rows_from(lossy)
    with_it = Model(NOMINAL, {"inverter_voltage_error": (DEAD_TIME, 0.0, 0.05), "q_axis_saturation": (0.3,)})
    rms, _ = off_by(fitted_map(rows, with_it))
    without, _ = off_by(fitted_map(rows, Model(NOMINAL)))
    assert rms < HALF
    assert without > 2.0 * rms


def test_a_map_is_reciprocal_and_symmetric_and_its_stiffness_the_inverse_of_its_slopes(found: FluxMap) -> None:
    i, h = np.array([-3.0 + 2.0j, -8.0 - 5.0j, 1.0 + 4.0j]), complex(1e-5)
    by_d = (found.flux(i + h) - found.flux(i - h)) / (2.0 * h)
    by_q = (found.flux(i + 1j * h) - found.flux(i - 1j * h)) / (2.0 * h)
    assert by_q.real == pytest.approx(by_d.imag, abs=1e-7)
    assert found.flux(i.conj()) == pytest.approx(found.flux(i).conj(), abs=1e-12)
    assert found.stiffness(i)(by_d) == pytest.approx(np.ones(3), abs=1e-4)
    assert found.stiffness(i)(by_q) == pytest.approx(np.full(3, 1j), abs=1e-4)


def test_where_the_recording_has_not_been_there_is_no_standard_error(found: FluxMap) -> None:
    std_d, std_q = found.std(np.array([-4.0 + 2.0j, -40.0 + 2.0j]))
    assert 0.0 < std_d[0] < 1e-3
    assert 0.0 < std_q[0] < 1e-3
    assert np.isnan(std_d[1])
    assert np.isnan(std_q[1])




def test_a_machine_of_constants_departs_from_them_by_nothing(scenario: Scenario, found: FluxMap) -> None:
    straight = fitted_map(rows_from(replace(scenario, effects=NONE)), Model(NOMINAL)).departures()
    bent = found.departures()
    assert all(share < 0.003 for share in straight.values()), straight
    assert all(share > 0.01 for share in bent.values()), bent
