"""Pictures of the shaft: friction, compliance."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.compliance import Compliance
from emulator.plant.physics.friction import Friction
from tests.emulator.plant.physics.effect_runs import SALIENT, T_S, free, states, switched, with_effects
from tests.gallery.picture import IDEAL, A, D, Picture, Q, label

_MOTOR = SALIENT._replace(B=1e-3)


def _friction(panels: Sequence[Axes]) -> None:
    cases = (
        (Friction(), IDEAL, "viscous only (ideal)"),
        (Friction(coulomb=0.1), D, "and Coulomb's"),
        (Friction(coulomb=0.1, static=0.25, omega_s=4.0), Q, "and Stribeck's"),
    )
    for friction, colour, name in cases:
        scenario = with_effects(motor=_MOTOR, run=free(40.0), drive={"enabled": False}, friction=friction)
        seen = states(VirtualDrive(switched(scenario)), 6000)
        omega, lost = np.array([s.omega_m for s in seen]), np.array([s.W_friction for s in seen])
        t = T_S * np.arange(len(seen))
        panels[0].plot(t, omega, color=colour, label=name)
        torque = np.diff(lost[::10]) / (0.5 * (omega[:-1:10] + omega[10::10]) * 10.0 * T_S + 1e-12)
        turning = omega[10::10] > 0.05
        panels[1].plot(omega[10::10][turning], torque[turning], color=colour, label=name)
        start = with_effects(motor=_MOTOR, run=free(), friction=friction)
        drive = VirtualDrive(start)
        i_q = np.linspace(0.0, 0.5, 26)
        speed: list[float] = []
        for i in i_q:
            drive.write("i_q_ref", float(i))
            drive.run(400)
            speed.append(drive.plant.omega_m)
        panels[2].plot(i_q, speed, color=colour, label=name)
    panels[1].set(xlim=(0.0, 60.0), ylim=(0.0, 0.32))
    label(panels[0], "Running down, the bridge off", "time in s", "omega_m in rad/s")
    label(panels[1], "What brakes, from the energy lost", "omega_m in rad/s", "Nm")
    label(panels[2], "A torque that rises within a second", "i_q in A", "omega_m in rad/s")


def _compliance(panels: Sequence[Axes]) -> None:
    soft = Compliance(stiffness=60.0, damping=0.01, J_L=1.6e-3)
    rigid = SALIENT._replace(J=SALIENT.J + soft.J_L)
    cases = ((rigid, Compliance(), IDEAL, "rigid"), (SALIENT, soft, Q, "motor, compliant"))
    for motor, compliance, colour, name in cases:
        drive = VirtualDrive(with_effects(motor=motor, run=free(5.0), compliance=compliance))
        drive.run(200)
        drive.write("i_q_ref", 3.0)
        seen = states(drive, 2000)
        t = 1e3 * T_S * np.arange(len(seen))
        omega = np.array([s.omega_m for s in seen])
        panels[0].plot(t, omega, color=colour, label=name)
        if compliance.stiffness > 0.0:
            panels[0].plot(t, [s.omega_L for s in seen], color=A, label="load, compliant")
            panels[1].plot(t, [1e3 * s.twist for s in seen], color=Q, label="twist")
        else:
            panels[1].axhline(0.0, color=IDEAL, label="rigid")
        swing = omega - np.polyval(np.polyfit(t, omega, 1), t)
        spectrum = np.abs(np.fft.rfft(swing * np.hanning(len(swing)))) * 4.0 / len(swing)
        panels[2].plot(np.fft.rfftfreq(len(swing), T_S), spectrum, color=colour, label=name)
    f = np.sqrt(soft.stiffness * (1.0 / SALIENT.J + 1.0 / soft.J_L)) / (2.0 * np.pi)
    panels[2].axvline(f, color="black", ls=":", lw=1.0)
    panels[0].set(xlim=(0.0, 100.0), ylim=(0.0, 110.0))
    panels[2].set_xlim(0.0, 200.0)
    label(panels[0], "Speed as the torque comes", "time in ms", "omega_m in rad/s")
    label(panels[1], "The shaft", "time in ms", "mrad")
    label(panels[2], "Swing of the speed; dotted: the two-mass resonance", "frequency in Hz", "rad/s")


PICTURES: Final = {
    "friction": Picture(
        "Friction",
        "Viscous friction runs down along an exponential; Coulomb's in a straight line to a sudden stop. Stribeck's is "
        "highest near standstill, so a rising torque does nothing at first and then runs off.",
        "Iron loss and cogging brake too; cogging holds at certain angles, iron loss vanishes at standstill.",
        _friction,
    ),
    "compliance": Picture(
        "Compliant shaft",
        "At a torque step the motor leaves at the pace of its own inertia and swings against the load at one "
        "frequency; the mean follows both inertias.",
        "A speed loop that is set too fast swings as well, at a frequency that follows its bandwidth.",
        _compliance,
    ),
}
