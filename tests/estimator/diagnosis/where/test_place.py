"""Where a mismatch is, and what one without a name looks like: found where it was put."""

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from emulator.conceal.recording import Choice, Concealed, drawn
from estimator.arrays import Vector
from estimator.diagnosis.angle.angle_rounding import unrounded
from estimator.diagnosis.likelihood.noise import filter_of, noise_of, whitened
from estimator.diagnosis.unnamed.branch import Branch
from estimator.diagnosis.unnamed.describe import best_resonance, describe
from estimator.diagnosis.verdict import Place, Unexplained
from estimator.diagnosis.where.place import place_of
from estimator.diagnosis.words import number
from estimator.machine import Machine
from estimator.physics.rows import Rows, rows_of
from estimator.samples import Samples
from estimator.twin.model import Model, residual
from tests.support.samples import machine_of, rows_of_columns

TURN = 2.0 * math.pi
T = 1e-4
MACHINE = Machine(0.5, 5e-3, 8e-3, 0.1, 4, 8.0)
NOISE = (5e-5, 8e-5)  # Vs: 10 mA of the current


def run(seconds: float = 6.0, seed: int = 1) -> Rows:
    """A run whose speed swings and whose currents jump between levels, with the voltages that they imply."""
    n = round(seconds / T)
    t = np.arange(n + 1) * T
    omega = 300.0 + 150.0 * np.sin(TURN * 0.4 * t)
    theta = np.cumsum(omega) * T
    levels = np.random.default_rng(seed).uniform(-6.0, 6.0, (2, n // 500 + 2))
    smooth = np.ones(20) / 20.0
    i_d, i_q = (np.convolve(np.repeat(level, 500)[: n + 20], smooth, "valid")[: n + 1] for level in levels)
    zero = np.zeros(n + 1)
    rows = rows_of([Samples(theta, omega, i_d, i_q, zero, zero, T)], MACHINE, 8.0)
    return replace(rows, u=MACHINE.R_s * rows.i_mean + rows.balance(rows.flux(rows.i)))


def flux_of(rows: Rows, v: Vector) -> Vector:
    return whitened(v, filter_of(rows, rows.machine))


def white(rows: Rows, seed: int = 2) -> Vector:
    d, q = np.random.default_rng(seed).normal(size=(2, len(rows)))
    return NOISE[0] * d + 1j * NOISE[1] * q


ROWS = run()
SMALLEST = np.min(np.abs([ROWS.phase(k)[:-1] for k in range(3)]), axis=0)
NONE = np.zeros(len(ROWS), np.complex128)
TIME = ROWS.t[:-1]


def placed(v: NDArray[Any], volts: float = 0.5) -> tuple[Place, Place]:
    """Where a voltage is found alone, and in noise."""
    alone = flux_of(ROWS, (volts * v).astype(np.complex128))
    return place_of(ROWS, alone, (0.0, 0.0)), place_of(ROWS, alone + white(ROWS), NOISE)


def limits(place: Place, key: str) -> tuple[float, float]:
    value = place.region[key]
    assert isinstance(value, tuple)
    return value


def test_what_acts_near_a_change_of_sign_is_found_there() -> None:
    for place in placed(np.where(SMALLEST < 0.25, 1j * np.sign(ROWS.phase(0)[:-1]), NONE), 4.0):
        assert limits(place, "zero_crossing") == pytest.approx((0.0, 0.25), abs=0.25)
        assert place.energy_share > 0.7
        assert place.samples_share < 0.45
        assert re.search(r"where a phase current is within [\d.]+ A of changing sign: \d+ % of the", place.sentence)


def test_what_acts_above_a_current_or_a_speed_on_one_axis_is_found_there() -> None:
    above = np.where(ROWS.i[:-1].imag > 3.0, 1j * np.cos(TURN * 37.0 * TIME), NONE)
    fast = np.where(ROWS.omega_e > 400.0, np.cos(TURN * 37.0 * TIME), NONE)
    for v, axis, key, edge in ((above, "q", "i_q", 3.0), (fast, "d", "speed", 400.0)):
        for place in placed(v, 2.0):
            assert place.region["axis"] == axis
            low, high = limits(place, key)
            assert low == pytest.approx(edge, rel=0.15)
            assert high == pytest.approx({"i_q": ROWS.i.imag.max(), "speed": 450.0}[key], rel=0.01)
            assert place.energy_share > 0.85
            assert f"on the {axis} axis, where" in place.sentence


def test_some_periods_of_a_long_recording_say_where_an_effect_acts() -> None:
    longer = run(12.0)
    above = np.where(longer.i[:-1].imag > 3.0, 1j * np.cos(TURN * 37.0 * longer.t[:-1]), 0j)
    place = place_of(longer, flux_of(longer, above), (0.0, 0.0))
    assert place.region["axis"] == "q"
    assert limits(place, "i_q") == pytest.approx((3.0, longer.i.imag.max()), rel=0.15)
    assert place.samples_share == pytest.approx(np.mean(longer.i.imag > 3.0), abs=0.05)


def test_two_conditions_are_found_together() -> None:
    both = (ROWS.i[:-1].imag > 2.0) & (TIME > 3.0)
    for place in placed(np.where(both, np.exp(1j * TURN * 37.0 * TIME), NONE)):
        assert limits(place, "i_q")[0] == pytest.approx(2.0, abs=0.6)
        assert limits(place, "time")[0] == pytest.approx(3.0, abs=0.3)
        assert place.samples_share == pytest.approx(both.mean(), abs=0.06)


def test_orders_and_lines_are_found_in_their_frame() -> None:
    theta = ROWS.theta_e[:-1]
    sixth, mechanical = placed(np.cos(6.0 * theta))[1], placed(np.exp(0.75j * theta))[1]
    assert sixth.region == {"electrical_order": 6.0, "frame": "rotor"}
    assert mechanical.region == {"mechanical_order": 3.0, "frame": "rotor"}
    line = placed(ROWS.stationary(np.exp(1j * TURN * 90.2 * TIME)))[1]
    assert line.region["frame"] == "stationary"
    assert line.region["frequency"] == pytest.approx(90.2, abs=0.01)
    assert placed(1j * np.cos(TURN * 210.0 * TIME))[1].region["frame"] == "rotor"


def test_what_hardly_changes_has_no_frequency() -> None:
    half_a_second = ROWS[:5000]
    place = place_of(half_a_second, flux_of(half_a_second, np.full(5000, 1.0 + 0.8j)), (0.0, 0.0))
    assert place.sentence == "all the time in the rotor frame, with all of the energy"


def test_what_acts_along_a_phase_is_found_there() -> None:
    along_b = np.exp(2j * TURN / 6.0) * np.cos(3.3 * np.sqrt(5000.0 * TIME))  # of no one frequency
    for place in placed(ROWS.stationary(along_b)):
        assert place.region["phase"] == "b"


def test_what_acts_everywhere_has_no_region() -> None:
    everywhere = np.random.default_rng(3).normal(size=(2, len(ROWS)))
    place = place_of(ROWS, flux_of(ROWS, everywhere[0] + 1j * everywhere[1]), (0.0, 0.0))
    assert place == Place("at all speeds, currents and times", {}, 1.0, 1.0)
    assert place_of(ROWS, 0.9 * white(ROWS), NOISE).energy_share == 0.0


# --- What has no name


def described(v: NDArray[Any]) -> Unexplained:
    found = describe(ROWS, flux_of(ROWS, v.astype(np.complex128)) + white(ROWS), NOISE)
    assert found is not None
    return found


def test_white_noise_has_nothing_to_describe() -> None:
    short = run(0.8)
    assert [seed for seed in range(60) if describe(short, white(short, seed), NOISE) is not None] == []


def test_a_stray_voltage_is_described_by_frequency_size_and_direction() -> None:
    v = np.cos(TURN * 90.2 * (TIME + 0.5 * T) + 0.3) * np.exp(1j * math.radians(35.0))
    found = described(ROWS.stationary(-v))
    told = re.fullmatch(
        r"a 90\.2 Hz voltage of ([\d.]+) V fixed in the stationary frame, along 35 deg from phase a", found.description
    )
    assert told, found.description
    assert float(told[1]) == pytest.approx(1.0, rel=2e-3)
    assert found.rms_V == pytest.approx(math.sqrt(0.5), rel=0.02)
    assert found.where.region["frequency"] == pytest.approx(90.2, abs=1e-3)


def test_of_a_slow_voltage_the_machine_hides_nothing() -> None:
    """Fitted alone, the machine takes a part of it, and what is left gives a smaller one."""
    found = described(ROWS.stationary(-np.cos(TURN * 9.7 * (TIME + 0.5 * T)) + 0j))
    assert found.where.region["frequency"] == pytest.approx(9.7, abs=1e-4)
    assert found.where.energy_share > 0.997
    told = re.match(r"a 9\.70 Hz voltage of ([\d.]+) V fixed in the stationary frame, along 0 deg", found.description)
    assert told, found.description
    assert float(told[1]) == pytest.approx(1.0, rel=5e-3)


def test_a_voltage_that_comes_and_goes_is_described_by_size_direction_and_number() -> None:
    there = (TIME % 0.4) > 0.32
    found = described(ROWS.stationary(-1.4 * there * np.exp(1j * math.radians(120.0))))
    told = re.fullmatch(
        r"a voltage of ([\d.]+) V along 120 deg of the stationary frame that comes and goes, 15 times, "
        r"for 80 ms on average", found.description,
    )  # fmt: skip
    assert told, found.description
    assert float(told[1]) == pytest.approx(1.4, rel=0.03)
    assert found.where.samples_share == pytest.approx(0.2, abs=0.01)


def test_a_step_and_a_drift_are_described() -> None:
    step = described(-0.5j * (TIME > 2.31))
    told = re.fullmatch(r"a step of ([\d.]+) V at 2\.31 s, along 90 deg of the rotor frame", step.description)
    assert told, step.description
    assert float(told[1]) == pytest.approx(0.5, rel=0.1)  # psi_f's fit takes a part of it
    assert step.where.region["time"] == pytest.approx((2.31, 6.0), abs=0.01)
    drift = described(0.5 * (TIME / 6.0 - 0.5))
    assert re.match(r"a drift of 0\.(49|50)\d* V from begin to end, along -?180 deg", drift.description)


def test_ripple_is_described_by_its_order() -> None:
    found = described(0.3 * np.cos(6.0 * ROWS.theta_e[:-1]))
    assert re.match(r"a ripple of 0\.1\d+ V rms at order 6 of the electrical turn", found.description)


def test_the_angles_rounding_is_told_from_the_rotors_movement() -> None:
    step = TURN * 4.0 / 10000.0
    lost = np.delete(np.arange(len(ROWS.t)), np.arange(5000, len(ROWS.t), 700))  # and some samples
    joined = np.diff(lost) == 1
    part = replace(
        ROWS, t=ROWS.t[lost], theta_e=ROWS.theta_e[lost], i=ROWS.i[lost], u=ROWS.u[lost[:-1]], joined=joined,
        half=np.exp(0.5j * np.diff(ROWS.theta_e[lost])),
    )  # fmt: skip
    rounded = np.floor(part.theta_e / step) * step
    off = rounded - part.theta_e
    coarse = replace(
        part, theta_e=rounded, i=part.i * np.exp(-1j * off), u=part.u * np.exp(-0.5j * (off[1:] + off[:-1])),
        half=np.exp(0.5j * np.diff(rounded)),
    )  # fmt: skip
    inner = slice(100, -100)
    for told in (step, 0.0):  # the encoder's counts, or nothing
        found = unrounded(coarse, told)
        left = (found.theta_e - part.theta_e + 0.5 * step)[inner]
        assert np.std(left) < 0.3 * step / math.sqrt(12.0)
        assert np.std(left) < 2.0 * found.angle_error
        assert np.allclose(found.i * found.rotor, part.i * part.rotor)  # the stationary frame's are what they were
        assert np.allclose(found.u * found.middle, part.u * part.middle)
    assert np.max(np.abs(unrounded(ROWS, 0.0).theta_e - ROWS.theta_e)) < 1e-6


def test_gaps_and_few_rows_are_no_obstacle() -> None:
    v = ROWS.stationary(np.cos(TURN * 90.2 * TIME) + 0j)
    joined = ROWS.joined.copy()
    joined[np.arange(3000, len(ROWS), 7000)] = False
    t = ROWS.t + 0.5 * (np.arange(len(ROWS.t)) > 30_000)
    u = replace(ROWS, joined=joined, t=t)
    later = np.exp(-1j * TURN * 90.2 * 0.5)  # the half second in the gap
    v[30_000:] = ROWS.stationary(np.real(np.exp(1j * TURN * 90.2 * TIME) / later) + 0j)[30_000:]
    found = describe(u, flux_of(u, v) + white(u), NOISE)
    assert found is not None
    told = re.match(
        r"a 90\.2 Hz voltage of ([\d.]+) V fixed in the stationary frame, along 0 deg", found.description
    )
    assert told, found.description
    assert float(told[1]) == pytest.approx(1.0, rel=5e-3)
    assert describe(ROWS, NONE, NOISE) is None
    for n in (3, 50, 300):
        short = ROWS[:n]
        assert describe(short, white(short), NOISE) is None
        assert place_of(short, flux_of(short, np.ones(n, np.complex128)), (0.0, 0.0)).energy_share <= 1.0


# --- Of the emulator


def left_in(
    kind: str, motor: str, number_: int, sizes: tuple[float, float] = (0.4, 1.0)
) -> tuple[Concealed, Rows, Vector, tuple[float, float]]:
    """A recording of 3 s with its true machine, but for the angle's mean rounding: its rows, flux errors and noise."""
    concealed, c = drawn(Choice(9, (kind,), sizes, (motor,), 3.0), number_)
    drive, machine = concealed.scenario.drive, machine_of(concealed.scenario.motor)
    step = TURN * machine.n_p / drive.encoder_counts
    rows = unrounded(rows_of_columns(c, machine, drive.T_s), step)
    z = whitened(residual(rows, rows, Model(machine, {}, -0.5 * step)), filter_of(rows, machine))
    return concealed, rows, z, noise_of(z, None, rows)[:2]


def seen(kind: str, motor: str, number_: int) -> tuple[Concealed, Unexplained | None]:
    concealed, rows, z, noise = left_in(kind, motor, number_)
    return concealed, describe(rows, z, noise)


@pytest.mark.parametrize("motor", ["beckhoff_am8141", "servo_4nm"])
def test_strangers_of_the_emulator_are_described(motor: str) -> None:
    assert seen("none", motor, 1)[1] is None
    concealed, found = seen("stray_voltage", motor, 1)
    stray = concealed.scenario.effects.stray
    assert found is not None
    assert found.where.region["frequency"] == pytest.approx(stray.frequency, rel=0.01)
    assert f"Hz voltage of {number(stray.amplitude)[:2]}" in found.description
    concealed, found = seen("telegraph", motor, 1)
    telegraph = concealed.scenario.effects.telegraph
    assert found is not None
    told = re.match(r"a voltage of ([\d.]+) V along .* of the stationary frame that comes and goes", found.description)
    assert told, found.description
    assert float(told[1]) == pytest.approx(telegraph.amplitude, rel=0.2)
    concealed, found = seen("resonance", motor, 1)
    branch = concealed.scenario.effects.resonance
    assert found is not None
    assert found.description.startswith("a resonance near")
    assert found.where.region["frequency"] == pytest.approx(1.0 / (TURN * math.sqrt(branch.L * branch.C)), rel=0.01)


@pytest.mark.parametrize("motor", ["beckhoff_am8141", "servo_4nm", "aalto_2k2"])
def test_a_small_resonance_is_told_from_an_iron_loss(motor: str) -> None:
    """Too small to ring aloud; an iron loss's current is in phase with the voltage, that of a branch leads it."""
    concealed, share, found = explained_by_a_branch("resonance", motor)
    true, T_s = concealed.scenario.effects.resonance, concealed.scenario.drive.T_s
    assert share > 1.0
    assert found.frequency / T_s == pytest.approx(1.0 / (TURN * math.sqrt(true.L * true.C)), rel=0.01)
    assert found.damping == pytest.approx(0.5 * true.R * math.sqrt(true.C / true.L), rel=0.1)
    assert explained_by_a_branch("iron_loss", motor)[1] < 0.85


def explained_by_a_branch(kind: str, motor: str) -> tuple[Concealed, float, Branch]:
    """A recording, the share of the energy over noise that a branch explains of it, and the branch."""
    concealed, rows, z, noise = left_in(kind, motor, 1, (0.0, 0.05))
    found = best_resonance(rows, z, noise)
    assert found is not None
    assert found[0].description.startswith("a resonance")
    before, after = (float(np.sum((x.real / noise[0]) ** 2 + (x.imag / noise[1]) ** 2)) for x in (z, found[1].left))
    return concealed, (before - after) / (before - 2.0 * np.count_nonzero(rows.joined)), found[1]
