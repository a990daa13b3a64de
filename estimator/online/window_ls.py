"""Streaming sliding-window least squares for any subset of R_s, L_d, L_q, psi_f.

The window's normal equations are sums over chunks of balances. A chunk only ever adds; what leaves the window leaves
as a whole chunk, and the oldest one, cut by the window's edge, is summed anew from its rows. Nothing is
subtracted, so nothing drifts: the estimate is the least-squares solution of the rows in the window.
The sums hold all four parameters, so what is estimated and what is held may change at any time at no cost.

    state = init(length=1000, m=1)
    state = update(state, samples)
    result = estimate(state, ("R_s", "L_d", "L_q"), {"psi_f": 0.12})

The method: S. Wang, Windowed Least Square Algorithm Based PMSM Parameters Estimation, Mathematical Problems
in Engineering, 2013, doi 10.1155/2013/131268; its downdate, which subtracts, is replaced as said.
Knows nothing of clocks, drives or files; `window_sums` does the summing and `solve` the solving.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from estimator.arrays import Array, Bools, Integers
from estimator.machine import PARAMETERS
from estimator.online.estimate import WindowEstimate
from estimator.online.flux_balance import COLUMNS, columns_of
from estimator.online.solve import check_held, solve
from estimator.online.sums import WindowSums, sums_from
from estimator.online.window_sums import (
    CHUNK,
    ROWS,
    SUMS,
    take_balances,
    take_sample,
    take_samples,
    total_sums,
    unfinished,
)
from estimator.samples import NOT_KNOWN, Resolution, Samples

MAX_LENGTH: Final = 1_000_000  # samples: 80 MB
MAX_M: Final = 1000
_HISTORY: Final = 1 << 14  # balances kept at least, so that a window can grow into what has been seen


@dataclass(slots=True, eq=False)
class WindowState:
    """A window over balances; `update` changes it in place and returns it.

    A *group* is m consecutive balances, averaged to one regression row per axis; a break in the stream
    ends the run, and an unfinished group with it.
    """

    length: int  # samples the window covers
    m: int  # periods per row: balances averaged to one
    rows: Array  # (10, capacity), ring of balances
    starts: Bools  # (capacity,), True where a balance does not join the one before
    sums: Array  # (capacity // CHUNK, SUMS), ring of finished chunks
    places: Integers  # (capacity // CHUNK,), balances of an unfinished group before each chunk
    ends: Array  # (8, 2), the newest sample, whose balance waits for its end, and room for that end
    count: Integers  # (3,), balances so far; whether the newest sample is there (1) and joins one (2); samples left out
    T_s: float = 1.0  # s, control period of the samples
    periods: int = 1  # control periods per sample
    resolution: Resolution = NOT_KNOWN
    q_only: bool = False  # the samples have no equation of the d axis

    @property
    def samples(self) -> int:
        """Balances now in the window."""
        return min(int(self.count[0]), self.length)

    @property
    def left_out(self) -> int:
        """Samples refused because a value was not finite."""
        return int(self.count[2])

    @property
    def gaps(self) -> int:
        """Breaks in the stream between the balances now in the window."""
        newest, capacity = int(self.count[0]), len(self.starts)
        first, end = (newest - self.samples) % capacity, newest % capacity
        inside = self.starts[first:end] if first < end else np.concatenate((self.starts[first:], self.starts[:end]))
        return int(np.count_nonzero(inside[1:]))


def init(length: int, m: int = 1) -> WindowState:
    """An empty window of `length` samples with rows of m periods. Raises ValueError outside the limits."""
    check_window(length, m)
    chunks = -(-max(_HISTORY, _needed(length, m)) // CHUNK)
    capacity = chunks * CHUNK
    return WindowState(
        length, m,
        rows=np.zeros((len(COLUMNS), capacity)), starts=np.zeros(capacity, dtype=np.bool_),
        sums=np.zeros((chunks, SUMS)), places=np.zeros(chunks, dtype=np.int64),
        ends=np.zeros((8, 2)), count=np.zeros(3, dtype=np.int64),
    )


def _needed(length: int, m: int) -> int:
    """Balances to keep: the window, and before it the oldest chunk's and the oldest group's."""
    return length + 2 * CHUNK + m


def warm_up() -> None:
    """Compile all kernels, or load them from the cache."""
    still = np.zeros(3)
    state = update(init(4), Samples(still, still, still, still, still, still, T_s=1.0))
    estimate(update_one(state, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    waiting(resized(state, 4, 2))


def check_window(length: int, m: int, parameters: int = 1) -> None:
    """Raise ValueError, in a sentence, when a window cannot work for so many parameters."""
    check_m(m)
    least = parameters * m
    if not least <= length <= MAX_LENGTH:
        raise ValueError(
            f"window length must be {least} ({parameters} parameters x {m} periods per row) "
            f"to {MAX_LENGTH} samples, got {length}"
        )


def check_m(m: int) -> None:
    """Raise ValueError, in a sentence, when rows cannot have so many periods."""
    if not 1 <= m <= MAX_M:
        raise ValueError(f"periods per row must be 1 to {MAX_M}, got {m}")


def update(state: WindowState, samples: Samples, *, joined: bool = True) -> WindowState:
    """Take in consecutive samples, one or many.

    `joined`: the first of them follows the last one taken in by exactly one row; otherwise a new run begins.
    Samples with a value that is not finite are left out and counted, and end the run.
    """
    columns = columns_of(samples)
    state.T_s, state.periods, state.resolution = samples.T_s, samples.periods, samples.resolution
    state.q_only = samples.q_only
    if not joined:
        state.count[1] = 0
    take_samples(
        *columns, samples.T_s, samples.periods, samples.i_d_mean is None, state.m, state.ends, state.rows, state.starts,
        state.sums, state.places, state.count,
    )
    return state


def update_one(
    state: WindowState, theta_e: float, omega_e: float, i_d: float, i_q: float, u_d: float, u_q: float,
    i_d_mean: float | None = None, i_q_mean: float | None = None,
) -> WindowState:
    """Take in the next sample, like those before in T_s and periods; see `Samples` for its values."""
    by_ends = i_d_mean is None or i_q_mean is None
    mean = (i_d, i_q) if i_d_mean is None or i_q_mean is None else (i_d_mean, i_q_mean)
    take_sample(
        (theta_e, omega_e, i_d, i_q, u_d, u_q, *mean), state.T_s, state.periods, by_ends, state.m, state.ends,
        state.rows, state.starts, state.sums, state.places, state.count,
    )
    return state


def resized(state: WindowState, length: int, m: int) -> WindowState:
    """This stream under another window: every balance still held is kept. Cost: one pass over them."""
    check_window(length, m)
    if m == state.m and _needed(length, m) <= len(state.starts):
        state.length = length
        return state
    new = init(length, m)
    new.T_s, new.periods, new.ends = state.T_s, state.periods, state.ends
    new.resolution, new.q_only = state.resolution, state.q_only
    new.count[1:] = state.count[1:]
    n = int(state.count[0])
    held = np.arange(max(0, n - min(len(state.starts), len(new.starts))), n) % len(state.starts)
    starts = state.starts[held]
    starts[:1] = True
    take_balances(state.rows[:, held], starts, m, new.rows, new.starts, new.sums, new.places, new.count)
    return new


def estimate(
    state: WindowState, estimated: Sequence[str] = PARAMETERS, held: Mapping[str, float] | None = None,
    *, noise_aware: bool = True,
) -> WindowEstimate:
    """What the window says. Parameters not in `estimated` need a value in `held` (SI); see `solve.solve`."""
    held = held or {}
    check_held(estimated, held)
    sums = sums_of(state, [state.length])
    found = solve(sums, estimated, held, noise_aware=noise_aware)
    return WindowEstimate(
        found.estimates, state.samples, state.gaps, sums.axes * int(sums.rows[0]), state.samples == state.length,
        found.condition, found.residual_rms, state.left_out, found.combinations, found.impossible,
    )


def sums_of(state: WindowState, lengths: Sequence[int], ends: Sequence[int] | None = None) -> WindowSums:
    """Sums over the newest so many balances, at most the window's own length; from `ends` balances ago, if given."""
    newest = int(state.count[0])
    total = np.zeros((len(lengths), SUMS))
    for length, end, into in zip(lengths, ends or [0] * len(lengths), total, strict=True):
        first = max(0, newest - min(length, state.length))
        total_sums(first, newest - end, state.m, state.rows, state.starts, state.sums, state.places, into)
    triangles = total[:, :ROWS].reshape(len(lengths), 6, -1)
    return sums_from(
        triangles, total[:, ROWS:], state.T_s, state.periods * state.m, state.resolution, q_only=state.q_only
    )


def waiting(state: WindowState) -> int:
    """Number of the newest balances that wait for the rest of their group of m."""
    return unfinished(state.m, state.rows, state.starts, state.places, state.count)
