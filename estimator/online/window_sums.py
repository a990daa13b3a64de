"""The compiled part of the window: samples to balances in a ring, balances to chunks' sums, chunks to a window's sums.

Balance number n lies at place n modulo the ring's capacity; chunk c holds the balances from c CHUNK on. A group of m
balances, averaged, is a regression row, and belongs to the chunk in which it ends. Consecutive rows of a chunk make
batches of at most BATCH, each half over the next, whose sums tell how the residual behaves over more than two rows.
They are weighted by sin^2 (P. D. Welch, The use of fast Fourier transform for the estimation of power spectra, IEEE
Transactions on Audio and Electroacoustics 15, 1967, doi 10.1109/TAU.1967.1161901), so that their two ends do not count.

A chunk's sums are the upper triangles of z z', of z_k z_{k-1}' + its transpose, and of b b' with b = sum w_k z_k over a
batch; z = (regressors, voltage): (R_s, L_d, L_q, h, u_d) of the d axis and (R_s, L_d, L_q, psi_f, u_q) of the q axis;
then the numbers of rows, of pairs of neighbouring rows, and of batches, and sums of w_k^2 and of w_k w_{k+1}.
Knows nothing of what the sums are for.
"""

from typing import Final

import numpy as np

from estimator.arrays import Array, Bools, Integers
from estimator.kernel import kernel, summing_kernel
from estimator.online.flux_balance import balances_into
from estimator.samples import Column

Sample = tuple[float, float, float, float, float, float, float, float]
"""theta_e (rad), omega_e (rad/s), i_d, i_q (A), u_d, u_q (V), i_d_mean, i_q_mean (A)."""

CHUNK: Final = 256  # balances
BATCH: Final = 32  # rows at most
SHORTEST_BATCH: Final = 4  # rows
ROWS: Final = 90  # place of the number of rows in a chunk's sums,
PAIRS: Final = 91  # of the number of pairs,
BATCHES: Final = 92  # of the number of batches,
WEIGHTS: Final = 93  # of the two sums of their weights,
SUMS: Final = 95  # and the size

PLACES: Final = ((0, 2, 5, 7, 8), (1, 4, 3, 6, 9))  # of a balance in z, by axis
SIGNS: Final = ((1.0, 1.0, -1.0, 1.0, 1.0), (1.0, 1.0, 1.0, 1.0, 1.0))


def _tapers() -> Array:
    """Row n: the weights of a batch of n rows, then the sums of w_k^2 and of w_k w_{k+1}."""
    tapers = np.zeros((BATCH + 1, BATCH + 2))
    for n in range(1, BATCH + 1):
        tapers[n, :n] = np.sin(np.pi * (np.arange(n) + 0.5) / n) ** 2
        tapers[n, BATCH] = np.sum(tapers[n, :BATCH] ** 2)
        tapers[n, BATCH + 1] = np.sum(tapers[n, 1:BATCH] * tapers[n, : BATCH - 1])
    return tapers


_TAPERS: Final = _tapers()


@kernel
def take_samples(
    theta_e: Column, omega_e: Column, i_d: Column, i_q: Column, u_d: Column, u_q: Column, i_d_mean: Column,
    i_q_mean: Column, T_s: float, periods: int, by_ends: bool, m: int, ends: Array, rows: Array, starts: Bools,
    sums: Array, places: Integers, count: Integers,
) -> None:
    """Take in samples, by stretches up to the next chunk; a stretch with a value that is no number, one by one."""
    n, k = len(theta_e), 0
    scratch = np.empty((3, CHUNK))
    while k < n:
        stop = min(n, k + CHUNK - count[0] % CHUNK)
        if k == 0 or count[1] == 0 or stop - k < 8:
            stop = k + 1
        else:
            at, size = count[0] % len(starts), stop - k
            a = k - 1  # the stretch's first balance begins at the sample before
            balances_into(
                theta_e[a:stop], omega_e[a:stop], i_d[a:stop], i_q[a:stop], u_d[a:stop], u_q[a:stop],
                i_d_mean[a:stop], i_q_mean[a:stop], T_s, periods, by_ends, rows, at, scratch,
            )
            last = (theta_e[stop - 1], omega_e[stop - 1], i_d[stop - 1], i_q[stop - 1], u_d[stop - 1], u_q[stop - 1],
                    i_d_mean[stop - 1], i_q_mean[stop - 1])
            if _all_finite(rows, at, at + size) and _is_finite(last):
                starts[at : at + size] = False
                starts[at] = count[1] == 1
                _set(ends, last)
                count[1] = 2
                k = stop
                _count_balances(size, m, rows, starts, sums, places, count)
                continue
        for j in range(k, stop):
            sample = (theta_e[j], omega_e[j], i_d[j], i_q[j], u_d[j], u_q[j], i_d_mean[j], i_q_mean[j])
            take_sample(sample, T_s, periods, by_ends, m, ends, rows, starts, sums, places, count)
        k = stop


