"""Cases of machines that saturate: the peer is told current as a function of flux linkage.

*Map.* motulator's saturated machine, that of its example of a 5.5 kW magnet-assisted reluctance motor (Baldor
ECS101M0H7EF4): the algebraic model fitted to the measured flux linkages in A.-R. Lelli, M. Hinkkanen, F. Giulii
Capponi, "A saturation model based on a simplified equivalent magnetic circuit for permanent magnet machines",
TechRxiv, 2024, doi 10.36227/techrxiv.171332345.53790692. Inverse inductances of iron, G_d and G_q, lie in parallel
with the magnets behind a bridge that saturates, G_b. Our side knows nothing of the model: it has a table of it in a
file, as of a measured machine.

The voltages are replayed at low speed, where the winding's resistance damps the machine. Around half its rated speed
a machine on voltages that are given hunts by itself, and any difference, however small, grows some hundredfold within
a second. The run at higher speed is under control on either side.

*Curve.* The other way round: our own saturation curve, its equations written once more, is told to motulator.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from emulator.plant.physics.saturation import Saturation
from emulator.scenario.effects import NONE, MapFile, curve_of
from emulator.scenario.motors import MOTORS
from emulator.scenario.scenarios import Excitation, Run, Scenario, drive_for
from tests.peers.cases import AVERAGED, Case, Vectors, switched
from tests.support.samples import noiseless

_POINTS: Final = 41  # of the table on either axis; of q one sign only, the machine is symmetric
_REACH: Final = ((0.2, 0.7), (0.0, 1.1))  # Vs, of psi_d and psi_q: a little beyond what the runs see
_BALDOR: Final = MOTORS["baldor_ecs101m"]
_DRIVE: Final = drive_for(_BALDOR.machine, _BALDOR.u_dc, T_s=1e-4)
_STEPPING: Final = Excitation(i_d_ref=-6.0, i_d_step=2.0, i_q_step=2.0, step_time=5e-3)
_SLOW: Final = Run(
    shaft="free", speed_rpm=100.0, rise_rpm=200.0, ramp_time=0.5, swing_rpm=60.0, swing_frequency=3.0,
    speed_control=True, speed_bandwidth=30.0, tau_L=20.0,
)
_FASTER: Final = replace(_SLOW, speed_rpm=300.0, rise_rpm=600.0, speed_bandwidth=20.0, tau_L=15.0)


def baldor_current(psi: Any) -> Any:
    """i_dq (A) of psi_dq (Vs)."""
    d, q = np.real(psi), np.imag(psi)
    G_d = 3.96 + 28.46 * np.abs(d) ** 4 + 41.52 / 3.0 * np.abs(d) * np.abs(q) ** 3
    G_q = 5.89 + 2.672 * np.abs(q) ** 6 + 41.52 / 3.0 * np.abs(d) ** 3 * np.abs(q)
    magnets, k_q = 0.804, 0.1
    square = (d - magnets) ** 2 + k_q * q**2
    G_b = 81.75 * square / (1.0 + square)
    return G_d * d + G_b * (d - magnets) + 1j * (G_q + k_q * G_b) * q


def tabled(points: int = _POINTS) -> tuple[Vectors, Vectors]:
    """Current (A) and flux linkage (Vs), so many points on either axis."""
    psi_d, psi_q = np.meshgrid(*(np.linspace(*ends, points) for ends in _REACH))
    psi = psi_d + 1j * psi_q
    return baldor_current(psi), psi


def by_map(folder: Path) -> Case:
    """motulator's machine; the map is written into the folder."""
    file = folder / "baldor.npz"
    i, psi = tabled()
    np.savez(file, i_s_dq=i, psi_s_dq=psi)
    effects = NONE._replace(flux_map=MapFile(str(file)))
    scenario = Scenario("peers", _BALDOR.machine, _DRIVE, _SLOW, _STEPPING, effects)
    return Case("5.5 kW by its map, same voltages, averaged", noiseless(scenario), baldor_current, _no_current())


def under_control(folder: Path) -> Case:
    """motulator's machine at higher speed, to be run by references."""
    case = by_map(folder)
    return replace(
        case, title="5.5 kW by its map, same references, each its own control",
        scenario=replace(case.scenario, run=_FASTER, excitation=Excitation(i_d_ref=_STEPPING.i_d_ref)),
    )


def by_curve() -> Case:
    """Our machine."""
    effects = NONE._replace(saturation=Saturation(L_d_drop=0.1, L_q_drop=0.35, cross_drop=0.1))
    motor = AVERAGED.scenario.motor
    curve = curve_of(effects, motor)
    g_d = 1.0 / motor.L_d - 3.0 * curve.a_d * motor.psi_f**2
    g_q = 1.0 / motor.L_q - curve.c * motor.psi_f**2
    i_f = g_d * motor.psi_f + curve.a_d * motor.psi_f**3

    def current(psi: Any) -> Any:
        d, q = np.real(psi), np.imag(psi)
        i_d = g_d * d + curve.a_d * d**3 + curve.c * d * q**2 - i_f
        return i_d + 1j * (g_q * q + curve.a_q * q**3 + curve.c * d**2 * q)

    return replace(
        AVERAGED, title="2.2 kW by its curve, same voltages, averaged",
        scenario=replace(AVERAGED.scenario, effects=effects), current=current, psi_0=complex(motor.psi_f),
    )


def same_voltages(folder: Path) -> tuple[Case, ...]:
    """Both machines, averaged and with edges."""
    return tuple(case for averaged in (by_map(folder), by_curve()) for case in (averaged, switched(averaged)))


def _no_current() -> complex:
    """psi_d (Vs) without current, by bisection."""
    low, high = _REACH[0]
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if baldor_current(middle).real < 0.0 else (low, middle)
    return complex(low)
