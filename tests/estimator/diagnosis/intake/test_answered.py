"""Voltages that answer the noise of their own row's currents: told by their gain, and never taken for a machine."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.legs import Inverter
from emulator.plant.physics.timing import Timing
from emulator.scenario.effects import NONE
from emulator.scenario.scenarios import PAPER, Excitation, Run, Scenario, drive_for
from estimator.diagnosis.diagnose import diagnose
from estimator.diagnosis.intake.answered import answered, at_one_point
from estimator.diagnosis.intake.data_sheet import contradicted
from estimator.diagnosis.verdict import Diagnosis, Verdict
from estimator.machine import PARAMETERS, Machine
from estimator.samples import Samples
from tests.estimator.diagnosis.convention_runs import recording, some_soon
from tests.support.samples import machine_of, recorded

MOTOR = PAPER.motor
NOMINAL = machine_of(MOTOR._replace(R_s=1.0, L_d=4.1e-3, L_q=6.4e-3, psi_f=0.118))
T_S = 5e-5  # s
AT_ONCE, EARLY = Timing(delay=-1), Timing(shift=1)
"""A row holds the answer to its own current: applied over its period, or over the next one."""


@cache
def in_loop(
    timing: Timing, K: float, step: float = 0.0, rpm: float = 1200.0, i_q: float = 3.0, kind: str = "levels",
    dead_time: float = 0.0, speed_loop: bool = False, rows: int = 24_000,
) -> Samples:  # fmt: skip
    """A drive with current noise of 20 mA in closed loop by a gain of K (V/A), under a speed loop by 4096 counts."""
    gains = {"own_gains": 1.0, "k_p_d": K, "k_p_q": K, "k_i_d": 200.0 * K, "k_i_q": 200.0 * K}
    drive = drive_for(MOTOR, T_s=T_S, noise_i=0.02, bridge="switched" if dead_time else "averaged",
                      encoder_counts=4096 if speed_loop else 0)  # fmt: skip
    around = Excitation(i_q_ref=i_q, i_d_step=step, i_q_step=step, kind=kind if step else "none")
    effects = NONE._replace(timing=timing, inverter=Inverter(dead_time=dead_time))
    run = Run(speed_rpm=rpm)
    if speed_loop:
        run = replace(run, shaft="free", speed_control=True, tau_L=1.5)
    emulated = VirtualDrive(Scenario("loop", MOTOR, drive, run, around, effects, gains))
    emulated.run(20_000 if speed_loop else 2000)
    return recorded(emulated, rows)


def in_errors(said: Diagnosis, names: tuple[str, ...] = PARAMETERS) -> Mapping[str, float]:
    """How far parameters are from the true ones, in standard errors."""
    found: dict[str, float] = {}
    for name in names:
        value, std = said.machine_after[name].value, said.machine_after[name].std
        assert value is not None
        assert std
        found[name] = (value - getattr(MOTOR, name)) / std
    return found


@pytest.mark.parametrize("timing", [AT_ONCE, EARLY])
@pytest.mark.parametrize("K", [6.0, 65.0])
def test_the_gain_is_told_where_nothing_else_moves_and_beside_steps(timing: Timing, K: float) -> None:
    alone = answered([in_loop(timing, K)])
    assert alone is not None
    assert alone.alone
    assert alone.gain == pytest.approx((K, K), rel=1e-3)
    assert alone.noise == pytest.approx((0.0167, 0.0167), rel=0.1)  # two thirds of three phases' power
    beside = answered([in_loop(timing, K, step=0.2)])
    assert beside is not None
    assert not beside.alone
    assert beside.gain == pytest.approx((K, K), rel=0.05)


@pytest.mark.parametrize("timing", [Timing(), Timing(shift=-1)])
@pytest.mark.parametrize("step", [0.0, 0.3])
def test_a_drive_that_records_what_it_applies_answers_earlier_rows(timing: Timing, step: float) -> None:
    assert answered([in_loop(timing, 65.0, step)]) is None


@pytest.mark.parametrize("kind", some_soon(("none", "dead_time", "saturation_q", "iron_loss", "skin", "voltage_late")))
def test_concealed_recordings_do_not_answer(kind: str) -> None:
    for number in range(4):
        runs, _ = recording(kind, number)
        assert answered(runs) is None


def test_without_a_controller_nothing_is_answered() -> None:
    """Voltages by chance, held for some periods, and a machine at rest."""
    rng, n = np.random.default_rng(3), 20_000
    u = np.repeat(rng.normal(0.0, 5.0, (2, n // 10)), 10, axis=1)
    L, i = np.array([MOTOR.L_d, MOTOR.L_q]), np.zeros((2, n))
    for k in range(n - 1):
        i[:, k + 1] = i[:, k] + T_S / L * (u[:, k] - MOTOR.R_s * i[:, k])
    i += rng.normal(0.0, 0.02, i.shape)
    assert answered([Samples(np.zeros(n), np.zeros(n), i[0], i[1], u[0], u[1], T_S)]) is None


@pytest.mark.parametrize("timing", [AT_ONCE, EARLY])
def test_a_speed_loop_by_a_coarse_encoder_moves_less_than_the_noise(timing: Timing) -> None:
    found = answered([there := in_loop(timing, 65.0, rpm=900.0, speed_loop=True)])
    assert found is not None
    assert found.alone
    assert at_one_point([there], 6.0)


@pytest.mark.parametrize("kind", ["levels", "multisine"])
@pytest.mark.parametrize("K", [6.0, 65.0])
def test_currents_that_move_by_three_times_their_noise_are_more_than_an_answer(K: float, kind: str) -> None:
    for timing in (AT_ONCE, EARLY):
        found = answered([in_loop(timing, K, 0.1, kind=kind)])
        assert found is not None
        assert found.whole < 0.0


def test_a_point_is_one_speed_and_one_level_of_a_rotor_that_turns() -> None:
    one, faster, more = in_loop(EARLY, 65.0), in_loop(EARLY, 65.0, rpm=1500.0), in_loop(EARLY, 65.0, i_q=2.0)
    assert at_one_point([one], 6.0)
    assert not at_one_point([one, faster], 6.0)
    assert not at_one_point([one, more], 6.0)
    assert not at_one_point([in_loop(EARLY, 65.0, rpm=0.0)], 6.0)  # where a level tells R_s


@pytest.mark.parametrize("timing", [AT_ONCE, EARLY])
def test_at_one_point_it_is_not_enough_excitation_and_the_gain_is_said(timing: Timing) -> None:
    said = diagnose([in_loop(timing, 65.0)], NOMINAL)
    assert said.verdict is Verdict.NOT_ENOUGH_EXCITATION
    assert "the recorded voltage answers the same row's current noise with 65.0 V/A" in said.sentence
    assert "the controller's own voltage" in said.sentence
    assert said.experiment is not None
    assert said.experiment.holds
    assert not said.findings
    assert not said.ambiguous


@pytest.mark.parametrize(("step", "kind"), [(0.15, "levels"), (0.3, "levels"), (0.3, "multisine")])
def test_beside_excitation_the_machine_is_told_and_nothing_else(step: float, kind: str) -> None:
    """By the currents as they are, a resistance that rises with frequency explains what is noise of both."""
    said = diagnose([in_loop(AT_ONCE, 65.0, step, kind=kind)], NOMINAL)
    assert said.verdict is Verdict.NO_MISMATCH
    assert max(map(abs, in_errors(said).values())) < 4.0
    assert said.machine_after["L_d"].value == pytest.approx(MOTOR.L_d, rel=0.05)


def test_a_voltage_that_acts_a_row_later_is_told_beside_steps() -> None:
    said = diagnose([in_loop(EARLY, 65.0, 0.3)], NOMINAL)
    assert [finding.effect for finding in said.findings] == ["voltage_delay"]
    assert max(map(abs, in_errors(said).values())) < 4.0


def test_some_points_in_one_file_are_one_drive_that_tells_what_levels_tell() -> None:
    points = [in_loop(AT_ONCE, 65.0, rpm=rpm, i_q=i_q) for rpm in (600.0, 1500.0) for i_q in (1.0, 3.0)]
    said = diagnose([replace(point[:8000], t0=float(n)) for n, point in enumerate(points)], NOMINAL)
    assert said.verdict is Verdict.NOT_ENOUGH_EXCITATION
    assert not said.ambiguous
    assert max(map(abs, in_errors(said, ("R_s", "L_q", "psi_f")).values())) < 4.0


def test_a_resistance_below_zero_is_not_held_against_the_data_sheet() -> None:
    """A quick loop at one point, dead time besides: R_s as fitted is its gain, and psi_f follows."""
    assert contradicted([in_loop(Timing(), 65.0, dead_time=8e-7)], NOMINAL) is None
    weak = Machine(NOMINAL.R_s, NOMINAL.L_d, NOMINAL.L_q, 0.03, NOMINAL.n_p, NOMINAL.i_rated)
    assert contradicted([in_loop(Timing(), 6.0, 0.5)], weak) is not None