@kernel
def take_sample(
    sample: Sample, T_s: float, periods: int, by_ends: bool, m: int, ends: Array, rows: Array, starts: Bools,
    sums: Array, places: Integers, count: Integers,
) -> None:
    """Take in a sample: it ends the balance of the one before, if that joins it, and waits for its own end."""
    if not _is_finite(sample):
        count[1] = 0
        count[2] += 1
        return
    for j in range(8):
        ends[j, 1] = sample[j]
    if count[1] > 0:
        at = count[0] % len(starts)
        balances_into(
            ends[0], ends[1], ends[2], ends[3], ends[4], ends[5], ends[6], ends[7], T_s, periods, by_ends,
            rows, at, np.empty((3, 1)),
        )
        starts[at] = count[1] == 1
        _count_balances(1, m, rows, starts, sums, places, count)
    count[1] = 2 if count[1] > 0 else 1
    _set(ends, sample)


@kernel
def _set(ends: Array, sample: Sample) -> None:
    for j in range(8):
        ends[j, 0] = sample[j]


@kernel
def _is_finite(sample: Sample) -> bool:
    check = 0.0
    for value in sample:
        check += value - value
    return check == 0.0


@summing_kernel
def _all_finite(rows: Array, at: int, end: int) -> bool:
    check = 0.0
    for j in range(len(rows)):
        column = rows[j, at:end]
        for k in range(len(column)):
            check += column[k] - column[k]
    return check == 0.0


@kernel
def take_balances(
    new: Array, new_starts: Bools, m: int, rows: Array, starts: Bools, sums: Array, places: Integers, count: Integers
) -> None:
    """Take in balances (10, n) as they are."""
    for k in range(len(new_starts)):
        at = count[0] % len(starts)
        for j in range(10):
            rows[j, at] = new[j, k]
        starts[at] = new_starts[k]
        _count_balances(1, m, rows, starts, sums, places, count)


@kernel
def _count_balances(
    size: int, m: int, rows: Array, starts: Bools, sums: Array, places: Integers, count: Integers
) -> None:
    """Count the balances just written, all of one chunk; sum the chunk when they complete it."""
    count[0] += size
    if count[0] % CHUNK == 0:
        chunk = count[0] // CHUNK - 1
        at = chunk % len(sums)
        sums[at] = 0.0
        place = add_sums(chunk * CHUNK, count[0], 0, int(places[at]), m, rows, starts, sums[at])
        places[(chunk + 1) % len(sums)] = place


