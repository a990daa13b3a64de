"""Streaming sliding-window least squares for any subset of R_s, L_d, L_q, psi_f.

The window's normal equations are sums over chunks of rows. A chunk only ever adds; what leaves the window leaves as a
whole chunk, and the oldest one, cut by the window's edge, is summed anew from its rows. Nothing is
subtracted, so nothing drifts: the estimate is the least-squares solution of the rows in the window.
The sums hold all four parameters, so what is estimated and what is held may change at any time at no cost.

    state = init(length=1000, m=1)
    state = update(state, samples)
    result = estimate(state, ("R_s", "L_d", "L_q"), {"psi_f": 0.12})

The method: S. Wang, Windowed Least Square Algorithm Based PMSM Parameters Estimation, Mathematical Problems
in Engineering, 2013, doi 10.1155/2013/131268; its downdate, which subtracts, is replaced as said.

Standard errors know that differenced current noise is coloured: the residual's variance and its lag-1 covariance,
both from sums of the window, per axis. The bias that current noise in the regressors leaves is bounded and
added to them. Knows nothing of clocks, drives or files.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.estimate import Estimate, Status, WindowEstimate
from estimator.excitation import Excitation, excitation
from estimator.flux_balance import COLUMNS, flux_balance
from estimator.kernel import kernel
from estimator.machine import PARAMETERS, UNITS
from estimator.samples import Samples

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Integers = NDArray[np.int64]

CHUNK: Final = 256  # rows a chunk holds at least
MAX_LENGTH: Final = 1_000_000  # rows: 80 MB
MAX_M: Final = 1000
NOISE_DOUBT: Final = 0.1  # the bias that current noise leaves is known to within this share of it
_ROUNDS: Final = 3  # of the solution with its own second-order terms; each gains three digits
_HISTORY: Final = 1 << 15  # rows kept at least, so that a window can grow into what has been seen

# A chunk's sums: upper triangles of z z' and of z_k z_{k+1}' + its transpose, z = (regressors, voltage),
# for the d axis (R_s, L_d, L_q, h, u_d) and the q axis (R_s, L_d, L_q, psi_f, u_q), then rows and adjacent pairs.
_Z: Final = 5
_D0: Final = 0
_Q0: Final = 15
_D1: Final = 30
_Q1: Final = 45
_GROUPS: Final = 60
_PAIRS: Final = 61
_SUMS: Final = 62
_D_AT: Final = np.array([0, 1, 2, 4, 5])  # places in (R_s, L_d, L_q, psi_f, h, u)
_Q_AT: Final = np.array([0, 1, 2, 3, 5])


@dataclass(slots=True, eq=False)
class WindowState:
    """A window over balances; `update` changes it in place and returns it.

    A *group* is m consecutive balances, averaged to one regression row per axis; a break in the stream
    ends the run, and an unfinished group with it.
    """

    length: int  # samples the window covers
    m: int  # periods per row: balances averaged to one
    rows: Array  # (capacity, 10), ring of balances
    starts: Bools  # (capacity,), True where a balance does not join the one before
    sums: Array  # (chunks, 62), ring of finished chunks
    firsts: Integers  # (chunks,), number of each chunk's first balance
    open_sums: Array  # (62,), the chunk being filled
    group: Array  # (2, 10), the group being filled (sum) and the finished one before it (mean)
    count: Integers  # balances, finished chunks, open chunk's first, filled of group, previous group valid
    last: Samples | None = None  # the newest sample, whose balance waits for its end
    left_out: int = 0  # rows refused because they were not finite

    @property
    def samples(self) -> int:
        """Balances now in the window."""
        return min(int(self.count[0]), self.length)

    @property
    def gaps(self) -> int:
        """Breaks in the stream between the balances now in the window."""
        newest, capacity = int(self.count[0]), len(self.rows)
        first, end = (newest - self.samples) % capacity, newest % capacity
        inside = self.starts[first:end] if first < end else np.concatenate((self.starts[first:], self.starts[:end]))
        return int(np.count_nonzero(inside[1:]))


def init(length: int, m: int = 1) -> WindowState:
    """An empty window of `length` samples with rows of m periods. Raises ValueError outside the limits."""
    check_window(length, m)
    capacity = max(_HISTORY, 1 << (length + CHUNK + m).bit_length())  # the oldest chunk stands out of the window
    chunks = capacity // CHUNK + 2
    return WindowState(
        length, m,
        rows=np.zeros((capacity, len(COLUMNS))), starts=np.zeros(capacity, dtype=np.bool_),
        sums=np.zeros((chunks, _SUMS)), firsts=np.zeros(chunks, dtype=np.int64),
        open_sums=np.zeros(_SUMS), group=np.zeros((2, len(COLUMNS))), count=np.zeros(5, dtype=np.int64),
    )


def warm_up() -> None:
    """Compile the kernels, or load them from the cache."""
    still = np.zeros(3)
    estimate(update(init(4), Samples(still, still, still, still, still, still, T_s=1.0)))


def check_window(length: int, m: int, estimated: Sequence[str] = PARAMETERS) -> None:
    """Raise ValueError, in a sentence, when a window cannot work."""
    if not 1 <= m <= MAX_M:
        raise ValueError(f"periods per row must be 1 to {MAX_M}, got {m}")
    least = len(estimated) * m
    if not least <= length <= MAX_LENGTH:
        raise ValueError(
            f"window length must be {least} ({len(estimated)} parameters x {m} periods per row) "
            f"to {MAX_LENGTH} samples, got {length}"
        )


def update(state: WindowState, samples: Samples, *, joined: bool = True) -> WindowState:
    """Take in consecutive samples, one or many.

    `joined`: the first of them follows the last one taken in by exactly one row; otherwise a new run begins.
    Samples with a value that is not finite are left out and counted, and end the run.
    """
    for run, follows in _finite_runs(samples, state):
        state = _take_run(state, run, joined=joined and follows)
        joined = True
    return state


def resized(state: WindowState, length: int, m: int) -> WindowState:
    """The same stream under another window: every balance still held is kept. Cost: one pass over them."""
    check_window(length, m, ())
    if m == state.m and length + CHUNK + m < len(state.rows):
        state.length = length
        return state
    new = init(length, m)
    new.last, new.left_out = state.last, state.left_out
    n = int(state.count[0])
    held = np.arange(max(0, n - min(len(state.rows), len(new.rows))), n) % len(state.rows)
    starts = state.starts[held]
    starts[:1] = True
    _append_to(new, state.rows[held], starts)
    return new


def estimate(
    state: WindowState, estimated: Sequence[str] = PARAMETERS, held: Mapping[str, float] | None = None,
    *, noise_aware: bool = True,
) -> WindowEstimate:
    """Least-squares solution of the window. Parameters not in `estimated` need a value in `held` (SI).

    `noise_aware` takes the energy that current noise adds to the regressors out of the normal matrix, which would else
    read inductances low; without it the result is plain least squares. A parameter that the window
    cannot tell gets no value of its own: its held one, if any, and a reason.
    """
    held = held or {}
    for name in PARAMETERS:
        if name not in estimated and name not in held:
            raise ValueError(f"{name} is not estimated and so needs a held value, got none")
    sums = np.zeros(_SUMS)
    first = max(0, int(state.count[0]) - state.length)
    _window_sums(first, state.m, state.rows, state.starts, state.sums, state.firsts, state.open_sums, state.count, sums)
    groups, pairs = int(sums[_GROUPS]), int(sums[_PAIRS])
    free = [PARAMETERS.index(name) for name in PARAMETERS if name in estimated]
    filled = state.samples == state.length
    if 2 * groups <= len(free):
        reason = f"{2 * groups} equations are too few for {len(free)} parameters"
        nothing = {
            name: Estimate(name, None, None, UNITS[name], Status.NO_DATA, reason) if name in estimated
            else _held(name, held, Status.HELD, "held at the given value")
            for name in PARAMETERS
        }
        return WindowEstimate(nothing, state.samples, state.gaps, 2 * groups, filled, None, None)

    lag0 = (_square(sums[_D0:_Q0], _D_AT), _square(sums[_Q0:_D1], _Q_AT))
    lag1 = (_square(sums[_D1:_Q1], _D_AT), _square(sums[_Q1:_GROUPS], _Q_AT))
    total = lag0[0] + lag0[1]
    G = total[np.ix_(free, free)]
    solution = np.append([0.0 if name in estimated else held[name] for name in PARAMETERS], [0.0, -1.0])
    solution[free] = 0.0
    ex = excitation(G, np.zeros_like(G))
    noise = np.zeros(len(free))
    for _ in range(_ROUNDS):
        solution[free] = 0.0
        solution[free] = -ex.inverse @ (total @ solution)[free]
        solution[4] = _arc(solution, ex, free, held)
        if noise_aware:
            noise = _regressor_noise(state, solution, lag0, lag1, groups, pairs)[free]
            ex = excitation(G, np.diag(noise))
    if not noise_aware:
        noise = _regressor_noise(state, solution, lag0, lag1, groups, pairs)[free]
    covariance, rss = _covariance(solution, free, ex, lag0, lag1, groups, pairs)
    bias = ex.inverse @ (noise * solution[free])
    std = np.sqrt(np.diag(covariance) + ((NOISE_DOUBT if noise_aware else 1.0) * bias) ** 2)

    estimates: dict[str, Estimate] = {}
    for name in PARAMETERS:
        if name not in estimated:
            estimates[name] = _held(name, held, Status.HELD, "held at the given value")
            continue
        j = free.index(PARAMETERS.index(name))
        if ex.told[j]:
            estimates[name] = Estimate(name, float(solution[free[j]]), float(std[j]), UNITS[name], Status.OK)
        else:
            estimates[name] = _held(name, held, Status.NOT_TOLD, _why(name, j, free, ex))
    rms = math.sqrt(rss / (2 * groups))
    return WindowEstimate(estimates, state.samples, state.gaps, 2 * groups, filled, ex.condition, rms)


def _finite_runs(samples: Samples, state: WindowState) -> list[tuple[Samples, bool]]:
    """Runs of finite samples, and whether each follows its predecessor directly."""
    columns = [samples.theta_e, samples.omega_e, samples.i_d, samples.i_q, samples.u_d, samples.u_q]
    columns += [column for column in (samples.i_d_mean, samples.i_q_mean) if column is not None]
    finite = np.isfinite(np.sum(columns, axis=0))
    if finite.all():
        return [(samples, True)] if len(samples) else []
    state.left_out += int(np.count_nonzero(~finite))
    edges = np.flatnonzero(np.diff(np.concatenate(([False], finite, [False]))))
    runs = [(samples[int(a) : int(b)], a == 0) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    if not finite[-1]:
        state.last = None
    return runs if finite[0] or not runs else [(runs[0][0], False), *runs[1:]]


def _take_run(state: WindowState, samples: Samples, *, joined: bool) -> WindowState:
    joins = joined and state.last is not None
    if joins and state.last is not None:
        samples = _joined(state.last, samples)
    state.last = samples[len(samples) - 1 :]
    balance = flux_balance(samples)
    starts = np.zeros(len(balance), dtype=np.bool_)
    starts[:1] = not joins
    if len(balance):
        _append_to(state, balance, starts)
    return state


def _append_to(state: WindowState, balance: Array, starts: Bools) -> None:
    _append(balance, starts, state.m, state.rows, state.starts, state.sums, state.firsts, state.open_sums, state.group,
            state.count)


def _joined(a: Samples, b: Samples) -> Samples:
    def both(x: Array, y: Array) -> Array:
        return np.concatenate((x, y))

    def both_or_none(x: Array | None, y: Array | None) -> Array | None:
        return None if x is None or y is None else np.concatenate((x, y))

    return replace(
        b, theta_e=both(a.theta_e, b.theta_e), omega_e=both(a.omega_e, b.omega_e), i_d=both(a.i_d, b.i_d),
        i_q=both(a.i_q, b.i_q), u_d=both(a.u_d, b.u_d), u_q=both(a.u_q, b.u_q),
        i_d_mean=both_or_none(a.i_d_mean, b.i_d_mean), i_q_mean=both_or_none(a.i_q_mean, b.i_q_mean), t0=a.t0,
    )


def _square(triangle: Array, at: Integers) -> Array:
    """Symmetric 6 x 6 matrix over (R_s, L_d, L_q, psi_f, h, u) from an axis' upper triangle."""
    full = np.zeros((6, 6))
    rows, columns = np.triu_indices(len(at))
    full[at[rows], at[columns]] = triangle
    full[at[columns], at[rows]] = triangle
    return full


