"""Regions: the range of one or two quantities that tells most of where a mismatch is.

Knows nothing of effects.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array
from estimator.diagnosis.likelihood.averages import Means
from estimator.diagnosis.words import number
from estimator.online.flux_balance import TURN
from estimator.physics.rows import Rows

REGION_SHARE: Final = 0.7  # of the energy, that a region must hold
_HISTOGRAM_BINS: Final = 24
_WORTH_NAT: Final = 0.25  # nat that a range must tell
_SECOND: Final = 0.35  # nat that a second one must add


@dataclass(frozen=True, slots=True, eq=False)
class QuantityRange:
    """A range of one quantity."""

    key: str
    bins: NDArray[np.intp]  # of each block
    edges: Array  # of bins, SI
    low: int
    high: int  # exclusive
    energy: float  # share
    samples: float  # share

    @property
    def limits(self) -> tuple[float, float]:
        """SI."""
        return (0.0 if self.key == "zero_crossing" else float(self.edges[self.low])), float(self.edges[self.high])

    @property
    def words(self) -> str:
        """The range as a clause of a sentence."""
        low, high = self.limits
        if self.key == "zero_crossing":
            return f"a phase current is within {number(high, 2)} A of changing sign"
        name, unit, scale = _NAMES[self.key]
        first, last = self.low == 0, self.high == len(self.edges) - 1
        a, b = number(low * scale), number(high * scale)
        if first and not last:
            return f"{name} is below {b} {unit}"
        if last and not first:
            return f"{name} is above {a} {unit}"
        return f"{name} is between {a} and {b} {unit}"


_NAMES: Final = {
    "i_q": ("i_q", "A", 1.0),
    "i_d": ("i_d", "A", 1.0),
    "current": ("the current", "A", 1.0),
    "speed": ("the electrical frequency", "Hz", 1.0 / TURN),
    "time": ("the time", "s", 1.0),
}
"""How a quantity is called, its unit in sentences, and how much of it one of SI is."""


def worth(energy: float, samples: float) -> float:
    """What a region tells of where the energy is, nat: that of a distribution over inside and outside."""
    return float(_worths(np.array([energy]), np.array([samples]))[0])


def _worths(energy: Array, samples: Array) -> Array:
    e, s = np.clip(energy, 1e-9, 1.0 - 1e-6), np.clip(samples, 1e-9, 1.0 - 1e-9)
    return np.where(e > s, e * np.log(e / s) + (1.0 - e) * np.log((1.0 - e) / (1.0 - s)), 0.0)


def regions(rows: Rows, blocks: Means, power: Array, *, most: int = 2) -> list[QuantityRange]:
    """The one or two ranges that tell most, at `most` so many; none where nothing tells much. Pairs take longer."""
    singles = [one for key, x in _by_quantity(rows, blocks).items() if (one := _single(key, x, power)) is not None]
    singles.sort(key=lambda one: -worth(one.energy, one.samples))
    best, told = list[QuantityRange](), _WORTH_NAT
    if singles and worth(singles[0].energy, singles[0].samples) > _WORTH_NAT:
        best, told = singles[:1], worth(singles[0].energy, singles[0].samples)
    needed = told + _SECOND
    for one, other in combinations(singles, 2) if most > 1 else ():
        pair = _pair(one, other, power)
        if pair is not None and worth(*shares_together(pair, power)) > needed:
            best, needed = list(pair), worth(*shares_together(pair, power))
    return best


def _by_quantity(rows: Rows, blocks: Means) -> dict[str, Array]:
    at = blocks.at
    i = rows.i[at]
    currents = np.abs([rows.phase(k)[at] for k in range(3)])
    return {
        "zero_crossing": currents.min(axis=0),
        "i_q": i.imag,
        "i_d": i.real,
        "current": np.abs(i),
        "speed": rows.omega_e[np.minimum(at, len(rows) - 1)],
        "time": rows.t[at],
    }


def _single(key: str, x: Array, power: Array) -> QuantityRange | None:
    """The range of one quantity that tells most."""
    edges = np.unique(np.quantile(x[:: max(1, len(x) // 4096)], np.linspace(0.0, 1.0, _HISTOGRAM_BINS + 1)))
    if len(edges) < 3:
        return None
    edges[0], edges[-1] = min(edges[0], x.min()), max(edges[-1], x.max())
    bins = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    n = len(edges) - 1
    energy, samples = _shares(np.bincount(bins, power, n)), _shares(np.bincount(bins, np.ones(len(bins)), n))
    low, high = np.triu_indices(n + 1, 1)
    if key == "zero_crossing":
        low, high = low[low == 0], high[low == 0]
    e, s = energy[high] - energy[low], samples[high] - samples[low]
    k = int(np.argmax(np.where(e >= REGION_SHARE, _worths(e, s), 0.0)))
    return QuantityRange(key, bins, edges, int(low[k]), int(high[k]), float(min(e[k], 1.0)), float(s[k]))


def _shares(x: Array | NDArray[np.intp]) -> Array:
    total = np.concatenate((np.zeros(1), np.cumsum(x)))
    return total / total[-1]


def _pair(one: QuantityRange, other: QuantityRange, power: Array) -> tuple[QuantityRange, QuantityRange] | None:
    """The rectangle of two quantities that tells most."""
    nx, ny = len(one.edges) - 1, len(other.edges) - 1
    flat = one.bins * ny + other.bins
    counts = (np.bincount(flat, weights, nx * ny).reshape(nx, ny) for weights in (power, None))
    tables = [np.pad(count.cumsum(0).cumsum(1), ((1, 0), (1, 0))) for count in counts]
    x0, x1 = np.triu_indices(nx + 1, 1)
    y0, y1 = np.triu_indices(ny + 1, 1)
    if one.key == "zero_crossing":
        x0, x1 = x0[x0 == 0], x1[x0 == 0]
    if other.key == "zero_crossing":
        y0, y1 = y0[y0 == 0], y1[y0 == 0]
    e, s = ((t[np.ix_(x1, y1)] - t[np.ix_(x0, y1)] - t[np.ix_(x1, y0)] + t[np.ix_(x0, y0)]) / t[-1, -1] for t in tables)
    told = np.where(e >= REGION_SHARE, _worths(e, s), 0.0)
    a, b = np.unravel_index(int(np.argmax(told)), told.shape)
    if not told[a, b] > 0.0:
        return None
    return (
        QuantityRange(one.key, one.bins, one.edges, int(x0[a]), int(x1[a]), float(e[a, b]), float(s[a, b])),
        QuantityRange(other.key, other.bins, other.edges, int(y0[b]), int(y1[b]), float(e[a, b]), float(s[a, b])),
    )


def shares_together(found: Sequence[QuantityRange], power: Array) -> tuple[float, float]:
    """Shares of energy and samples where all hold."""
    inside = np.ones(len(power), np.bool_)
    for c in found:
        inside &= (c.bins >= c.low) & (c.bins < c.high)
    return min(float(power[inside].sum() / power.sum()), 1.0), float(inside.mean())
