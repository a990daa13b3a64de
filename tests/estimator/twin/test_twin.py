"""The twin against the emulated drive behind a bridge with edges, which shares no equation with it."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.imbalance import Imbalance
from emulator.plant.physics.legs import Inverter
from emulator.plant.physics.saturation import Saturation
from emulator.plant.physics.sensing import AngleSensing, CurrentSensing
from emulator.plant.physics.skin import Skin
from emulator.plant.physics.timing import Timing
from emulator.scenario.effects import NONE, Effects
from emulator.scenario.scenarios import PAPER, Excitation, Run, Scenario
from estimator.diagnosis.answer.quality import fit_quality
from estimator.diagnosis.likelihood.cleaning import raw
from estimator.diagnosis.likelihood.given import Given
from estimator.diagnosis.likelihood.noise import filter_of, noise_of, whitened
from estimator.diagnosis.search.fitting import polished
from estimator.diagnosis.verdict import ErrorChange
from estimator.machine import PARAMETERS
from estimator.physics.library import LIBRARY
from estimator.physics.rows import Rows, rows_of
from estimator.samples import Samples
from estimator.twin.currents import followed_currents, free_run, implied_voltage, one_step
from estimator.twin.model import Model
from tests.support.samples import machine_of

T_S = 1e-4  # s
NOISE = 0.01  # A, of each phase current
PHASOR = NOISE * math.sqrt(2.0 / 3.0)  # A, of i_d and of i_q
RATED = PAPER.motor.i_rated
ONES = NONE._replace(
    inverter=Inverter(dead_time=2e-6, u_transistor=1.0, u_diode=1.0),
    saturation=Saturation(L_d_drop=0.1, L_q_drop=0.2, cross_drop=0.05),
    skin=Skin(rise=0.5, frequency=300.0),
    imbalance=Imbalance(a=0.1, b=-0.05, c=-0.05),
    current_sensing=CurrentSensing(1.02, 0.99, 0.99, 0.02, -0.01, -0.01),
    angle_sensing=AngleSensing(offset=0.03 / PAPER.motor.n_p),
)
"""In the library's terms: `SIZES`."""
SIZES = {
    "inverter": {"inverter_voltage_error": (2e-6, 1.0, 0.005 * RATED, 0.01 * RATED)},
    "saturation": {"d_axis_saturation": (0.1,), "q_axis_saturation": (0.2,), "cross_saturation": (0.05,)},
    "skin": {"ac_resistance": (1.0, 300.0)},
    "imbalance": {"phase_resistance_imbalance": (0.1 * PAPER.motor.R_s, 0.0)},
    "current_sensing": {"current_sensor_gain": (0.02, 0.0, 0.0), "current_sensor_offset": (0.02, 0.0)},
    "angle_sensing": {"angle_offset": (0.03,)},
}
ALL_SIZES = {name: sizes for found in SIZES.values() for name, sizes in found.items()}


def drive_with(effects: Effects = NONE, noise: float = 0.0, speed_rpm: float = 600.0) -> Scenario:
    drive = replace(PAPER.drive, noise_i=noise, adc_bits=0, encoder_counts=0, T_s=T_S, bridge="switched")
    excitation = Excitation(-0.3 * RATED, 0.4 * RATED, 0.2 * RATED, 0.2 * RATED)
    return replace(PAPER, drive=drive, run=Run(speed_rpm=speed_rpm), excitation=excitation, effects=effects)


def rows_from(scenario: Scenario, periods: int = 6000) -> Rows:
    drive = VirtualDrive(scenario)
    drive.run(1000)
    r = drive.record(periods)
    tick = np.rint(r["t"] / T_S).astype(int)
    ends = [0, *(np.flatnonzero(np.diff(tick) != 1) + 1), len(tick)]
    whole = Samples(r["theta_e"], r["omega_e"], r["i_d"], r["i_q"], r["u_d"], r["u_q"], T_S, u_dc=r["u_dc"])
    runs = [replace(whole[a:b], t0=float(r["t"][a])) for a, b in itertools.pairwise(ends) if b - a > 1]
    return rows_of(runs, machine_of(scenario.motor), scenario.motor.i_rated)


TRUTH = machine_of(PAPER.motor)
PLAIN = Model(TRUTH)


def rms(x: np.ndarray[tuple[int, ...], np.dtype[np.complex128]]) -> float:
    """Of d and q together."""
    return float(np.sqrt(np.mean(np.abs(x) ** 2) / 2.0))


@pytest.fixture(scope="module")
def noisy() -> Rows:
    return rows_from(drive_with(noise=NOISE), 20000)


@pytest.fixture(scope="module")
def clean() -> Rows:
    return rows_from(drive_with())


@pytest.fixture(scope="module")
def everything() -> Rows:
    return rows_from(drive_with(ONES))


