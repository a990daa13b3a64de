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
Knows nothing of clocks, drives or files, and leaves the solution of the equations to `solve`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.estimate import WindowEstimate
from estimator.flux_balance import COLUMNS, flux_balance
from estimator.kernel import kernel
from estimator.machine import PARAMETERS
from estimator.samples import Samples
from estimator.solve import WindowSums, solve, window_sums
from estimator.stream import Stream, runs_of

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Integers = NDArray[np.int64]

CHUNK: Final = 256  # rows a chunk holds at least
MAX_LENGTH: Final = 1_000_000  # rows: 80 MB
MAX_M: Final = 1000
_HISTORY: Final = 1 << 15  # rows kept at least, so that a window can grow into what has been seen

# A chunk's sums: upper triangles of z z' and of z_k z_{k+1}' + its transpose, z = (regressors, voltage),
# for the d axis (R_s, L_d, L_q, h, u_d) and the q axis (R_s, L_d, L_q, psi_f, u_q), then rows and adjacent pairs.
_Z: Final = 5
_LAG1: Final = 30
_GROUPS: Final = 60
_PAIRS: Final = 61
_SUMS: Final = 62


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
    stream: Stream = field(default_factory=Stream)

    @property
    def left_out(self) -> int:
        """Samples refused because a value was not finite."""
        return self.stream.left_out

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
    """Take in consecutive samples, one or many; `joined` and values that are not finite as in `stream.runs_of`."""
    for run, continues in runs_of(state.stream, samples, joined=joined):
        balance = flux_balance(run)
        starts = np.zeros(len(balance), dtype=np.bool_)
        starts[:1] = not continues
        _append_to(state, balance, starts)
    return state


def resized(state: WindowState, length: int, m: int) -> WindowState:
    """The same stream under another window: every balance still held is kept. Cost: one pass over them."""
    check_window(length, m, ())
    if m == state.m and length + CHUNK + m < len(state.rows):
        state.length = length
        return state
    new = init(length, m)
    new.stream = state.stream
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
    """What the window says. Parameters not in `estimated` need a value in `held` (SI); see `solve.solve`."""
    held = held or {}
    for name in PARAMETERS:
        if name not in estimated and name not in held:
            raise ValueError(f"{name} is not estimated and so needs a held value, got none")
    sums = sums_of(state, state.length)
    found = solve(sums, estimated, held, noise_aware=noise_aware)
    return WindowEstimate(
        found.estimates, state.samples, state.gaps, 2 * sums.rows, state.samples == state.length, found.condition,
        found.residual_rms,
    )


def sums_of(state: WindowState, length: int) -> WindowSums:
    """Sums over the newest `length` balances, at most the window's own length."""
    total = np.zeros(_SUMS)
    first = max(0, int(state.count[0]) - min(length, state.length))
    _window_sums(
        first, state.m, state.rows, state.starts, state.sums, state.firsts, state.open_sums, state.count, total
    )
    triangles = total[:_GROUPS].reshape(4, _Z * (_Z + 1) // 2)
    T_s, periods = state.stream.T_s, state.stream.periods
    return window_sums(triangles, int(total[_GROUPS]), int(total[_PAIRS]), T_s, periods * state.m)


def _append_to(state: WindowState, balance: Array, starts: Bools) -> None:
    _append(balance, starts, state.m, state.rows, state.starts, state.sums, state.firsts, state.open_sums, state.group,
            state.count)


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
    _add_products(group[0], group[0], 0.5, sums[:_LAG1])
    sums[_GROUPS] += 1.0
    if fill[1]:
        _add_products(group[0], group[1], 1.0, sums[_LAG1:_GROUPS])
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
