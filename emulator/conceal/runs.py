"""Runs: motor, drive, shaft, excitation and surroundings of a recording, drawn without knowledge of its class.

Most runs tell much: several speeds, both directions of current, steps on both axes. Some tell less, as in the field:
one speed, one level, small steps. The machine differs from its data sheet as data sheets allow.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from emulator.conceal.chance import Chance
from emulator.conceal.population import Sections
from emulator.plant.inverter import longest
from emulator.plant.machine import Machine
from emulator.scenario.motors import MOTORS, TOLERANCE
from emulator.scenario.scenarios import Drive, Excitation, Run, drive_for

_RPM: Final = 2.0 * math.pi / 60.0  # rad/s
_REACH: Final = 0.75  # of the voltage there is, that a run's corners may take in a machine without effects
_TRIP: Final = 180.0  # degC, insulation class H
_U_DC: Final = 0.05  # by which the dc link may differ from its nominal voltage


@dataclass(frozen=True, slots=True)
class Drawn:
    """A run, all but the class."""

    motor: str  # name in the catalogue
    machine: Machine  # the true one, with the load's inertia where it carries one
    drive: Drive
    run: Run
    excitation: Excitation
    surroundings: Sections  # effects that bend no relation of voltages, currents and angle

    @property
    def omega_e(self) -> float:
        """Rated speed, rad/s, electrical."""
        return MOTORS[self.motor].speed_rpm * _RPM * self.machine.n_p


def drawn_run(chance: Chance, motors: Sequence[str], length: float) -> Drawn:
    """A run of so many seconds with one of these motors."""
    name = chance.one_of(motors)
    machine = _machine(chance, MOTORS[name].machine)
    drive = _drive(chance, name)
    free = chance.happens(0.35)
    excitation = _excitation(chance, machine.i_rated, length)
    surroundings = _surroundings(chance, name, drive.u_dc)
    if not free:
        run = _speeds(chance, _fastest(machine, excitation, drive, name), length)
        return Drawn(name, machine, drive, replace(run, seed=chance.seed()), excitation, surroundings)

    # A free shaft, under speed control: its loop sets i_q, the steps come on top
    machine = machine._replace(J=machine.J * chance.uniform(1.0, 4.0))
    tau_rated = 1.5 * machine.n_p * machine.psi_f * machine.i_rated
    load = chance.uniform(-0.4, 0.4)
    excitation = _turning_right(machine, excitation)
    fastest = _fastest(machine, replace(excitation, i_q_ref=load * machine.i_rated), drive, name)
    jerk = 0.1 * fastest * machine.J / (1.5 * machine.n_p * machine.psi_f * excitation.step_time)
    excitation = replace(excitation, i_q_ref=0.0, i_q_step=min(excitation.i_q_step, jerk))
    run = _within(_speeds(chance, fastest, length), 0.3 * tau_rated / machine.J)
    run = replace(
        run, shaft="free", speed_control=True, speed_bandwidth=chance.log_uniform(20.0, 60.0),
        tau_L=load * tau_rated, seed=chance.seed(),
    )  # fmt: skip
    return Drawn(name, machine, drive, run, excitation, surroundings | _shaft(chance, machine, tau_rated))


def _machine(chance: Chance, nominal: Machine) -> Machine:
    """One out of a series: each parameter within the data sheet's tolerance."""
    off = {key: chance.uniform(1.0 - TOLERANCE, 1.0 + TOLERANCE) for key in ("R_s", "L_d", "L_q", "psi_f", "J")}
    return nominal._replace(**{key: getattr(nominal, key) * factor for key, factor in off.items()})


def _drive(chance: Chance, name: str) -> Drive:
    """Full scales suit the data sheet: told in a recording, they must not tell of the machine."""
    motor = MOTORS[name]
    suited = drive_for(motor.machine, motor.u_dc, T_s=motor.T_s, bridge="switched")
    return replace(
        suited,
        u_dc=motor.u_dc * chance.uniform(1.0 - _U_DC, 1.0 + _U_DC),
        noise_i=motor.machine.i_rated * chance.log_uniform(3e-4, 3e-3),
        adc_bits=chance.one_of((12, 12, 14, 16)),
        encoder_counts=chance.one_of((10_000, 16_384, 131_072, 1_048_576)),
        timer_counts=chance.one_of((2_500, 5_000, 10_000)),
        temperature_trip=_TRIP,
        overvoltage_trip=1.25 * motor.u_dc,
    )


def _excitation(chance: Chance, i_rated: float, length: float) -> Excitation:
    """Both axes are excited in most runs; in the others a little, or one alone."""
    kind = chance.one_of(("rich",) * 7 + ("small", "d alone", "q alone"))
    sequence = chance.one_of(("levels",) * 5 + ("prbs", "multisine", "multisine", "staircase", "staircase"))
    i_d_ref, i_d_step = chance.uniform(-0.35, 0.1), chance.uniform(0.2, 0.5)
    i_q_ref, i_q_step = chance.uniform(-0.3, 0.3), chance.uniform(0.3, 0.75)
    small = chance.uniform(0.05, 0.2)
    level = chance.sign() * chance.uniform(0.2, 0.8)
    if kind == "small":
        i_d_step, i_q_step, i_q_ref = small * i_d_step, small * i_q_step, level
    elif kind == "d alone":
        i_q_step, i_q_ref = 0.0, level
    elif kind == "q alone":
        i_d_step = 0.0
    return Excitation(
        i_rated * i_d_ref, i_rated * i_q_ref, i_rated * i_d_step, i_rated * i_q_step, chance.log_uniform(2e-3, 0.03),
        kind=sequence, sine_frequency=chance.log_uniform(2.0, 15.0), level_time=chance.uniform(0.02, 0.06) * length,
    )  # fmt: skip


