"""A free flux map from a recording of an emulated machine that saturates as no curve of the library does."""

import tomllib
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from bench.diagnoses.diagnosed_machine import machine_text
from bench.diagnoses.figures.figure import figures_text
from bench.diagnoses.figures.pictures import pictures
from bench.machine_file import Nominal, nominal_of
from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.legs import Inverter
from emulator.scenario.effects import NONE, MapFile
from emulator.scenario.motors import MOTORS
from emulator.scenario.scenarios import Excitation, Run, Scenario, drive_for
from estimator.diagnosis.diagnose import diagnose
from estimator.diagnosis.likelihood.given import Given
from estimator.diagnosis.likelihood.noise import flux_errors
from estimator.diagnosis.search.fitting import Fitted, fitted
from estimator.diagnosis.search.flux_map_fit import FluxMap, map_begun, told_map
from estimator.diagnosis.verdict import Diagnosis, Verdict
from estimator.machine import PARAMETERS, Machine
from estimator.physics.rows import Rows, rows_of
from estimator.physics.saturation import EFFECTS
from estimator.samples import Samples
from estimator.twin.currents import free_run
from estimator.twin.model import Model, residual
from tests.peers.saturated import baldor_current, tabled
from tests.support.samples import recorded

pytestmark = pytest.mark.thorough

BALDOR = MOTORS["baldor_ecs101m"]
NOMINAL = Machine(0.6, 20e-3, 90e-3, 0.45, BALDOR.machine.n_p, BALDOR.machine.i_rated)
TOLERANCE: Mapping[str, float] = dict.fromkeys(PARAMETERS, 0.1)
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


def samples_from(scenario: Scenario) -> Samples:
    samples = recorded(VirtualDrive(scenario), 25_000)
    return replace(samples, u_dc=np.full(len(samples), BALDOR.u_dc))


def rows_from(scenario: Scenario) -> Rows:
    return rows_of([samples_from(scenario)], NOMINAL, BALDOR.machine.i_rated)


def fit_to(rows: Rows) -> Fitted:
    begin = map_begun(rows, Model(NOMINAL))
    assert begin is not None
    return fitted(rows, Given(NOMINAL, TOLERANCE, 0.0), begin=begin)


@pytest.fixture(scope="module")
def fit(scenario: Scenario) -> Fitted:
    return fit_to(rows_from(scenario))


@pytest.fixture(scope="module")
def found(fit: Fitted) -> FluxMap:
    return told_map(fit.search, fit.choice)


def off_by(found: FluxMap) -> tuple[float, float]:
    """Rms and largest error of the flux linkage over its rms, where the recording has been."""
    psi_d, psi_q = np.meshgrid(np.linspace(0.25, 0.5, 31), np.linspace(-0.9, 0.9, 61))
    psi = (psi_d + 1j * psi_q).ravel()
    i = np.asarray(baldor_current(psi), np.complex128)
    seen = found.seen(i)
    assert np.count_nonzero(seen) > 200
    off, whole = np.abs(found.flux(i) - psi)[seen], np.sqrt(np.mean(np.abs(psi[seen]) ** 2))
    return float(np.sqrt(np.mean(off**2)) / whole), float(off.max() / whole)


def test_the_map_is_recovered_where_the_recording_has_been(fit: Fitted, found: FluxMap) -> None:
    rms, most = off_by(found)
    assert rms < HALF
    assert most < 2.0 * HALF
    assert fit.model.machine.R_s == pytest.approx(BALDOR.machine.R_s, rel=0.002)
    assert fit.choice == ()


def test_the_twin_runs_on_the_map(fit: Fitted) -> None:
    rows = fit.rows

    def off(model: Model) -> float:
        return float(np.sqrt(np.mean(np.abs(free_run(rows, model) - rows.i) ** 2)))

    assert off(fit.model) < 0.1 * off(replace(fit.model, bend=None))


