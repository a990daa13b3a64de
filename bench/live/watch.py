"""The watch over one drive's stream: since when, and where, constant parameters no longer explain the drive.

It judges its rows window by window: by what is left of their voltages and, since parameters absorb what is missing, by
estimates that the nominal machine does not have even when it is warm. An episode begins with two windows in a row that
are not explained and ends with two that clearly are; a window in which nothing moves says nothing and changes nothing.
Knows nothing of threads, drives or HTTP.
"""

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from enum import StrEnum
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bench.live.window import Window
from estimator.diagnosis.watch import FEWEST_WATCHED, Left, mismatch_of, place_in_window
from estimator.diagnosis.words import number
from estimator.online.estimate import Estimate, Status
from estimator.samples import Samples

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

MOST: Final = 20_000  # rows judged at once, the newest of the window
WINDOWS: Final = 2  # in a row, that begin an episode, or end it
LIKELY: Final = {"R_s": (0.8, 1.6), "L_d": (0.7, 1.3), "L_q": (0.7, 1.3), "psi_f": (0.8, 1.15)}
"""Of nominal values: what tolerances and 150 K of warming make of a machine."""
SURELY: Final = 3.0  # standard errors
STEADY: Final = "currents and speed are constant, and any parameters would explain that"
_LARGER: Final = 1.2  # times: worth another look at where it is
_COLUMNS: Final = ("theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q", "i_d_mean", "i_q_mean")


class Explained(StrEnum):
    """Whether constant parameters explain the drive."""

    YES = "explained"
    NO = "unexplained"
    NOT_TOLD = "not_told"  # no window has said it yet


@dataclass(frozen=True, slots=True)
class Mismatch:
    """What the windows so far say. The figures are those of the latest window in which something moved."""

    status: Explained = Explained.NOT_TOLD
    since: datetime | None = None  # of the first window of the latest episode
    until: datetime | None = None  # of the first window after it; None while it lasts
    where: str = ""  # the episode acts, a clause: in the window in which it was largest,
    largest_V: float = 0.0  # of so much above noise
    reason: str = "no window has been judged yet"  # a sentence, where the latest window says nothing
    significance: float | None = None  # of what is left, in standard deviations of noise
    ratio: float | None = None  # its energy over that of noise
    rms_V: float | None = None  # of what stands above noise, V
    least_V: float | None = None  # of that, from which it matters, V
    strange: tuple[str, ...] = ()  # parameters that `where` names
    against: tuple[datetime, int] | None = None  # the first, and how many, of the latest windows that deny the status


@dataclass(slots=True)
class Watch:
    """What has been said, and the rows to judge; `take` and `judge` change it in place."""

    said: Mismatch = field(default_factory=Mismatch)
    recent: deque[Samples] = field(default_factory=deque[Samples])
    rows: int = 0


def anew(watch: Watch) -> Watch:
    """One that goes on with other rows: what was not explained lasts, what was is to be seen again."""
    said = watch.said
    if said.status is Explained.YES:
        reason = "no window has been judged since the rows began anew"
        said = replace(said, status=Explained.NOT_TOLD, reason=reason, against=None)
    return Watch(said)


def take(watch: Watch, samples: Samples, window: Window) -> None:
    """Take in consecutive rows."""
    watch.recent.append(samples)
    watch.rows += len(samples)
    most = min(window.samples, MOST)
    while watch.rows - len(watch.recent[0]) > most:
        watch.rows -= len(watch.recent.popleft())


def judge(
    watch: Watch, window: Window, estimates: Mapping[str, Estimate], nominal: Mapping[str, float], now: datetime
) -> None:
    """Judge the rows on which the estimates rest; `nominal` values (SI) are those that are known."""
    most = min(window.samples, MOST)
    runs = _runs(watch.recent, most + 1)
    watch.recent = deque(runs)  # joined once, however many parts they came in
    watch.rows = sum(map(len, runs))
    rows = min([most, *(e.window for e in estimates.values() if e.window is not None)])
    left = mismatch_of(_newest(runs, rows + 1), estimates)
    if left is None:
        reason = f"the window has fewer than {FEWEST_WATCHED} rows, or nothing in it tells the inductances"
    elif not left.moves:
        reason = STEADY
    else:
        watch.said = _after(watch.said, left, estimates, nominal, now)
        return
    watch.said = replace(watch.said, reason=reason)


