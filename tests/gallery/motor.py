"""Pictures of the motor: magnetics, iron, heat, windings."""

import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.dynamics import advanced, motor_current
from emulator.plant.physics.demagnetisation import Demagnetisation
from emulator.plant.physics.flux_map import gradient, loaded
from emulator.plant.physics.harmonics import Harmonics
from emulator.plant.physics.imbalance import Imbalance
from emulator.plant.physics.iron_loss import IronLoss
from emulator.plant.physics.legs import vector as held
from emulator.plant.physics.saturation import Saturation
from emulator.plant.physics.skin import Skin
from emulator.plant.physics.thermal import Thermal
from emulator.plant.physics.turn_short import TurnShort
from emulator.plant.physics.warming import Warming
from emulator.scenario.effects import MapFile
from emulator.scenario.motors import MOTORS
from tests.emulator.plant.physics.effect_runs import (
    ROUND,
    SALIENT,
    T_S,
    Recording,
    Vectors,
    at,
    currents,
    flux_linkage,
    middle,
    states,
    steady,
    voltage_error,
    voltages,
    with_effects,
)
from tests.gallery.picture import IDEAL, A, D, Picture, Q, bars, degrees, dq, label, ms
from tests.support.real_data import REAL_DATA

_MAP: Final = REAL_DATA / "baldor_flux_map" / "baldor_400rpm_map.npz"
_COLOURS: Final = ("C4", "C0", "C2", "C1", "C3")


def _told_flux(r: Recording, R_s: float) -> complex:
    """psi_dq (Vs) from the voltage of the steady state: u = R_s i + j omega_e psi."""
    turn = float(r["omega_e"].mean()) * T_S
    back_emf = complex(voltages(r).mean()) - R_s * math.cos(turn / 2.0) * complex(currents(r).mean())
    return back_emf * T_S / (2j * math.sin(turn / 2.0))


def _saturation(panels: Sequence[Axes]) -> None:
    saturation = Saturation(L_d_drop=0.1, L_q_drop=0.2, cross_drop=0.15)
    i = np.linspace(-10.0, 10.0, 21)

    def psi(i_dq: complex) -> complex:
        r = steady(with_effects(i_dq=i_dq, run=at(10.0), saturation=saturation), 0.1, 0.01)
        return _told_flux(r, SALIENT.R_s)

    panels[0].plot(i, SALIENT.psi_f + SALIENT.L_d * i, color=IDEAL, ls="--", label="ideal")
    panels[1].plot(i, SALIENT.L_q * i, color=IDEAL, ls="--", label="ideal")
    for other, colour in ((-6.0, "C4"), (0.0, "C0"), (6.0, "C3")):
        panels[0].plot(i, [psi(complex(x, other)).real for x in i], color=colour, label=f"i_q = {other:g} A")
        along_q = np.array([psi(complex(other, x)).imag for x in i])
        panels[1].plot(i, along_q, color=colour, label=f"i_d = {other:g} A")
        panels[2].plot(i, 1e3 * np.gradient(along_q, i), color=colour, label=f"i_d = {other:g} A")
    panels[2].axhline(1e3 * SALIENT.L_q, color=IDEAL, ls="--")
    label(panels[0], "Flux linkage on the magnets' axis", "i_d in A", "psi_d in Vs")
    label(panels[1], "and across", "i_q in A", "psi_q in Vs")
    label(panels[2], "What a small step on q sees", "i_q in A", "d(psi_q)/d(i_q) in mH", legend="upper right")


def _points() -> tuple[Path, Vectors, Vectors]:
    """A flux map's file and its points, of current (A) and flux linkage (Vs)."""
    if _MAP.is_file():
        with np.load(_MAP) as file:
            return _MAP, file["i_s_dq"], file["psi_s_dq"]
    # Where the measured one is absent: two saturating axes, made up
    i_d, i_q = np.meshgrid(np.linspace(-25.0, 25.0, 21), np.linspace(-25.0, 25.0, 27))
    psi = 0.47 + 0.3 * np.tanh(i_d / 17.0) + 1.2j * np.tanh(i_q / 11.0)
    file = Path("build") / "gallery" / "made_up_map.npz"
    file.parent.mkdir(parents=True, exist_ok=True)
    np.savez(file, i_s_dq=i_d + 1j * i_q, psi_s_dq=psi)
    return file, i_d + 1j * i_q, psi


