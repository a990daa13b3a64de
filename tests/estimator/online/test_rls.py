"""Recursive least squares is least squares over all rows, weighted by their age; it never blows up."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER
from estimator.machine import PARAMETERS
from estimator.online import rls
from estimator.online.estimate import Status, WindowEstimate
from estimator.online.flux_balance import Balance, flux_balance, mean_of
from estimator.online.rls import Prior, RlsState
from estimator.samples import Samples
from tests.support.samples import noiseless, recorded, streamed, truth_of

ROWS = 3000
SAMPLES = streamed(VirtualDrive(PAPER), ROWS)
BALANCE = flux_balance(SAMPLES)
HELD = {"R_s": 0.95, "L_d": 4.2e-3, "L_q": 6.3e-3, "psi_f": 0.121}
STIFF = Prior({"R_s": 1.2, "L_d": 5e-3, "L_q": 5e-3, "psi_f": 0.1}, P_0=1.0)  # a prior that is felt


def values(result: WindowEstimate) -> np.ndarray:
    """Estimated values in the order of PARAMETERS."""
    return np.array([result.estimates[name].value for name in PARAMETERS], dtype=np.float64)


def regression(g: Balance, result: WindowEstimate) -> tuple[np.ndarray, np.ndarray]:
    """Both equations of every row in turn, written down here anew, the small terms taken from the result itself."""
    R_s, L_d, L_q, psi_f = values(result)
    i_d, i_q, x_d, x_q, y_d, y_q, s, h, u_d, u_q = g.T
    b = (R_s * SAMPLES.T_s) ** 2 / 12
    A = np.stack([np.stack([i_d, x_d, -y_q, 0 * s], axis=1), np.stack([i_q, y_d, x_q, s], axis=1)], axis=1)
    u = np.stack([u_d + R_s * psi_f / L_d * h - b / L_d * (x_d - y_q), u_q - b / L_q * (x_q + y_d)], axis=1)
    return A.reshape(-1, 4), u.reshape(-1)


def least_squares(g: Balance, result: WindowEstimate, lam: float, prior: Prior) -> np.ndarray:
    """numpy's solution of all rows, weighted by lam^age, and of the prior's."""
    A, u = regression(g, result)
    weight = np.repeat(lam ** (0.5 * np.arange(len(g) - 1, -1, -1)), 2)
    start = np.array([prior.beta_0.get(name, 0.0) for name in PARAMETERS]) / prior.P_0**0.5
    rows = np.concatenate([A * weight[:, None], np.eye(4) / prior.P_0**0.5])
    return np.linalg.lstsq(rows, np.concatenate([u * weight, start]))[0]


def recursion(A: np.ndarray, u: np.ndarray, lam: float, prior: Prior) -> np.ndarray:
    """The published recursion with a forgetting factor, two rows at a time."""
    beta = np.array([prior.beta_0.get(name, 0.0) for name in PARAMETERS])
    P_now = prior.P_0 * np.eye(4)
    for a, b in zip(A.reshape(-1, 2, 4), u.reshape(-1, 2), strict=True):
        K = P_now @ a.T @ np.linalg.inv(lam * np.eye(2) + a @ P_now @ a.T)
        beta = beta + K @ (b - a @ beta)
        P_now = (P_now - K @ a @ P_now) / lam
        P_now = 0.5 * (P_now + P_now.T)
    return beta


def fed(state: RlsState, samples: Samples, cuts: list[int]) -> RlsState:
    """Update with samples cut at some places."""
    for a, b in zip([0, *cuts], [*cuts, len(samples)], strict=True):
        state = rls.update(state, samples[a:b])
    return state


def still(rows: int) -> Samples:
    """A drive at rest without a trace of noise."""
    zero = np.zeros(rows)
    return Samples(zero, zero, zero, zero, zero, zero, SAMPLES.T_s, SAMPLES.periods, zero, zero)


@settings(max_examples=40, deadline=None)
@given(
    lam=st.sampled_from([1.0, 0.9999, 0.999, 0.995, 0.99]), m=st.integers(1, 12),
    prior=st.sampled_from([Prior(), STIFF]), cuts=st.lists(st.integers(1, ROWS - 1), max_size=20, unique=True),
)
def test_over_any_split_of_the_stream_it_is_the_least_squares_solution_of_all_rows_weighted_by_age(
    lam: float, m: int, prior: Prior, cuts: list[int]
) -> None:
    state = fed(rls.init(lam=lam, m=m, prior=prior), SAMPLES, sorted(cuts))
    result = rls.estimate(state, noise_aware=False)
    assert values(result) == pytest.approx(least_squares(mean_of(BALANCE, m), result, lam, prior), rel=1e-9)


@pytest.mark.parametrize("lam", [1.0, 0.999])
def test_it_is_the_published_recursion(lam: float) -> None:
    prior = Prior(P_0=1e3)  # weighs so little that the recursion's forgetting of it makes no difference
    result = rls.estimate(rls.update(rls.init(lam=lam, prior=prior), SAMPLES), noise_aware=False)
    A, u = regression(BALANCE, result)
    assert values(result) == pytest.approx(recursion(A, u, lam, prior), rel=1e-6)


def test_one_sample_at_a_time_is_the_same_as_a_block() -> None:
    block = rls.update(rls.init(lam=0.995, m=3), SAMPLES[:1000])
    single = fed(rls.init(lam=0.995, m=3), SAMPLES[:1000], list(range(1, 1000)))
    assert values(rls.estimate(single)) == pytest.approx(values(rls.estimate(block)), rel=1e-12)


def test_the_forgetting_factor_changes_while_running() -> None:
    state = rls.update(rls.init(lam=0.99), SAMPLES[:1500])
    state = rls.update(rls.with_lam(state, 1.0), SAMPLES[1500:2500])
    state = rls.update(rls.with_lam(state, 0.999), SAMPLES[2500:])
    result = rls.estimate(state, noise_aware=False)
    factors = np.concatenate([np.full(1499, 0.99), np.ones(1000), np.full(500, 0.999)])
    weights = np.cumprod(np.append(1.0, factors[:0:-1]))[::-1]
    A, u = regression(BALANCE, result)
    w = np.repeat(np.sqrt(weights), 2)
    assert values(result) == pytest.approx(np.linalg.lstsq(A * w[:, None], u * w)[0], rel=1e-9)


@settings(max_examples=30, deadline=None)
@given(
    bad=st.lists(st.integers(0, 1999), min_size=1, max_size=30, unique=True),
    value=st.sampled_from([np.nan, np.inf, -np.inf]),
    column=st.sampled_from(["theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q", "i_d_mean", "i_q_mean"]),
)
def test_a_value_that_is_no_number_is_left_out_and_counted(bad: list[int], value: float, column: str) -> None:
    spoilt = getattr(SAMPLES[:2000], column).copy()
    spoilt[bad] = value
    state = rls.update(rls.init(), replace(SAMPLES[:2000], **{column: spoilt}))
    assert state.stream.left_out == len(bad)
    good = np.ones(2000, dtype=np.bool_)
    good[bad] = False
    rows = BALANCE[:1999][good[:-1] & good[1:]]
    result = rls.estimate(state, noise_aware=False)
    assert values(result) == pytest.approx(least_squares(rows, result, 1.0, Prior()), rel=1e-9)


def test_a_gap_makes_no_row_across_it_and_is_counted() -> None:
    state = rls.update(rls.init(), SAMPLES[:400])
    result = rls.estimate(rls.update(state, SAMPLES[500:800], joined=False), noise_aware=False)
    rows = np.concatenate([BALANCE[:399], BALANCE[500:799]])
    assert (result.samples, result.gaps, result.equations) == (698, 1, 2 * 698)
    assert values(result) == pytest.approx(least_squares(rows, result, 1.0, Prior()), rel=1e-9)


@pytest.mark.parametrize("estimated", [("R_s",), ("L_d", "L_q"), ("R_s", "psi_f")])
def test_what_is_not_estimated_is_held_on_the_right_hand_side(estimated: tuple[str, ...]) -> None:
    result = rls.estimate(rls.update(rls.init(estimated, HELD), SAMPLES), noise_aware=False)
    A, u = regression(BALANCE, result)
    free = [PARAMETERS.index(name) for name in estimated]
    u = u - A @ np.array([0.0 if name in estimated else HELD[name] for name in PARAMETERS])
    assert values(result)[free] == pytest.approx(np.linalg.lstsq(A[:, free], u)[0], rel=1e-9)
    for name in PARAMETERS:
        estimate = result.estimates[name]
        assert estimate.status is (Status.OK if name in estimated else Status.HELD)
        assert (estimate.std is not None) == (name in estimated)


@pytest.mark.parametrize("lam", [0.99, 0.9999])
def test_a_million_rows_of_standstill_bring_P_back_to_its_bound_and_no_further(lam: float) -> None:
    state = rls.update(rls.init(lam=lam), SAMPLES)
    before = np.diag(rls.P_of(state))
    state = rls.update(state, still(1_000_000), joined=False)
    assert np.all(before < 10.0)
    assert np.diag(rls.P_of(state)) == pytest.approx(1e6, rel=1e-9)
    for e in rls.estimate(state).estimates.values():
        assert (e.value, e.std, e.status) == (None, None, Status.NOT_TOLD)
        assert "forgotten" in e.reason
    result = rls.estimate(rls.update(state, SAMPLES, joined=False))  # and it is as good as new
    fresh = rls.estimate(rls.update(rls.init(lam=lam), SAMPLES))
    assert values(result) == pytest.approx(values(fresh), rel=1e-6)


def test_a_standstill_on_the_emulated_drive_is_told_as_one() -> None:
    drive = VirtualDrive(replace(PAPER, run=replace(PAPER.run, speed_rpm=0.0)))
    state = rls.update(rls.init(lam=0.999), SAMPLES)
    state = rls.update(state, streamed(drive, 60_000), joined=False)
    result = rls.estimate(state)
    status = {name: e.status.value for name, e in result.estimates.items()}
    assert status == {"R_s": "ok", "L_d": "ok", "L_q": "ok", "psi_f": "not_told"}
    assert "lam = 0.999" in result.estimates["psi_f"].reason


def test_without_forgetting_a_standstill_takes_nothing_away() -> None:
    state = rls.update(rls.init(), SAMPLES)
    before = values(rls.estimate(state, noise_aware=False))
    state = rls.update(state, still(1_000_000), joined=False)
    assert values(rls.estimate(state, noise_aware=False)) == pytest.approx(before, rel=1e-9)


def test_P_is_symmetric_and_positive_whatever_comes() -> None:
    loud = replace(SAMPLES, i_d=SAMPLES.i_d * 1e4, i_q=SAMPLES.i_q * 1e-4, u_d=SAMPLES.u_d * 1e4)
    state = rls.init(lam=0.99)
    for samples in (loud, still(1000), SAMPLES, loud):
        state = rls.update(state, samples, joined=False)
        P = rls.P_of(state)
        assert np.array_equal(P, P.T)
        assert np.all(np.diag(P) > 0.0)
        assert np.all(np.linalg.eigvalsh(P / np.sqrt(np.outer(np.diag(P), np.diag(P)))) > 0.0)


@pytest.mark.parametrize(("noise", "bound"), [(True, 3e-3), (False, 2e-5)])
@pytest.mark.parametrize("lam", [1.0, 0.998])
@pytest.mark.parametrize("stream", [True, False])
def test_on_the_emulated_drive_every_parameter_is_close(noise: bool, bound: float, lam: float, stream: bool) -> None:
    drive = VirtualDrive(PAPER if noise else noiseless())
    samples = streamed(drive, 3000) if stream else recorded(drive, 30_000)
    found = values(rls.estimate(rls.update(rls.init(lam=lam, m=1 if stream else 20), samples)))
    truth = np.array([truth_of(drive)[name] for name in PARAMETERS])
    assert found / truth - 1.0 == pytest.approx(0.0, abs=bound)


@pytest.mark.slow
def test_standard_errors_with_forgetting_are_those_of_its_effective_memory() -> None:
    drive = VirtualDrive(PAPER)
    truth = np.array([truth_of(drive)[name] for name in PARAMETERS])
    state, inside, runs = rls.update(rls.init(lam=0.99), streamed(drive, 1000)), np.zeros(4), 300
    for _ in range(runs):
        state = rls.update(state, streamed(drive, 600))  # six time constants: all but independent
        result = rls.estimate(state)
        std = np.array([result.estimates[name].std for name in PARAMETERS], dtype=np.float64)
        inside += np.abs(values(result) - truth) < 1.96 * std
    assert np.all((inside / runs > 0.88) & (inside / runs < 0.99)), inside / runs


def test_without_forgetting_it_does_not_follow_a_warmer_winding_and_with_forgetting_it_does() -> None:
    drive = VirtualDrive(PAPER)
    samples = streamed(drive, 5000)
    never, soon = rls.update(rls.init(), samples), rls.update(rls.init(lam=0.998), samples)
    drive.set_temperature(70.0)
    drive.run(int(drive.read("stream_periods")) * 2)
    samples = streamed(drive, 5000)
    off = {}
    for name, state in (("never", never), ("soon", soon)):
        result = rls.estimate(rls.update(state, samples, joined=False))
        off[name] = abs((result.estimates["R_s"].value or 0.0) / drive.truth.R_s - 1.0)
    assert off["never"] > 0.05  # half of the 17 % between 23.4 and 70 degC
    assert off["soon"] < 5e-3


def test_before_any_row_it_has_no_values_and_says_so() -> None:
    result = rls.estimate(rls.init())
    assert {(e.value, e.std, e.status) for e in result.estimates.values()} == {(None, None, Status.NO_DATA)}
    assert not result.filled


@pytest.mark.parametrize(
    "wrong", [{"lam": 0.0}, {"lam": 1.1}, {"m": 0}, {"m": 1001}, {"prior": Prior(P_0=0.0)}, {"lam": float("nan")}]
)
def test_what_cannot_work_is_refused_in_a_sentence(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"must be .* got"):
        rls.init(**wrong)  # pyright: ignore[reportArgumentType]


def test_a_parameter_neither_estimated_nor_held_is_refused_in_a_sentence() -> None:
    with pytest.raises(ValueError, match="psi_f is not estimated and so needs a held value"):
        rls.init(("R_s", "L_d", "L_q"))
