"""Mean responses of made-up loops: overshoot, settling and tracking beside what equations say, and no nonsense."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.commissioning.response import BAND, Column, Response, UnclearStepError, averaged, averaged_with

T = 1e-4  # s
HOLD = 400  # samples
COUNT = 30  # levels
SLOW = 4e-3  # s, time constant
SMOOTHED = HOLD * T / 100.0  # s, over which a mean is taken, twice
SIZE = 3.0
LEVEL = -7.0


def reference(rng: np.random.Generator, at: int = 0, hold: int = HOLD, count: int = COUNT) -> Column:
    """0 or 1 for `hold` samples each; the first level is `at` samples longer."""
    levels = rng.integers(0, 2, count).astype(np.float64)
    return np.concatenate((np.full(at, levels[0]), np.repeat(levels, hold)))


def first_order(u: Column, tau: float = SLOW) -> Column:
    """u through 1/(1 + s tau), exactly."""
    a, y, now = math.exp(-T / tau), np.empty(len(u)), float(u[0])
    for k, wanted in enumerate(u):
        y[k] = now
        now = a * now + (1.0 - a) * wanted
    return y


def second_order(u: Column, omega: float, zeta: float) -> Column:
    """u through omega^2 / (s^2 + 2 zeta omega s + omega^2), exactly: zeta below 1."""
    s = complex(-zeta, math.sqrt(1.0 - zeta * zeta)) * omega
    z, y = np.exp(s * T), np.empty(len(u))
    now, before = 0j, float(u[0])  # y = u + Re(now), each step adds a ringing of its own
    ringing = complex(1.0, -s.real / s.imag) * -1.0
    for k, wanted in enumerate(u):
        now += ringing.conjugate() * (wanted - before)
        before = float(wanted)
        y[k] = wanted + now.real
        now *= z
    return y


def drawn(seed: int = 1) -> np.random.Generator:
    return np.random.default_rng(seed)


@pytest.mark.parametrize("at", [0, 1, 57, 200, 333, 399])
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_a_first_order_is_told_wherever_its_steps_begin(at: int, noise: float) -> None:
    rng = drawn()
    clean = first_order(reference(rng, at))
    got = averaged(LEVEL + SIZE * (clean + noise * rng.standard_normal(len(clean))), T, HOLD, SIZE)
    assert got.overshoot <= 0.005 + noise
    assert got.settling == pytest.approx(SLOW * math.log(19.0), abs=0.5 * SLOW if noise else SMOOTHED)
    assert got.tracking == pytest.approx(0.95 * SLOW, abs=2.0 * T if not noise else 0.2 * SLOW)
    assert got.error == pytest.approx(noise / math.sqrt(got.steps * HOLD // 100), abs=0.3 * noise + 5e-3)
    assert 5 <= got.steps < COUNT


@pytest.mark.parametrize("zeta", [0.2, 0.45, 0.7, 0.9])
def test_a_second_order_overshoots_and_settles_as_its_damping_says(zeta: float) -> None:
    omega = 1.0 / (0.06 * HOLD * T * zeta)  # it has rung out well before the next step
    got = averaged(SIZE * second_order(reference(drawn()), omega, zeta), T, HOLD, SIZE)
    t = np.arange(0.0, HOLD * T, 1e-6)
    phase = math.sqrt(1.0 - zeta * zeta) * omega * t
    y = 1.0 - np.exp(-zeta * omega * t) * (np.cos(phase) + zeta / math.sqrt(1.0 - zeta * zeta) * np.sin(phase))
    begins = t[np.argmax(y > BAND)]
    assert got.overshoot == pytest.approx(math.exp(-math.pi * zeta / math.sqrt(1.0 - zeta * zeta)), abs=0.04)
    assert got.settling == pytest.approx(t[np.flatnonzero(np.abs(y - 1.0) > BAND)[-1]] - begins, abs=SMOOTHED)
    assert got.tracking == pytest.approx(float(np.sum(np.abs(y[t >= begins] - 1.0))) * 1e-6, rel=0.03, abs=2.0 * T)


def test_what_never_comes_within_the_band_does_not_settle() -> None:
    got = averaged(SIZE * 0.9 * first_order(reference(drawn())), T, HOLD, SIZE)
    assert (got.settling, got.overshoot) == (math.inf, 0.0)
    assert got.tracking > 0.1 * 0.8 * HOLD * T


@pytest.mark.parametrize("height", [0.96, 1.0, 1.04])
def test_a_response_at_once_settles_at_once(height: float) -> None:
    got = averaged(SIZE * height * reference(drawn(), 11), T, HOLD, SIZE)
    assert 0.0 <= got.settling <= 10.0 * T  # what the means over a hundredth make of a jump
    assert got.overshoot == pytest.approx(max(0.0, height - 1.0), abs=1e-9)


def test_a_response_that_leaves_the_band_at_its_very_end_does_not_settle() -> None:
    t = np.array([0.0, 1.0, 2.0, 3.0])
    assert Response(t, np.array([0.0, 0.5, 1.0, 1.2]), 9, 0.0).settling == math.inf
    assert Response(t, np.array([0.0, 0.5, 1.2, 1.0]), 9, 0.0).settling == pytest.approx(2.0 + 0.15 / 0.2)
    assert Response(t, np.array([1.0, 1.0, 1.0, 1.0]), 9, 0.0).settling == 0.0
    assert Response(t, np.array([0.0, 0.5, 1.2, 1.0]), 9, 0.0).tracking == pytest.approx(1.0 + 0.5 + 0.2)


def test_other_columns_come_as_they_are_at_the_same_steps_upwards() -> None:
    u = reference(drawn(), 20)
    y = SIZE * first_order(u)
    got, (same, against, still) = averaged_with(y, T, HOLD, SIZE, (y, LEVEL - 2.0 * y, np.full(len(y), 5.0)))
    assert same == pytest.approx(SIZE * got.y, abs=0.15)  # that is smoothed
    assert against == pytest.approx(-2.0 * same, abs=1e-9)
    assert still == pytest.approx(0.0, abs=1e-9)
    assert len(same) == len(got.t)


@pytest.mark.parametrize("first", [0, 1])
def test_steps_to_and_fro_and_holds_without_one_all_count_alike(first: int) -> None:
    levels = [first, 1 - first, 1 - first, first, 1 - first, first, first, 1 - first, first, 1 - first]
    got = averaged(first_order(np.repeat(np.array(levels, dtype=np.float64), HOLD)), T, HOLD, 1.0)
    assert got.settling == pytest.approx(SLOW * math.log(19.0), abs=SMOOTHED)


@pytest.mark.parametrize(("count", "said"), [(4, "at least 4 steps, 400 samples each, got 1600"), (0, "got 0 samples")])
def test_too_short_a_recording_tells_so(count: int, said: str) -> None:
    with pytest.raises(UnclearStepError, match=said):
        averaged(first_order(np.repeat(np.arange(count) % 2, HOLD).astype(np.float64)) if count else np.array([]),
                 T, HOLD, 1.0)  # fmt: skip


def test_too_few_steps_and_steps_that_are_too_small_tell_so() -> None:
    u = np.repeat([0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0], HOLD)
    with pytest.raises(UnclearStepError, match=r"expected at least 4 steps by 3, found [23]$"):
        averaged(SIZE * first_order(u), T, HOLD, SIZE)
    with pytest.raises(UnclearStepError, match="found 0"):
        averaged(0.4 * SIZE * first_order(reference(drawn())), T, HOLD, SIZE)
    with pytest.raises(UnclearStepError, match="found 0"):
        averaged(np.zeros(COUNT * HOLD), T, HOLD, SIZE)


def test_steps_that_are_lost_in_noise_tell_so() -> None:
    rng = drawn()
    y = first_order(reference(rng)) + 8.0 * rng.standard_normal(COUNT * HOLD)
    with pytest.raises(UnclearStepError, match=r"times their noise, expected 6|expected at least 4 steps"):
        averaged(y, T, HOLD, 1.0)


@given(
    seed=st.integers(0, 10_000), hold=st.integers(1, 120), count=st.integers(0, 40), at=st.integers(0, 119),
    tau=st.floats(1e-5, 1e-2), zeta=st.floats(0.05, 0.95), noise=st.floats(0.0, 3.0), kind=st.integers(0, 2),
)  # fmt: skip
def test_whatever_comes_is_a_response_with_sensible_numbers_or_a_sentence(
    seed: int, hold: int, count: int, at: int, tau: float, zeta: float, noise: float, kind: int
) -> None:
    rng = drawn(seed)
    u = reference(rng, at % hold, hold, max(count, 1))
    y = first_order(u, tau) if kind == 0 else second_order(u, 1.0 / tau, zeta) if kind == 1 else u
    try:
        got = averaged(y + noise * rng.standard_normal(len(y)), T, hold, 1.0)
    except UnclearStepError as error:
        assert str(error).startswith(("expected at least 4 steps", "the steps are "))
        return
    assert np.isfinite(got.y).all()
    assert np.isfinite(got.t).all()
    assert got.steps >= 4
    assert 0.0 <= got.overshoot < math.inf
    assert got.settling >= 0.0
    assert 0.0 <= got.tracking < math.inf
    assert math.isfinite(got.error)
