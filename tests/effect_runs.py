"""Runs for the tests and pictures of the emulator's effects, and what their recordings say of voltage and flux linkage.

What is worked out here is worked out anew, from textbooks: nothing of the emulator's own equations is used.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emulator.effects import Effects
from emulator.machine import Machine
from emulator.motors import MOTORS
from emulator.physics.compliance import Compliance
from emulator.physics.dc_link import DcLink
from emulator.physics.demagnetisation import Demagnetisation
from emulator.physics.friction import Friction
from emulator.physics.harmonics import Harmonics
from emulator.physics.imbalance import Imbalance
from emulator.physics.iron_loss import IronLoss
from emulator.physics.legs import Inverter
from emulator.physics.saturation import Saturation
from emulator.physics.sensing import AngleSensing, CurrentSensing, VoltageSensing
from emulator.physics.skin import Skin
from emulator.physics.strangers import Resonance, Stray, Telegraph
from emulator.physics.thermal import Thermal
from emulator.physics.timing import Timing
from emulator.physics.turn_short import TurnShort
from emulator.plant import PlantState
from emulator.scenarios import PAPER, Excitation, Run, Scenario, drive_for
from emulator.virtual_drive import VirtualDrive

Column = NDArray[np.float64]
Vectors = NDArray[np.complex128]
Recording = dict[str, Column]

SALIENT = PAPER.motor
ROUND = MOTORS["servo_4nm"].machine  # L_d = L_q
T_S = 1e-4  # s

ALL = Effects(
    inverter=Inverter(dead_time=1.5e-6, min_pulse=1e-6, u_transistor=0.9, u_diode=0.7, r_on=0.02),
    dc_link=DcLink(C=1e-3, R=0.5, ripple=3.0),
    saturation=Saturation(L_d_drop=0.05, L_q_drop=0.15, cross_drop=0.05),
    harmonics=Harmonics(d_6=0.01, q_6=0.008, d_12=0.004, q_12=0.003, inductance=0.02, cogging=0.05),
    iron_loss=IronLoss(R_c=300.0, omega_h=200.0),
    thermal=Thermal(C_w=2.0, C_m=1.0, C_h=4.0),
    demagnetisation=Demagnetisation(share=0.05, time=0.02),
    imbalance=Imbalance(a=0.05, b=-0.02, c=0.01),
    turn_short=TurnShort(share=0.03, R_t=0.2, phase=1),
    skin=Skin(rise=0.2),
    friction=Friction(coulomb=0.05, static=0.08),
    compliance=Compliance(stiffness=500.0, damping=0.02),
    current_sensing=CurrentSensing(1.01, 0.99, 1.0, 0.03, -0.02, 0.01, 0.0, 1e-6, 2e-6),
    angle_sensing=AngleSensing(offset=0.01, once=0.005, twice=0.002),
    voltage_sensing=VoltageSensing(gain=1.01, offset=0.5),
    timing=Timing(delay=1, shift=-1, lost=0.02),
    stray=Stray(amplitude=2.0, frequency=130.0, along_beta=0.5),
    telegraph=Telegraph(amplitude=1.5, dwell=0.01, direction=0.7),
    resonance=Resonance(C=5e-6, L=1e-3, R=2.0),
)
"""All of them at once, but for a flux map, which has its own saturation."""


def with_effects(
    *,
    motor: Machine = SALIENT,
    i_dq: complex = 0j,
    step: float = 0.0,
    run: Run | None = None,
    drive: dict[str, Any] | None = None,
    **effects: Any,
) -> Scenario:
    """A drive with ideal sensors that holds a current (A), with pseudo-random steps (A) on top, at `run`."""
    ideal: dict[str, Any] = {"noise_i": 0.0, "adc_bits": 0, "T_s": T_S} | (drive or {})
    excitation = Excitation(float(i_dq.real), float(i_dq.imag), step, step)
    return Scenario("test.toml", motor, drive_for(motor, **ideal), run or Run(speed_rpm=0.0), excitation,
                    Effects(**effects))  # fmt: skip


def switched(scenario: Scenario) -> Scenario:
    """The same behind a bridge with edges, whose timer is ideal."""
    return replace(scenario, drive=replace(scenario.drive, bridge="switched", timer_counts=0))


def at(frequency: float, motor: Machine = SALIENT) -> Run:
    """A dynamometer that holds an electrical frequency (Hz)."""
    return Run(speed_rpm=60.0 * frequency / motor.n_p)


def free(frequency: float = 0.0, motor: Machine = SALIENT, tau_L: float = 0.0) -> Run:
    """A free shaft that starts at an electrical frequency (Hz)."""
    return Run(shaft="free", speed_rpm=60.0 * frequency / motor.n_p, tau_L=tau_L)


def steady(scenario: Scenario, settle: float, duration: float) -> Recording:
    """What is recorded over a duration (s) when the start (s) has passed."""
    drive = VirtualDrive(scenario)
    drive.run(round(settle / scenario.drive.T_s))
    return drive.record(round(duration / scenario.drive.T_s))


def states(drive: VirtualDrive, periods: int) -> list[PlantState]:
    """The plant's true state at every tick from now on, the one after `periods` with it."""
    seen = [drive.plant]
    for _ in range(periods):
        drive.run(1)
        seen.append(drive.plant)
    return seen


