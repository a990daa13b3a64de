"""Emulated drives on shafts of all kinds, and what their shafts truly are."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.compliance import Compliance
from emulator.plant.physics.friction import Friction
from emulator.scenario.effects import Effects
from emulator.scenario.motors import MOTORS, Motor
from emulator.scenario.scenarios import PAPER, Excitation, Run, Scenario, drive_for
from estimator.machine import Machine
from estimator.mechanics.mechanics import Mechanics
from estimator.online.estimate import Estimate
from estimator.samples import Samples
from tests.support.samples import machine_of, streamed

COUNTS = (1000, 4096, 2**14, 2**17, 0)  # of a mechanical turn; 0: ideal
PAPER_MOTOR = Motor("the paper's", "", PAPER.motor, P_rated=540.0, speed_rpm=2400.0, u_dc=310.0, T_s=1e-4)
_BEGIN = 0.3  # s, until the speed swings


def shaft(
    motor: Motor = PAPER_MOTOR, *, J: float = 8e-4, B: float = 1e-3, T_C: float = 0.05, tau_L: float = 0.3,
    middle: float = 0.0, swing: float = 80.0, ramp: float = 400.0, hold: float = 0.1, counts: int = 4096,
    noise_i: float = 0.01, bandwidth: float = 60.0, i_d: float = 0.0, seed: int = 1,
) -> Scenario:
    """A free shaft whose speed swings around `middle` (rad/s, mechanical as all here) at a rate (rad/s2)."""
    machine = motor.machine._replace(J=J, B=B)
    n_p = machine.n_p
    run = Run(
        shaft="free", speed_rpm=middle * 30.0 / math.pi, speed_control=True, speed_reference="ramp",
        speed_bandwidth=bandwidth, tau_L=tau_L, seed=seed,
    )  # fmt: skip
    excitation = Excitation(
        i_d_ref=i_d, kind="none", speed_ref=n_p * middle, speed_step=n_p * swing, speed_ramp=n_p * ramp, speed_hold=hold
    )
    drive = drive_for(machine, motor.u_dc, T_s=motor.T_s, noise_i=noise_i, encoder_counts=counts)
    return Scenario(f"shaft {seed}", machine, drive, run, excitation, Effects(friction=Friction(coulomb=T_C)))


def drawn(seed: int) -> Scenario:
    """A shaft of any kind on any motor: J over two decades, 5 to 60 % of the rated torque to accelerate it."""
    r = np.random.default_rng(seed)
    motor = [PAPER_MOTOR, *MOTORS.values()][int(r.integers(1 + len(MOTORS)))]
    machine = motor.machine
    rated = 1.5 * machine.n_p * machine.psi_f * machine.i_rated
    J = machine.J * 10.0 ** (r.uniform(-1.0, 1.0) if motor is PAPER_MOTOR else r.uniform(0.0, 2.0))
    fastest = motor.speed_rpm * math.pi / 30.0 * r.uniform(0.1, 0.6)
    both = r.random() < 0.7
    swing = fastest if both else 0.4 * fastest
    time = np.clip(2.0 * swing * J / (rated * 10.0 ** r.uniform(math.log10(0.05), math.log10(0.6))), 0.05, 1.5)
    return shaft(
        motor, J=J, B=rated * 10.0 ** r.uniform(-3.0, -0.7) / fastest, T_C=rated * r.uniform(0.0, 0.1),
        tau_L=rated * r.uniform(-0.3, 0.3) if r.random() < 0.7 else 0.0, middle=0.0 if both else 0.6 * fastest,
        swing=swing, ramp=min(2.0 * swing / time, 0.8 * rated / J), hold=r.uniform(0.05, 0.3),
        counts=int(r.choice(COUNTS)), noise_i=machine.i_rated * 10.0 ** r.uniform(-3.5, -2.3),
        bandwidth=r.uniform(30.0, 100.0), i_d=-0.15 * machine.i_rated * float(r.choice((0.0, 1.0))), seed=seed,
    )  # fmt: skip


def on_dynamometer(
    scenario: Scenario, *, rpm: float = 600.0, swing_rpm: float = 0.0, i_q_step: float = 0.5
) -> Scenario:
    """The same motor held by a dynamometer, which may swing it, under steps of current."""
    i = scenario.motor.i_rated
    run = Run(speed_rpm=rpm, swing_rpm=swing_rpm, swing_frequency=1.0, seed=scenario.run.seed)
    return replace(scenario, run=run, excitation=Excitation(i_q_ref=0.3 * i, i_q_step=i_q_step * i))


def at_one_speed(scenario: Scenario, speed: float = 75.0) -> Scenario:
    """The same shaft at one speed, rad/s."""
    excitation = replace(scenario.excitation, speed_ref=scenario.motor.n_p * speed, speed_step=0.0)
    return replace(scenario, excitation=excitation)


def compliant(scenario: Scenario, J_L: float, f: float) -> Scenario:
    """The same motor with its load behind a shaft that gives way, of a resonance in Hz."""
    stiffness = (2.0 * math.pi * f) ** 2 / (1.0 / scenario.motor.J + 1.0 / J_L)
    damping = 0.06 * math.sqrt(stiffness / (1.0 / scenario.motor.J + 1.0 / J_L))
    effects = scenario.effects._replace(compliance=Compliance(stiffness, damping, J_L))
    return replace(scenario, effects=effects, run=replace(scenario.run, tau_L=0.0))


def rows_of(scenario: Scenario, seconds: float = 8.0) -> tuple[Samples, Machine]:
    """Stream rows of 1 ms, and the machine, known exactly."""
    drive = VirtualDrive(scenario)
    periods = int(drive.read("stream_periods"))
    drive.run(round(_BEGIN / drive.T_s))
    return streamed(drive, round(seconds / (periods * drive.T_s))), machine_of(scenario.motor)


def truth_of(scenario: Scenario) -> Mapping[str, float]:
    """What the shaft is; a compliant one's inertia is that of both ends."""
    compliance, T_C, tau_L = scenario.effects.compliance, scenario.effects.friction.coulomb, scenario.run.tau_L
    J = scenario.motor.J + (compliance.J_L if compliance.stiffness > 0.0 else 0.0)
    sums = {"tau_L + T_C": tau_L + T_C, "tau_L - T_C": tau_L - T_C}
    return {"J": J, "B": scenario.motor.B, "T_C": T_C, "tau_L": tau_L} | sums


def told(said: Mechanics) -> list[Estimate]:
    """Every estimate that has a value, the sum in place of its parts."""
    every = [*said.estimates.values(), *([] if said.sum is None else [said.sum])]
    return [e for e in every if e.value is not None]


def off_by(e: Estimate, scenario: Scenario) -> float:
    """An estimate's error in standard errors."""
    assert e.value is not None
    assert e.std is not None
    return (e.value - truth_of(scenario)[e.name]) / e.std


def rated_rpm(scenario: Scenario) -> float:
    """The motor's rated speed, rpm."""
    by_R_s = {motor.machine.R_s: motor.speed_rpm for motor in (PAPER_MOTOR, *MOTORS.values())}
    return by_R_s[scenario.motor.R_s]
