"""Recursive least squares for any subset of R_s, L_d, L_q, psi_f, with infinite memory or a forgetting factor.

The published recursion, two rows (a, u) for each balance of `flux_balance`, with a forgetting factor lam,

    K = P a / (lam + a'P a)        beta += K (u - a'beta)        P = (P - K a'P) / lam

is kept in its information form, P^-1 and P^-1 beta instead of P and beta:

    P^-1 = P_0^-1 + sum lam^(n-k) a_k a_k'        P^-1 beta = P_0^-1 beta_0 + sum lam^(n-k) a_k u_k

The same numbers, but nothing is subtracted: P cannot lose its symmetry or its sign, the sums serve whatever is held or
estimated, and an unknown start (P_0 large) costs no digits. Two things differ from the textbook:

* The start P_0, beta_0 is not forgotten. Without excitation the textbook's P grows as lam^-n, without bound (windup);
  here it never exceeds P_0, and a parameter whose P has come back to it is `not_told`. A floor under the information
  is the idea of M. E. Salgado, G. C. Goodwin, R. H. Middleton, Modified least squares algorithm incorporating
  exponential resetting and forgetting, International Journal of Control 47, 1988, doi 10.1080/00207178808906026.
* Batches of rows are summed beside rows, see `fit`: they tell how large the noise is.
* Rows with forgotten weights count as (sum w)^2 / (sum w^2) rows of full weight in the standard errors (the effective
  sample size of L. Kish, Survey Sampling, 1965): 1/(1 - lam) remembered rows are worth (1 + lam)/(1 - lam).

The method: S. Wang, Windowed Least Square Algorithm Based PMSM Parameters Estimation, Mathematical Problems in
Engineering, 2013, doi 10.1155/2013/131268. The second-order terms of the mean current, the noise in the regressors
and the standard errors are those of `solve`. Knows nothing of clocks, drives or files.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from estimator.arrays import Array, Integers
from estimator.kernel import kernel
from estimator.machine import PARAMETERS
from estimator.online.estimate import Estimate, Status, WindowEstimate
from estimator.online.flux_balance import COLUMNS, flux_balance
from estimator.online.solve import check_held, solve
from estimator.online.stream import Stream, runs_of
from estimator.online.sums import SIZE, U, WindowSums, sums_from
from estimator.online.window_ls import check_m
from estimator.online.window_sums import BATCH, BATCHES, PLACES, SIGNS, SUMS, add_batch
from estimator.samples import Samples

SMALLEST_LAM: Final = 0.99  # the smallest lam: a hundred rows remembered; fewer tell no standard errors
FEWEST_EFFECTIVE_ROWS: Final = 100  # rows, effective, from which anything is told
_AT_BOUND: Final = 0.5  # share of P_0 from which P counts as come back to it
_FILLED: Final = 0.95  # share of its final length that a forgetting memory has after three time constants
_TINY: Final = 1e-200  # sums below are zero; they would become subnormal numbers, which are slow
_SWEEP: Final = 256  # balances after which they are looked for
_ROWS, _PAIRS, _BATCHES, _SQUARES = 0, 1, 2, 5  # places in the sums of weights


@dataclass(frozen=True, slots=True)
class Prior:
    """Where the recursion starts: beta_0 by name, and the diagonal of P_0 in (unit of the parameter / V)^2.

    It weighs like one row of the regressor 1/sqrt(P_0): with the default, less than 1 mA of current.
    """

    beta_0: Mapping[str, float] = field(default_factory=dict[str, float])  # SI; 0 where not given
    P_0: float = 1e6  # ohm^2/V^2, H^2/V^2, (Vs)^2/V^2


@dataclass(slots=True, eq=False)
class RlsState:
    """The sums so far; `update` changes it in place and returns it."""

    estimated: tuple[str, ...]
    held: Mapping[str, float]  # SI
    lam: float  # forgetting factor for each regression row of m periods; 1 = none
    m: int  # periods per row: balances averaged to one
    prior: Prior
    products: Array  # (6, 15), weighted sums of z z' (d, q), z_k z_{k-1}' + its transpose, b b' of batches; see `_take`
    weights: Array  # (6,), sums of the weights of rows, pairs, batches, their two sums of squares, squares of rows'
    batch: Array  # (10, BATCH), rows of the batch under way
    group: Array  # (2, 10), the group being filled (sum) and the finished one before it (mean)
    fill: Integers  # (3,), filled of group, previous group valid, rows of the batch
    stream: Stream = field(default_factory=Stream)
    samples: int = 0  # balances taken in


def init(
    estimated: Sequence[str] = PARAMETERS, held: Mapping[str, float] | None = None,
    lam: float = 1.0, m: int = 1, prior: Prior | None = None,
) -> RlsState:
    """Nothing known but the prior. Parameters not in `estimated` need a value in `held` (SI). Raises ValueError."""
    held = held or {}
    prior = prior or Prior()
    check_held(estimated, held)
    check_m(m)
    if not 0.0 < prior.P_0 < np.inf:
        raise ValueError(f"P_0 must be positive and finite, got {prior.P_0}")
    check_lam(lam)
    return RlsState(
        tuple(estimated), dict(held), lam, m, prior,
        products=np.zeros((6, 15)), weights=np.zeros(6), batch=np.zeros((len(COLUMNS), BATCH)),
        group=np.zeros((2, len(COLUMNS))), fill=np.zeros(3, dtype=np.int64),
    )


def check_lam(lam: float) -> None:
    """Raise ValueError, in a sentence, when a forgetting factor cannot work."""
    if not SMALLEST_LAM <= lam <= 1.0:
        raise ValueError(f"the forgetting factor must be {SMALLEST_LAM} to 1, got {lam}")


def warm_up() -> None:
    """Compile the kernels, or load them from the cache."""
    still = np.zeros(3)
    estimate(update(init(), Samples(still, still, still, still, still, still, T_s=1.0)))


def update(state: RlsState, samples: Samples, *, joined: bool = True) -> RlsState:
    """Take in consecutive samples, one or many; `joined` and values that are not finite as in `stream.runs_of`."""
    for run, continues in runs_of(state.stream, samples, joined=joined):
        if not continues:
            state.fill[:] = 0  # a group that a gap cuts is dropped whole
        balance = flux_balance(run)
        state.samples += len(balance)
        _append(balance, state.m, state.lam, state.group, state.fill, state.batch, state.products, state.weights)
    return state


def with_lam(state: RlsState, lam: float) -> RlsState:
    """This memory, forgetting at another rate from here on. Raises ValueError."""
    check_lam(lam)
    state.lam = lam
    return state


def estimate(state: RlsState, *, noise_aware: bool = True) -> WindowEstimate:
    """What is remembered; `noise_aware` as in `solve.solve`, without it the textbook's recursion."""
    sums = _with_prior(state)
    found = solve(sums, state.estimated, _stand_ins(state), noise_aware=noise_aware)
    at_bound = _at_bound(state)
    if sums.rows[0] < FEWEST_EFFECTIVE_ROWS:
        at_bound = set(state.estimated)
    estimates = {name: _told_by_recursion(state, e, name in at_bound) for name, e in found.estimates.items()}
    rows = float(state.weights[_ROWS])
    return WindowEstimate(
        estimates, state.samples, state.stream.gaps, 2 * round(rows),
        rows >= _FILLED / (1.0 - state.lam) if state.lam < 1.0 else rows > 0.0,
        found.condition, found.residual_rms, state.stream.left_out, found.combinations, found.impossible,
    )


