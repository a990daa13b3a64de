"""Runs for the tests and pictures of the emulator's effects, and what their recordings say of voltage and flux linkage.

What is worked out here is worked out anew, from textbooks: nothing of the emulator's own equations is used.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.dynamics import PlantState
from emulator.plant.machine import Machine
from emulator.scenario.effects import Effects
from emulator.scenario.motors import MOTORS
from emulator.scenario.scenarios import PAPER, Excitation, Run, Scenario, drive_for

Column = NDArray[np.floating[Any]]
Vectors = NDArray[np.complexfloating[Any, Any]]
Recording = Mapping[str, Column]

SALIENT = PAPER.motor
ROUND = MOTORS["servo_4nm"].machine  # L_d = L_q
T_S = 1e-4  # s


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
    """A scenario's drive behind a bridge with edges, whose timer is ideal."""
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
    psi: Vectors = np.concatenate([np.zeros(1, complex), np.cumsum(steps)])
    return psi - np.mean(psi[:-1])  # the last row is the first of the next turn


def phases_of(x: complex) -> tuple[float, float, float]:
    """Phase values of a stationary vector."""
    a = np.exp(2j * math.pi / 3.0)
    return x.real, float((x * a**-1).real), float((x * a).real)