def _arc(solution: Array, ex: Excitation, free: list[int], held: Mapping[str, float]) -> float:
    """Coefficient of h in V: -R_s psi_f/L_d, from what is told or held; 0 where that is not known."""
    known = solution[:4].copy()
    for j, told in zip(free, ex.told, strict=True):
        if not told:
            known[j] = held.get(PARAMETERS[j], 0.0)
    R_s, L_d, _, psi_f = known
    return float(-R_s * psi_f / L_d) if L_d > 0.0 else 0.0


def _regressor_noise(
    state: WindowState, solution: Array, lag0: tuple[Array, Array], lag1: tuple[Array, Array], groups: int, pairs: int
) -> Array:
    """Energy that current noise contributes to each regressor, shape (4,).

    White noise of variance sigma2 in the sampled current leaves a residual whose lag-1 covariance is
    -(L sigma/T)2, however the machine is excited. Where the window does not tell L, the flux difference x itself
    has one of -sigma2/T2; so has a signal that steps from row to row, but not without a residual to match.
    """
    if pairs == 0 or state.last is None:
        return np.zeros(4)
    T = state.last.T * state.m
    sigma2 = np.zeros(2)  # A2, per sample and axis
    for axis, (S0, S1) in enumerate(zip(lag0, lag1, strict=True)):
        j = 1 + axis  # L_d of the d axis, L_q of the q axis
        L2 = max(float(solution[j]) ** 2, 1e-18)
        gamma0 = max(0.0, float(solution @ S0 @ solution)) / groups
        gamma1 = float(solution @ S1 @ solution) / (2 * pairs)
        by_residual = min(max(0.0, -gamma1) / L2, S0[j, j] / (2 * groups))
        by_signal = min(max(0.0, -S1[j, j] / (2 * pairs)), gamma0 / (2.0 * L2))
        sigma2[axis] = T**2 * max(by_residual, by_signal)
    of_mean = sigma2 / (state.last.periods * state.m)
    s2 = lag0[1][3, 3]  # sum of s2, (rad/s)2
    x = groups * 2.0 * sigma2 / T**2 + s2 * of_mean
    return np.array([groups * of_mean.sum(), x[0], x[1], 0.0])