def _flux_map(panels: Sequence[Axes]) -> None:
    file, i, psi = _points()
    flux_map, motor = loaded(file), MOTORS["baldor_ecs101m"].machine
    inside = np.abs(i) < 26.0
    panels[0].scatter(i.imag[inside], psi.imag[inside], c=i.real[inside], s=8, cmap="viridis", label="points, by i_d")
    steps = np.linspace(-15.0, 15.0, 11)
    for i_d, colour in ((-8.0, "C0"), (0.0, "C1"), (8.0, "C3")):
        drive = VirtualDrive(
            with_effects(motor=motor, i_dq=complex(i_d, steps[0]), run=at(20.0, motor),
                         drive={"u_dc": 540.0, "bandwidth": 400.0}, flux_map=MapFile(str(file.resolve())))
        )  # fmt: skip
        told: list[complex] = []
        for x in steps:
            drive.write("i_q_ref", float(x))
            drive.run(10000)
            told.append(_told_flux(drive.record(100), motor.R_s))
        panels[0].plot(steps, [x.imag for x in told], color=colour, lw=1.8, label=f"drive at i_d = {i_d:g} A")
        panels[1].plot(steps, [x.real for x in told], color=colour, lw=1.8, label=f"drive at i_d = {i_d:g} A")
    panels[1].set_ylim(0.0, 1.2)
    panels[1].scatter(i.imag[inside], psi.real[inside], c=i.real[inside], s=8, cmap="viridis")
    miss = np.array([abs(gradient(flux_map, complex(x)) - y) for x, y in zip(psi.ravel(), i.ravel(), strict=True)])
    rms = 1e3 * np.sqrt(np.mean(miss**2))
    panels[2].hist(1e3 * miss, bins=30, color=A, label=f"{len(miss)} points, rms {rms:.0f} mA")
    label(panels[0], "psi_q: points of the file, and of the drive", "i_q in A", "psi_q in Vs")
    label(panels[1], "psi_d: the same", "i_q in A", "psi_d in Vs")
    label(panels[2], "What one energy function misses of them", "distance of the current in mA", "points")


def _harmonics(panels: Sequence[Axes]) -> None:
    harmonics = Harmonics(d_6=0.02, q_6=0.03, d_12=0.01, q_12=0.005, cogging=0.05)
    runs = [
        steady(with_effects(motor=ROUND, i_dq=5j, run=at(25.0), harmonics=h), 0.2, 0.0401)
        for h in (Harmonics(), harmonics)
    ]
    for r, colour, name in zip(runs, (IDEAL, A), ("ideal", "with harmonics"), strict=True):
        psi = flux_linkage(r, ROUND.R_s) - ROUND.L_d * currents(r) * np.exp(1j * r["theta_e"])
        panels[0].plot(degrees(r)[:-1], np.diff(psi).real / T_S, color=colour, label=name)
    panels[0].set(xlim=(0.0, 360.0), xticks=range(0, 361, 60))
    ideal, real = (voltage_error(r, ROUND) for r in runs)
    bars(panels[1], ideal, real, middle(runs[0]), 13, "V")
    panels[1].set_xticks(range(-12, 13, 6))
    for h, colour, name in ((Harmonics(), IDEAL, "ideal"), (harmonics, Q, "with harmonics and cogging")):
        drive = VirtualDrive(with_effects(motor=ROUND, i_dq=5j, run=at(10.0), drive={"bandwidth": 4e3}, harmonics=h))
        drive.run(1000)
        seen = states(drive, 1000)
        torque = [
            (b.W_shaft - a.W_shaft) / ((b.theta_m - a.theta_m) % (2.0 * np.pi)) for a, b in itertools.pairwise(seen)
        ]
        panels[2].plot(np.linspace(0.0, 360.0, 1000), torque, color=colour, label=name)
    panels[2].set(xlim=(0.0, 360.0), xticks=range(0, 361, 60), ylim=(0.0, None))
    label(panels[0], "Back-EMF of phase a at 25 Hz", "electrical angle in degrees", "V")
    label(panels[2], "Torque at a constant i_q", "electrical angle in degrees", "Nm")