def _after(
    said: Mismatch, left: Left, estimates: Mapping[str, Estimate], nominal: Mapping[str, float], now: datetime
) -> Mismatch:
    """What is said after one window more."""
    said = replace(said, reason="", **figures_of(left))
    strange = strange_of(estimates, nominal, SURELY)
    denied = left.mismatch or bool(strange)
    clear = left.clear and not strange_of(estimates, nominal, 0.0)
    lasts = said.status is Explained.NO
    if lasts and denied and (left.rms_V > _LARGER * said.largest_V or set(strange) - set(said.strange)):
        said = _placed(said, left, strange)
    if not (clear if lasts else denied):
        status = Explained.YES if said.status is Explained.NOT_TOLD and clear else said.status
        return replace(said, status=status, against=None)
    first, count = said.against or (now, 0)
    if count + 1 < WINDOWS:
        return replace(said, against=(first, count + 1))
    if lasts:
        return replace(said, status=Explained.YES, until=first, against=None)
    return _placed(replace(said, status=Explained.NO, since=first, until=None, against=None), left, strange)


def _placed(said: Mismatch, left: Left, strange: Mapping[str, str]) -> Mismatch:
    return replace(said, where=where_of(left, strange), largest_V=left.rms_V, strange=tuple(strange))


def figures_of(left: Left) -> dict[str, Any]:
    """What is told of a window in numbers."""
    return {name: getattr(left, name) for name in ("significance", "ratio", "rms_V", "least_V")}


def where_of(left: Left, strange: Mapping[str, str]) -> str:
    """Where a mismatch acts, and what parameters are strange, clauses."""
    return "; ".join([*([place_in_window(left).sentence] if left.mismatch else []), *strange.values()])


def strange_of(estimates: Mapping[str, Estimate], nominal: Mapping[str, float], surely: float) -> dict[str, str]:
    """Parameters that are those of another machine, by so many standard errors, each with a clause."""
    found: dict[str, str] = {}
    for name, given in nominal.items():
        e, (low, high) = estimates[name], LIKELY[name]
        if e.status not in (Status.OK, Status.DOUBTFUL) or e.value is None or e.std is None:
            continue
        if e.value + surely * e.std < low * given or e.value - surely * e.std > high * given:
            found[name] = f"{name} reads {number(e.value)} {e.unit}, nominal {number(given)} {e.unit}"
    return found


def _newest(runs: list[Samples], rows: int) -> list[Samples]:
    found: list[Samples] = []
    for run in reversed(runs):
        if rows > 0:
            found.insert(0, run[max(0, len(run) - rows) :])
        rows -= len(run)
    return found


def _runs(recent: Iterable[Samples], rows: int) -> list[Samples]:
    """The last so many rows as runs without gaps by the drive's clock; a row with a value that is no number is one."""
    parts = list(recent)
    if not parts:
        return []
    one = parts[-1]
    table: Array = np.array([np.concatenate([getattr(part, name) for part in parts]) for name in _COLUMNS])
    t = np.concatenate([part.t0 + one.T * np.arange(len(part)) for part in parts])
    begins: Bools = np.abs(np.diff(t, prepend=t[0]) - one.T) > 0.5 * one.T
    table, t, begins = table[:, -rows:], t[-rows:], begins[-rows:]
    finite: Bools = np.all(np.isfinite(table), axis=0)
    edges = np.flatnonzero(begins[1:] | (finite[1:] != finite[:-1])) + 1
    runs: list[Samples] = []
    for a, b in pairwise((0, *edges.tolist(), len(t))):
        if finite[a]:
            theta_e, omega_e, i_d, i_q, u_d, u_q, i_d_mean, i_q_mean = table[:, a:b]
            runs.append(Samples(
                theta_e, omega_e, i_d, i_q, u_d, u_q, one.T_s, one.periods, i_d_mean, i_q_mean, float(t[a]),
                one.resolution,
            ))  # fmt: skip
    return runs