def _covariance(
    solution: Array, free: list[int], ex: Excitation, lag0: tuple[Array, Array], lag1: tuple[Array, Array],
    groups: int, pairs: int,
) -> tuple[Array, float]:
    """Sandwich covariance with first-order moving-average residuals per axis, and the residual's sum of squares."""
    dof = 2.0 * groups / (2.0 * groups - len(free))
    meat = np.zeros((len(free), len(free)))
    total = 0.0
    for S0, S1 in zip(lag0, lag1, strict=True):
        rss = max(0.0, float(solution @ S0 @ solution))
        total += rss
        gamma0 = dof * rss / groups
        gamma1 = dof * float(solution @ S1 @ solution) / (2.0 * pairs) if pairs else 0.0
        gamma1 = min(max(gamma1, -0.5 * gamma0), 0.5 * gamma0)
        meat += gamma0 * S0[np.ix_(free, free)] + gamma1 * S1[np.ix_(free, free)]
    covariance = ex.inverse @ meat @ ex.inverse
    return np.maximum(covariance, 0.0) * np.eye(len(free)), total


def _held(name: str, held: Mapping[str, float], status: Status, reason: str) -> Estimate:
    return Estimate(name, held.get(name), None, UNITS[name], status, reason)


_SILENT: Final = {
    "R_s": "no current flows",
    "L_d": "i_d is zero or does not stand out of its noise",
    "L_q": "i_q is zero or does not stand out of its noise",
    "psi_f": "the motor stands still",
}