def _iron_loss(panels: Sequence[Axes]) -> None:
    f = np.concatenate([[1.0, 3.0, 6.0, 12.0], np.linspace(20.0, 250.0, 12)])
    cases = (
        (IronLoss(), IDEAL, "ideal"),
        (IronLoss(R_c=200.0), D, "eddy currents"),
        (IronLoss(R_c=200.0, omega_h=400.0), Q, "and hysteresis"),
    )
    for iron, colour, name in cases:
        error: list[complex] = []
        power: list[float] = []
        for x in f:
            drive = VirtualDrive(with_effects(run=at(float(x)), drive={"u_dc": 600.0}, iron_loss=iron))
            drive.run(1000)
            before = drive.plant
            r = drive.record(1000)
            error.append(complex(voltage_error(r, SALIENT).mean()))
            power.append(-(drive.plant.W_load - before.W_load) / 0.1)
        panels[0].plot(f, power, color=colour, label=name)
        panels[1].plot(f, np.array(power) / (2.0 * np.pi * f / SALIENT.n_p), color=colour, label=name)
        panels[2].plot(f, np.real(error), color=colour, label=f"d, {name}")
        panels[2].plot(f, np.imag(error), color=colour, ls=":", label=f"q, {name}")
    label(panels[0], "Power the shaft must bring, no current", "electrical frequency in Hz", "W")
    label(panels[1], "as torque", "electrical frequency in Hz", "Nm")
    label(panels[2], "Voltage that the textbook misses", "electrical frequency in Hz", "V, rotor frame")


def _thermal(panels: Sequence[Axes]) -> None:
    thermal = Thermal(C_w=2.0, C_m=4.0, C_h=6.0, R_wh=0.4, R_mh=0.5, R_ha=0.4)
    drive = VirtualDrive(with_effects(i_dq=complex(2.0, 6.0), run=at(25.0), thermal=thermal))
    rows: list[tuple[float, ...]] = []
    for n in range(150):
        r, truth = drive.record(1000), drive.truth
        u_d = voltages(r)[500:].mean().real + r["omega_e"].mean() * SALIENT.L_q * 6.0
        rows.append((0.1 * n, truth.temp_winding, truth.temp_magnet, truth.R_s, truth.psi_f, u_d / 2.0))
    t, winding, magnet, R_s, psi_f, told_R = np.array(rows).T
    panels[0].plot(t, winding, color=Q, label="winding")
    panels[0].plot(t, magnet, color=D, label="magnets")
    panels[0].axhline(23.4, color=IDEAL, label="ideal")
    panels[1].plot(t, told_R, color=Q, label="(u_d + omega_e L_q i_q) / i_d")
    panels[1].plot(t, R_s, color="black", ls="--", label="R_s")
    panels[1].axhline(SALIENT.R_s, color=IDEAL)
    panels[2].plot(t, 1e3 * psi_f, color=D, label="psi_f")
    panels[2].axhline(1e3 * SALIENT.psi_f, color=IDEAL, label="ideal")
    label(panels[0], "Temperatures of a small motor at its current", "time in s", "degC")
    label(panels[1], "The winding's resistance", "time in s", "ohm")
    label(panels[2], "The magnets' flux linkage", "time in s", "mVs")