def P_of(state: RlsState) -> Array:
    """P of the estimated parameters in the order of PARAMETERS, shape (p, p), in the units of `Prior.P_0`."""
    free = [j for j, name in enumerate(PARAMETERS) if name in state.estimated]
    G = sums_from(state.products[None], np.zeros((1, 5)), 1.0, 1).lag0.sum(axis=(0, 1))
    information = G[np.ix_(free, free)] + np.eye(len(free)) / state.prior.P_0
    scale = 1.0 / np.sqrt(np.diag(information))
    P = np.array(np.linalg.inv(information * np.outer(scale, scale)), np.float64) * np.outer(scale, scale)
    return 0.5 * (P + P.T)


def _with_prior(state: RlsState) -> WindowSums:
    """The sums scaled to the effective number of rows, with the prior as one row more for each parameter."""
    weight, squares = float(state.weights[_ROWS]), float(state.weights[_SQUARES])
    rows = round(weight**2 / squares) if squares > 0.0 else 0
    scale = rows / weight if rows else 1.0
    stream = state.stream
    counts = state.weights[None, :_SQUARES] * scale
    counts[0, _ROWS] = rows
    sums = sums_from(state.products[None] * scale, counts, stream.T_s, stream.periods * state.m, stream.resolution)
    for j, name in enumerate(PARAMETERS):
        if name in state.estimated:
            z = np.zeros(SIZE)
            z[j], z[U] = 1.0, state.prior.beta_0.get(name, 0.0)
            sums.lag0[0, 0] += np.outer(z, z) * (scale / state.prior.P_0)
    return sums