def _why(name: str, j: int, free: list[int], ex: Excitation) -> str:
    """Why the window cannot tell a parameter, in a sentence."""
    groups = [group for group in ex.combinations if j in group]
    partners = sorted({PARAMETERS[free[k]] for group in groups for k in group if k != j}, key=PARAMETERS.index)
    if (j,) in groups or not partners:
        return f"this window cannot tell {name}: {_SILENT[name]}"
    return f"this window cannot tell {name} apart from {' and '.join(partners)}: currents and speed vary too little"


@kernel
def _append(
    new_rows: Array, new_starts: Bools, m: int, rows: Array, starts: Bools, sums: Array, firsts: Integers,
    open_sums: Array, group: Array, count: Integers,
) -> None:
    """Put balances into the ring and their groups into the open chunk; close a full chunk between groups."""
    capacity, chunks = len(rows), len(sums)
    for k in range(len(new_rows)):
        if new_starts[k]:
            count[3] = 0
            count[4] = 0
        if count[3] == 0 and count[0] - count[2] >= CHUNK:
            sums[count[1] % chunks] = open_sums
            firsts[count[1] % chunks] = count[2]
            count[1] += 1
            count[2] = count[0]
            open_sums[:] = 0.0
        at = count[0] % capacity
        rows[at] = new_rows[k]
        starts[at] = new_starts[k]
        count[0] += 1
        _take(new_rows[k], m, group, count[3:5], open_sums)


