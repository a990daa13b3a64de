"""The angle's rounding: which resolution is believed, and where counts are smoothed out of a recording."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from emulator.conceal.recording import Choice, drawn
from emulator.drive.virtual_drive import VirtualDrive
from estimator.diagnosis.angle.angle_rounding import resolution_of, unrounded
from estimator.machine import Machine
from estimator.physics.rows import Rows, rows_of
from estimator.samples import Resolution, Samples
from tests.support.samples import machine_of

MACHINE = Machine(R_s=0.5, L_d=2e-3, L_q=2e-3, psi_f=0.1, n_p=4, i_rated=10.0)
T_S = 1e-4  # s
NUMBER = 2.0 * math.pi / 65536  # rad: a 16-bit channel
N = 20_000


Array = NDArray[np.float64]


def rows(
    count: float, number: float, noise: float = 1e-3, theta: Array | None = None, torque: Array | float = 0.0
) -> tuple[Rows, Array]:
    """An angle in counts (rad), told in numbers of so many rad, and the true one; noise of the currents, A.

    `torque`: as i_q makes it, A.
    """
    t = T_S * np.arange(N)
    theta = 300.0 * t + 2.0 * np.sin(7.0 * t) if theta is None else theta
    told = theta
    for step in (count, number):
        told = step * np.round(told / step) if step else told
    generator = np.random.default_rng(1)
    i_d, i_q = generator.normal(0.0, noise, (2, N))
    omega, zero = np.gradient(theta, T_S), np.zeros(N)
    return rows_of([Samples(told, omega, i_d, torque + 2.0 + i_q, zero, zero, T_S)], MACHINE, 10.0), theta


@pytest.mark.parametrize("count", [0.25 * NUMBER, 0.5 * NUMBER, 1.5 * NUMBER, 20.0 * NUMBER])
def test_counts_that_are_told_in_numbers_have_the_resolution_of_both(count: float) -> None:
    resolution = math.hypot(count, NUMBER)
    assert unrounded(rows(count, NUMBER)[0], resolution).angle_step == resolution


def test_an_angle_that_is_coarser_than_told_is_believed_as_it_shows() -> None:
    found = unrounded(rows(20.0 * NUMBER, NUMBER)[0], NUMBER)
    assert found.angle_step == pytest.approx(20.0 * NUMBER, rel=0.1)


def test_coarse_counts_are_smoothed_out() -> None:
    count = 50.0 * NUMBER
    there, theta = rows(count, NUMBER)
    inner = slice(200, -200)
    smooth = unrounded(there, math.hypot(count, NUMBER))
    before, after = (float(np.std((each.theta_e - theta)[inner])) for each in (there, smooth))
    assert after < 0.04 * before
    assert 0.3 * after < smooth.angle_error < 3.0 * after


def test_currents_turned_by_finer_counts_than_the_angle_is_told_in_stay_as_they_were() -> None:
    """Turned by what the numbers round, they would move with it."""
    count = 0.25 * NUMBER
    there, theta = rows(count, NUMBER, noise=1e-9)
    told = math.hypot(count, NUMBER)
    inner = slice(200, -200)

    def off(found: Rows) -> float:
        return float(np.std(np.angle(found.i_s / (there.i * np.exp(1j * theta)))[inner]))

    assert off(there) > 0.9 * NUMBER / math.sqrt(12.0)
    assert off(unrounded(there, told)) > 0.9 * off(there)
    known = unrounded(replace(there, angle_turned=Resolution(theta_e=told, encoder=count).turned), told)
    assert off(known) < 1.2 * count / math.sqrt(12.0)
    assert known.angle_turned == pytest.approx((count / told) ** 2)


@pytest.mark.parametrize("encoder", [0.0, math.hypot(20.0 * NUMBER, NUMBER)])
def test_an_encoder_that_is_not_known_or_told_as_it_is_turned_the_currents(encoder: float) -> None:
    count = 20.0 * NUMBER
    resolution = Resolution(theta_e=math.hypot(count, NUMBER), encoder=encoder)
    assert resolution.turned == 1.0
    there = replace(rows(count, NUMBER)[0], angle_turned=resolution.turned)
    assert unrounded(there, resolution.theta_e).angle_turned == 1.0


@pytest.mark.parametrize("share", [0.05, 0.2])
@pytest.mark.parametrize("order", [6.0, 2.0 / MACHINE.n_p])
def test_a_swing_at_an_order_of_the_turn_stays_though_it_is_less_than_a_count(order: float, share: float) -> None:
    """Cogging moves a rotor; without that movement, its angle would look like a harmonic of the magnets' flux.

    And an eccentric encoder's error, twice in a mechanical turn, would be told too small.
    """
    count, turn = 50.0 * NUMBER, 300.0 * T_S * np.arange(N)
    swing = share * count * np.cos(order * turn)
    there, theta = rows(count, NUMBER, theta=turn + swing)
    found = unrounded(there, math.hypot(count, NUMBER))
    inner = slice(500, -500)
    left = (found.theta_e - theta)[inner] - np.mean((found.theta_e - theta)[inner])
    along = swing[inner] / np.std(swing)
    assert np.std(left) < 0.5 * np.std((there.theta_e - theta)[inner])
    for end in (slice(150, 400), slice(-400, -150)):  # a swing is not known from less than its turns
        assert np.std((found.theta_e - theta)[end]) < 0.6 * np.std((there.theta_e - theta)[end])
    assert abs(np.mean(left * along)) < 0.1 * np.std(swing)


@pytest.mark.parametrize(("push", "most"), [(0.0, 0.2), (1e-4, 0.3)])
def test_an_eccentric_encoders_error_of_many_counts_does_not_keep_the_rounding(push: float, most: float) -> None:
    """No stiff course would follow it; and it stays, with a speed that changes suddenly or by torque."""
    count, turn = 50.0 * NUMBER, 1250.0 * T_S * np.arange(N)
    turn = turn + 0.2 * np.maximum(turn - 0.5 * turn[-1], 0.0)
    torque = 4.0 * np.repeat(np.random.default_rng(2).choice([-1.0, 1.0], N // 400), 400)
    turn = turn + push * np.cumsum(np.cumsum(torque - np.mean(torque)))
    error: Array = 10.0 * count * np.cos(turn / MACHINE.n_p)
    there, theta = rows(count, NUMBER, theta=turn + error, torque=torque)
    found = unrounded(there, math.hypot(count, NUMBER))
    inner = np.r_[500 : N // 2 - 300, N // 2 + 300 : N - 500]
    left = (found.theta_e - theta)[inner] - np.mean((found.theta_e - theta)[inner])
    assert np.std(left) < most * np.std((there.theta_e - theta)[inner])
    assert abs(np.mean(left * error[inner])) < 5e-3 * np.var(error)


@pytest.mark.parametrize("bends", [False, True])
def test_what_the_torque_makes_of_a_free_shaft_stays(bends: bool) -> None:
    """What a mean lost of it would look like what currents do."""
    generator = np.random.default_rng(2)
    torque = 4.0 * np.repeat(generator.choice([-1.0, 1.0], N // 80 + 1), 80)[:N]
    push = 1.5e-6 * torque
    if bends:  # half of the inertia behind a spring
        wave = np.exp(-0.05 * np.arange(400)) * np.cos(2.0 * np.pi * 300.0 * T_S * np.arange(400))
        push = 0.5 * push + 0.5 * np.convolve(push, wave)[:N] / np.sum(wave)
    move = np.cumsum(np.cumsum(push - np.mean(push)))
    count = 50.0 * NUMBER
    there, theta = rows(count, NUMBER, theta=300.0 * T_S * np.arange(N) + move, torque=torque)
    found = unrounded(there, math.hypot(count, NUMBER))
    mean = np.convolve(move, np.ones(65) / 65.0, "same")
    inner = slice(500, -500)
    left, lost = (x[inner] - np.mean(x[inner]) for x in (found.theta_e - theta, move - mean))
    assert np.std(left) < 0.33 * np.std((there.theta_e - theta)[inner])
    assert abs(np.mean(left * lost)) < 0.06 * np.var(lost)


def test_a_torque_that_nominal_inductances_do_not_tell_moves_a_free_shaft_too() -> None:
    """That of i_d i_q, where L_d and L_q are nominally the same: its movement looked like a cross-saturation."""
    generator = np.random.default_rng(3)
    i_d, more = (
        4.0 * np.repeat(generator.choice([-1.0, 1.0], N // m + 1), m)[:N] for m in (80, 190)
    )  # fmt: skip
    push, both = 1.5e-6 * (2.0 + more), 1.5e-7 * i_d * (2.0 + more)
    move, by_both = (np.cumsum(np.cumsum(x - np.mean(x))) for x in (push + both, both))
    count = 50.0 * NUMBER
    there, theta = rows(count, NUMBER, theta=300.0 * T_S * np.arange(N) + move, torque=more)
    found = unrounded(replace(there, i=there.i + i_d), math.hypot(count, NUMBER))
    mean, inner = np.convolve(by_both, np.ones(65) / 65.0, "same"), slice(500, -500)
    left, lost = (x[inner] - np.mean(x[inner]) for x in (found.theta_e - theta, by_both - mean))
    assert np.std(left) < 0.33 * np.std((there.theta_e - theta)[inner])
    assert abs(np.mean(left * lost)) < 0.06 * np.var(lost)


def test_rows_that_are_lost_do_not_lose_turns() -> None:
    """Some of every ten, one to four after the other, at a speed of half a radian in a period."""
    count, chance = 50.0 * NUMBER, np.random.default_rng(3)
    there, theta = rows(count, NUMBER, theta=0.5 * np.arange(N) + 2.0 * np.sin(7.0 * T_S * np.arange(N)))
    omega, zero, k = np.gradient(theta, T_S), np.zeros(N), 0
    runs, kept = list[Samples](), list[NDArray[np.intp]]()
    while k < N - 12:
        run = slice(k, k + int(chance.integers(3, 8)))
        i_d, i_q, none = there.i.real[run], there.i.imag[run], zero[run]
        runs.append(Samples(there.theta_e[run], omega[run], i_d, i_q, none, none, T_S, t0=T_S * k))
        kept.append(np.arange(N)[run])
        k = run.stop + int(chance.integers(1, 5))
    found = unrounded(rows_of(runs, MACHINE, 10.0), math.hypot(count, NUMBER))
    off = np.angle(np.exp(1j * (found.theta_e - theta[np.concatenate(kept)])))
    assert np.std(off) < 0.2 * count / math.sqrt(12.0)


def test_a_rotor_that_stands_lends_no_movement() -> None:
    count = 50.0 * NUMBER
    theta = np.concatenate((np.full(N // 2, 1.0), 1.0 + 300.0 * T_S * np.arange(N - N // 2)))
    found = unrounded(rows(count, NUMBER, theta=theta)[0], math.hypot(count, NUMBER))
    assert found.angle_error < 0.2 * count / math.sqrt(12.0)


def test_counts_finer_than_the_currents_noise_stay() -> None:
    """A smooth angle would lose what the rotor does within a few periods."""
    there, _ = rows(NUMBER, NUMBER, noise=0.05)
    found = unrounded(there, math.hypot(NUMBER, NUMBER))
    assert np.array_equal(found.theta_e, there.theta_e)
    assert found.angle_error < 0.5 * NUMBER / math.sqrt(12.0)


def test_a_resolution_that_is_not_told_shows_by_the_few_values_of_the_angle() -> None:
    count = 64.0 * NUMBER
    assert resolution_of(rows(count, 0.0)[0], 0.0) == pytest.approx(count, rel=1e-3)
    assert resolution_of(rows(0.0, 0.0)[0], 0.0) == 0.0
    assert resolution_of(rows(count, 0.0)[0], 0.5 * count) == 0.5 * count


# --- Of the emulator


@pytest.mark.parametrize(("motor", "number", "most"), [
    ("servo_4nm", 1, 0.03), ("anaheim_bly172s", 2, 0.01), ("servo_4nm", 6, 0.25), ("teknic_m2310p", 8, 0.06),
])
def test_little_is_left_of_an_emulated_encoders_rounding(motor: str, number: int, most: float) -> None:
    concealed, _ = drawn(Choice(9, ("none",), (0.4, 1.0), (motor,), 3.0), number)
    scenario = concealed.scenario
    drive = VirtualDrive(replace(scenario, drive=replace(scenario.drive, encoder_counts=0)))
    c = drive.record(concealed.periods)
    true, theta = scenario.motor, np.unwrap(c["theta_e"])
    count = 2.0 * math.pi * true.n_p / 10_000
    told = count * np.floor(theta / count)
    i = (c["i_d"] + 1j * c["i_q"]) * np.exp(1j * (theta - told))
    machine = machine_of(true)
    zero = np.zeros(len(theta))
    there = rows_of(
        [Samples(told, c["omega_e"], i.real, i.imag, zero, zero, scenario.drive.T_s)], machine, true.i_rated
    )  # fmt: skip
    before, after = (float(np.std(each.theta_e - theta)) for each in (there, unrounded(there, count)))
    print(f"{motor}, shaft {scenario.run.shaft}: {after / before:.3f} of the rounding is left")
    assert after < most * before
