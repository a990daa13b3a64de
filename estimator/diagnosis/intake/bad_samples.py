"""Bad samples: rows that no machine makes - voltages beyond the dc link, currents and angles that jump and return,
repeated rows.

They are left out, as gaps, and told. What a machine may do stays: a current may change as fast as its voltage drives
it, and voltages that are often too high are no glitch but another unit. Knows no effect.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final, NamedTuple

import numpy as np

from estimator.arrays import Array, Bools, Vector, stretches
from estimator.diagnosis.intake.drive_data import Remarked
from estimator.diagnosis.intake.odd_rows import FAR, MEDIAN_SIDE, odd_samples, off_median
from estimator.diagnosis.words import number
from estimator.machine import Machine
from estimator.samples import Samples

_RARE: Final = 0.01  # of the rows: what is more often is no glitch
_BEYOND_LINK: Final = 1.0  # times the dc link: half as much again as a bridge's corner
_HIGH_VOLTAGE: Final = 2.0  # times what 99 % of the voltages stay below
_JUMP_SIDE: Final = MEDIAN_SIDE  # rows to either side, among which a jump is one
_DRIVEN: Final = 3.0  # times what the dc link changes a current by in a row; between a current and the median around it
_NOISE_OF_JUMPS: Final = 30.0  # standard deviations of the same
_NINE_OF_TEN_VECTORS: Final = 2.146  # standard deviations of a component, that nine of ten vectors stay below
_OF_RATED: Final = 0.5  # of rated current, the same
_CALM: Final = 0.15  # of a jump, that the voltages around it explain at most
_STUCK: Final = 20  # rows
_ZEROS: Final = 5  # rows
_TURNING: Final = 0.01  # rad in the rows: the motor turns
_SAG: Final = 0.25  # of the dc link, which a capacitor holds, by which a row of it may leave those around it
_LIVELY: Final = 0.5  # of the rows, that may repeat where rows are no noise
_REPEATS: Final = 3  # rows that repeat the one before: fewer may be chance
_COARSE_CHANCE: Final = 0.1  # times as many, that repeat the row before that one: numbers so coarse repeat by chance
_ANGLE_JUMP: Final = 0.1  # rad, and
_FAR_FROM_EVEN: Final = 20.0  # times what nine of ten angles depart from an even turn
_WAY_BACK: Final = 0.2  # of a jump of the angle, by which the way back may differ


class Found(NamedTuple):
    """Bad rows of one kind in a run, and how those from a to b are told."""

    bad: Bools
    says: Callable[[int, int], str]


@dataclass(slots=True)
class Account:
    """Bad rows of one kind, as they are found one run after another: the first in words, of the others how often."""

    first: str = ""
    places: int = 0
    rows: int = 0

    def add(self, found: Found) -> None:
        """Count what was found in a run."""
        for a, b in stretches(found.bad):
            self.first = self.first or found.says(a, b)
            self.places += 1
            self.rows += b - a

    def remark(self) -> str:
        """A sentence; empty where nothing was found."""
        if not self.places:
            return ""
        more = self.places - 1
        others = f", and likewise {more} time{'s' if more > 1 else ''} more" if more else ""
        return f"{self.first}{others}: {self.rows} row{'s' if self.rows > 1 else ''} left out"


def without_bad(runs: Sequence[Samples], nominal: Machine) -> Remarked:
    """The runs, cut where a sample is bad, and a remark on each kind."""
    columns = ("theta_e", "i_d", "i_q", "u_d", "u_q")
    long_enough = [run for run in runs if len(run) > 2 * _JUMP_SIDE]
    finite = [run for run in long_enough if all(np.isfinite(getattr(run, name)).all() for name in columns)]
    if not finite:
        return Remarked(tuple(runs), ())
    whole = [_beyond_link(finite), _dc_links(finite), _jumps(finite, nominal), _angle_leaps(finite), repeated(finite)]
    bad = {id(run): np.logical_or.reduce([found[k].bad for found in whole]) for k, run in enumerate(finite)}
    odd = odd_samples(finite, list(bad.values()))
    whole.append([Found(one & ~bad[id(run)], partial(_of_sample, run)) for run, one in zip(finite, odd, strict=True)])
    bad = {id(run): bad[id(run)] | one for run, one in zip(finite, odd, strict=True)}
    accounts = [Account() for _ in whole]
    for account, found in zip(accounts, whole, strict=True):
        for one in found:
            account.add(one)
    remarks = tuple(said for account in accounts if (said := account.remark()))
    good = {id(run): stretches(~bad[id(run)]) if id(run) in bad else [(0, len(run))] for run in runs}
    cut = tuple(run[a:b] for run in runs for a, b in good[id(run)])
    return Remarked(cut if remarks else tuple(runs), remarks)


def time_of(run: Samples, row: int) -> str:
    return f"{run.t0 + row * run.T:.6g} s"


# --- Voltages


def _beyond_link(runs: Sequence[Samples]) -> list[Found]:
    """Voltages that no bridge makes of the dc link."""
    size = [np.hypot(run.u_d, run.u_q) for run in runs]
    usual = _HIGH_VOLTAGE * float(np.quantile(np.concatenate(size), 0.99))
    found = [
        (u > np.maximum(_BEYOND_LINK * run.u_dc, usual)) if run.u_dc is not None else np.zeros(len(run), np.bool_)
        for run, u in zip(runs, size, strict=True)
    ]
    return [Found(bad, partial(_of_voltage, run)) for run, bad in zip(runs, _rare(found), strict=True)]


def _of_voltage(run: Samples, a: int, _b: int) -> str:
    assert run.u_dc is not None
    name, value = max((("u_d", run.u_d[a]), ("u_q", run.u_q[a])), key=lambda one: abs(one[1]))
    return f"{name} is {number(value)} V at {time_of(run, a)}, beyond what u_dc = {number(run.u_dc[a])} V can give"


def _dc_links(runs: Sequence[Samples]) -> list[Found]:
    """Voltages of the dc link that leave those around them, as no capacitor does."""
    found: list[Bools] = []
    for run in runs:
        if run.u_dc is None:
            found.append(np.zeros(len(run), np.bool_))
            continue
        middle = np.median(_with_sides(run.u_dc), axis=1)
        found.append(~(np.abs(run.u_dc - middle) <= _SAG * np.abs(middle)))
    return [Found(bad, partial(_of_dc_link, run)) for run, bad in zip(runs, _rare(found), strict=True)]


def _of_dc_link(run: Samples, a: int, _b: int) -> str:
    assert run.u_dc is not None
    return f"u_dc jumps to {number(run.u_dc[a])} V at {time_of(run, a)} and back"


def _rare(found: list[Bools]) -> list[Bools]:
    """What was found where it is rare, else nothing."""
    if sum(int(np.count_nonzero(bad)) for bad in found) <= _RARE * sum(map(len, found)):
        return found
    return [np.zeros(len(bad), np.bool_) for bad in found]


# --- Currents


def _jumps(runs: Sequence[Samples], nominal: Machine) -> list[Found]:
    """Currents that leave those around them, farther than voltages drive them."""
    off = [_off_own_median(run.i_d + 1j * run.i_q) for run in runs]
    noise = float(np.quantile(np.abs(np.concatenate(off)), 0.9)) / _NINE_OF_TEN_VECTORS
    high = nominal.i_rated or float(np.quantile(np.concatenate([np.hypot(run.i_d, run.i_q) for run in runs]), 0.999))
    L = min(nominal.L_d, nominal.L_q)
    found: list[Bools] = []
    for run, jump in zip(runs, off, strict=True):
        far = np.abs(jump)
        bad = far > max(_NOISE_OF_JUMPS * noise, _OF_RATED * high)
        if bad.any():
            beside = _with_sides(np.abs(_off_own_median(run.u_d + 1j * run.u_q)))
            calm = np.max(beside, axis=1) * (run.T / L) < _CALM * far
            driven = np.inf if run.u_dc is None else _DRIVEN * run.u_dc * (run.T / L)
            bad &= calm | (far > driven)
        found.append(bad)
    return [Found(bad, partial(_of_current, run, jump)) for run, bad, jump in zip(runs, _rare(found), off, strict=True)]


def _with_sides(x: Array) -> Array:
    """Each value and those to its sides, as rows; the ends' own repeated."""
    padded = np.pad(x, _JUMP_SIDE, mode="edge")
    return np.lib.stride_tricks.sliding_window_view(padded, 2 * _JUMP_SIDE + 1)


