"""The extended Kalman filter: its derivatives, its covariance, and what it really does on the emulated drive."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER, Excitation, Scenario
from estimator.online import ekf, kalman
from estimator.online.ekf import TELLABLE, EkfState, EkfTuning, FilterModel, tuned
from estimator.online.estimate import Status
from estimator.samples import Samples
from tests.support.samples import noiseless, recorded, streamed, truth_of

pytestmark = pytest.mark.slow

START = {"R_s": 0.9664 * 1.1, "L_d": 4.24e-3 * 0.9, "L_q": 6.21e-3 * 1.1}  # 10 % off, each
HELD = {"psi_f": 0.12}
SAMPLES = streamed(VirtualDrive(PAPER), 3000)
PRESETS = {"paper": ekf.PAPER, "tuned": ekf.TUNED}


def started(tuning: EkfTuning = ekf.TUNED, start: Mapping[str, float] = START) -> EkfState:
    """A filter before its first sample."""
    return ekf.init(start, HELD, tuning=tuning)


def with_excitation(**given: float) -> Scenario:
    """The paper's drive under other currents."""
    return replace(PAPER, excitation=replace(Excitation(), **given))


def errors(state: EkfState, drive: VirtualDrive) -> dict[str, float]:
    """Relative errors of what is estimated."""
    truth = truth_of(drive)
    found = ekf.estimate(state).estimates
    return {name: (found[name].value or np.nan) / truth[name] - 1.0 for name in TELLABLE}


def track(state: EkfState, samples: Samples, step: int) -> dict[str, np.ndarray]:
    """The told values of the second half, one for every `step` rows."""
    told: dict[str, list[float]] = {name: [] for name in TELLABLE}
    for first in range(0, len(samples), step):
        state = ekf.update(state, samples[first : first + step])
        if 2 * first < len(samples):
            continue
        for name, values in told.items():
            estimate = ekf.estimate(state).estimates[name]
            if estimate.status is Status.OK and estimate.value is not None:
                values.append(estimate.value)
    return {name: np.array(values) for name, values in told.items()}