def vector(d: Column, q: Column) -> Vectors:
    return d + 1j * q


def currents(r: Recording) -> Vectors:
    """Rotor frame, A."""
    return vector(r["i_d"], r["i_q"])


def voltages(r: Recording) -> Vectors:
    """Rotor frame, V."""
    return vector(r["u_d"], r["u_q"])


def stationary_voltages(r: Recording) -> Vectors:
    """V; the recorded ones are in the rotor frame at the middle of their period."""
    return voltages(r) * np.exp(1j * (r["theta_e"] + 0.5 * r["omega_e"] * T_S_of(r)))


def line(x: Vectors | Column, angle: Column, order: float) -> complex:
    """Amplitude of exp(j order angle) in x; over whole turns of an angle that turns evenly."""
    return complex(np.mean(x * np.exp(-1j * order * angle)))


def flux_of(i: Vectors, motor: Machine) -> Vectors:
    """psi_dq (Vs) of the textbook's machine."""
    return vector(motor.L_d * i.real + motor.psi_f, motor.L_q * i.imag)


def voltage_error(r: Recording, motor: Machine) -> Vectors:
    """Recorded voltage less what the textbook's machine takes, all rows but the last; rotor frame, V.

    The balance of flux linkages over each period, of rows that are there without a gap.
    """
    half = np.exp(0.5j * r["omega_e"] * T_S_of(r))[:-1]
    i, u = currents(r), voltages(r)
    psi = flux_of(i, motor)
    mean = 0.5 * (i[1:] * half + i[:-1] / half)
    return u[:-1] - motor.R_s * mean - (psi[1:] * half - psi[:-1] / half) / T_S_of(r)


def T_S_of(r: Recording) -> float:
    """The control period (s) of a recording without gaps."""
    return float(r["t"][1] - r["t"][0])


def middle(r: Recording) -> Column:
    """Electrical angle (rad) in the middle of each period but the last, where `voltage_error` stands."""
    return (r["theta_e"] + 0.5 * r["omega_e"] * T_S_of(r))[:-1]


def flux_linkage(r: Recording, R_s: float) -> Vectors:
    """psi (Vs, stationary frame) from recorded voltages and currents, whole turns; what stands is taken out."""
    T_s = T_S_of(r)
    turn = np.exp(1j * (r["theta_e"] + 0.5 * r["omega_e"] * T_s))
    i = currents(r) * np.exp(1j * r["theta_e"])
    steps = T_s * (voltages(r)[:-1] * turn[:-1] - 0.5 * R_s * (i[1:] + i[:-1]))
    psi = np.concatenate([[0j], np.cumsum(steps)])
    return psi - np.mean(psi[:-1])  # the last row is the first of the next turn


def phases_of(x: complex) -> tuple[float, float, float]:
    """Phase values of a stationary vector."""
    a = np.exp(2j * math.pi / 3.0)
    return x.real, float((x * a**-1).real), float((x * a).real)