def _off_own_median(x: Vector) -> Vector:
    """What is between values and the median around them; none at the ends."""
    inner = np.zeros(len(x), np.bool_)
    inner[_JUMP_SIDE:-_JUMP_SIDE] = True
    return off_median(x, inner)


def _of_current(run: Samples, jump: Vector, a: int, _b: int) -> str:
    d = abs(jump[a].real) > abs(jump[a].imag)
    name, value = ("i_d", run.i_d[a]) if d else ("i_q", run.i_q[a])
    return f"{name} jumps to {number(value)} A at {time_of(run, a)} and back"


def _of_sample(run: Samples, a: int, _b: int) -> str:
    return (
        f"the row at {time_of(run, a)} (i_d = {number(run.i_d[a])} A, i_q = {number(run.i_q[a])} A, u_d = "
        f"{number(run.u_d[a])} V, u_q = {number(run.u_q[a])} V) leaves those around it, by over {FAR:g} times the "
        f"noise, and returns as no motor does"
    )


# --- Angles


def _angle_leaps(runs: Sequence[Samples]) -> list[Found]:
    """Angles that leave the rotor's even turn for one row, and return."""
    off = [_uneven(run) for run in runs]
    usual = float(np.quantile(np.abs(np.concatenate(off)), 0.9))
    least = max(_ANGLE_JUMP, _FAR_FROM_EVEN * usual, *(_FAR_FROM_EVEN * run.resolution.theta_e for run in runs))
    found: list[Bools] = []
    for run, r in zip(runs, off, strict=True):
        away, back = r[:-1], r[1:]
        there = (
            (np.abs(away) > least) & (np.abs(back) > least) & (np.abs(_wrapped(away + back)) < _WAY_BACK * np.abs(away))
        )
        found.append(np.concatenate(([False], there, [False]))[: len(run)])
    return [Found(bad, partial(_of_angle, run, r)) for run, bad, r in zip(runs, _rare(found), off, strict=True)]