def _warming(panels: Sequence[Axes]) -> None:
    winding, magnets = ((0.0, 0.0), (0.4, 0.2), (1.0, 0.05)), ((0.0, 0.0), (0.6, -0.04), (1.0, -0.02))
    warming = Warming(winding, magnets)
    for i, colour in ((2.0, D), (6.0, Q)):
        r = steady(with_effects(i_dq=complex(i, 0.0), run=at(25.0), warming=warming), 0.02, 1.0)
        t, omega_e = ms(r), r["omega_e"]
        panels[0].plot(t, r["i_d"], color=colour, label=f"{i:g} A")
        panels[1].plot(t, voltages(r).real / i, color=colour, label=f"u_d / i_d at {i:g} A")
        psi = 1e3 * (voltages(r).imag / omega_e - SALIENT.L_d * i)
        panels[2].plot(t, psi, color=colour, label=f"u_q / omega_e - L_d i_d at {i:g} A")
    panels[1].axhline(SALIENT.R_s, color=IDEAL, label="ideal")
    panels[2].axhline(1e3 * SALIENT.psi_f, color=IDEAL, label="ideal")
    label(panels[0], "Two currents that are held", "time in ms", "A")
    label(panels[1], "The winding's resistance follows the same course", "time in ms", "ohm")
    label(panels[2], "and so does the magnets' flux linkage", "time in ms", "mVs")


def _demagnetisation(panels: Sequence[Axes]) -> None:
    for share, ls in ((0.0, IDEAL), (0.1, "")):
        drive = VirtualDrive(with_effects(i_dq=4j, run=at(50.0), demagnetisation=Demagnetisation(share, 0.12, 2e-3)))
        drive.run(1000)
        before = drive.plant.W_shaft
        torque: list[float] = []
        columns: list[tuple[float, ...]] = []
        for _ in range(500):
            r = drive.record(1)
            columns.append((r["t"][0], r["i_d"][0], r["i_q"][0], r["u_d"][0], r["u_q"][0]))
            torque.append((drive.plant.W_shaft - before) / (2.0 * np.pi * 50.0 / SALIENT.n_p * T_S))
            before = drive.plant.W_shaft
        t, i_d, i_q, u_d, u_q = np.array(columns).T
        x = 1e3 * (t - 0.12)
        for axes, d, q, letter in ((panels[0], i_d, i_q, "i"), (panels[1], u_d, u_q, "u")):
            axes.plot(x, d, color=ls or D, label="ideal" if ls else f"{letter}_d", zorder=1 if ls else 2)
            axes.plot(x, q, color=ls or Q, label=None if ls else f"{letter}_q", zorder=1 if ls else 2)
        panels[2].plot(x, torque, color=ls or A, label="ideal" if ls else "10 % of psi_f lost")
    label(panels[0], "Currents: a kick on d", "time in ms", "A")
    label(panels[1], "Voltages: a step on q", "time in ms", "V")
    label(panels[2], "Torque at the same i_q", "time in ms", "Nm")
    panels[2].set_ylim(0.0, 3.8)


def _imbalance(panels: Sequence[Axes]) -> None:
    ideal, real = (
        steady(with_effects(i_dq=6j, run=at(50.0), imbalance=x), 0.2, 0.0201) for x in (Imbalance(), Imbalance(a=0.3))
    )
    dq(panels[0], degrees(ideal)[:-1], voltage_error(ideal, SALIENT), voltage_error(real, SALIENT), "error of u")
    panels[0].set(xlim=(0.0, 360.0), xticks=range(0, 361, 90))
    bars(panels[1], voltage_error(ideal, SALIENT), voltage_error(real, SALIENT), middle(ideal), 5, "V")
    for i in np.linspace(1.0, 10.0, 7):
        r = steady(with_effects(i_dq=1j * i, run=at(50.0), imbalance=Imbalance(a=0.3)), 0.2, 0.0201)
        e, x = voltage_error(r, SALIENT), middle(r)
        panels[2].plot(i, abs(np.mean(e * np.exp(2j * x))), "o", color=Q, label="turns back" if i == 1.0 else None)
        panels[2].plot(i, abs(np.mean(e)), "x", color=D, label="stands still" if i == 1.0 else None)
    panels[2].plot([0.0, 10.0], [0.0, SALIENT.R_s], color="black", lw=0.8, ls="--", label="R_s share / 3 times i")
    label(panels[0], "Voltage that the textbook misses", "electrical angle in degrees", "V, rotor frame")
    label(panels[2], "Both grow with the current", "current in A", "V")


