"""Fit of a choice of effects, and what it predicts of points that take no part in it.

Levenberg and Marquardt's method; leaving a group out follows from the fit of all rows, as for a linear model:
e_g = (1 - H_g)^-1 r_g (R. D. Cook, S. Weisberg, "Residuals and Influence in Regression", 1982, chapter 2). Standard
errors are the largest of the textbook's and of the jackknife's over groups and over kin, so that residuals that belong
together do not pass for independent ones.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Final, cast

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array
from estimator.diagnosis.points.problem import MACHINE, Key, PointSizes, Problem, Size
from estimator.diagnosis.points.table import Places
from estimator.witness import Witness, updated

_FIT_STEPS: Final = 40
_STUCK, _CLOSE = 1e6, 1e-7  # damping, and gain as a share, at which a fit ends
_OF_TYPICAL: Final = 1e-5  # of a typical size
_WIDE: Final = 3.0  # typical sizes: how far off one may be before it costs as much as noise does


@dataclass(frozen=True, slots=True, eq=False)
class PointsFit:
    """A choice of effects fitted to all rows."""

    choice: tuple[str, ...]
    sizes: tuple[Size, ...]
    x: Array  # SI
    r: Array  # residual, over noise
    left_out: Array  # the same of rows that took no part
    J: Array  # of the prediction over noise, by typical sizes
    covariance: Array  # SI
    scale: float  # rms of left_out

    @property
    def values(self) -> dict[Key, float]:
        return {size.key: float(value) for size, value in zip(self.sizes, self.x, strict=True)}

    def value(self, owner: str, name: str) -> float:
        return self.values[owner, name]

    def std(self, owner: str, name: str) -> float:
        """Standard error, SI."""
        place = [size.key for size in self.sizes].index((owner, name))
        return math.sqrt(max(float(self.covariance[place, place]), 0.0))

    def doubted(self, by: Mapping[Key, float]) -> "PointsFit":
        """This fit with further standard errors (SI)."""
        std = np.sqrt(np.diag(self.covariance))
        more = np.array([by.get(size.key, 0.0) for size in self.sizes])
        wider = np.where(std > 0.0, np.hypot(std, more) / np.where(std > 0.0, std, 1.0), 1.0)
        return replace(self, covariance=self.covariance * np.outer(wider, wider))

    def witnessed(self, by: Mapping[Key, Witness]) -> "PointsFit":
        """This fit with one more row for each witness of a size."""
        if not by:
            return self
        keys = [size.key for size in self.sizes]
        x, covariance = updated(self.x, self.covariance, [keys.index(key) for key in by], list(by.values()))
        return replace(self, x=x, covariance=covariance)

    def places(self, owner: str) -> list[int]:
        """Of an owner's sizes that are no shapes."""
        return [k for k, size in enumerate(self.sizes) if size.owner == owner and not size.shape]

    @property
    def missed(self) -> float:
        """Sum of squares of what is missed of rows left out, over noise."""
        return float(self.left_out @ self.left_out)


def fitted_points(
    problem: Problem, choice: tuple[str, ...], noise: Array, start: PointSizes | None = None
) -> PointsFit:
    """The best fit of a choice. `noise`: V, of each equation. `start`: sizes known from another choice."""
    sizes = problem.sizes(choice)
    known = start or {}
    fits = [
        _levenberg(problem, sizes, noise, np.array(values))
        for values in product(*((known[s.key],) if s.key in known else s.starts for s in sizes))
    ]
    x, J, r = min(fits, key=lambda fit: float(fit[2] @ fit[2]))
    return _left_out_error(problem, choice, sizes, x, J, r)