def test_a_map_is_reciprocal_and_symmetric_and_its_stiffness_the_inverse_of_its_slopes(
    fit: Fitted, found: FluxMap
) -> None:
    i, h = np.array([-3.0 + 2.0j, -8.0 - 5.0j, 1.0 + 4.0j]), complex(1e-5)
    bend, machine = fit.model.bend, fit.model.machine
    assert bend is not None

    def flux(i: np.ndarray[tuple[int], np.dtype[np.complex128]]) -> np.ndarray[tuple[int], np.dtype[np.complex128]]:
        return machine.psi_f + machine.L_d * i.real + 1j * machine.L_q * i.imag + bend.flux(i)

    by_d = (flux(i + h) - flux(i - h)) / (2.0 * h)
    by_q = (flux(i + 1j * h) - flux(i - 1j * h)) / (2.0 * h)
    assert found.flux(i) == pytest.approx(flux(i), abs=1e-5)  # a last step less
    assert by_q.real == pytest.approx(by_d.imag, abs=1e-7)
    assert flux(i.conj()) == pytest.approx(flux(i).conj(), abs=1e-12)
    assert bend.stiffness(machine, i)(by_d) == pytest.approx(np.ones(3), abs=1e-4)
    assert bend.stiffness(machine, i)(by_q) == pytest.approx(np.full(3, 1j), abs=1e-4)


def test_errors_at_every_current_are_those_of_currents(fit: Fitted) -> None:
    """10 mA more at one sample are as many flux errors of the straight lines, wherever on the map."""
    rows, model = fit.rows, fit.model
    places = np.linspace(1000, len(rows) - 1000, 40).astype(int)
    for axis, step, L in ((0, 0.01, model.machine.L_d), (1, 0.01j, model.machine.L_q)):
        i = rows.i.copy()
        i[places] += step
        moved = rows.with_currents(i)
        change = flux_errors(residual(moved, moved, model) - residual(rows, rows, model), rows, model)[places - 1]
        assert [-change.real, -change.imag][axis] == pytest.approx(np.full(40, 0.01 * L), rel=0.05)


def test_where_the_recording_has_not_been_there_is_no_standard_error(found: FluxMap) -> None:
    std_d, std_q = found.std(np.array([-4.0 + 2.0j, -40.0 + 2.0j]))
    assert 0.0 < std_d[0] < 2e-3
    assert 0.0 < std_q[0] < 5e-3
    assert np.isnan(std_d[1])
    assert np.isnan(std_q[1])


def test_a_machine_of_constants_departs_from_them_by_nothing(scenario: Scenario, found: FluxMap) -> None:
    straight = fit_to(rows_from(replace(scenario, effects=NONE)))
    assert not any(part.told for part in told_map(straight.search, straight.choice).departures().values())
    assert all(part.told for part in found.departures().values())


@pytest.fixture(scope="module")
def lossy(scenario: Scenario) -> Diagnosis:
    """The diagnosis of the machine behind a bridge with a dead time."""
    there = replace(scenario, effects=scenario.effects._replace(inverter=Inverter(dead_time=DEAD_TIME)))
    return diagnose([samples_from(there)], NOMINAL)


@pytest.mark.slow
def test_saturations_are_named_by_a_map_and_the_dead_time_beside_it(lossy: Diagnosis) -> None:
    found = {finding.effect: finding for finding in lossy.findings}
    assert set(found) == {*EFFECTS, "inverter_voltage_error"}
    dead_time = found["inverter_voltage_error"].parameters["dead_time"]
    assert dead_time.value == pytest.approx(DEAD_TIME, abs=2.0 * (dead_time.std or 0.0))
    assert (dead_time.std or 1.0) < 0.1 * DEAD_TIME
    assert lossy.verdict in (Verdict.EXPLAINED, Verdict.PARTLY_EXPLAINED)
    assert lossy.fit is not None
    assert lossy.fit.free_run_rms_A.after < 0.05 * lossy.fit.free_run_rms_A.before
    assert "free map" in lossy.remarks[-1]


@pytest.mark.slow
def test_what_is_told_of_a_map_goes_into_machine_file_and_picture(lossy: Diagnosis) -> None:
    text = machine_text(lossy, Nominal({}), "lossy.parquet")
    assert nominal_of(tomllib.loads(text), "found.toml").given["psi_f"] > 0.0
    table = lossy.flux_map
    assert table is not None
    assert table.psi_d.shape == table.psi_q_std.shape == (len(table.i_d), len(table.i_q))
    assert "[flux_map]" in text
    assert '"flux-map"' in figures_text(pictures(lossy))
