"""Pictures of what lies between the drive's command and the motor's terminals: inverter, dc link, strangers."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.compensation import BY_COMMAND, Compensation
from emulator.plant.physics.dc_link import DcLink
from emulator.plant.physics.legs import Inverter
from emulator.plant.physics.strangers import Resonance, Stray, Telegraph
from tests.emulator.plant.physics.effect_runs import (
    ROUND,
    T_S,
    Column,
    Recording,
    Vectors,
    at,
    middle,
    steady,
    switched,
    voltage_error,
    with_effects,
)
from tests.gallery.picture import IDEAL, A, B, D, Picture, Q, bars, degrees, dq, label, ms
from tests.gallery.within import coming_period

_LEGS = Inverter(dead_time=2.5e-6, u_transistor=1.2, u_diode=1.0, r_on=0.05)


def _inverter(panels: Sequence[Axes]) -> None:
    ideal, real = (
        steady(switched(with_effects(motor=ROUND, i_dq=8j, run=at(20.0), inverter=inverter)), 0.2, 0.0501)
        for inverter in (Inverter(), _LEGS)
    )
    x = degrees(ideal)[:-1]
    dq(panels[0], x, voltage_error(ideal, ROUND), voltage_error(real, ROUND), "error of u")
    panels[0].set(xlim=(0.0, 360.0), xticks=range(0, 361, 60), ylim=(-8.0, 18.0))
    label(panels[0], "Voltage that gets lost on the way", "electrical angle in degrees", "V, rotor frame",
          legend="upper right")  # fmt: skip
    bars(panels[1], voltage_error(ideal, ROUND), voltage_error(real, ROUND), middle(ideal), 19, "V")
    panels[1].set_xticks(range(-18, 19, 6))
    panels[1].legend(loc="upper left")
    panels[2].set_ylim(-0.95, 0.7)
    near = panels[2].inset_axes((0.56, 0.09, 0.42, 0.27), xlim=(0.77, 0.785), ylim=(-0.03, 0.03))
    near.set(xticks=(0.77, 0.775, 0.78), title="one of its edges")
    for dead_time, colour, name in ((0.0, IDEAL, "ideal"), (3e-6, A, "dead time 3 us")):
        t, i_a = _around_zero(dead_time)
        for axes in (panels[2], near):
            axes.plot(1e3 * t, i_a, color=colour, label=name)
            axes.axhline(0.0, color="black", lw=0.6)
    label(panels[2], "Zero crossing of phase a, between edges too", "time in ms", "i_a in A")


def _around_zero(dead_time: float) -> tuple[Column, Column]:
    """Time (s) and current (A) of phase a for some periods about its zero crossing."""
    drive = VirtualDrive(switched(with_effects(motor=ROUND, i_dq=2j, run=at(20.0), inverter=Inverter(dead_time))))
    drive.run(2000 + 235)
    t: list[Column] = []
    i: list[Column] = []
    for n in range(36):
        t_n, i_n = coming_period(drive)
        t.append(t_n + n * T_S)
        i.append(i_n)
        drive.run(1)
    return np.concatenate(t), np.concatenate(i)


def _compensation(panels: Sequence[Axes]) -> None:
    dead = Inverter(dead_time=2.5e-6)

    def turning(compensation: Compensation, i_dq: complex, noise: float = 0.0) -> Recording:
        scenario = with_effects(
            motor=ROUND, i_dq=i_dq, run=at(20.0), drive={"noise_i": noise}, inverter=dead, compensation=compensation
        )
        return steady(switched(scenario), 0.2, 0.0501)

    for name, share, colour in (("none", 0.0, IDEAL), ("half", 0.5, D), ("1.8 times", 1.8, Q)):
        r = turning(Compensation(share * dead.dead_time), 8j)
        panels[0].plot(degrees(r)[:-1], voltage_error(r, ROUND).imag, color=colour, label=f"compensated: {name}")
    panels[0].set(xlim=(0.0, 360.0), xticks=range(0, 361, 60))
    label(panels[0], "Voltage that gets lost, or is too much", "electrical angle in degrees", "error of u_q in V")
    for name, by, colour in (("the sample", 0, A), ("the command", BY_COMMAND, IDEAL)):
        r = turning(Compensation(1.2 * dead.dead_time, by=by), 1j, 0.05)
        error = voltage_error(r, ROUND) * np.exp(1j * middle(r))
        panels[1].plot(degrees(r)[:-1], error.real, color=colour, lw=0.8, label=f"by the sign of {name}")
    panels[1].set(xlim=(0.0, 360.0), xticks=range(0, 361, 60))
    label(panels[1], "The same at 1 A with noise of 50 mA", "electrical angle in degrees", "error of u_alpha in V")
    levels = np.linspace(0.5, 8.0, 7)
    for name, width, colour in (("sign", 0.0, A), ("zone of 2 A", 2.0, B)):
        runs = [turning(Compensation(1.8 * dead.dead_time, width), 1j * float(x)) for x in levels]
        means = [voltage_error(r, ROUND).mean().imag for r in runs]
        panels[2].plot(levels, means, "o-", ms=3, color=colour, label=name)
    label(panels[2], "Mean of u_q's error, compensated 1.8 times", "current in A", "V")


def _dc_link(panels: Sequence[Axes]) -> None:
    records: list[Recording] = []
    for link in (DcLink(), DcLink(C=3e-4, R=2.0, ripple=8.0, frequency=300.0)):
        drive = VirtualDrive(switched(with_effects(motor=ROUND, run=at(150.0), dc_link=link)))
        drive.run(500)
        before = drive.record(200)
        drive.write("i_q_ref", 10.0)
        after = drive.record(400)
        records.append({name: np.concatenate([before[name], after[name]]) for name in before})
    for r, colour, name in zip(records, (IDEAL, Q), ("stiff", "behind 2 ohm, with 300 Hz"), strict=True):
        panels[0].plot(ms(r), r["u_dc"], color=colour, label=name)
        panels[2].plot(ms(r), r["i_q"], color=colour, label=name)
        spectrum = np.abs(np.fft.rfft((r["u_dc"] - r["u_dc"][300:].mean())[300:])) * 2.0 / 300.0
        panels[1].plot(np.fft.rfftfreq(300, T_S), spectrum, color=colour, label=name)
    panels[1].set_xlim(0.0, 1000.0)
    label(panels[0], "dc link as the torque comes", "time in ms", "u_dc in V")
    label(panels[1], "Its spectrum under load", "frequency in Hz", "amplitude in V")
    label(panels[2], "The torque's current", "time in ms", "i_q in A")


def _unexplained(duration: float, **effects: Any) -> tuple[Column, Vectors]:
    """Time (s) and voltage (V) in the stationary frame that the drive did not give."""
    r = steady(with_effects(motor=ROUND, i_dq=3j, run=at(40.0), **effects), 0.1, duration)
    return r["t"][:-1] - r["t"][0], -voltage_error(r, ROUND) * np.exp(1j * middle(r))


def _stray(panels: Sequence[Axes]) -> None:
    stray = Stray(amplitude=3.0, frequency=130.0, along_alpha=0.9, along_beta=0.4)
    t, plain = _unexplained(0.5001)
    _, u = _unexplained(0.5001, stray=stray)
    short = t < 0.05
    panels[0].plot(1e3 * t[short], plain.real[short], color=IDEAL, label="ideal")
    panels[0].plot(1e3 * t[short], u.real[short], color=A, label="alpha")
    panels[0].plot(1e3 * t[short], u.imag[short], color=B, label="beta")
    panels[0].set_ylim(-3.2, 4.8)
    label(panels[0], "Voltage that nobody gave", "time in ms", "V, stationary frame", legend="upper right")
    turned = np.exp(-2j * np.pi * 40.0 * t)
    for axes, y, frame in ((panels[1], u, "stationary"), (panels[2], u * turned, "rotor")):
        f = np.fft.fftshift(np.fft.fftfreq(len(y), T_S))
        axes.plot(f, np.abs(np.fft.fftshift(np.fft.fft(y))) / len(y), color=Q)
        axes.set(xlim=(-250.0, 250.0), ylim=(0.0, None))
        label(axes, f"Spectrum in the {frame} frame, turning at 40 Hz", "frequency in Hz", "amplitude in V")


def _telegraph(panels: Sequence[Axes]) -> None:
    telegraph = Telegraph(amplitude=2.0, dwell=0.02, direction=0.6)
    t, u = _unexplained(20.0, telegraph=telegraph)
    _, plain = _unexplained(0.4)
    short = slice(0, 4000)
    panels[0].plot(t[short], u.real[short], color=A, label="alpha")
    panels[0].plot(t[short], u.imag[short], color=B, label="beta")
    panels[0].plot(t[: len(plain)], plain.real, color=IDEAL, label="ideal")
    panels[0].set_ylim(-0.2, 2.6)
    label(panels[0], "Voltage that nobody gave", "time in s", "V, stationary frame", legend="upper right")
    there = np.flatnonzero(np.diff((np.abs(u) > 1.0).astype(int)))
    dwells = np.diff(there) * T_S * 1e3
    panels[1].hist(dwells, bins=[5.0 * n for n in range(25)], color=A, label=f"{len(dwells)} dwells")
    mean = telegraph.dwell * 1e3
    edges = np.arange(0.0, 120.0, 5.0)
    expected = len(dwells) * (np.exp(-edges / mean) - np.exp(-(edges + 5.0) / mean))
    panels[1].plot(edges + 2.5, expected, color="black", ls="--", label="exponential, mean 20 ms")
    label(panels[1], "How long it stays", "dwell in ms", "number")
    for_rotor = u[:2000] * np.exp(-2j * np.pi * 40.0 * t[:2000])
    dq(panels[2], 1e3 * t[:2000], np.zeros(2000, complex), for_rotor, "error of u")
    panels[2].set_ylim(-2.4, 3.6)
    label(panels[2], "For the rotor, at 40 Hz, it turns", "time in ms", "V, rotor frame", legend="upper right")


def _resonance(panels: Sequence[Axes]) -> None:
    branch = Resonance(C=2e-5, L=2e-3, R=1.0)
    records: list[Recording] = []
    for given in (Resonance(), branch):
        drive = VirtualDrive(with_effects(motor=ROUND, run=at(10.0), resonance=given))
        drive.run(2000)
        before = drive.record(50)
        drive.write("i_d_ref", 5.0)
        after = drive.record(950)
        records.append({name: np.concatenate([before[name], after[name]]) for name in before})
    for r, colour, name in zip(records, (IDEAL, D), ("ideal", "with L and C"), strict=True):
        panels[0].plot(ms(r)[:250], r["i_d"][:250], color=colour, label=name)
        panels[1].plot(ms(r)[:250], r["u_d"][:250], color=colour, label=name)
        admittance = np.abs(np.fft.rfft(np.diff(r["i_d"])) / np.fft.rfft(np.diff(r["u_d"])))
        panels[2].semilogy(np.fft.rfftfreq(len(r["t"]) - 1, T_S), admittance, color=colour, label=name)
    panels[2].axvline(1.0 / (2.0 * np.pi * np.sqrt(branch.L * branch.C)), color="black", ls=":", lw=1.0)
    panels[2].set(xlim=(0.0, 2000.0), ylim=(0.02, 10.0))
    label(panels[0], "Current of the bridge at a step", "time in ms", "i_d in A")
    label(panels[1], "Voltage of the control", "time in ms", "u_d in V")
    label(panels[2], "Current over voltage; dotted: 1 / (2 pi sqrt(L C))", "frequency in Hz", "A/V")


PICTURES: Final = {
    "inverter": Picture(
        "Inverter",
        "Steps of the lost voltage at every zero crossing of a phase current, six per turn; in the spectrum 6, 12, 18 "
        "with amplitudes like 1/5, 1/7, 1/11 of what stands still. A current that reaches zero in a dead time "
        "stays there until the next switch is on: flat pieces on the zero line, and a crossing that takes long.",
        "The part that stands still looks like R_s at one level of current: the error keeps its size while the "
        "current changes, a resistance's does not. Flux harmonics are at the same orders, but grow with speed.",
        _inverter,
    ),
    "compensation": Picture(
        "Dead-time compensation",
        "Compensated by half, half of the loss is left; by 1.8 times, what is too much has the other sign. Near zero "
        "the sign of a sample jumps with its noise, and the voltage with it.",
        "By the command's sign, or in a wide zone, only what is added less what is lost shows, as an inverter's loss "
        "of either sign; at one level of current as R_s.",
        _compensation,
    ),
    "dc_link": Picture(
        "dc link",
        "The link falls by R i_dc when power is drawn, and carries the rectifier's 300 Hz. The drive measures it "
        "and makes up for it: the current stays clean as long as there is voltage to spare.",
        "A wrong gain of the voltage's reading loses voltage in proportion too, but does not move with load and time.",
        _dc_link,
    ),
    "stray": Picture(
        "Stranger: stray voltage",
        "A line of free frequency along one direction of the stationary frame: at plus and minus 130 Hz there, at 90 "
        "and -170 Hz for the rotor, which turns at 40 Hz. It stays where it is when the speed changes.",
        "Any harmonic, if one looks at one speed only: a harmonic moves with speed, this does not.",
        _stray,
    ),
    "telegraph": Picture(
        "Stranger: telegraph offset",
        "A voltage that jumps between two values by chance, fixed to the stationary frame; times of stay spread "
        "exponentially.",
        "On average it is a dc offset of half its size, as a drifting sensor or inverter makes; the jumps tell.",
        _telegraph,
    ),
    "resonance": Picture(
        "Stranger: resonant branch at the terminals",
        "Every voltage step rings in the bridge's current at 1/(2 pi sqrt(L C)), whatever the speed; the motor's "
        "own current knows little of it.",
        "A control loop that is set too fast rings as well, but at a frequency that moves with its bandwidth.",
        _resonance,
    ),
}