def _turn_short(panels: Sequence[Axes]) -> None:
    short = TurnShort(share=0.08, R_t=0.3)
    ideal, real = (
        steady(with_effects(motor=ROUND, i_dq=4j, run=at(50.0), turn_short=x), 0.2, 0.0201)
        for x in (TurnShort(), short)
    )
    drive = VirtualDrive(with_effects(motor=ROUND, i_dq=4j, run=at(50.0), turn_short=short))
    drive.run(2000)
    loop = [s.i_t for s in states(drive, 200)]
    panels[0].plot(degrees(real), real["i_a"], color=A, label="phase a, which the drive sees")
    panels[0].plot(degrees(real), loop, color=Q, label="within the shorted turns")
    panels[0].set(xlim=(0.0, 360.0), xticks=range(0, 361, 90), ylim=(-7.0, 10.0))
    bars(panels[1], voltage_error(ideal, ROUND), voltage_error(real, ROUND), middle(ideal), 5, "V")
    panels[1].set_title("Voltage that the textbook misses, rotor frame")
    f = np.linspace(5.0, 150.0, 10)
    for x, colour, name in ((TurnShort(), IDEAL, "ideal"), (short, Q, "8 % of the turns shorted")):
        torque: list[float] = []
        for frequency in f:
            drive = VirtualDrive(with_effects(motor=ROUND, run=at(float(frequency)), turn_short=x))
            drive.run(1000)
            before = drive.plant.W_load
            drive.run(2000)
            torque.append((drive.plant.W_load - before) / (0.2 * 2.0 * np.pi * frequency / ROUND.n_p))
        panels[2].plot(f, torque, color=colour, label=name)
    label(panels[0], "Currents over a turn", "electrical angle in degrees", "A", legend="upper right")
    label(panels[2], "Torque without stator current: it brakes", "electrical frequency in Hz", "Nm")


def _impedance(skin: Skin, frequency: float) -> complex:
    """Of a locked rotor along d (ohm), from a sine of voltage."""
    n, turns = 200, 12
    T = 1.0 / (frequency * n)
    drive = VirtualDrive(with_effects(motor=ROUND._replace(L_d=3e-4, L_q=3e-4), skin=skin))
    plant, state = drive.plant_now(), drive.plant
    seen: list[float] = []
    for k in range(turns * n):
        u = complex(math.cos(2.0 * math.pi * (k + 0.5) / n))
        state = advanced(plant, held(u, 310.0), k * T, T, 2, state)
        seen.append(motor_current(plant, state).real)
    angle = 2.0 * np.pi * (np.arange(4 * n) + 1.0) / n
    return 1.0 / complex(2.0 * np.mean(np.array(seen[-4 * n :]) * np.exp(-1j * angle)))


def _skin(panels: Sequence[Axes]) -> None:
    skin = Skin(rise=0.5, frequency=400.0)
    f = np.geomspace(40.0, 4000.0, 13)
    for x, colour, name in ((Skin(), IDEAL, "ideal"), (skin, Q, "with the effect")):
        Z = [_impedance(x, float(frequency)) for frequency in f]
        panels[0].semilogx(f, np.real(Z) / ROUND.R_s, "o-", ms=3, color=colour, label=name)
        panels[1].semilogx(f, 1e3 * np.imag(Z) / (2.0 * np.pi * f), "o-", ms=3, color=colour, label=name)
    panels[0].axvline(400.0, color="black", lw=0.8, ls=":")
    speeds = np.linspace(0.0, 300.0, 13)
    for x, colour, name in ((Skin(), IDEAL, "ideal"), (skin, Q, "with the effect")):
        fine = {"T_s": 5e-5, "u_dc": 400.0}
        runs = [
            steady(with_effects(motor=ROUND, i_dq=8.0 + 0j, run=at(float(s)), drive=fine, skin=x), 0.1, 0.02)
            for s in speeds
        ]
        told = [ROUND.R_s + voltage_error(r, ROUND).mean().real / 8.0 for r in runs]
        panels[2].plot(speeds, told, color=colour, label=name)
    panels[2].set_ylim(0.0, 0.9)
    label(panels[0], "Resistance of a locked rotor", "frequency in Hz", "of R_s")
    label(panels[1], "and its inductance", "frequency in Hz", "mH")
    label(panels[2], "What a turning drive takes for R_s", "electrical frequency in Hz", "ohm")


