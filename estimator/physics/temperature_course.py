"""A course of temperature from outside, whatever the losses: what `winding_temperature` and `magnet_temperature` share.

A cubic through four points from the start to a turn, and one through four from there to the end, so that a heat source
that comes or goes may bend it once. At the start it is none; its sizes are the shares at the six points after that.
Cubic elements of Lagrange: O. C. Zienkiewicz, R. L. Taylor, "The Finite Element Method", 2000, chapter 8.
"""

from collections.abc import Callable
from typing import Final

import numpy as np

from estimator.arrays import Array
from estimator.kernel import kernel
from estimator.physics.effect import Parameter, Sizes, constant
from estimator.physics.rows import Rows

_TOLD_AT: Final = {"start": 0.0, "quarter": 0.25, "half": 0.5, "three_quarters": 0.75, "end": 1.0}
_FINE: Final = 256  # parts of a recording, to look for the most


def share_at(rows: Rows, sizes: Sizes, t: Array) -> Array:
    """By which a parameter differs from that at the start, at times (s)."""
    *points, turn = map(float, sizes)
    return _share_at((t - rows.span[0]) / rows.span[1], np.array([0.0, *points]), turn)


@kernel
def _share_at(x: Array, points: Array, turn: float) -> Array:
    share = np.empty(len(x))
    for k in range(len(x)):
        first = 0 if x[k] < turn else 3
        s = 3.0 * (x[k] / turn if first == 0 else (x[k] - turn) / (1.0 - turn))
        a, b, c, d = points[first], points[first + 1], points[first + 2], points[first + 3]
        share[k] = (
            -(s - 1.0) * (s - 2.0) * (s - 3.0) * a / 6.0 + s * (s - 2.0) * (s - 3.0) * b / 2.0
            - s * (s - 1.0) * (s - 3.0) * c / 2.0 + s * (s - 1.0) * (s - 2.0) * d / 6.0
        )  # fmt: skip
    return share


def parameters_of(typical: float, low: float, high: float) -> tuple[Parameter, ...]:
    """The six shares, in the order of time, and the turn as a share of the recording."""
    sizes = (Parameter(f"share_{k}", "1", constant(typical), constant(low), constant(high)) for k in range(1, 7))
    return (*sizes, Parameter("turn", "1", constant(0.5), constant(0.2), constant(0.8), shape=True))


def shapes(_rows: Rows) -> tuple[tuple[float, ...], ...]:
    """A turn halfway, to begin with."""
    return ((0.5,),)


def told_as(
    most: str, unit: str, value: Callable[[Rows], float]
) -> Callable[[Rows, Sizes], dict[str, tuple[float, str]]]:
    """The most that it differs by, under a name of its own, and when; the parameter itself at five times."""

    def told(rows: Rows, sizes: Sizes) -> dict[str, tuple[float, str]]:
        begin, length = rows.span
        x, largest = _most(share_at(rows, sizes, begin + length * np.linspace(0.0, 1.0, _FINE + 1)))
        times = np.array([begin + at * length for at in _TOLD_AT.values()])
        at = value(rows) * (1.0 + share_at(rows, sizes, times))
        course = {f"at_{name}": (each, unit) for name, each in zip(_TOLD_AT, at.tolist(), strict=True)}
        return {most: (largest, "1"), "time": (begin + x * length, "s"), **course}

    return told


def _most(share: Array) -> tuple[float, float]:
    """Where (0 to 1) and how much an evenly spaced course is at its most, by the parabola there."""
    k = int(np.argmax(np.abs(share)))
    if k in {0, _FINE}:
        return k / _FINE, float(share[k])
    before, there, after = share[k - 1 : k + 2].tolist()
    bend = before - 2.0 * there + after
    off = 0.5 * (before - after) / bend if bend != 0.0 else 0.0
    return (k + off) / _FINE, there - 0.25 * (before - after) * off
