"""Pictures of what the drive sees and records: sensing, timing."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.sensing import AngleSensing, CurrentSensing, VoltageSensing
from emulator.plant.physics.timing import Timing
from tests.emulator.plant.physics.effect_runs import (
    ROUND,
    T_S,
    Column,
    Vectors,
    at,
    currents,
    steady,
    voltage_error,
    voltages,
    with_effects,
)
from tests.gallery.picture import IDEAL, A, D, Picture, Q, dq, label, ms, orders

_WITHOUT = np.arange(-3, 4) != 0


def _true_currents(sensing: CurrentSensing) -> tuple[Column, Vectors, Vectors]:
    """Electrical angle (deg), told and true currents (A) of a turn at 50 Hz; the true ones from the flux linkage."""
    drive = VirtualDrive(with_effects(motor=ROUND, i_dq=5j, run=at(50.0), current_sensing=sensing))
    drive.run(2000)
    told: list[complex] = []
    true: list[complex] = []
    for _ in range(200):
        state = drive.plant
        turned = complex(np.exp(-1j * ROUND.n_p * state.theta_m))
        true.append((state.psi * turned - ROUND.psi_f) / ROUND.L_d)
        told.append(complex(currents(drive.record(1))[0]))
    return 360.0 * np.arange(200) / 200.0, np.array(told), np.array(true)


def _current_sensing(panels: Sequence[Axes]) -> None:
    cases = (
        (panels[0], CurrentSensing(offset_a=0.2), "Offset of 0.2 A in phase a", D),
        (panels[1], CurrentSensing(gain_a=1.05), "Gain of phase a 5 % high", Q),
    )
    x, _, ideal = _true_currents(CurrentSensing())
    theta = np.radians(x)
    ks = np.arange(-3, 4)
    for n, (axes, sensing, title, colour) in enumerate(cases):
        _, told, true = _true_currents(sensing)
        dq(axes, x, ideal - 5j, true - 5j, "true i")
        axes.plot(x, told.real, color=D, ls=":", label="i_d as told")
        axes.plot(x, told.imag - 5.0, color=Q, ls=":", label="i_q as told")
        axes.set(xlim=(0.0, 360.0), xticks=range(0, 361, 90), ylim=(-0.2, 0.35))
        label(axes, title, "electrical angle in degrees", "A off the reference")
        axes.legend(loc="upper right", ncols=2)
        shown = orders(true, theta, 3)
        panels[2].bar(ks[_WITHOUT] + 0.36 * (n - 0.5), shown[_WITHOUT], 0.36, color=colour, label=("offset", "gain")[n])
    label(panels[2], "True current: what the control swings with", "order of the electrical frequency", "A")


def _angle_sensing(panels: Sequence[Axes]) -> None:
    eccentric = AngleSensing(offset=0.0, once=0.01, twice=0.004)
    turn = 4.0 / 40.0  # s, four electrical turns
    ideal, real = (
        steady(with_effects(motor=ROUND, i_dq=5j, run=at(40.0), angle_sensing=a), 0.2, turn + T_S)
        for a in (AngleSensing(), eccentric)
    )
    x = np.linspace(0.0, 360.0, len(ideal["t"]))
    wrong = np.angle(np.exp(1j * (real["theta_e"] - ideal["theta_e"]))) / ROUND.n_p
    panels[0].plot(x, np.zeros_like(x), color=IDEAL, label="ideal")
    panels[0].plot(x, 1e3 * wrong, color=A, label="eccentric and bent")
    for r, colour, name in ((ideal, IDEAL, "ideal"), (real, A, "eccentric and bent")):
        panels[1].plot(x, r["omega_e"] / ROUND.n_p, color=colour, label=name)
    for axes in panels[:2]:
        axes.set(xlim=(0.0, 360.0), xticks=range(0, 361, 90))
    offsets = np.linspace(-0.1, 0.1, 9)
    runs = [
        steady(with_effects(motor=ROUND, run=at(40.0), angle_sensing=AngleSensing(offset=float(o))), 0.2, 0.025)
        for o in offsets
    ]
    errors = [complex(voltage_error(r, ROUND).mean()) for r in runs]
    panels[2].plot(1e3 * offsets, np.real(errors), color=D, label="error of u_d")
    panels[2].plot(1e3 * offsets, np.imag(errors), color=Q, label="error of u_q")
    panels[2].axhline(0.0, color=IDEAL, label="ideal")
    label(panels[0], "Error of the angle", "mechanical angle in degrees", "mrad, mechanical")
    label(panels[1], "Speed as told; the true one stands", "mechanical angle in degrees", "omega_m in rad/s")
    label(panels[2], "A constant offset at 40 Hz, no current", "offset in mrad, mechanical", "V, rotor frame")


def _voltage_sensing(panels: Sequence[Axes]) -> None:
    high = VoltageSensing(gain=1.05)
    for sensing, colour, name in ((VoltageSensing(), IDEAL, "ideal"), (high, Q, "reads 5 % high")):
        drive = VirtualDrive(with_effects(motor=ROUND, run=at(60.0), voltage_sensing=sensing))
        drive.run(1000)
        before = drive.record(50)
        drive.write("i_q_ref", 8.0)
        after = drive.record(250)
        r = {key: np.concatenate([before[key], after[key]]) for key in before}
        panels[0].plot(ms(r), r["u_dc"], color=colour, label=f"u_dc, {name}")
        panels[1].plot(ms(r), r["u_q"], color=colour, label=name)
        f = np.linspace(5.0, 150.0, 10)
        runs = [
            steady(with_effects(motor=ROUND, i_dq=4j, run=at(float(x)), voltage_sensing=sensing), 0.2, 0.02) for x in f
        ]
        panels[2].plot(
            [np.abs(voltages(r)).mean() for r in runs], [np.abs(voltage_error(r, ROUND).mean()) for r in runs], "o-",
            ms=3, color=colour, label=name,
        )  # fmt: skip
    panels[0].set_ylim(300.0, 335.0)
    label(panels[0], "dc link as recorded", "time in ms", "V")
    label(panels[1], "Voltage as recorded: it asks for more", "time in ms", "u_q in V")
    label(panels[2], "Voltage that the textbook misses", "recorded voltage in V", "V")


def _timing(panels: Sequence[Axes]) -> None:
    runs = {
        name: VirtualDrive(with_effects(motor=ROUND, step=4.0, run=at(50.0), timing=timing)).record(700)
        for name, timing in (
            ("ideal", Timing()), ("one row late", Timing(shift=-1)), ("one row early", Timing(shift=1)),
            ("lost", Timing(lost=0.3)),
        )
    }  # fmt: skip
    window = slice(320, 420)
    for name, colour in (("ideal", IDEAL), ("one row late", Q), ("one row early", D)):
        r = runs[name]
        t = 1e3 * r["t"]
        panels[0].step(t[window], r["u_q"][window], where="post", color=colour, label=name)
        panels[1].step(t[window], voltage_error(r, ROUND).imag[window], where="post", color=colour, label=name)
    full, lossy = runs["ideal"], runs["lost"]
    start, end = full["t"][330], full["t"][390]
    for r, colour, style, name in ((full, IDEAL, "-", "ideal"), (lossy, A, "o", "30 % of the rows lost")):
        inside = (r["t"] >= start) & (r["t"] <= end)
        panels[2].plot(1e3 * r["t"][inside], r["i_q"][inside], style, ms=3, color=colour, label=name)
    label(panels[0], "Voltage as recorded, the current stepping", "time in ms", "u_q in V")
    label(panels[1], "Voltage that the textbook misses", "time in ms", "error of u_q in V")
    label(panels[2], "Rows that are there", "time in ms", "i_q in A")


PICTURES: Final = {
    "current_sensing": Picture(
        "Current sensing",
        "The control holds what it measures, so the error is in the true current: an offset swings at the electrical "
        "frequency (order -1), a gain of one phase at twice it (order -2).",
        "Resistance imbalance is of order -2 too, but in the voltage, with a true current that stands.",
        _current_sensing,
    ),
    "angle_sensing": Picture(
        "Angle sensing",
        "An encoder off its centre is wrong once a mechanical turn, a bent ring twice; the told speed swings where the "
        "true one stands. A constant offset turns d into q: u_d grows with it, u_q hardly.",
        "A load that swings with the turn moves the true speed, and the current with it.",
        _angle_sensing,
    ),
    "voltage_sensing": Picture(
        "Voltage sensing",
        "A dc link that is read high makes the drive set shorter pulses than it believes: less voltage arrives than is "
        "recorded, by one share at every operating point.",
        "All of R_s, L and psi_f seem larger by that share; only a power meter or a known R_s tells.",
        _voltage_sensing,
    ),
    "timing": Picture(
        "Timing",
        "A voltage recorded a row late or early is right while nothing changes, and wrong in pairs of peaks at every "
        "step. Lost rows leave gaps in the time column.",
        "A wrong inductance makes single peaks at steps, in proportion to the current's slope.",
        _timing,
    ),
}