@kernel
def _take(row: Array, m: int, group: Array, fill: Integers, sums: Array) -> None:
    """Add one balance to its group; add the group to the sums when it is complete."""
    if fill[0] == 0:
        group[0] = row
    else:
        group[0] += row
    fill[0] += 1
    if fill[0] < m:
        return
    group[0] /= m
    fill[0] = 0
    _add_products(group[0], group[0], 0.5, sums[:_D1])
    sums[_GROUPS] += 1.0
    if fill[1]:
        _add_products(group[0], group[1], 1.0, sums[_D1:_GROUPS])
        sums[_PAIRS] += 1.0
    group[1] = group[0]
    fill[1] = 1


@kernel
def _add_products(a: Array, b: Array, weight: float, sums: Array) -> None:
    """Add weight (z_a z_b' + z_b z_a') of both axes, upper triangles, to the sums (30,)."""
    za = (a[0], a[2], -a[5], a[7], a[8])
    zb = (b[0], b[2], -b[5], b[7], b[8])
    n = 0
    for i in range(_Z):
        for j in range(i, _Z):
            sums[n] += weight * (za[i] * zb[j] + zb[i] * za[j])
            n += 1
    za = (a[1], a[4], a[3], a[6], a[9])
    zb = (b[1], b[4], b[3], b[6], b[9])
    for i in range(_Z):
        for j in range(i, _Z):
            sums[n] += weight * (za[i] * zb[j] + zb[i] * za[j])
            n += 1


@kernel
def _window_sums(
    first: int, m: int, rows: Array, starts: Bools, sums: Array, firsts: Integers, open_sums: Array, count: Integers,
    total: Array,
) -> None:
    """Sums over the complete groups among the balances numbered `first` and up."""
    capacity, chunks = len(rows), len(sums)
    end = count[0]  # one past the rows of the chunk in hand
    oldest = count[2]
    if oldest >= first:
        total += open_sums
        end = oldest
        for back in range(1, count[1] + 1):
            at = (count[1] - back) % chunks
            oldest = firsts[at]
            if oldest < first:
                break
            total += sums[at]
            end = oldest
    if oldest >= first:
        return
    # The chunk that the window's edge cuts: its groups are counted from the chunk's start or the run's.
    group = np.zeros((2, rows.shape[1]))
    fill = np.zeros(2, dtype=np.int64)
    place = 0
    for number in range(oldest, end):
        at = number % capacity
        if starts[at]:
            place = 0
            fill[:] = 0
        if number >= first and (place == 0 or fill[0] > 0):
            _take(rows[at], m, group, fill, total)
        place = (place + 1) % m