@pytest.fixture(scope="module")
def broken() -> Rows:
    return rows_from(drive_with(ONES._replace(timing=Timing(lost=0.002))))


def test_without_noise_the_currents_imply_the_recorded_voltage(clean: Rows) -> None:
    assert rms(implied_voltage(clean, PLAIN) - clean.u) < 2e-4 * rms(clean.u)


def test_without_noise_a_free_run_and_a_step_meet_the_measured_currents(clean: Rows) -> None:
    assert rms(free_run(clean, PLAIN) - clean.i) < 2e-4 * RATED
    assert rms(one_step(clean, PLAIN) - clean.i[1:]) < 2e-5 * RATED


def test_with_noise_a_free_run_is_off_by_the_noise_once_its_starts_has_decayed(noisy: Rows) -> None:
    since = np.arange(len(noisy) + 1) % 1000 * T_S
    off = (free_run(noisy, PLAIN) - noisy.i)[since > 4.0 * TRUTH.L_q / TRUTH.R_s]
    assert rms(off) == pytest.approx(PHASOR, rel=0.03)


def test_with_noise_a_step_is_off_by_that_of_two_samples(noisy: Rows) -> None:
    rho = math.exp(-2.0 * TRUTH.R_s * T_S / (TRUTH.L_d + TRUTH.L_q))
    assert rms(one_step(noisy, PLAIN) - noisy.i[1:]) == pytest.approx(PHASOR * math.hypot(1.0, rho), rel=0.03)


@pytest.mark.parametrize("name", SIZES)
def test_with_a_drives_effect_a_free_run_follows_it_and_without_it_does_not(name: str) -> None:
    rows = rows_from(drive_with(NONE._replace(**{name: getattr(ONES, name)})))
    found = Model(TRUTH, SIZES[name])
    without, with_it = (rms(free_run(rows, model) - rows.i) for model in (PLAIN, found))
    assert with_it < 0.05 * without


def test_currents_that_follow_a_model_are_the_same_when_found_from_those_of_another() -> None:
    rows = rows_from(drive_with(NONE._replace(inverter=ONES.inverter), NOISE))
    model = Model(TRUTH, SIZES["inverter"])
    near, _ = followed_currents(
        rows, Model(TRUTH, {"inverter_voltage_error": (2.5e-6, 0.5, 0.01 * RATED, 0.01 * RATED)}), 0.02
    )
    (i, lost), (again, lost_again) = followed_currents(rows, model, 0.02), followed_currents(rows, model, 0.02, near)
    off = np.abs(again - i) / RATED
    assert rms(near - i) > 1e-2 * RATED
    assert np.quantile(off, 0.98) < 1e-5  # where a phase current changes sign, Newton's method may end elsewhere
    assert np.max(off) < 1e-3
    assert rms(lost_again - lost) < 1e-3 * rms(lost)


@pytest.mark.thorough
def test_what_a_bridge_loses_does_not_turn_with_an_angle_that_is_tried() -> None:
    """Where it loses more than the magnets induce, one that did would lead the angle away from its offset."""
    offset, low_speed = 0.03, 100.0  # rad, rpm
    effects = NONE._replace(inverter=ONES.inverter, angle_sensing=ONES.angle_sensing)
    rows = rows_from(drive_with(effects, NOISE, low_speed))
    begin = Model(TRUTH, {**SIZES["inverter"], "angle_offset": (0.0,)})
    found, *_ = polished(rows, raw(rows), begin, Given(TRUTH, dict.fromkeys(PARAMETERS, 0.2), 0.0), times=1)
    assert found.effects["angle_offset"][0] == pytest.approx(offset, rel=0.1)


def test_a_free_run_follows_all_effects_at_once(everything: Rows) -> None:
    off = rms(free_run(everything, Model(TRUTH, ALL_SIZES)) - everything.i)
    assert off < 0.01 * RATED
    assert off < 0.1 * rms(free_run(everything, PLAIN) - everything.i)