def _uneven(run: Samples) -> Array:
    """By how much each step of the angle differs from those around it, rad; one less than rows."""
    turned = _wrapped(np.diff(run.theta_e))
    middle = np.median(_with_sides(np.cos(turned)), axis=1) + 1j * np.median(_with_sides(np.sin(turned)), axis=1)
    return _wrapped(turned - np.angle(middle))


def _wrapped(angle: Array) -> Array:
    return angle - 2.0 * math.pi * np.round(angle / (2.0 * math.pi))


def _of_angle(run: Samples, off: Array, a: int, _b: int) -> str:
    return f"theta_e jumps by {number(abs(off[a - 1]))} rad at {time_of(run, a)} and back"


# --- Rows that repeat


def repeated(runs: Sequence[Samples]) -> list[Found]:
    """Rows of a recording with noise that hold what the row before them held: for long, or its angle too, often."""
    same = [_same(run) for run in runs]
    lively = sum(int(np.count_nonzero(s)) for s in same) < _LIVELY * sum(map(len, runs))
    if not lively:
        return [Found(np.zeros(len(run), np.bool_), partial(_of_rows, run)) for run in runs]
    twice = [s & _stays(run) for run, s in zip(runs, same, strict=True)]
    by_chance = sum(int(np.count_nonzero(_same(run, 2) & ~s)) for run, s in zip(runs, same, strict=True))
    often = sum(int(np.count_nonzero(t)) for t in twice)
    if often < _REPEATS or by_chance > _COARSE_CHANCE * often:
        twice = [np.zeros(len(run), np.bool_) for run in runs]
    return [Found(_stuck(run, s) | t, partial(_of_rows, run)) for run, s, t in zip(runs, same, twice, strict=True)]


def _same(run: Samples, rows: int = 1) -> Bools:
    """Of each row: voltages and currents are those of so many rows before."""
    columns = (run.i_d, run.i_q, run.u_d, run.u_q)
    same = np.logical_and.reduce([column[rows:] == column[:-rows] for column in columns])
    return np.concatenate((np.zeros(min(rows, len(run)), np.bool_), same))


def _stays(run: Samples) -> Bools:
    """Of each row: the angle is that of the row before, and not that of the next that differs."""
    stays = np.concatenate(([False], np.diff(run.theta_e) == 0.0))
    moved = np.zeros(len(run), np.bool_)
    for a, b in stretches(stays):
        moved[a:b] = b < len(run)
    return stays & moved


def _stuck(run: Samples, same: Bools) -> Bools:
    bad = np.zeros(len(run), np.bool_)
    for a, b in stretches(same):
        if _empty(run, a):
            turns = abs(math.remainder(float(run.theta_e[b - 1] - run.theta_e[a - 1]), 2.0 * math.pi)) > _TURNING
            bad[a - 1 : b] = b - a + 1 >= (_ZEROS if turns else _STUCK)
        else:
            bad[a:b] = b - a >= _STUCK
    return bad


def _empty(run: Samples, row: int) -> bool:
    return run.i_d[row] == run.i_q[row] == run.u_d[row] == run.u_q[row] == 0.0


def _of_rows(run: Samples, a: int, b: int) -> str:
    if b - a < _ZEROS:
        return f"i_d, i_q, u_d, u_q and theta_e repeat the row before at {time_of(run, a)}"
    what = "are all 0" if _empty(run, a) else "do not change at all"
    return f"i_d, i_q, u_d and u_q {what} from {time_of(run, a)} to {time_of(run, b - 1)}"
