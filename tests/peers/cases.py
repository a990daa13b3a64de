"""Cases: a machine, told to both sides, and what our side makes of it. Knows nothing of the peers' code."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.magnetics import current_and_pull, flux_of
from emulator.scenario.motors import MOTORS
from emulator.scenario.scenarios import Excitation, Run, Scenario, drive_for
from tests.support.samples import noiseless

Array = NDArray[np.float64]
Vectors = NDArray[np.complex128]

PERIODS: Final = 10_000  # one second
BAR: Final = 1.0  # %, rms
_RPM: Final = 2.0 * np.pi / 60.0


@dataclass(frozen=True, slots=True)
class Course:
    """What a drive did: samples at the starts of control periods."""

    t: Array  # s
    i: Vectors  # A, rotor frame
    tau_e: Array  # Nm
    omega_m: Array  # rad/s, mean over the period

    def signals(self) -> dict[str, Array]:
        """What is compared, by name."""
        return {"i_d": self.i.real, "i_q": self.i.imag, "tau_e": self.tau_e, "omega_m": self.omega_m}


@dataclass(frozen=True, slots=True)
class Voltages:
    """What a recording says of the voltage: held over each period."""

    u: Vectors  # V, stationary frame
    u_dc: float  # V
    T_s: float  # s


@dataclass(frozen=True, slots=True)
class Case:
    """A machine and a run. A saturated machine is told to the peer by its map, in the rotor frame."""

    title: str
    scenario: Scenario
    current: Callable[[Any], Any] | None = None  # A of Vs
    psi_0: complex | None = None  # Vs, where that current is zero


def recorded(case: Case, periods: int = PERIODS) -> tuple[Course, Voltages]:
    """What our drive does, and the voltages it says it set. No drive records its torque: it is that of the currents."""
    scenario = case.scenario
    drive = VirtualDrive(scenario)
    recording = drive.record(periods)
    i = recording["i_d"] + 1j * recording["i_q"]
    turn = recording["omega_e"] * drive.T_s
    u = (recording["u_d"] + 1j * recording["u_q"]) * np.exp(1j * (recording["theta_e"] + 0.5 * turn))
    n_p = scenario.motor.n_p
    course = Course(recording["t"], i, _torque(drive, i), recording["omega_e"] / n_p)
    return course, Voltages(u, scenario.drive.u_dc, drive.T_s)


def _torque(drive: VirtualDrive, i: Vectors) -> Array:
    """tau_e (Nm) of currents (A, rotor frame)."""
    plant = drive.plant_now()
    magnetics, flux_map = plant.magnetics, plant.flux_map

    def pull(sample: complex) -> float:
        psi = flux_of(magnetics, flux_map, sample, 1.0 + 0.0j)
        return current_and_pull(magnetics, flux_map, psi, 1.0 + 0.0j)[1]

    return 1.5 * plant.machine.n_p * np.array([pull(complex(sample)) for sample in i])


def switched(case: Case) -> Case:
    """The case with edges instead of averaged bridges."""
    drive = replace(case.scenario.drive, bridge="switched")
    title = case.title.replace("averaged", "edges")
    return replace(case, title=title, scenario=replace(case.scenario, drive=drive))


def speed_reference(run: Run) -> Callable[[float], float]:
    """The run's speed reference (rad/s, mechanical) over time (s), written once more."""

    def omega_ref(t: float) -> float:
        rise = min(t / run.ramp_time, 1.0) if run.ramp_time > 0.0 else 1.0
        swing = run.swing_rpm * np.sin(2.0 * np.pi * run.swing_frequency * t)
        return float(_RPM * (run.speed_rpm + run.rise_rpm * rise + swing))

    return omega_ref


def errors(ours: Course, theirs: Course) -> dict[str, float]:
    """Rms of the difference over the peer's rms in per cent, by signal."""
    pairs = zip(ours.signals().items(), theirs.signals().values(), strict=True)
    return {
        name: 100.0 * float(np.sqrt(np.mean((a - b) ** 2) / np.mean(b**2))) for (name, a), b in pairs
    }


_AALTO: Final = MOTORS["aalto_2k2"]
_RUN: Final = Run(
    shaft="free", speed_rpm=300.0, rise_rpm=900.0, ramp_time=0.5, swing_rpm=60.0, swing_frequency=3.0,
    speed_control=True, tau_L=7.0,
)
_STEPPING: Final = Excitation(i_d_ref=-1.0, i_d_step=1.0, i_q_step=1.0, step_time=5e-3)
_DRIVE: Final = drive_for(_AALTO.machine, _AALTO.u_dc, T_s=1e-4)

AVERAGED: Final = Case(
    "2.2 kW, same voltages, averaged", noiseless(Scenario("peers", _AALTO.machine, _DRIVE, _RUN, _STEPPING))
)
SWITCHED: Final = switched(AVERAGED)
REFERENCES: Final = replace(
    AVERAGED,
    title="2.2 kW, same references, each its own control",
    scenario=replace(AVERAGED.scenario, excitation=Excitation(i_d_ref=-1.0)),
)
SAME_VOLTAGES: Final = (AVERAGED, SWITCHED)
