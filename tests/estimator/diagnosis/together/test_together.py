"""Several recordings of one emulated machine: what they share, what differs, doubts that one settles for another."""

from dataclasses import replace
from functools import cache

import pytest

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.machine import Machine as Plant
from emulator.plant.physics.angle_signal import AngleSignal
from emulator.plant.physics.legs import Inverter
from emulator.scenario.effects import NONE, Effects
from emulator.scenario.scenarios import PAPER, Excitation, Run, Scenario, drive_for
from estimator.diagnosis.diagnose import diagnose
from estimator.diagnosis.together.said import Kind, Together
from estimator.diagnosis.together.together import Named, diagnose_together
from estimator.diagnosis.verdict import Verdict
from estimator.machine import PARAMETERS, Machine
from estimator.samples import Samples
from tests.support.samples import machine_of

MOTOR = PAPER.motor
NOMINAL = machine_of(MOTOR._replace(R_s=1.0, L_d=4.1e-3, L_q=6.4e-3, psi_f=0.118))
DEAD_TIME = 6e-7  # s
ROWS = 12_000


@cache
def of_drive(
    effects: Effects = NONE, warmer: float = 0.0, rpm: float = 1200.0, swing: float = 600.0, step: float = 1.5,
    seed: int = 1, of: Plant = MOTOR,
) -> Samples:  # fmt: skip
    """A recording of the drive; `warmer`: share by which R_s is higher, four times that by which psi_f is lower."""
    motor = of._replace(R_s=of.R_s * (1.0 + warmer), psi_f=of.psi_f * (1.0 - 0.25 * warmer))
    drive = drive_for(of, noise_i=0.02, bridge="switched", encoder_counts=0)
    run = Run(speed_rpm=rpm, swing_rpm=swing, seed=seed)
    around = Excitation(i_q_ref=3.0, i_d_step=step, i_q_step=step)
    emulated = VirtualDrive(Scenario("one of several", motor, drive, run, around, effects))
    emulated.run(2000)
    r = emulated.record(ROWS)
    return Samples(
        r["theta_e"], r["omega_e"], r["i_d"], r["i_q"], r["u_d"], r["u_q"], emulated.T_s, u_dc=r["u_dc"],
        i_a=r["i_a"], i_b=r["i_b"], i_c=r["i_c"],
    )  # fmt: skip


OTHER = MOTOR._replace(R_s=0.5, L_d=1e-3, L_q=1e-3, psi_f=0.02)  # another motor


def together(**samples: Samples) -> Together:
    return diagnose_together([Named(name, [one]) for name, one in samples.items()], NOMINAL)


@pytest.mark.thorough
def test_states_differ_and_constants_are_one() -> None:
    said = together(cold=of_drive(), warm=of_drive(warmer=0.06, seed=2))
    assert said.verdict is Verdict.NO_MISMATCH
    assert not said.findings
    changes = {one.what: one for one in said.differences}
    assert changes.keys() == {"R_s", "psi_f"}
    for name, change in (("R_s", 0.06), ("psi_f", -0.015)):
        share = changes[name].share
        assert share is not None
        assert share.value is not None
        assert share.std is not None
        assert changes[name].kind is Kind.STATE
        assert changes[name].between == ("cold", "warm")
        assert abs(share.value - change) < 3.0 * share.std
    for name in ("L_d", "L_q"):
        joint = said.machine[name].joint
        assert said.machine[name].alike
        assert joint.value == pytest.approx(getattr(MOTOR, name), abs=3.0 * (joint.std or 0.0))


@pytest.mark.slow
def test_a_recording_of_another_motor_is_no_recording_of_this_one() -> None:
    said = together(this=of_drive(), other=of_drive(of=OTHER, seed=2))
    assert said.verdict not in (Verdict.NO_MISMATCH, Verdict.EXPLAINED)
    assert "f 2 recordings as one" not in said.sentence or "differ" in said.sentence


@pytest.mark.thorough
def test_an_effect_that_was_switched_on_is_told_as_that() -> None:
    said = together(off=of_drive(), on=of_drive(NONE._replace(inverter=Inverter(dead_time=DEAD_TIME)), seed=2))
    assert said.verdict is Verdict.EXPLAINED
    (found,) = said.findings
    assert (found.effect, found.named_by) == ("inverter_voltage_error", ("on",))
    off, on = found.parameters["dead_time"].each
    assert off is not None
    assert on is not None
    assert on.value == pytest.approx(DEAD_TIME, abs=3.0 * (on.std or 0.0))
    assert abs(off.value or 0.0) < 0.02 * DEAD_TIME
    assert [(one.what, one.parameter) for one in said.differences] == [("inverter_voltage_error", "dead_time")]
    assert "is there in on and not in off" in said.sentence
    assert found.equation_of == ("on",)
    assert found.equation[0] == pytest.approx(DEAD_TIME, rel=0.05)


@pytest.mark.thorough
def test_what_one_recording_tells_of_the_machine_is_there_for_all() -> None:
    """At one point the parameters are not told."""
    flat = of_drive(step=0.0, swing=0.0)
    assert diagnose([flat], NOMINAL).verdict is not Verdict.NO_MISMATCH
    said = together(flat=flat, rich=of_drive(seed=2))
    assert said.verdict is Verdict.NO_MISMATCH
    for name in PARAMETERS:
        joint, true = said.machine[name].joint, getattr(MOTOR, name)
        assert joint.value == pytest.approx(true, abs=4.0 * (joint.std or 0.0) + 3e-4 * true)


@pytest.mark.thorough
def test_a_doubt_of_each_recording_is_settled_by_both() -> None:
    """A latency of the angle is an offset of it at one speed: the same seconds at another speed, another angle."""
    late = NONE._replace(angle_signal=AngleSignal(latency=2e-4))
    slow, fast = (of_drive(late, rpm=rpm, swing=0.0, seed=seed) for rpm, seed in ((900.0, 1), (1800.0, 2)))
    for one in (slow, fast):
        assert {"angle_latency", "angle_offset"} in [set(doubt.effects) for doubt in diagnose([one], NOMINAL).ambiguous]
    said = together(slow=slow, fast=fast)
    assert said.verdict is Verdict.EXPLAINED
    (found,) = said.findings
    assert found.effect == "angle_latency"
    (told,) = found.parameters.values()
    assert told.alike
    assert told.joint.value == pytest.approx(2e-4, rel=0.02)
    assert found.equation_of == ("slow", "fast")
    assert found.equation == pytest.approx((told.joint.value,), rel=0.01)
    assert not said.ambiguous


@pytest.mark.thorough
def test_a_convention_is_told_of_the_recording_that_follows_it() -> None:
    other, as_expected = of_drive(), of_drive(seed=2)
    reversed_currents = {name: -getattr(other, name) for name in ("i_d", "i_q", "i_a", "i_b", "i_c")}
    said = together(other=replace(other, **reversed_currents), expected=as_expected)
    assert [(one.effect, one.named_by) for one in said.findings] == [("convention_error", ("other",))]
    assert said.verdict is Verdict.EXPLAINED
    assert not said.differences


def test_two_recordings_of_one_name_are_refused() -> None:
    one = Named("a", [])
    with pytest.raises(ValueError, match="each of its own name, got a, a"):
        diagnose_together([one, one], Machine(1.0, 1e-3, 1e-3, 0.1, 4))
    with pytest.raises(ValueError, match="two recordings or more"):
        diagnose_together([one], NOMINAL)