def _turning_right(machine: Machine, excitation: Excitation) -> Excitation:
    """The excitation with i_d so low that reluctance leaves enough of the magnets' torque for a speed loop."""
    if machine.L_q <= machine.L_d:
        return excitation
    highest = 0.5 * machine.psi_f / (machine.L_q - machine.L_d)
    return replace(excitation, i_d_ref=min(excitation.i_d_ref, highest - excitation.i_d_step))


def _fastest(machine: Machine, excitation: Excitation, drive: Drive, name: str) -> float:
    """Speed (rad/s, mechanical) up to which the voltage suffices for these currents with some to spare."""
    i_d = abs(excitation.i_d_ref) + excitation.i_d_step
    i_q = abs(excitation.i_q_ref) + excitation.i_q_step
    u = _REACH * longest(drive.u_dc)
    # |(R i_d + omega x, R i_q + omega y)| = u
    x, y = machine.L_q * i_q, machine.L_d * i_d + machine.psi_f
    a, b, c = x * x + y * y, machine.R_s * (i_d * x + i_q * y), (machine.R_s * math.hypot(i_d, i_q)) ** 2 - u * u
    omega_e = (-b + math.sqrt(b * b - a * c)) / a
    return min(omega_e, 0.5 / drive.T_s, MOTORS[name].speed_rpm * _RPM * machine.n_p) / machine.n_p


def _speeds(chance: Chance, fastest: float, length: float) -> Run:
    """A ramp through many speeds, a slow swing, or a speed that stays."""
    kind = chance.one_of(("ramp",) * 9 + ("swing",) * 6 + ("ripple",) * 3 + ("steady",) * 2)
    turns, share = chance.sign() / _RPM * fastest, chance.uniform(0.0, 1.0)
    if kind == "ramp":
        start, end = -0.8 + 1.2 * share, chance.uniform(0.5, 1.0)
        return Run(
            speed_rpm=turns * start, rise_rpm=turns * (end - start), ramp_time=length * chance.uniform(0.6, 1.0)
        )
    if kind == "swing":
        mean = 0.1 + 0.4 * share
        swing = abs(turns) * chance.uniform(0.3, 1.0 - mean)
        return Run(speed_rpm=turns * mean, swing_rpm=swing, swing_frequency=chance.uniform(1.0, 4.0) / length)
    mean = 0.15 + 0.7 * share
    swing, frequency = chance.uniform(0.02, 0.15), chance.uniform(1.0, 5.0)
    if kind == "ripple":
        return Run(speed_rpm=turns * mean, swing_rpm=abs(turns) * swing, swing_frequency=frequency)
    return Run(speed_rpm=turns * mean)


def _within(run: Run, most: float) -> Run:
    """The run with no acceleration beyond one (rad/s2, mechanical)."""
    rise = abs(run.rise_rpm) * _RPM / run.ramp_time if run.ramp_time > 0.0 else 0.0
    swing = run.swing_rpm * _RPM * 2.0 * math.pi * run.swing_frequency
    return replace(
        run,
        rise_rpm=run.rise_rpm * min(1.0, most / max(rise, 1e-9)),
        swing_rpm=run.swing_rpm * min(1.0, most / max(swing, 1e-9)),
    )


def _surroundings(chance: Chance, name: str, u_dc: float) -> Sections:
    """A dc link that sags in half of the runs, rows that are lost in a fifth."""
    sags, loses = chance.happens(0.5), chance.happens(0.2)
    R = chance.log_uniform(0.002, 0.03) * u_dc**2 / MOTORS[name].P_rated
    link: Sections = {"dc_link": {"R": R, "C": chance.log_uniform(5e-3, 5e-2) / R}}
    lost: Sections = {"timing": {"lost": chance.log_uniform(1e-4, 3e-3)}}
    return (link if sags else {}) | (lost if loses else {})


def _shaft(chance: Chance, machine: Machine, tau_rated: float) -> Sections:
    """Friction, and in some runs a compliant shaft and cogging."""
    coulomb = tau_rated * chance.log_uniform(0.003, 0.05)
    sections: Sections = {"friction": {"coulomb": coulomb, "static": coulomb * chance.uniform(1.0, 1.5)}}
    J_L = machine.J * chance.log_uniform(0.3, 3.0)
    omega = 2.0 * math.pi * chance.log_uniform(40.0, 200.0)
    stiffness = omega**2 / (1.0 / machine.J + 1.0 / J_L)
    damping = 2.0 * chance.uniform(0.03, 0.1) * stiffness / omega
    if chance.happens(0.3):
        sections["compliance"] = {"stiffness": stiffness, "damping": damping, "J_L": J_L}
    cogging = tau_rated * chance.log_uniform(0.003, 0.03)
    if chance.happens(0.3):
        sections["harmonics"] = {"cogging": cogging}
    return sections