def _levenberg(problem: Problem, sizes: tuple[Size, ...], noise: Array, x: Array) -> tuple[Array, Array, Array]:
    typical = np.array([size.typical for size in sizes])
    low, high = (np.array([getattr(size, end) for size in sizes]) for end in ("low", "high"))
    loose = np.array([0.0 if s.owner == MACHINE or s.shape else (1.0 / (_WIDE * s.typical)) for s in sizes])

    def residual(x: Array) -> Array:
        with np.errstate(all="ignore"):
            r = (problem.y - problem.predict({s.key: float(v) for s, v in zip(sizes, x, strict=True)})) / noise
        return r if np.isfinite(r).all() else np.full(len(r), 1e6)

    def cost(r: Array, x: Array) -> float:
        return float(r @ r + np.sum((loose * x) ** 2))

    x = np.clip(x, low, high)
    r, slopes, damping = residual(x), None, 1e-3
    for _ in range(_FIT_STEPS):
        slopes = _derivatives(residual, x, r, typical, high) if slopes is None else slopes
        step = _bounded_step(slopes, r, x / typical, loose * typical, (x <= low, x >= high), damping)
        new = np.clip(x + step * typical, low, high)
        there = residual(new)
        gain = cost(r, x) - cost(there, new)
        if gain <= 0.0:
            damping *= 10.0
            if damping > _STUCK:
                break
            continue
        x, r, slopes, damping = new, there, None, max(0.2 * damping, 1e-9)
        if gain < _CLOSE * cost(r, x):
            break
    return x, _derivatives(residual, x, r, typical, high), r


def _bounded_step(
    slopes: Array, r: Array, x: Array, loose: Array, ends: tuple[NDArray[np.bool_], NDArray[np.bool_]], damping: float
) -> Array:
    """A step in typical sizes, of what does not press against an end of its range."""
    A, b = slopes.T @ slopes + np.diag(loose**2), slopes.T @ r - loose**2 * x
    free = np.flatnonzero(~((ends[0] & (b < 0.0)) | (ends[1] & (b > 0.0))))
    inner = A[np.ix_(free, free)]
    step = np.zeros(len(x))
    step[free] = np.linalg.lstsq(inner + damping * np.diag(np.diag(inner) + 1e-12), b[free], rcond=None)[0]
    return step


def _derivatives(residual: Callable[[Array], Array], x: Array, r: Array, typical: Array, high: Array) -> Array:
    J = np.empty((len(r), len(x)))
    for k in range(len(x)):
        by = -_OF_TYPICAL if x[k] + _OF_TYPICAL * typical[k] > high[k] else _OF_TYPICAL
        moved = x.copy()
        moved[k] += by * typical[k]
        J[:, k] = (r - residual(moved)) / by
    return J


def _left_out_error(
    problem: Problem, choice: tuple[str, ...], sizes: tuple[Size, ...], x: Array, J: Array, r: Array
) -> PointsFit:
    typical = np.array([size.typical for size in sizes])
    own = np.array([0.0 if s.owner == MACHINE or s.shape else _WIDE**-2 for s in sizes])
    at_bound = np.array([v <= s.low or v >= s.high for s, v in zip(sizes, x, strict=True)])
    free = np.flatnonzero(~at_bound)
    left_out = r.copy()
    covariance = np.zeros((len(x), len(x)))
    if len(free):
        K = J[:, free]
        precision = K.T @ K + np.diag(own[free] + 1e-9)
        A = cast(Array, np.linalg.inv(precision))
        for group in np.unique(problem.group):
            rows = np.flatnonzero(problem.group == group)
            H = K[rows] @ A @ K[rows].T
            left_out[rows] = np.linalg.solve(np.eye(len(rows)) * (1.0 + 1e-9) - H, r[rows])
        plain = A * float(left_out @ left_out) / len(left_out)
        scores = (A @ K.T) * left_out
        pushed = [np.diag(plain), *(_spread(scores, of) for of in (problem.group, problem.kin))]
        wider = np.sqrt(np.max(pushed, axis=0) / np.maximum(np.diag(plain), 1e-300))
        covariance[np.ix_(free, free)] = plain * np.outer(wider, wider)
    covariance *= np.outer(typical, typical)
    return PointsFit(choice, sizes, x, r, left_out, J, covariance, math.sqrt(float(np.mean(left_out**2))))


def _spread(scores: Array, of: Places) -> Array:
    """Variance of each parameter for scores (parameters, equations) that only equations of one number share."""
    count = int(of.max()) + 1
    sums = np.array([np.bincount(of, weights=row, minlength=count) for row in scores])
    return np.sum(sums**2, axis=1) * count / max(count - 1, 1)