def _stand_ins(state: RlsState) -> dict[str, float]:
    """What stands in for a parameter that is not told: its held value, else where the recursion started."""
    return {**state.prior.beta_0, **state.held}


def _at_bound(state: RlsState) -> set[str]:
    """Parameters whose P has come back to P_0, or never left it."""
    names = [name for name in PARAMETERS if name in state.estimated]
    return {name for name, P in zip(names, np.diag(P_of(state)), strict=True) if P > _AT_BOUND * state.prior.P_0}


def _told_by_recursion(state: RlsState, e: Estimate, at_bound: bool) -> Estimate:
    if e.status not in (Status.OK, Status.NOT_TOLD):
        return e
    reason = e.reason
    if e.status is Status.OK:
        if not at_bound:
            return e
        reason = f"the rows cannot tell {e.name}: P is at its bound"
    if state.lam < 1.0:
        reason += f"; what came before is forgotten (lam = {state.lam:g})"
    return replace(e, value=_stand_ins(state).get(e.name), std=None, status=Status.NOT_TOLD, reason=reason)


@kernel
def _append(
    balance: Array, m: int, lam: float, group: Array, fill: Integers, batch: Array, products: Array, weights: Array
) -> None:
    """Take in a row for every complete group of m balances."""
    for k in range(len(balance)):
        if k % _SWEEP == 0:
            for axis in range(6):
                for n in range(15):
                    if abs(products[axis, n]) < _TINY:
                        products[axis, n] = 0.0
        if fill[0] == 0:
            group[0] = balance[k]
        else:
            group[0] += balance[k]
        fill[0] += 1
        if fill[0] == m:
            group[0] /= m
            fill[0] = 0
            _take(group[0], group[1], fill[1], lam, products, weights)
            _take_batch(group[0], fill, batch, products, weights)
            group[1] = group[0]
            fill[1] = 1


@kernel
def _take(row: Array, before: Array, joins: int, lam: float, products: Array, weights: Array) -> None:
    """Forget, then add a row's products with itself and, where it joins it, with the one before.

    Upper triangles over the places in z of `window_sums`, by axis.
    """
    for axis in range(2):
        places, signs, n = PLACES[axis], SIGNS[axis], 0
        for i in range(5):
            a, a_before = signs[i] * row[places[i]], signs[i] * before[places[i]]
            for j in range(i, 5):
                b, b_before = signs[j] * row[places[j]], signs[j] * before[places[j]]
                products[axis, n] = lam * products[axis, n] + a * b
                products[2 + axis, n] = lam * products[2 + axis, n] + joins * (a * b_before + a_before * b)
                products[4 + axis, n] *= lam
                n += 1
    weights[:5] *= lam
    weights[_ROWS] += 1.0
    weights[_PAIRS] += joins
    weights[_SQUARES] = lam * lam * weights[_SQUARES] + 1.0


@kernel
def _take_batch(row: Array, fill: Integers, batch: Array, products: Array, weights: Array) -> None:
    """Add a row to the batch under way, and the batch when it is complete; each overlaps the next by half."""
    if fill[1] == 0:
        fill[2] = 0
    batch[:, fill[2]] = row
    fill[2] += 1
    if fill[2] == BATCH:
        total = np.zeros(SUMS)
        add_batch(batch, 0, BATCH, total)
        for axis in range(2):
            products[4 + axis] += total[60 + 15 * axis : 75 + 15 * axis]
        weights[_BATCHES:_SQUARES] += total[BATCHES:SUMS]
        fill[2] = BATCH // 2
        batch[:, : BATCH // 2] = batch[:, BATCH // 2 :].copy()
