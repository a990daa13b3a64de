"""The bridge's lost voltage, period by period."""

import numpy as np
import pytest

from estimator.arrays import Array
from estimator.physics.bridge.legs import legs_at_rest
from estimator.physics.bridge.lost_voltage import lost_between
from estimator.physics.vectors import AXES

U_DC, T_s, L = 545.0, 1e-4, 0.02  # V, s, H
DEAD_TIME = 2.7e-6  # s
ROUNDING = 1e-9  # A


@pytest.mark.parametrize(("u_drop", "knee", "most"), [(0.0, 1e-4, 1e-3), (2.0, 0.1, 0.05)])
def test_a_current_that_comes_to_rest_in_a_dead_time_makes_no_step_of_the_lost_voltage(
    u_drop: float, knee: float, most: float
) -> None:
    """Where a rail keeps it from floating, too: next to none more of a current is next to no other voltage. Beside
    drops the last shot at the end of a course that bends may miss it by a little.
    """
    n, random = 20_000, np.random.default_rng(1)
    duties = random.uniform(0.3, 0.7, (n, 1)) + random.uniform(-0.1, 0.1, (n, 3))
    legs = legs_at_rest(np.full(n, U_DC), duties, T_s, L)
    zero_crossing = 0.02 * random.normal(size=n) + 1j * random.normal(size=n)
    begin = zero_crossing * np.array(AXES)[random.integers(0, 3, n)]
    end = begin + 0.05 * (random.normal(size=n) + 1j * random.normal(size=n))
    lost = [lost_between(legs, begin + off, end + off, DEAD_TIME, u_drop, 1e-4, knee) for off in (0.0, ROUNDING)]
    assert np.max(np.abs(lost[0])) > 0.5 * DEAD_TIME / T_s * U_DC
    step = np.abs(lost[1] - lost[0])
    assert np.max(step) < most
    assert np.mean(step > 1e-3) < 0.01


def mean_drop(duties: Array, begin: complex, end: complex, L: float, u_drop: float, knee: float) -> complex:
    """Mean voltage (V, stationary) of drops over a period along the course that they bend, by steps of T_s/20000."""
    axes, t = np.array(AXES), (np.arange(20_000) + 0.5) / 20_000
    u = 2.0 / 3.0 * U_DC * (np.abs(t[:, None] - 0.5) < 0.5 * duties) @ axes

    def flux(v: np.ndarray) -> np.ndarray:  # Vs, without its mean: the ends are known
        rest = (v - v.mean()) * T_s / len(t)
        return np.cumsum(rest) - 0.5 * rest

    i = straight = begin + (end - begin) * t + flux(u) / L
    while True:
        legs = np.real(i[:, None] * axes.conj())
        drop = 2.0 / 3.0 * u_drop * (legs / np.hypot(legs, knee)) @ axes
        change = straight - flux(drop) / L - i
        i = i + 0.5 * change
        if np.max(np.abs(change)) < 1e-9:
            return complex(drop.mean())


@pytest.mark.parametrize(("L", "most"), [(0.02, 0.003), (0.002, 0.04)])
def test_drops_are_those_along_the_course_that_they_bend(L: float, most: float) -> None:
    u_drop, knee, n, random = 2.0, 0.02, 40, np.random.default_rng(1)
    duties = random.uniform(0.3, 0.7, (n, 1)) + random.uniform(-0.1, 0.1, (n, 3))
    begin = 2.0 * knee * (random.normal(size=n) + 1j * random.normal(size=n))
    end = begin + knee * (random.normal(size=n) + 1j * random.normal(size=n))
    lost = lost_between(legs_at_rest(np.full(n, U_DC), duties, T_s, L), begin, end, 0.0, u_drop, 1e-4, knee)
    expected = [mean_drop(duties[k], begin[k], end[k], L, u_drop, knee) for k in range(n)]
    assert np.mean(np.abs(lost - expected)) < most * np.mean(np.abs(expected))