def test_sizes_of_zero_are_the_machine_alone(everything: Rows) -> None:
    nothing = {
        effect.name: tuple(next(shapes) if parameter.shape else 0.0 for parameter in effect.parameters)
        for effect in LIBRARY
        for shapes in map(iter, effect.shapes(everything)[:1])  # none where it cannot show
    }
    none = Model(TRUTH, nothing)
    assert np.allclose(implied_voltage(everything, none), implied_voltage(everything, PLAIN), rtol=0.0, atol=1e-9)
    assert np.allclose(free_run(everything, none), free_run(everything, PLAIN), rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("more", [0.5, 1.0, 1.25, 1.5])
def test_what_a_free_run_finds_implies_the_recorded_voltage(everything: Rows, more: float) -> None:
    """Narrow zero crossings, as of currents without noise, and wrong sizes."""
    sizes = {name: tuple(more * size for size in sizes) for name, sizes in ALL_SIZES.items()}
    sizes["inverter_voltage_error"] = (more * 2e-6, more * 1.0, 3e-4 * RATED, 1e-3 * RATED)
    model = Model(replace(TRUTH, R_s=1.3 * TRUTH.R_s), sizes)
    rows = replace(everything, i=free_run(everything, model, 500))
    within = np.arange(1, len(rows) + 1) % 500 != 0  # the others end in a measured current
    off, most = np.abs(implied_voltage(rows, model) - rows.u)[within], 2e-4 * RATED * TRUTH.L_q / T_S
    assert np.quantile(off, 0.999) < most
    assert np.max(off) < 3.0 * most  # at edges where another diode takes over


def test_a_step_implies_the_recorded_voltage_from_the_measured_current(everything: Rows) -> None:
    no_spread = {"inverter_voltage_error": (2e-6, 1.0, 3e-4 * RATED, 1e-3 * RATED)}
    model = Model(TRUTH, ALL_SIZES | no_spread)
    step = one_step(everything, model)
    for first in (0, 1):
        i = everything.i.copy()
        i[first + 1 :: 2] = step[first::2]
        off = (implied_voltage(replace(everything, i=i), model) - everything.u)[first::2]
        assert np.max(np.abs(off)) < 1e-4 * RATED * TRUTH.L_q / T_S


def test_the_windows_length_changes_a_noiseless_run_by_little(clean: Rows) -> None:
    short, long = free_run(clean, PLAIN, 100), free_run(clean, PLAIN, 3000)
    assert rms(short - long) < 2e-4 * RATED


def test_a_window_starts_with_the_measured_current(noisy: Rows) -> None:
    i = free_run(noisy, PLAIN, 700)
    starts = np.arange(len(i)) % 700 == 0
    assert np.array_equal(i == noisy.i, starts)


def test_after_a_gap_a_run_starts_anew(broken: Rows) -> None:
    model = Model(TRUTH, ALL_SIZES)
    i, step = free_run(broken, model), one_step(broken, model)
    after = np.flatnonzero(~broken.joined)
    assert len(after) > 3
    assert np.array_equal(i[after + 1], broken.i[after + 1])
    assert np.array_equal(step[after], broken.i[after + 1])
    assert rms(i - broken.i) < 0.01 * RATED


def test_a_model_that_cannot_be_still_gives_bounded_currents(everything: Rows) -> None:
    saturated = {"d_axis_saturation": (0.6,), "q_axis_saturation": (0.6,)}
    model = Model(TRUTH, saturated | {"current_sensor_gain": (0.3, 0.3, 0.0)})
    i = free_run(everything, model)
    assert np.all(np.abs(i) < 10.1 * max(RATED, np.max(np.abs(everything.i))))


def noise_left_by(rows: Rows, model: Model) -> tuple[float, float, float]:
    left = rows.u - implied_voltage(rows, model)
    return noise_of(whitened(left, filter_of(rows, model.machine)), None, rows)


def test_the_true_model_leaves_noise_and_the_machine_alone_does_not() -> None:
    """The bridge is ideal: what its equation leaves of these 2 us would show beside the noise."""
    rows = rows_from(drive_with(ONES._replace(inverter=Inverter()), noise=NOISE), 20000)
    held_out = np.arange(len(rows)) // 2000 % 2 == 1
    found = Model(TRUTH, {name: sizes for name, sizes in ALL_SIZES.items() if name != "inverter_voltage_error"})
    runs = free_run(rows, PLAIN), free_run(rows, found)
    fit = fit_quality(rows, PLAIN, found, runs, held_out, noise_left_by(rows, found))
    step, run, low = fit.one_step_rms_V, fit.free_run_rms_A, fit.whiteness
    assert fit.held_out
    assert step.noise_floor is not None
    assert isinstance(run, ErrorChange)
    assert run.noise_floor is not None
    assert step.after == pytest.approx(step.noise_floor, rel=0.05)
    assert run.after < 2.0 * run.noise_floor < 0.1 * run.before
    assert step.before > 1.2 * step.after
    assert fit.explained > 0.98
    assert low.after < 0.002 * low.before


def test_what_noise_alone_leaves_is_at_its_floors_and_white(noisy: Rows) -> None:
    everywhere = np.ones(len(noisy), np.bool_)
    i = free_run(noisy, PLAIN)
    fit = fit_quality(noisy, PLAIN, PLAIN, (i, i), everywhere, noise_left_by(noisy, PLAIN))
    assert not fit.held_out
    assert fit.one_step_rms_V.after == pytest.approx(fit.one_step_rms_V.noise_floor, rel=0.02)
    run = fit.free_run_rms_A
    assert isinstance(run, ErrorChange)
    assert run.after == pytest.approx(run.noise_floor, rel=0.2)
    assert fit.whiteness.after == pytest.approx(1.0, abs=0.1)