@kernel
def total_sums(
    first: int, end: int, m: int, rows: Array, starts: Bools, sums: Array, places: Integers, total: Array
) -> None:
    """Sums over the groups that lie wholly in the balances numbered [first, end)."""
    for chunk in range(first // CHUNK, (end - 1) // CHUNK + 1):
        begin, stop = chunk * CHUNK, min(end, (chunk + 1) * CHUNK)
        at = chunk % len(sums)
        if begin - places[at] >= first and stop == begin + CHUNK:
            total += sums[at]
        else:
            add_sums(begin, stop, first, int(places[at]), m, rows, starts, total)


@kernel
def unfinished(m: int, rows: Array, starts: Bools, places: Integers, count: Integers) -> int:
    """Number of the newest balances that wait for the rest of their group."""
    chunk = count[0] // CHUNK
    place = int(places[chunk % len(places)])
    return add_sums(chunk * CHUNK, count[0], count[0], place, m, rows, starts, np.zeros(SUMS))


@kernel
def add_sums(begin: int, end: int, first: int, place: int, m: int, rows: Array, starts: Bools, total: Array) -> int:
    """Add the groups that end in [begin, end) of one chunk and start at `first` or later.

    `place` is the number of balances of an unfinished group before `begin`. Returns the number at `end`.
    """
    capacity = len(starts)
    if m == 1:
        begin = max(begin, first)
        at, end_at = begin % capacity, begin % capacity + end - begin  # a chunk lies in one piece
        if begin > first and not starts[at]:
            add_pair(rows[:, at], rows[:, (begin - 1) % capacity], total)
        while at < end_at:  # stretches without a break, summed at once
            stop = at + 1
            while stop < end_at and not starts[stop]:
                stop += 1
            add_products(rows, at, stop, total)
            batch = at
            while batch + BATCH < stop:
                add_batch(rows, batch, batch + BATCH, total)
                batch += BATCH // 2
            add_batch(rows, batch, stop, total)
            at = stop
        return 0

    return add_groups(begin, end, first, place, m, rows, starts, total)


@kernel
def add_groups(begin: int, end: int, first: int, place: int, m: int, rows: Array, starts: Bools, total: Array) -> int:
    """Add groups of several balances to a total; a chunk ends within its last group. Places as for single ones."""
    capacity = len(starts)
    group, before = np.zeros(10), np.zeros(10)
    batch, rows_of_batch, fresh = np.empty((10, BATCH)), 0, False
    filled, joins = 0, False
    number = begin - place
    if number - m >= first and not starts[number % capacity]:  # the group before, for its pair with the next
        joins = True
        for k in range(number - m, number):
            if k > number - m and starts[k % capacity]:
                joins = False
            before += rows[:, k % capacity]
        before /= m
    for k in range(number, end):
        at = k % capacity
        if starts[at]:
            filled, joins = 0, False
        if fresh and (rows_of_batch == BATCH or not joins):
            add_batch(batch, 0, rows_of_batch, total)
            fresh = False
            rows_of_batch = BATCH // 2 if joins else 0
            batch[:, :rows_of_batch] = batch[:, BATCH // 2 : BATCH // 2 + rows_of_batch]
        if filled == 0:
            group[:] = 0.0
        group += rows[:, at]
        filled += 1
        if filled == m:
            filled = 0
            if k - m + 1 >= first:
                group /= m
                add_products(group.reshape(10, 1), 0, 1, total)
                if joins:
                    add_pair(group, before, total)
                before[:] = group
                joins = True
                batch[:, rows_of_batch] = group
                rows_of_batch += 1
                fresh = True
    if fresh:
        add_batch(batch, 0, rows_of_batch, total)
    return filled


@summing_kernel
def add_products(rows: Array, at: int, end: int, total: Array) -> None:
    """Add the products of consecutive regression rows, places [at, end), of each with itself and with the next."""
    n = end - at
    place = 0
    for axis in range(2):
        for i in range(5):
            a = rows[PLACES[axis][i], at:end]
            for j in range(i, 5):
                b = rows[PLACES[axis][j], at:end]
                lag0, lag1 = a[0] * b[0], 0.0
                for k in range(1, n):
                    lag0 += a[k] * b[k]
                    lag1 += a[k] * b[k - 1] + a[k - 1] * b[k]
                sign = SIGNS[axis][i] * SIGNS[axis][j]
                total[place] += sign * lag0
                total[30 + place] += sign * lag1
                place += 1
    total[ROWS] += n
    total[PAIRS] += n - 1


@summing_kernel
def add_batch(rows: Array, at: int, end: int, total: Array) -> None:
    """Add the products of the weighted sum of consecutive regression rows, places [at, end), if they are enough."""
    n = end - at
    if n < SHORTEST_BATCH:
        return
    w = _TAPERS[n]
    b = np.empty(10)
    for j in range(10):
        column = rows[j, at:end]
        b[j] = 0.0
        for k in range(n):
            b[j] += w[k] * column[k]
    place = 60
    for axis in range(2):
        for i in range(5):
            p = PLACES[axis][i]
            for j in range(i, 5):
                q = PLACES[axis][j]
                total[place] += SIGNS[axis][i] * SIGNS[axis][j] * b[p] * b[q]
                place += 1
    total[BATCHES] += 1.0
    total[WEIGHTS] += _TAPERS[n, BATCH]
    total[WEIGHTS + 1] += _TAPERS[n, BATCH + 1]


@kernel
def add_pair(row: Array, before: Array, total: Array) -> None:
    """Add the products of two neighbouring regression rows (10,)."""
    place = 30
    for axis in range(2):
        for i in range(5):
            p = PLACES[axis][i]
            for j in range(i, 5):
                q = PLACES[axis][j]
                sign = SIGNS[axis][i] * SIGNS[axis][j]
                total[place] += sign * (row[p] * before[q] + before[p] * row[q])
                place += 1
    total[PAIRS] += 1.0
