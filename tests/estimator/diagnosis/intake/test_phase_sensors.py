"""Phase sensors: one that is turned or dead is read off the three columns, and nothing is said of sound ones."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from emulator.conceal.populations import STRANGERS
from estimator.diagnosis.diagnose import diagnose
from estimator.diagnosis.intake.phase_sensors import PHASES, sensor_fault, without_fault
from estimator.diagnosis.verdict import Verdict
from estimator.samples import Samples
from tests.estimator.diagnosis.convention_runs import Real, Runs, currents, recording, scaled, with_vectors

pytestmark = pytest.mark.thorough

NUMBERS = (1, 2, 3, 5, 8)
OTHERS = ("i_b and i_c", "i_a and i_c", "i_a and i_b")
Three = tuple[Real, Real, Real]


def phases_of(run: Samples) -> Three:
    assert run.i_a is not None
    assert run.i_b is not None
    assert run.i_c is not None
    return run.i_a, run.i_b, run.i_c


def in_rotor_frame(phases: Three, theta_e: Real) -> np.ndarray:
    """Amplitude-invariant, of three phases."""
    a, b, c = phases
    return ((2.0 * a - b - c) / 3.0 + 1j * (b - c) / np.sqrt(3.0)) * np.exp(-1j * theta_e)


def read(runs: Runs, sensors: Callable[[Three], Three], *, made_of: bool = True) -> Runs:
    """The recording by other sensors, of which the drive makes its i_d and i_q, or does not."""
    found: list[Samples] = []
    for run in runs:
        phases = sensors(phases_of(run))
        i = in_rotor_frame(phases, run.theta_e)
        made = with_vectors(run, i=i if made_of else currents(run))
        found.append(replace(made, i_a=phases[0], i_b=phases[1], i_c=phases[2]))
    return tuple(found)


def times(phase: int, factor: float, offset: float = 0.0) -> Callable[[Three], Three]:
    def sensors(phases: Three) -> Three:
        a, b, c = (factor * x + offset if k == phase else x for k, x in enumerate(phases))
        return a, b, c

    return sensors


def each(sensor: Callable[[Real], Real]) -> Callable[[Three], Three]:
    def sensors(phases: Three) -> Three:
        a, b, c = phases
        return sensor(a), sensor(b), sensor(c)

    return sensors


@pytest.mark.parametrize("phase", [0, 1, 2])
@pytest.mark.parametrize("made_of", [True, False])
def test_a_turned_sensor_is_told_and_undone(phase: int, *, made_of: bool) -> None:
    for number in NUMBERS:
        sound = read(recording("none", number)[0], lambda phases: phases)
        runs = read(sound, times(phase, -1.0, offset=0.02), made_of=made_of)
        fault = sensor_fault(runs)
        assert fault is not None, number
        name = PHASES[phase]
        assert fault.says.startswith(f"i_a + i_b + i_c is not zero: it is -2 {name}, with {name} = -(")
        assert fault.says.endswith(f": {name} has the wrong sign")
        assert (fault.factor, fault.made_of, fault.sure) == (-1.0, made_of, True)
        assert f"--map {PHASES[phase]}=COLUMN*-1" in fault.remedy()
        for run, right in zip(without_fault(runs, fault), sound, strict=True):
            np.testing.assert_allclose(currents(run), currents(right), atol=0.03)
            np.testing.assert_allclose(phases_of(run), phases_of(right), atol=0.03)
        assert sensor_fault(without_fault(runs, fault)) is None


@pytest.mark.parametrize("phase", [0, 1, 2])
@pytest.mark.parametrize("reads", [0.0, 0.1])
def test_a_dead_sensor_is_told_and_the_other_two_are_taken(phase: int, reads: float) -> None:
    for number in NUMBERS:
        sound = read(recording("none", number)[0], lambda phases: phases)
        runs = read(sound, times(phase, 0.0, offset=reads))
        fault = sensor_fault(runs)
        assert fault is not None, number
        value = "0.100 A" if reads else "0"
        assert fault.says == f"{PHASES[phase]} is {value} in all rows while {OTHERS[phase]} are not"
        assert (fault.factor, fault.made_of, fault.sure) == (0.0, True, True)
        assert fault.remedy().endswith(f"i_d and i_q are then made of {OTHERS[phase]}")
        for run, right in zip(without_fault(runs, fault), sound, strict=True):
            off = np.abs(currents(run) - currents(right))
            assert np.sqrt(np.mean(off**2)) < 0.02 * np.sqrt(np.mean(np.abs(currents(right)) ** 2))
            assert run.i_a is run.i_b is run.i_c is None


def test_the_noise_of_a_dead_sensor_is_not_a_current() -> None:
    runs = recording("none", 1)[0]
    noise = np.random.default_rng(1).standard_normal(sum(map(len, runs)))
    (fault,) = {sensor_fault(read(runs, lambda phases: (phases[0], 0.01 * noise[: len(phases[0])], phases[2])))}
    assert fault is not None
    assert fault.says.startswith("i_b stays between -0.0")
    assert fault.says.endswith("A in all rows while i_a and i_c, which it balances, do not")


@pytest.mark.parametrize("kind", ["none", "one", "two", "three", "current_gain", "current_offset", *STRANGERS])
def test_nothing_is_said_of_sound_sensors(kind: str) -> None:
    for number in range(1, 9):
        assert sensor_fault(recording(kind, number, seed=31, length=1.0)[0]) is None, (kind, number)


def test_offsets_gains_and_noise_are_no_fault() -> None:
    runs = recording("none", 2)[0]
    rms = float(np.sqrt(np.mean(np.abs(currents(runs[0])) ** 2)))
    chance = np.random.default_rng(1)
    sound: tuple[Callable[[Three], Three], ...] = (
        each(lambda x: x + 0.5 * rms), times(1, 1.0, offset=rms), times(0, 1.2), times(2, 0.9), each(lambda x: -x),
        lambda phases: (phases[1], phases[0], phases[2]),
        each(lambda x: x + 0.3 * rms * chance.standard_normal(len(x))),
        each(lambda x: 0.05 * rms * chance.standard_normal(len(x))), each(np.zeros_like),
    )  # fmt: skip
    for sensors in sound:
        assert sensor_fault(read(runs, sensors)) is None


def test_a_gain_beyond_what_sensors_differ_by_is_told_with_its_factor_and_not_undone() -> None:
    fault = sensor_fault(read(recording("none", 1)[0], times(1, 0.5)))
    assert fault is not None
    assert not fault.sure
    assert "i_b is 0.5 times -(i_a + i_c), expected once" in fault.says
    assert "i_d and i_q are made of it" in fault.remark()


def test_a_rotor_that_is_held_tells_nothing() -> None:
    (run, *_), _ = recording("none", 1)
    held = replace(run, theta_e=np.full(len(run), 0.3))
    i = run.i_d * np.exp(0.3j)
    phases = tuple((i * np.exp(-2j * np.pi * k / 3.0)).real for k in range(3))
    still = replace(held, i_a=phases[0], i_b=-phases[1], i_c=phases[2])
    assert sensor_fault([still]) is None
    assert sensor_fault([replace(run, i_b=None)]) is None
    assert sensor_fault([]) is None


@pytest.mark.parametrize(("phase", "factor"), [(1, -1.0), (0, 0.0)])
def test_the_verdict_names_the_sensor_and_is_of_the_recording_without_its_fault(phase: int, factor: float) -> None:
    runs, nominal = recording("none", 3, length=1.0)
    said = diagnose(read(runs, times(phase, factor)), nominal)
    assert said.verdict is Verdict.EXPLAINED
    assert [finding.effect for finding in said.findings] == ["convention_error"]
    assert said.findings[0].parameters[f"{PHASES[phase]}_scale"].value == factor
    assert ("i_b has the wrong sign" if factor else "i_a is 0 in all rows while i_b and i_c are not") in said.sentence
    assert any("i_d and i_q, which are made of it, are corrected" in remark for remark in said.remarks)


@pytest.mark.slow
def test_a_fault_that_i_d_and_i_q_are_not_made_of_is_a_remark() -> None:
    runs, nominal = recording("none", 3, length=1.0)
    said = diagnose(read(runs, times(1, -1.0), made_of=False), nominal)
    assert said.verdict is Verdict.NO_MISMATCH
    assert any("i_d and i_q are not made of it, and hold" in remark for remark in said.remarks)


@pytest.mark.slow
def test_a_sensor_is_told_beside_another_convention() -> None:
    """Two of three turned: one beside the others, and all of them."""
    runs, nominal = recording("none", 3, length=1.0)
    turned = read(runs, lambda phases: (-phases[0], -phases[1], phases[2]))
    said = diagnose(turned, nominal)
    assert said.verdict is Verdict.EXPLAINED
    assert "i_c has the wrong sign; the currents have the wrong sign" in said.sentence
    twice = tuple(scaled(u=2.0)(run, nominal)[0] for run in read(runs, times(2, -1.0)))
    said = diagnose(twice, nominal)
    assert "i_c has the wrong sign; the voltages are twice what they are" in said.sentence