def moved(model: FilterModel, x: np.ndarray, row: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The states one row later, and the Jacobian; a row so short that the small terms it leaves out are nothing."""
    x, F, T_s = x.copy(), np.eye(5), 1e-6
    start = np.array([1.0, 4e-3, 6e-3, 0.12])
    if model is FilterModel.FLUXES:
        kalman._fluxes_moved(row, T_s, T_s, start, x, F)
    else:
        kalman._inductances_moved(row, T_s, 1, start[3], np.full(2, 1e-30), x, F, np.zeros(2))
    return x, F


@pytest.mark.parametrize("model", FilterModel)
def test_the_jacobian_is_the_derivative(model: FilterModel) -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        i_d, i_q, D = rng.normal(0, 3), rng.normal(0, 3), rng.normal(0, 0.1)
        s = 2e4 * np.sin(D / 2)
        row = np.array([i_d, i_q, 0, 0, s * i_d, s * i_q, s, 0, *rng.normal(0, 60, 2), D, 9.0, 9.0])
        parameters = [0.15, 0.02, 0.9] if model is FilterModel.FLUXES else [0.9, 4.1e-3, 6.3e-3]
        x = np.array([*rng.normal(0, 3, 2), *parameters])
        _, F = moved(model, x, row)
        for j in range(5):
            step = np.zeros(5)
            step[j] = 1e-5 * max(abs(x[j]), 1e-3)
            derivative = (moved(model, x + step, row)[0] - moved(model, x - step, row)[0]) / (2.0 * step[j])
            assert F[:, j] == pytest.approx(derivative, rel=1e-5, abs=1e-9)


@pytest.mark.parametrize("preset", PRESETS)
def test_P_stays_symmetric_and_not_negative_over_a_million_samples_whatever_they_are(preset: str) -> None:
    zero = np.zeros(100_000)
    still = Samples(zero, zero, zero, zero, zero, zero, SAMPLES.T_s, SAMPLES.periods, zero, zero)
    lively = streamed(VirtualDrive(PAPER), 100_000)
    loud = replace(lively, i_d=lively.i_d * 1e3, u_d=lively.u_d * 1e3, u_q=lively.u_q * 1e3)
    state = started(PRESETS[preset])
    for samples in (lively, still, loud, lively, still, lively, lively, loud, still, lively):
        state = ekf.update(state, samples)
        assert np.isfinite(state.x).all()
        assert np.array_equal(state.P, state.P.T)
        scale = np.sqrt(np.diag(state.P))
        assert np.linalg.eigvalsh(state.P / np.outer(scale, scale))[0] > -1e-12
    assert state.samples == 1_000_000 - 1


@pytest.mark.parametrize("stream", [True, False])
@pytest.mark.parametrize(("noise", "bound"), [(True, 3e-3), (False, 2e-4)])
def test_the_better_posed_filter_finds_every_parameter_on_the_emulated_drive(
    stream: bool, noise: bool, bound: float
) -> None:
    drive = VirtualDrive(PAPER if noise else noiseless())
    samples = streamed(drive, 1000) if stream else recorded(drive, 10_000)
    assert errors(ekf.update(started(), samples), drive) == pytest.approx(dict.fromkeys(TELLABLE, 0.0), abs=bound)


@pytest.mark.parametrize("stream", [True, False])
def test_the_published_filter_under_stepping_currents_is_right_to_a_fifth_and_says_that_it_is_vague(
    stream: bool
) -> None:
    drive = VirtualDrive(PAPER)
    samples = streamed(drive, 5000) if stream else recorded(drive, 50_000)
    state = started(ekf.PAPER)
    values = track(state, samples, 7 if stream else 70)
    for name, truth in truth_of(drive).items():
        if name in TELLABLE:
            assert np.median(values[name]) == pytest.approx(truth, rel=0.2)
    R_s = ekf.estimate(state).estimates["R_s"]
    assert R_s.value is not None and R_s.std is not None
    assert R_s.std > 0.05 * R_s.value
    assert np.std(values["L_d"]) > 0.1 * drive.truth.L_d  # a flux linkage that knows of no current, over a current


def test_intervals_of_the_better_posed_filter_hold_the_truth_at_least_as_often_as_they_say() -> None:
    drive = VirtualDrive(PAPER)
    truth, inside, runs = truth_of(drive), dict.fromkeys(TELLABLE, 0), 200
    state = ekf.update(started(), streamed(drive, 1000))
    for _ in range(runs):
        state = ekf.update(state, streamed(drive, 100))
        for name, e in ekf.estimate(state).estimates.items():
            if name in TELLABLE and e.value is not None and e.std is not None:
                inside[name] += abs(e.value - truth[name]) < 1.96 * e.std
    assert all(count / runs > 0.92 for count in inside.values()), inside


def test_both_follow_a_winding_that_is_suddenly_warmer() -> None:
    drive = VirtualDrive(PAPER)
    samples = streamed(drive, 2000)
    states = {name: ekf.update(started(tuning), samples) for name, tuning in PRESETS.items()}
    drive.set_temperature(70.0)
    drive.run(int(drive.read("stream_periods")) * 2)
    samples = streamed(drive, 2000)
    for name, tolerance in (("paper", 0.2), ("tuned", 3e-3)):
        values = track(states[name], samples, 7)["R_s"]
        assert np.mean(values) == pytest.approx(drive.truth.R_s, rel=tolerance)
    assert drive.truth.R_s == pytest.approx(1.1592)


@pytest.mark.parametrize("stream", [True, False])
def test_constant_currents_do_not_tell_R_s_and_nobody_claims_so(stream: bool) -> None:
    drive = VirtualDrive(with_excitation(i_d_ref=-2.0, i_q_ref=3.0))
    drive.run(2000)
    samples = streamed(drive, 5000) if stream else recorded(drive, 50_000)
    for tuning in PRESETS.values():
        e = ekf.estimate(ekf.update(started(tuning), samples)).estimates["R_s"]
        assert (e.value, e.std, e.status) == (START["R_s"], None, Status.NOT_TOLD)
        assert "nothing of R_s" in e.reason


@pytest.mark.parametrize("preset", PRESETS)
def test_without_current_nothing_is_told(preset: str) -> None:
    drive = VirtualDrive(with_excitation())
    result = ekf.estimate(ekf.update(started(PRESETS[preset]), recorded(drive, 50_000)))
    assert {result.estimates[name].status for name in TELLABLE} == {Status.NOT_TOLD}
    assert {name: result.estimates[name].value for name in TELLABLE} == START


def test_a_current_that_is_too_small_for_the_ratio_is_named() -> None:
    drive = VirtualDrive(with_excitation(i_q_ref=3.0))
    drive.run(2000)
    reason = ekf.estimate(ekf.update(started(ekf.PAPER), streamed(drive, 500))).estimates["L_d"].reason
    assert reason.startswith("L_d is a flux linkage over i_d, and that is ")


@pytest.mark.parametrize("preset", PRESETS)
def test_one_sample_at_a_time_is_the_same_as_a_block(preset: str) -> None:
    block, single = started(PRESETS[preset]), started(PRESETS[preset])
    block = ekf.update(block, SAMPLES[:500])
    for k in range(500):
        single = ekf.update(single, SAMPLES[k : k + 1])
    assert single.x == pytest.approx(block.x, rel=1e-9)
    assert np.allclose(single.P, block.P, rtol=1e-9, atol=0.0)
    assert (single.samples, single.stream.runs) == (block.samples, block.stream.runs) == (499, 1)


@pytest.mark.parametrize("preset", PRESETS)
def test_after_a_gap_the_currents_are_new_and_the_parameters_stay(preset: str) -> None:
    state = ekf.update(started(PRESETS[preset]), SAMPLES[:1000])
    n = 4 if preset == "paper" else 2
    x, P = state.x.copy(), state.P.copy()
    state = ekf.update(state, SAMPLES[2000:2001], joined=False)
    assert (state.x[0], state.x[1]) == (SAMPLES.i_d[2000], SAMPLES.i_q[2000])
    assert np.array_equal(state.x[n:], x[n:])
    assert np.array_equal(state.P[n:, n:], P[n:, n:])
    assert np.all(state.P[:n, n:] == 0.0)
    result = ekf.estimate(state)
    assert (result.samples, result.gaps, result.equations) == (999, 1, 2 * 999)


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_value_that_is_no_number_is_left_out_counted_and_poisons_nothing(preset: str, value: float) -> None:
    i_d, u_q = SAMPLES.i_d.copy(), SAMPLES.u_q.copy()
    i_d[[0, 500, 501]], u_q[[700, 2999]] = value, value
    state = ekf.update(started(PRESETS[preset]), replace(SAMPLES, i_d=i_d, u_q=u_q))
    assert (state.stream.left_out, state.restarts) == (5, 0)
    assert np.isfinite(state.x).all() and np.isfinite(state.P).all()
    state = ekf.update(state, SAMPLES)
    assert ekf.estimate(state).gaps == 3
    if preset == "tuned":
        drive = VirtualDrive(PAPER)
        assert errors(state, drive) == pytest.approx(dict.fromkeys(TELLABLE, 0.0), abs=3e-3)


def test_a_filter_that_runs_away_starts_anew_and_counts_it() -> None:
    loose = (1e3, 1e3, 1e3, 1e3, 1e3)
    wild = EkfTuning(P_0=loose, Q=loose, R=(1e-6, 1e-6), model=FilterModel.INDUCTANCES)
    state = ekf.update(started(wild), SAMPLES)
    assert state.restarts > 0
    assert np.isfinite(state.x).all() and np.isfinite(state.P).all()


@settings(max_examples=60, deadline=None)
@given(
    model=st.sampled_from(list(FilterModel)), exponents=st.lists(st.floats(-20.0, 6.0), min_size=12, max_size=12),
)
def test_no_tuning_makes_it_fail(model: FilterModel, exponents: list[float]) -> None:
    v = [10.0**exponent for exponent in exponents]
    tuning = EkfTuning(
        P_0=(v[0], v[1], v[2], v[3], v[4]), Q=(v[5], v[6], v[7], v[8], v[9]), R=(max(v[10], 1e-12), max(v[11], 1e-12)),
        model=model,
    )
    state = ekf.update(started(tuning), SAMPLES[:500])
    assert np.isfinite(state.x).all() and np.isfinite(state.P).all()
    for e in ekf.estimate(state).estimates.values():
        assert e.std is None or e.std >= 0.0


def test_a_user_sets_the_tuning_and_a_slower_one_is_calmer_and_lags() -> None:
    fast = tuned(0.9664, 4.24e-3, 6.21e-3, noise_i=0.01, lsb=0.009, omega_e=503.0, T_s=1e-4, warming=100.0)
    slow = replace(fast, Q=(*fast.Q[:2], *(q * 1e-8 for q in fast.Q[2:])))
    drive = VirtualDrive(PAPER)
    samples = streamed(drive, 4000)
    states = {"fast": started(fast), "slow": started(slow)}
    spread = {name: np.std(track(state, samples, 50)["R_s"]) for name, state in states.items()}
    assert spread["slow"] < 0.2 * spread["fast"]
    drive.set_temperature(70.0)
    drive.run(20)
    samples = streamed(drive, 1000)
    off = {name: abs(errors(ekf.update(state, samples, joined=False), drive)["R_s"]) for name, state in states.items()}
    assert off["slow"] > 0.02 > off["fast"]


@pytest.mark.parametrize("preset", PRESETS)
def test_what_is_held_stays(preset: str) -> None:
    truth = truth_of(VirtualDrive(PAPER))
    state = ekf.init({"L_d": START["L_d"], "L_q": START["L_q"]}, truth, ("L_d", "L_q"), PRESETS[preset])
    result = ekf.estimate(ekf.update(state, SAMPLES))
    R_s = result.estimates["R_s"]
    assert (R_s.value, R_s.std, R_s.status) == (truth["R_s"], None, Status.HELD)
    assert state.x[4 if preset == "paper" else 2] == truth["R_s"]
    if preset == "tuned":
        for name in ("L_d", "L_q"):
            assert result.estimates[name].value == pytest.approx(truth[name], rel=3e-3)


def test_before_any_row_it_has_no_values_and_says_so() -> None:
    result = ekf.estimate(started())
    assert {(result.estimates[name].value, result.estimates[name].status) for name in TELLABLE} == {
        (None, Status.NO_DATA)
    }
    assert (result.residual_rms, result.filled) == (None, False)


def test_what_it_cannot_estimate_or_start_from_is_refused_in_a_sentence() -> None:
    with pytest.raises(ValueError, match="holds the rest, got psi_f"):
        ekf.init(START, HELD, ("R_s", "psi_f"))
    with pytest.raises(ValueError, match="psi_f needs a held value that is positive, got none"):
        ekf.init(START, {})
    with pytest.raises(ValueError, match=r"R_s needs a start value that is positive, got -1\.0"):
        ekf.init({**START, "R_s": -1.0}, HELD)
    with pytest.raises(ValueError, match="L_d needs a held value that is positive, got none"):
        ekf.init(START, HELD, ("R_s", "L_q"))
