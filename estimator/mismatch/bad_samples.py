"""Bad samples: rows that no machine makes - voltages beyond the dc link, currents that jump and return, repeated rows.

They are left out, as gaps, and told. What a machine may do stays: a current may change as fast as its voltage drives
it, and voltages that are often too high are no glitch but another unit. Knows no effect.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.machine import Machine
from estimator.mismatch.words import number
from estimator.samples import Samples

Array = NDArray[np.float64]
Vector = NDArray[np.complex128]
Bools = NDArray[np.bool_]

_RARE: Final = 0.01  # of the rows: what is more often is no glitch
_BEYOND: Final = 1.0  # times the dc link: half as much again as a bridge's corner
_HIGH: Final = 2.0  # times what 99 % of the voltages stay below
_SIDE: Final = 3  # rows to either side, among which a jump is one
_DRIVEN: Final = 3.0  # times what the dc link changes a current by in a row; between a current and the median around it
_NOISE: Final = 30.0  # standard deviations of the same
_NINE_OF_TEN: Final = 2.146  # standard deviations of a component, that nine of ten vectors stay below
_PART: Final = 0.5  # of rated current, the same
_CALM: Final = 0.15  # of a jump, that the voltages around it explain at most
_STUCK: Final = 20  # rows
_ZEROS: Final = 5  # rows
_TURNS: Final = 0.01  # rad in the rows: the motor turns
_LIVELY: Final = 0.5  # of the rows, that may repeat where rows are no noise


class Cleared(NamedTuple):
    """Runs without bad samples, and what was left out."""

    runs: tuple[Samples, ...]
    remarks: tuple[str, ...]


class _Found(NamedTuple):
    """Bad rows of one kind in a run, and how those from a to b are told."""

    bad: Bools
    says: Callable[[int, int], str]


def without_bad(runs: Sequence[Samples], nominal: Machine) -> Cleared:
    """The runs, cut where a sample is bad, and a remark on each kind."""
    finite = [run for run in runs if len(run) > 2 * _SIDE and _finite(run)]
    if not finite:
        return Cleared(tuple(runs), ())
    whole = [_beyond(finite), _jumps(finite, nominal), _repeated(finite)]
    bad = {id(run): np.logical_or.reduce([found[k].bad for found in whole]) for k, run in enumerate(finite)}
    cut = [part for run in runs for part in (_cut(run, bad[id(run)]) if id(run) in bad else (run,))]
    remarks = tuple(said for found in whole if (said := _said(finite, found)))
    return Cleared(tuple(cut) if remarks else tuple(runs), remarks)


def _finite(run: Samples) -> bool:
    columns = (run.theta_e, run.i_d, run.i_q, run.u_d, run.u_q)
    return all(bool(np.all(np.isfinite(column))) for column in columns)


def _cut(run: Samples, bad: Bools) -> Iterator[Samples]:
    """What is between bad rows."""
    for a, b in _stretches(~bad):
        yield run[a:b]


def _stretches(there: Bools) -> list[tuple[int, int]]:
    """Begin and end of what is there."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], there, [False])).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _said(runs: Sequence[Samples], found: Sequence[_Found]) -> str:
    """One remark on all rows of a kind: the first in words, of the others how often."""
    places = [(k, a, b) for k, one in enumerate(found) for a, b in _stretches(one.bad)]
    if not places:
        return ""
    k, a, b = places[0]
    rows = sum(b - a for _, a, b in places)
    more = len(places) - 1
    others = f", and likewise {more} time{'s' if more > 1 else ''} more" if more else ""
    return f"{found[k].says(a, b)}{others}: {rows} row{'s' if rows > 1 else ''} left out"


def _time(run: Samples, row: int) -> str:
    return f"{run.t0 + row * run.T:.6g} s"


# --- Voltages


def _beyond(runs: Sequence[Samples]) -> list[_Found]:
    """Voltages that no bridge makes of the dc link."""
    size = [np.hypot(run.u_d, run.u_q) for run in runs]
    usual = _HIGH * float(np.quantile(np.concatenate(size), 0.99))
    found = [
        (u > np.maximum(_BEYOND * run.u_dc, usual)) if run.u_dc is not None else np.zeros(len(run), np.bool_)
        for run, u in zip(runs, size, strict=True)
    ]
    return [_Found(bad, _of_voltage(run)) for run, bad in zip(runs, _rare(found), strict=True)]


