"""Odds that mean odds: of all effects that are told to be there at odds of 10 to 1, one in eleven is not.

`python -m tests.score.reliability ROWS.json ...`: the table, and what makes it level: by how much, and times what, the
log-odds that are told are off, which go into the two numbers of `estimator.diagnosis.trust.odds`.

Rows are those that `tests.score.score --json` and the proof write. Every effect of every recording is one candidate,
named or not, with the odds that the diagnosis tells of it. A bin's share is of those that are there.
"""

import json
import math
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

EDGES: Final = (-3.0, -2.0, -1.0, 0.0, 1.0, 3.0)  # log10 of odds
FEWEST: Final = 50  # candidates in a bin that is judged
WITHIN: Final = 3.0  # times, that odds may be off
_ROUNDS: Final = 50

Candidates = Sequence[tuple[float, bool]]


class Bin(NamedTuple):
    """Candidates whose odds are told to be from 10^low to 10^high."""

    low: float
    high: float
    candidates: int
    there: int
    told: float  # odds of the mean share that is told

    @property
    def right(self) -> float:
        """Odds of the share that is there, of which half a candidate more is and is not."""
        return (self.there + 0.5) / (self.candidates - self.there + 0.5)

    @property
    def off(self) -> float:
        """Times by which told odds and right ones differ."""
        return math.exp(abs(math.log(self.told / self.right)))


def bins(candidates: Candidates, edges: Sequence[float] = EDGES) -> list[Bin]:
    """By the odds that are told."""
    found: list[Bin] = []
    for low, high in pairwise(edges):
        some = [(odds, there) for odds, there in candidates if low <= odds < high]
        share = float(np.mean([1.0 / (1.0 + 10.0**-odds) for odds, _ in some])) if some else 0.5
        found.append(Bin(low, high, len(some), sum(there for _, there in some), share / (1.0 - share)))
    return found


def fitted(candidates: Candidates) -> tuple[float, float]:
    """a and b of log odds = a + b times the log-odds of the evidence, by maximum likelihood (Newton's method)."""
    x = np.array([math.log(10.0) * odds for odds, _ in candidates])
    y = np.array([there for _, there in candidates], np.float64)
    columns, coefficients = np.stack([np.ones_like(x), x]), np.array([0.0, 1.0])
    for _ in range(_ROUNDS):
        share = 1.0 / (1.0 + np.exp(-np.clip(coefficients @ columns, -50.0, 50.0)))
        curvature = (columns * (share * (1.0 - share))) @ columns.T + 1e-9 * np.eye(2)
        step = np.linalg.solve(curvature, columns @ (y - share))
        coefficients = coefficients + np.clip(step, -1.0, 1.0)
    return float(coefficients[0]), float(coefficients[1])


def candidates_in(paths: Sequence[Path]) -> list[tuple[float, bool]]:
    """Of all rows in some files."""
    rows = [row for path in paths for row in json.loads(path.read_text(encoding="utf-8"))]
    return [(float(odds), bool(there)) for row in rows for odds, there in row["candidates"]]


def main(arguments: Sequence[str]) -> int:
    """Print the table."""
    candidates = candidates_in([Path(each) for each in arguments])
    print(f"{'odds told':>20}{'candidates':>12}{'there':>8}{'told':>10}{'right':>10}{'off':>8}")
    for each in bins(candidates):
        span = f"{10.0**each.low:g} to {10.0**each.high:g}"
        print(f"{span:>20}{each.candidates:12}{each.there:8}{each.told:10.3g}{each.right:10.3g}{each.off:8.2f}")
    near = [(odds, there) for odds, there in candidates if EDGES[0] <= odds < EDGES[-1]]
    if near:
        a, b = fitted(near)
        print(f"level by: log odds = {a:.3f} + {b:.3f} x log odds told, over {len(near)} candidates")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
