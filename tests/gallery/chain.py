"""Pictures of what lies between the motor's currents and angle and what the drive knows of them."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from matplotlib.axes import Axes

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.angle_signal import AngleSignal
from emulator.plant.physics.current_filter import CurrentFilter
from emulator.plant.physics.current_hum import CurrentHum
from emulator.plant.physics.hall import BY_SECTOR, BY_TURN, MIDDLE, Hall
from emulator.scenario.scenarios import Run
from tests.emulator.plant.physics.effect_runs import ROUND, T_S, at, line, middle, steady, voltage_error, with_effects
from tests.gallery.picture import IDEAL, A, D, Picture, Q, label, ms

_FILTERS: Final = (
    ("ideal", CurrentFilter(), IDEAL), ("a mean over two periods", CurrentFilter(periods=2), Q),
    ("an RC of two periods", CurrentFilter(tau=2.0 * T_S), D),
)  # fmt: skip


def _current_filter(panels: Sequence[Axes]) -> None:
    f = np.linspace(10.0, 200.0, 9)
    for name, filter_, colour in _FILTERS:
        scenario = with_effects(motor=ROUND, step=4.0, run=at(20.0), current_filter=filter_)
        scenario = replace(scenario, drive=replace(scenario.drive, bandwidth=400.0))
        r = VirtualDrive(scenario).record(700)
        window = slice(325, 375)
        panels[0].plot(ms(r)[window], r["i_q"][window], ".-", ms=3, color=colour, label=name)
        panels[1].step(ms(r)[window], voltage_error(r, ROUND).imag[window], where="post", color=colour, label=name)
        turning = [
            steady(with_effects(motor=ROUND, i_dq=5j, run=at(float(x)), current_filter=filter_), 0.2, 0.02) for x in f
        ]
        panels[2].plot(
            f, [voltage_error(r, ROUND).mean().real for r in turning], "o-", ms=3, color=colour, label=f"u_d, {name}"
        )
    label(panels[0], "Current as recorded, stepping", "time in ms", "i_q in A")
    label(panels[1], "Voltage that the textbook misses", "time in ms", "error of u_q in V")
    label(panels[2], "The same at 5 A that stand", "electrical frequency in Hz", "V")


def _current_hum(panels: Sequence[Axes]) -> None:
    ways = (("ideal", CurrentHum(), IDEAL), ("50 Hz in phase a", CurrentHum(a=0.2), A),
            ("100 Hz in phases a and b", CurrentHum(a=0.2, b=-0.2, frequency=100.0), D))  # fmt: skip
    f = np.arange(-150.0, 151.0, 10.0)
    for n, (name, hum, colour) in enumerate(ways):
        r = steady(with_effects(motor=ROUND, i_dq=5j, run=at(30.0), current_hum=hum), 0.2, 0.1001)
        panels[0].plot(ms(r), r["i_q"], color=colour, label=name)
        t = r["t"][:-1] - r["t"][0]
        error = voltage_error(r, ROUND) * np.exp(1j * middle(r))
        panels[1].plot(1e3 * t, error.real, color=colour, label=name)
        lines = [abs(line(error, 2.0 * np.pi * t, float(x))) for x in f]
        panels[2].bar(f + 3.0 * (n - 1), lines, 3.0, color=colour, label=name)
    label(panels[0], "Current as recorded: the control hides most of it", "time in ms", "i_q in A")
    label(panels[1], "Voltage that the textbook misses", "time in ms", "V, along phase a")
    label(panels[2], "The same, turning at 30 Hz", "frequency in the stationary frame in Hz", "amplitude in V")


def _angle_signal(panels: Sequence[Axes]) -> None:
    turn = 4.0 / 40.0  # s
    for signal, colour, name in (
        (AngleSignal(quadrature=0.05), Q, "out of quadrature by 50 mrad"),
        (AngleSignal(offset_sin=0.03), D, "sine offset by 3 %"),
    ):
        ideal, real = (
            steady(with_effects(motor=ROUND, run=at(40.0), angle_signal=s), 0.2, turn + T_S)
            for s in (AngleSignal(), signal)
        )
        x = np.linspace(0.0, 1440.0, len(ideal["t"]))
        wrong = np.angle(np.exp(1j * (real["theta_e"] - ideal["theta_e"])))
        panels[0].plot(x, 1e3 * wrong, color=colour, label=name)
    panels[0].set(xlim=(0.0, 1440.0), xticks=range(0, 1441, 360), ylim=(-60.0, 35.0))
    swings = Run(speed_rpm=600.0, swing_rpm=300.0, swing_frequency=10.0)
    for signal, colour, name in (
        (AngleSignal(), IDEAL, "ideal"), (AngleSignal(bandwidth=40.0), A, "tracking loop of 40 Hz"),
        (AngleSignal(latency=2.0 * T_S), D, "two periods late"),
    ):  # fmt: skip
        ideal, real = (
            steady(with_effects(motor=ROUND, run=swings, angle_signal=s), 0.2, 0.2) for s in (AngleSignal(), signal)
        )
        wrong = np.angle(np.exp(1j * (real["theta_e"] - ideal["theta_e"])))
        panels[1].plot(ms(real), 1e3 * wrong, color=colour, label=name)
        f = np.linspace(10.0, 150.0, 8)
        runs = [
            steady(with_effects(motor=ROUND, i_dq=2j, run=at(float(x)), angle_signal=signal), 0.2, 0.02) for x in f
        ]
        panels[2].plot(
            f, [voltage_error(r, ROUND).mean().real for r in runs], "o-", ms=3, color=colour, label=f"u_d, {name}"
        )
    label(panels[0], "Error of a sensor's angle", "electrical angle in degrees", "mrad, electrical")
    label(panels[1], "Error as the speed swings 300 rpm around 600", "time in ms", "mrad, electrical")
    label(panels[2], "Voltage that the textbook misses", "electrical frequency in Hz", "V")


_DISPLACED: Final = Hall(MIDDLE, displaced_a=0.08, displaced_b=-0.05, displaced_c=-0.03)


def _hall(panels: Sequence[Axes]) -> None:
    turn = 1.0 / 40.0  # s
    sensors = (
        (_DISPLACED, A, "the middle of the sector"),
        (_DISPLACED._replace(rate=BY_TURN), Q, "goes on by the last turn's rate"),
        (_DISPLACED._replace(rate=BY_SECTOR), D, "goes on by the last sector's"),
    )
    x = np.linspace(0.0, 360.0, round(turn / T_S))
    for hall, colour, name in sensors:
        ideal, real = (
            steady(with_effects(motor=ROUND, run=at(40.0, ROUND), hall=h), 0.2, turn) for h in (Hall(), hall)
        )
        wrong = np.angle(np.exp(1j * (real["theta_e"] - ideal["theta_e"])))
        panels[0 if hall.rate == MIDDLE else 1].plot(x, 1e3 * wrong, color=colour, label=name)
        if hall.rate != MIDDLE:
            held = steady(with_effects(motor=ROUND, i_dq=5j, run=at(40.0, ROUND), hall=hall), 0.2, turn)
            panels[2].plot(x, held["i_q"], color=colour, label=name)
    for panel in panels:
        panel.set(xlim=(0.0, 360.0), xticks=range(0, 361, 60))
    label(panels[0], "Error of the sensors as they are", "electrical angle in degrees", "mrad, electrical")
    label(panels[1], "Error of an angle between edges", "electrical angle in degrees", "mrad, electrical")
    label(panels[2], "A current of 5 A that it turns", "electrical angle in degrees", "i_q in A")


PICTURES: Final = {
    "current_filter": Picture(
        "Current filter",
        "What is measured comes late: a step is smeared over the periods that follow, and as the rotor turns a current "
        "that stands is read behind where it is, by its lag times the speed.",
        "A mean and an RC of one lag differ at steps alone; voltages recorded in another row shift the same steps.",
        _current_filter,
    ),
    "current_hum": Picture(
        "Current hum",
        "The control takes a channel's hum for current and works against it: what is recorded hardly hums, but the "
        "voltage does, at the mains' frequency in the stationary frame at any speed.",
        "A voltage coupled into the leads does the same to a motor without saliency; with the bridge off only the "
        "channels hum, and the sum of three that hum is not zero.",
        _current_hum,
    ),
    "angle_signal": Picture(
        "Angle signal",
        "Signals out of quadrature are wrong twice an electrical turn, offset ones once. A latency is an offset that "
        "grows with speed; a tracking loop lags only while the speed changes.",
        "An encoder off its centre is wrong once a mechanical turn; an offset of the angle is the same at every speed.",
        _angle_signal,
    ),
    "hall": Picture(
        "Hall sensors",
        "Six edges an electrical turn, and what a drive makes of their times. Sensors that are displaced make edges "
        "come early and late, the same every half turn: the angle jumps there, or waits.",
        "An angle sensor's signals make smooth errors, of orders 1 to 4; an offset is the same all around.",
        _hall,
    ),
}
