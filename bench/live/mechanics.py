"""The shaft of one drive, live: moment of inertia, friction and load torque from the last seconds of its stream.

Torque is that of the estimated magnet flux where it is ok, of the machine file's where not. What was told stays, as
stale, while the shaft does not accelerate: its inertia is not lost when it holds a speed. Rows are joined until there
are so many that a step of the shortest stretch has two: more say no more, and take longer. Knows nothing of threads,
drives or HTTP.
"""

import math
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from typing import Final

import numpy as np

from bench.machine_file import Nominal
from estimator.machine import Machine
from estimator.mechanics.mechanics import PARAMETERS, SHORTEST, UNITS, Mechanics, Told, mechanics, unmoved
from estimator.online.estimate import Estimate, Status
from estimator.samples import Resolution, Samples

SPAN: Final = 10.0  # s of rows that it rests on
OFTEN: Final = 2.0  # s between two looks, and
SHARE: Final = 0.03  # of a core that they may take
_COLUMNS: Final = ("theta_e", "omega_e", "i_d", "i_q", "i_d_mean", "i_q_mean")


def _nothing(why: str) -> Mechanics:
    none = {name: Estimate(name, None, None, UNITS[name], Status.NO_DATA, why) for name in PARAMETERS}
    return Mechanics(Told.NO_DATA, why, none)


@dataclass(frozen=True, slots=True)
class Shaft:
    """What the stream says of the shaft, and since when it says no more than that."""

    said: Mechanics = field(default_factory=lambda: _nothing("no rows have come yet"))
    since: datetime | None = None  # what is told is stale: since then the shaft tells nothing
    now: str = ""  # why that is so, a sentence


@dataclass(slots=True)
class Shafts:
    """What has been said, and the rows of the last seconds; `take` and `judge` change it in place."""

    shaft: Shaft = field(default_factory=Shaft)
    recent: deque[Samples] = field(default_factory=deque[Samples])
    due: float = 0.0  # s, monotonic, of the next look


def anew(shafts: Shafts) -> Shafts:
    """One that goes on with other rows."""
    return Shafts(shafts.shaft)


def take(shafts: Shafts, samples: Samples) -> None:
    """Take in consecutive rows."""
    shafts.recent.append(samples)
    newest = samples.t0 + len(samples) * samples.T
    while shafts.recent[0].t0 + len(shafts.recent[0]) * samples.T < newest - SPAN:
        shafts.recent.popleft()


def judge(shafts: Shafts, estimates: Mapping[str, Estimate], nominal: Nominal, now: datetime) -> None:
    """Look at the rows, by the estimates of the machine and what its file says."""
    began = time.monotonic()
    known = machine_of(estimates, nominal)
    if isinstance(known, str):
        said = _nothing(known)
    else:
        runs = _runs(shafts)
        shafts.recent = deque(runs)  # joined once
        machine, std = known
        rows = [joined_rows(run) for run in runs]
        said = unmoved(rows, machine.n_p) or mechanics(rows, machine, std)
    shafts.shaft = _after(shafts.shaft, said, now)
    ended = time.monotonic()
    shafts.due = ended + max(OFTEN, (ended - began) / SHARE)


def _after(before: Shaft, said: Mechanics, now: datetime) -> Shaft:
    if said.status in (Told.OK, Told.DOUBTFUL):
        return Shaft(said)
    if before.said.estimates["J"].value is None or said.status is Told.NO_DATA:
        return Shaft(said)
    return Shaft(before.said, before.since or now, said.sentence)


def machine_of(estimates: Mapping[str, Estimate], nominal: Nominal) -> tuple[Machine, dict[str, float]] | str:
    """The machine, with standard errors of what is estimated; or what is missing, a sentence."""
    if nominal.n_p is None:
        return "torque needs the pole pairs: n_p in the machine file"
    values, std = dict(nominal.given), dict[str, float]()
    for name, e in estimates.items():
        if e.status is Status.OK and e.value is not None and e.std is not None:
            values[name], std[name] = e.value, e.std
    if "psi_f" not in values:
        return "torque needs the magnet flux: psi_f in the machine file, or estimated"
    if "L_d" not in values or "L_q" not in values:  # reluctance torque is taken for none
        values |= {"L_d": 0.0, "L_q": 0.0}
    return Machine(values.get("R_s", 0.0), values["L_d"], values["L_q"], values["psi_f"], nominal.n_p), std


def _runs(shafts: Shafts) -> list[Samples]:
    """The rows as runs without gaps, by the drive's clock."""
    runs: list[list[Samples]] = []
    for part in shafts.recent:
        last = runs[-1][-1] if runs else None
        if last is not None and abs(part.t0 - last.t0 - len(last) * last.T) < 0.5 * part.T:
            runs[-1].append(part)
        else:
            runs.append([part])
    return [_one_of(parts) for parts in runs]


def _one_of(parts: list[Samples]) -> Samples:
    """Voltages stay behind: where a bridge is off there are none."""
    first = parts[0]
    columns = {name: _column(parts, name) for name in _COLUMNS}
    none = np.zeros(sum(map(len, parts)))
    return replace(first, **columns, u_d=none, u_q=none, u_dc=None, i_a=None, i_b=None, i_c=None)


def _column(parts: list[Samples], name: str) -> np.ndarray[tuple[int], np.dtype[np.float64]] | None:
    columns = [column for part in parts if (column := getattr(part, name)) is not None]
    return np.concatenate(columns) if len(columns) == len(parts) else None


def joined_rows(run: Samples) -> Samples:
    """The same in longer rows, whole ones: of half of the shortest stretch's step, where they are shorter."""
    many = math.floor(0.5 * SHORTEST / run.T + 1e-9)
    n = len(run) // max(many, 1)
    if many < 2 or n < 2:
        return run
    by_ends = run.i_d_mean is None or run.i_q_mean is None
    i_d, i_q = (run.i_d, run.i_q) if by_ends else (run.i_d_mean, run.i_q_mean)
    assert i_d is not None
    assert i_q is not None

    def mean(x: np.ndarray[tuple[int], np.dtype[np.float64]]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        return x[: n * many].reshape(n, many).mean(axis=1)

    starts = slice(0, n * many, many)
    return Samples(
        run.theta_e[starts], mean(run.omega_e), run.i_d[starts], run.i_q[starts], run.u_d[starts], run.u_q[starts],
        run.T_s, many * run.periods, mean(i_d), mean(i_q), run.t0, Resolution(theta_e=run.resolution.theta_e),
    )