def _of_voltage(run: Samples) -> Callable[[int, int], str]:
    def says(a: int, _b: int) -> str:
        assert run.u_dc is not None
        name, value = max((("u_d", run.u_d[a]), ("u_q", run.u_q[a])), key=lambda one: abs(one[1]))
        return f"{name} is {number(value)} V at {_time(run, a)}, beyond what u_dc = {number(run.u_dc[a])} V can give"

    return says


def _rare(found: list[Bools]) -> list[Bools]:
    """What was found where it is rare, else nothing."""
    if sum(int(np.count_nonzero(bad)) for bad in found) <= _RARE * sum(map(len, found)):
        return found
    return [np.zeros(len(bad), np.bool_) for bad in found]


# --- Currents


def _jumps(runs: Sequence[Samples], nominal: Machine) -> list[_Found]:
    """Currents that leave those around them, farther than voltages drive them."""
    off = [_off(run.i_d + 1j * run.i_q) for run in runs]
    noise = float(np.quantile(np.abs(np.concatenate(off)), 0.9)) / _NINE_OF_TEN
    high = nominal.i_rated or float(np.quantile(np.concatenate([np.hypot(run.i_d, run.i_q) for run in runs]), 0.999))
    L = min(nominal.L_d, nominal.L_q)
    found: list[Bools] = []
    for run, jump in zip(runs, off, strict=True):
        far = np.abs(jump)
        bad = far > max(_NOISE * noise, _PART * high)
        if bad.any():
            calm = _most_around(np.abs(_off(run.u_d + 1j * run.u_q))) * (run.T / L) < _CALM * far
            driven = np.inf if run.u_dc is None else _DRIVEN * run.u_dc * (run.T / L)
            bad &= calm | (far > driven)
        found.append(bad)
    return [_Found(bad, _of_current(run, jump)) for run, bad, jump in zip(runs, _rare(found), off, strict=True)]


def _around(x: Array) -> Array:
    """Each value and those to its sides, as rows; the ends' own repeated."""
    padded = np.pad(x, _SIDE, mode="edge")
    return np.lib.stride_tricks.sliding_window_view(padded, 2 * _SIDE + 1)


def _off(x: Vector) -> Vector:
    """What is between values and the median around them; none at the ends."""
    middle = np.median(_around(x.real), axis=1) + 1j * np.median(_around(x.imag), axis=1)
    off = x - middle
    off[:_SIDE] = off[-_SIDE:] = 0.0
    return off


def _most_around(x: Array) -> Array:
    return np.max(_around(x), axis=1)


def _of_current(run: Samples, jump: Vector) -> Callable[[int, int], str]:
    def says(a: int, _b: int) -> str:
        d = abs(jump[a].real) > abs(jump[a].imag)
        name, value = ("i_d", run.i_d[a]) if d else ("i_q", run.i_q[a])
        return f"{name} jumps to {number(value)} A at {_time(run, a)} and back"

    return says


# --- Rows that repeat


def _repeated(runs: Sequence[Samples]) -> list[_Found]:
    """Rows of a recording with noise that hold what the row before them held, for long."""
    same = [_same(run) for run in runs]
    lively = sum(int(np.count_nonzero(s)) for s in same) < _LIVELY * sum(map(len, runs))
    return [_Found(_stuck(run, s) if lively else np.zeros(len(run), np.bool_), _of_rows(run))
            for run, s in zip(runs, same, strict=True)]  # fmt: skip


def _same(run: Samples) -> Bools:
    """Of each row: voltages and currents are those of the row before."""
    columns = (run.i_d, run.i_q, run.u_d, run.u_q)
    return np.concatenate(([False], np.logical_and.reduce([np.diff(column) == 0.0 for column in columns])))


def _stuck(run: Samples, same: Bools) -> Bools:
    bad = np.zeros(len(run), np.bool_)
    for a, b in _stretches(same):
        if _empty(run, a):
            turns = abs(math.remainder(float(run.theta_e[b - 1] - run.theta_e[a - 1]), 2.0 * math.pi)) > _TURNS
            bad[a - 1 : b] = b - a + 1 >= (_ZEROS if turns else _STUCK)
        else:
            bad[a:b] = b - a >= _STUCK
    return bad


def _empty(run: Samples, row: int) -> bool:
    return run.i_d[row] == run.i_q[row] == run.u_d[row] == run.u_q[row] == 0.0


def _of_rows(run: Samples) -> Callable[[int, int], str]:
    def says(a: int, b: int) -> str:
        what = "are all 0" if _empty(run, a) else "do not change at all"
        return f"i_d, i_q, u_d and u_q {what} from {_time(run, a)} to {_time(run, b - 1)}"

    return says