PICTURES: Final = {
    "saturation": Picture(
        "Saturation and cross-saturation",
        "Flux linkages bend away from their lines as the current grows; a current on the other axis bends them too. "
        "Small steps see an inductance that falls with current.",
        "An encoder offset mixes the axes and makes one inductance look like two, but the same at every current.",
        _saturation,
    ),
    "flux_map": Picture(
        "A measured flux map",
        "Points of a file (measured on a 5.6 kW machine where that recording is at hand), turned into one energy "
        "function; the drive's own voltages give the points back. psi_d that falls as i_q grows is cross-saturation. "
        "What is missed is the measurement's: its points are not reciprocal by themselves.",
        "It is saturation, of a shape that no short formula has.",
        _flux_map,
    ),
    "harmonics": Picture(
        "Space harmonics and cogging",
        "A back-EMF that is no sine; orders 6 and 12 in the rotor frame, in proportion to speed; the torque ripples "
        "at a constant current, and by cogging at no current too.",
        "Dead time has the same orders, but of a size that does not grow with speed.",
        _harmonics,
    ),
    "iron_loss": Picture(
        "Iron loss",
        "The rotor drags without any current, by a torque that grows with speed (eddy currents) or stays (hysteresis). "
        "The drive sees a voltage on d that grows with the square of speed.",
        "Friction drags as well, but leaves no trace in the voltages. At one speed the voltage on d looks like an "
        "angle offset, which grows with the first power of speed only.",
        _iron_loss,
    ),
    "thermal": Picture(
        "Thermal",
        "R_s rises and psi_f falls, each with its own time constant: the winding leads, the magnets follow.",
        "Demagnetisation takes psi_f at once and for good; a drop of the inverter looks like R_s, but does not drift.",
        _thermal,
    ),
    "warming": Picture(
        "Warmth from outside",
        "R_s and psi_f follow temperatures that no loss of this machine makes, along one course whatever the current.",
        "A winding that its own losses warm follows the load: the square of the current, summed up.",
        _warming,
    ),
    "demagnetisation": Picture(
        "Partial demagnetisation",
        "The flux linkage cannot jump, so i_d makes up for what the magnets lose until the control takes it back. "
        "Afterwards back-EMF and torque are less by the same share.",
        "A speed or voltage gain error scales the back-EMF as well, but not the torque, and was there before.",
        _demagnetisation,
    ),
    "imbalance": Picture(
        "Resistance imbalance",
        "A voltage of twice the electrical frequency, turning back, in proportion to current; what stands still looks "
        "like R_s.",
        "Unequal gains of the current channels make the same line by a current that does not flow; shorted turns "
        "make it grow with speed.",
        _imbalance,
    ),
    "turn_short": Picture(
        "Inter-turn short",
        "The back-EMF drives a large current around the shorted turns, which no sensor sees. It turns with the phase: "
        "order -2 in the rotor frame, and it brakes.",
        "Resistance imbalance has the same order, but in proportion to current, not to speed.",
        _turn_short,
    ),
    "skin": Picture(
        "Skin and proximity effect",
        "The resistance rises with frequency, by half at the dotted line, where the inductance falls. "
        "For a drive that turns, R_s rises with speed.",
        "Iron loss rises with speed too, but costs torque; at one speed, it is a larger R_s.",
        _skin,
    ),
}
