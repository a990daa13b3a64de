"""Odd rows: the few that constant parameters miss by far where they meet the rows around them.

A cell that was changed on its way - a digit, a sign, the decimal point - is such a row, whatever its column: the flux
balances of `flux_balance` hold before and after it, and not across it. They are looked for in the flux error of
`detect`, in which a wrong current or angle stands alone, and in the balances themselves, for wrong voltages; each less
the median around it, so that a mismatch which lasts is none. The worst is taken out first and the parameters are fitted
anew, since it bends them. Rows that are many are no accident: then none is odd.

What constant parameters miss may as well be physics that they leave out, of a few rows. `odd_samples` finds what no
physics makes: a sample whose currents leave those around it and return, while no voltage drives them - the balances it
ends and begins miss as they do by a change of it alone, and those around them do not -, and a voltage that leaves those
around it and returns, while no current follows. Knows nothing of streams and effects.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array, Bools, Vector, Vectors
from estimator.diagnosis.likelihood.constant_parameters import (
    POLE,
    balance_columns,
    half_turn,
    least_squares,
    of_h,
    whiten_axes,
)
from estimator.kernel import kernel
from estimator.online.flux_balance import angle_turned, flux_balance
from estimator.samples import Samples

FEWEST_ODD_ROWS: Final = 200  # rows, of which parameters and noise are told
FAR: Final = 6.0  # standard deviations of what is usual
RARE: Final = 1e-3  # of the rows, and
FEW: Final = 3  # of few rows: more are no accident
_AS_BAD: Final = 0.5  # of the worst: what is as bad is taken out with it
MEDIAN_SIDE: Final = 3  # rows to either side, of the median
_NINE_OF_TEN_NORMAL: Final = 1.645  # standard deviations, that nine of ten values stay within
_BOTH: Final = 0.3  # of the worst, that the balance after it misses by where it is the sample between them
_RETURNS: Final = 0.2  # of what a sample's balances miss, that a change of its currents leaves of them
_QUIET_SIDES: Final = 0.3  # of the same, that balances to their sides miss at most; of a jump, that the way back is off
_LOUD: Final = 20.0  # times what voltages usually leave those around them by
_USUAL_NOISE: Final = 4.0  # standard deviations of what is usual, that noise stays within
_REFITS: Final = 5  # of fits, each without what the one before found
_ROUNDED_TO: Final = 1e-9  # of the voltages' rms: what numbers are rounded to


class Usual(NamedTuple):
    """Constant parameters, and what they usually leave."""

    beta: Array  # (4,), SI
    usual: Array  # (4,): standard deviations of the flux error on d and q, Vs, and of the balance, V


@dataclass(frozen=True, slots=True, eq=False)
class Odd:
    """What was found."""

    bad: tuple[Bools, ...]  # rows of each run that are odd
    fitted: Usual | None  # by the other rows, for runs too short to be fitted


def odd_rows(runs: Sequence[Samples], before: Usual | None = None) -> Odd:
    """Odd rows of runs without gaps. `before`: a fit of rows before them, used where these are too few for one."""
    table, bad = _table(runs), np.zeros(sum(map(len, runs)), np.bool_)
    few = len(table.D) < FEWEST_ODD_ROWS
    fitted = before if few else None
    if not few or before is not None:
        with np.errstate(all="ignore"):  # numbers without bound are among what is looked for
            bad, fitted = _searched(table, fitted, len(bad))
    return Odd(_by_run(runs, bad), fitted)


def odd_samples(runs: Sequence[Samples], bad: Sequence[Bools]) -> tuple[Bools, ...]:
    """Samples of each run that leave those around them and return, as no machine does. `bad`: what is known as such."""
    table = _table(runs)
    known = np.concatenate(bad)
    found = np.zeros(len(known), np.bool_)
    with np.errstate(all="ignore"):
        for _ in range(_REFITS if len(table.D) >= FEWEST_ODD_ROWS else 0):
            _, e, fitted = _beyond_median(table, known | found, None)
            new = np.append(False, _currents_return(table, e, fitted)) | _voltage_returns(table, e, fitted)
            if not new.any():
                break
            found[table.begins[new]] = True
    return _by_run(runs, found & (np.count_nonzero(found) <= table.most))


def _by_run(runs: Sequence[Samples], found: Bools) -> tuple[Bools, ...]:
    return tuple(found[a:b] for a, b in pairwise(np.cumsum([0, *map(len, runs)])))


class _Table(NamedTuple):
    """Flux balances of all runs, one after another."""

    columns: Vectors  # see `detect.columns_of`
    half: Vector  # turn of half a row
    D: Array  # rad, turned in a control period
    joined: Bools  # to the balance before
    begins: NDArray[np.int64]  # the sample that a balance begins with, counted over all runs
    T: float  # s, of a row

    @property
    def most(self) -> int:
        """Odd rows that may be there by accident."""
        return max(FEW, int(RARE * len(self.D)))


def _table(runs: Sequence[Samples]) -> _Table:
    parts = [flux_balance(run) for run in runs]
    balance = np.concatenate(parts)
    ends = np.cumsum([0, *map(len, runs)])
    begins: NDArray[np.int64] = np.concatenate([
        np.arange(a, a + len(part), dtype=np.int64) for a, part in zip(ends.tolist(), parts, strict=False)
    ])
    joined = np.diff(begins, prepend=-2) == 1
    D = angle_turned(balance, runs[0].T_s)
    q_only = runs[0].q_only
    return _Table(
        balance_columns(balance, q_only=q_only), half_turn(D, q_only=q_only), D, joined, begins, runs[0].T
    )


def _searched(table: _Table, known: Usual | None, samples: int) -> tuple[Bools, Usual | None]:
    """The odd samples, and the fit of all others; none where they are too many."""
    bad = np.zeros(samples, np.bool_)
    first = known
    while True:
        z, e, fitted = _beyond_median(table, bad, known)
        first = first or fitted
        far = np.maximum(_over_usual(z, fitted.usual[:2]), _over_usual(e, fitted.usual[2:]))
        worst = float(np.max(far, initial=0.0))
        if not worst > FAR:
            return bad, fitted
        if np.count_nonzero(far > max(FAR, _AS_BAD * worst)) + np.count_nonzero(bad) > 4 * table.most:
            return np.zeros(samples, np.bool_), first
        found = np.flatnonzero(far >= max(FAR, _AS_BAD * worst))
        peaks = found[np.concatenate(([True], np.diff(found) > 1))]  # the first of neighbours; others in their turn
        bad[_sample_of(table, peaks, np.abs(e))] = True
        if np.count_nonzero(bad) > table.most:
            return np.zeros(samples, np.bool_), first


def _sample_of(table: _Table, balances: NDArray[np.int64], e: Array) -> NDArray[np.int64]:
    """The sample that makes a balance odd: the one at its end, where the next balance misses as well, or its first."""
    after = np.minimum(balances + 1, len(e) - 1)
    both = (e[after] > _BOTH * e[balances]) & table.joined[after] & (after > balances)
    return table.begins[balances] + both


def _currents_return(table: _Table, e: Vector, fitted: Usual) -> Bools:
    """Of each two balances, whether a change of the sample between them is what both miss, and what no other does."""
    R_s, L_d, L_q, _ = fitted.beta.tolist()
    there, back = e[:-1], e[1:]
    least = np.minimum(np.abs(there), np.abs(back))
    turned, s = np.cos(0.5 * table.D[1:]), table.columns[3, 1:].imag
    i_d = (back - there).real * table.T / (2.0 * (L_d or 1.0) * turned)  # A, by which the sample is off
    i_q = (back - there).imag * table.T / (2.0 * L_q * turned)
    left = there + back + R_s * (i_d + 1j * i_q) - L_q * s * i_q + 1j * L_d * s * i_d
    far = _over_usual(e, fitted.usual[2:]) > FAR
    size, joined = np.abs(e), table.joined[1:]
    before = np.concatenate(([0.0], np.where(joined[:-1], size[:-2], 0.0)))  # what the balances around both miss
    after = np.concatenate((np.where(joined[1:], size[2:], 0.0), [0.0]))
    alone = np.maximum(before, after) < _QUIET_SIDES * least
    return far[:-1] & far[1:] & joined & alone & (np.abs(left) < _RETURNS * least)


def _voltage_returns(table: _Table, e: Vector, fitted: Usual) -> Bools:
    """Of each balance, whether it misses what its voltage leaves those around it by, and those miss nothing.

    By far more than noise, or, where voltages are quiet otherwise, within noise.
    """
    u, usual, size = table.columns[4], fitted.usual[2:], np.abs(e)
    returns = np.zeros(len(u), np.bool_)
    before, after = u[1:-1] - u[:-2], u[1:-1] - u[2:]
    jump = 0.5 * (before + after)
    misses, beside = e[1:-1], np.maximum(size[:-2], size[2:])
    by_far = (_over_usual(misses, usual) > FAR) & (np.abs(before - after) < np.abs(jump))  # a step does not return
    by_far &= (np.abs(misses - jump) < _RETURNS * size[1:-1]) & (beside < _QUIET_SIDES * size[1:-1])
    own = np.array([_usual(jump.real), _usual(jump.imag)])
    quiet = _over_usual(jump, np.maximum(usual, own * _LOUD / FAR)) > FAR
    quiet &= (np.abs(before - after) < _QUIET_SIDES * np.abs(jump)) & (_over_usual(misses - jump, usual) < _USUAL_NOISE)
    quiet &= np.maximum(_over_usual(e[:-2], usual), _over_usual(e[2:], usual)) < _USUAL_NOISE
    returns[1:-1] = table.joined[1:-1] & table.joined[2:] & (by_far | quiet)
    return returns


def _beyond_median(table: _Table, bad: Bools, known: Usual | None) -> tuple[Vector, Vector, Usual]:
    """Flux error (Vs) and voltage (V) that parameters leave, less the median around; none next to bad samples."""
    used = ~(bad[table.begins] | bad[table.begins + 1])
    columns = cast(Vectors, np.where(used, table.columns, 0.0))
    joined = table.joined & used & np.concatenate(([False], used[:-1]))
    white = columns.copy()
    whiten_axes(white, table.half, joined, table.T, POLE, POLE)
    if known is None:
        bounded = white[:5] / np.maximum(1.0, _largest_entry(white[:5]))
        beta = least_squares(bounded[:4], bounded[4])
    else:
        beta = known.beta
    coefficients = np.array([*-beta, 1.0, of_h(beta), 0.0])
    z: Vector = coefficients @ white
    e: Vector = coefficients @ columns
    z, e = off_median(z, used), off_median(e, used)
    if known is not None:
        return z, e, known
    least = _ROUNDED_TO * float(np.median(np.abs(columns[4])))
    usual = np.array([_usual(x[used]) for x in (z.real, z.imag, e.real, e.imag)])
    return z, e, Usual(beta, np.maximum(usual, [least * table.T, least * table.T, least, least]))


def _largest_entry(white: Vectors) -> Array:
    """Of each row, how far beyond the usual its largest entry is."""
    size = np.zeros(white.shape[1])
    for column in white:
        there = np.abs(column)
        usual = float(np.quantile(there, 1.0 - 4.0 * RARE))
        if usual > 0.0:
            size = np.maximum(size, there / usual)
    return size


def off_median(x: Vector, used: Bools) -> Vector:
    """Values less the median of each and those to its sides, on either axis; 0 where they are not used."""
    off = np.zeros(len(x), np.complex128)
    off.real, off.imag = _less_median(np.ascontiguousarray(x.real)), _less_median(np.ascontiguousarray(x.imag))
    off[~used] = 0.0
    return off


@kernel
def _less_median(x: Array) -> Array:
    """Each value less the median of it and `MEDIAN_SIDE` to either side, at the ends of as many to one side."""
    n, off = len(x), np.empty_like(x)
    width = min(2 * MEDIAN_SIDE + 1, n)
    around = np.empty(width)
    for k in range(n):
        first = min(max(k - MEDIAN_SIDE, 0), n - width)
        for j in range(width):
            value, place = x[first + j], j
            while place > 0 and around[place - 1] > value:
                around[place] = around[place - 1]
                place -= 1
            around[place] = value
        off[k] = x[k] - around[width // 2]
    return off


def _usual(x: Array) -> float:
    return float(np.quantile(np.abs(x), 0.9)) / _NINE_OF_TEN_NORMAL if len(x) else 0.0


def _over_usual(x: Vector, usual: Array) -> Array:
    far = np.maximum(np.abs(x.real) / max(usual[0], 1e-300), np.abs(x.imag) / max(usual[1], 1e-300))
    return np.where(np.isfinite(far), far, 1e300)
