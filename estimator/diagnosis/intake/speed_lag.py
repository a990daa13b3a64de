"""Speed lag: how far a speed column is behind the rate of its own angle, as a filter or a latency makes it.

    omega + lag d(omega)/dt = scale d(theta)/dt

Exact for a first-order filter, and a latency's first order; both sides as means over the same rows, so that an angle's
rounding counts little. The column's change is noisy, so the angle's own bend in the rows around stands in for it in the
normal equations (instrumental variables: L. Ljung, *System Identification*, 1999). Errors are those by which groups of
rows scatter. Takes a recording in parts, in constant memory. Knows no effect.
"""

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from estimator.arrays import Array
from estimator.diagnosis.words import with_interval
from estimator.samples import Samples, turned_angle

_WIDTHS: Final = (4, 16, 64, 256)  # rows of a mean
_GROUP: Final = 32  # means of a group, half a width apart
_FEWEST: Final = 8  # groups, and
_SPREAD: Final = 4.0  # of equal weight: what one group alone tells is an accident
_OWN: Final = 0.75  # rows: by as much differ conventions of what a row's speed is
_KNOWN: Final = 0.01  # rows, to which such a convention is a lag
_SCALE: Final = 0.015  # share by which the two may differ
_MATTERS: Final = 1e-4  # of the speed, rms, by which a late one is off
_SURELY: Final = 4.0  # standard errors
_SHARPEST: Final = 0.2  # of the lag: a standard error beyond tells none


@dataclass(frozen=True, slots=True)
class SpeedLag:
    """A speed column against its angle."""

    lag: float  # s, that omega_e is late; below zero: early
    lag_std: float  # s
    scale: float  # omega_e over the angle's rate
    scale_std: float
    bend: float  # 1/s, rms change of the speed over its rms
    T: float  # s, of a row

    @property
    def lags(self) -> bool:
        """Whether it is late, or early, by more than a row's conventions, while the speed changes."""
        surely = abs(self.lag) - _SURELY * self.lag_std > _OWN * self.T and self.lag_std < _SHARPEST * abs(self.lag)
        return surely and abs(self.lag) * self.bend > _MATTERS

    @property
    def off(self) -> bool:
        """Whether it is another number times the angle's rate."""
        return abs(self.scale - 1.0) > _SCALE + _SURELY * self.scale_std and self.scale_std < _SCALE

    def sentence(self, *, scale: bool = True) -> str:
        """What is wrong with the column; empty where nothing is. `scale`: whether a wrong one is told, too."""
        times = ""
        if scale and self.off:
            times = f"omega_e is {with_interval(self.scale, self.scale_std)} times the rate of theta_e"
        if not self.lags:
            return times and f"{times}: the speed of the angle is used"
        way, late = "lags" if self.lag > 0.0 else "leads", with_interval(1e3 * abs(self.lag), 1e3 * self.lag_std)
        begin = f"{times}, and" if times else "omega_e"
        return f"{begin} {way} theta_e by {late} ms: the speed of the angle is used"


@dataclass(slots=True)
class SpeedLags:
    """Takes a recording's samples in their order; `found` after the last."""

    _row: float = 0.0  # s
    _sums: dict[int, tuple[int, Array, Array]] = field(default_factory=dict[int, tuple[int, Array, Array]])

    def take(self, samples: Samples) -> None:
        """Take in a run, or a part of one."""
        if len(samples) <= 4 * _WIDTHS[0]:
            return
        self._row = T = samples.T
        speed = samples.omega_e
        by_angle = np.concatenate(([0.0], np.cumsum(turned_angle(samples.theta_e, speed, T))))
        by_speed = np.concatenate(([0.0], np.cumsum(0.5 * T * (speed[1:] + speed[:-1]))))
        for width in _WIDTHS:
            each = _of_groups(by_angle, by_speed, speed, T, width)
            if len(each):
                count, once, squared = self._sums.get(width, (0, np.zeros(8), np.zeros((6, 6))))
                self._sums[width] = count + len(each), once + each.sum(axis=0), squared + each[:, :6].T @ each[:, :6]

    def found(self) -> SpeedLag | None:
        """The column against its angle; None where they cannot be compared."""
        each = [(width, one) for width, sums in self._sums.items() if (one := _solved(*sums, self._row)) is not None]
        wide = [one for width, one in each if width * self._row >= abs(one.lag)] or [one for _, one in each[-1:]]
        return min(wide, key=lambda one: one.lag_std, default=None)


def _of_groups(by_angle: Array, by_speed: Array, speed: Array, T: float, width: int) -> Array:
    """Of each group of means the products of two instruments with omega, the rate, and omega's change; and the
    squares of omega and its change; (groups, 8)."""
    half = width // 2
    at = np.arange(2 * width, len(speed) - 2 * width, half)
    at = at[: len(at) // _GROUP * _GROUP]
    before, after, over = at - half, at + half, width * T
    omega, change = (by_speed[after] - by_speed[before]) / over, (speed[after] - speed[before]) / over
    rate = (by_angle[after] - by_angle[before]) / over
    later, earlier = (by_angle[at + k * width] - by_angle[at + (k - 1) * width] for k in (2, -1))
    around = (by_angle[at + 2 * width] - by_angle[at - 2 * width]) / (4.0 * over)
    bend = (later - earlier) / (3.0 * over**2)
    products = np.stack([*(z * x for z in (around, bend) for x in (omega, rate, change)), omega**2, change**2])
    return products.reshape(len(products), -1, _GROUP).sum(axis=2).T


def _solved(count: int, once: Array, squared: Array, T: float) -> SpeedLag | None:
    if count < _FEWEST or not once[5] ** 2 > _SPREAD * squared[5, 5]:
        return None
    m, (omega2, change2) = once[:6].reshape(2, 3), once[6:].tolist()
    normal = np.stack((m[:, 1], -m[:, 2]), axis=1)
    if abs(float(np.linalg.det(normal))) < 1e-12 * math.sqrt(math.prod(np.sum(normal**2, axis=1).tolist())):
        return None
    inverse = np.linalg.inv(normal)
    scale, lag = map(float, inverse @ m[:, 0])
    score = np.kron(np.eye(2), np.array([1.0, -scale, lag]))  # of a group's products
    covariance = inverse @ (score @ squared @ score.T) @ inverse.T
    scale_std, lag_std = map(float, np.sqrt(np.maximum(np.diag(covariance), 0.0)))
    lag_std = math.hypot(lag_std, _KNOWN * T)
    bend = math.sqrt(change2 / max(omega2, 1e-300))
    return SpeedLag(lag, lag_std, scale, scale_std, bend, T) if math.isfinite(lag_std + scale_std) else None
