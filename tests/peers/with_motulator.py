"""motulator's machine, shaft and drive under our voltages, or under our references."""

from typing import Any, cast

import numpy as np
from motulator.common.control import PIController
from motulator.common.model import Delay
from motulator.drive import model
from motulator.drive.control import DriveControlSystem, sm
from motulator.drive.utils import SynchronousMachinePars

from tests.peers.cases import Case, Course, Voltages, speed_reference


def under_voltages(case: Case, voltages: Voltages) -> Course:
    """motulator's machine and shaft with the voltages that our drive recorded."""
    mdl = _model(case)
    mdl.delay = Delay(0)
    switched = case.scenario.drive.bridge == "switched"
    if switched:
        mdl.pwm = model.CarrierComparison(N=case.scenario.drive.timer_counts)
    replay = _Replay(voltages, 2 if switched else 1)
    _simulate(mdl, replay, len(voltages.u) * voltages.T_s)
    return replay.watched.course()


def under_references(case: Case, periods: int) -> Course:
    """motulator's drive with its own vector control, set to our references, load and bandwidths."""
    scenario = case.scenario
    motor, drive, run = scenario.motor, scenario.drive, scenario.run
    mdl = _model(case)
    watched = _Watched(drive.T_s)
    ctrl: Any = _VectorControl(_parameters(case), _References(scenario), drive.T_s, drive.bandwidth, watched)
    alpha_s = run.speed_bandwidth
    ctrl.speed_ctrl = PIController(alpha_s * motor.J, 0.25 * alpha_s**2 * motor.J)
    omega_ref = speed_reference(run)

    def electrical(t: float) -> float:
        return motor.n_p * omega_ref(t)

    ctrl.ref.w_m = electrical
    _simulate(mdl, ctrl, periods * drive.T_s)
    return watched.course()


def _parameters(case: Case) -> Any:
    motor = case.scenario.motor
    return SynchronousMachinePars(n_p=motor.n_p, R_s=motor.R_s, L_d=motor.L_d, L_q=motor.L_q, psi_f=motor.psi_f)


def _model(case: Case) -> Any:
    motor, run = case.scenario.motor, case.scenario.run
    machine = model.SynchronousMachine(_parameters(case), i_s=case.current, psi_s0=case.psi_0)

    def tau_L(t: Any) -> Any:
        return run.tau_L + 0.0 * t  # of a time, or of an array of them

    mechanics: Any = cast(Any, model.StiffMechanicalSystem)(J=motor.J, B_L=motor.B, tau_L=tau_L)
    mechanics.state.w_M = run.speed_rpm * 2.0 * np.pi / 60.0
    return model.Drive(model.VoltageSourceConverter(u_dc=case.scenario.drive.u_dc), machine, mechanics)


def _simulate(mdl: Any, ctrl: Any, duration: float) -> None:
    """A quarter of a period longer, so that the last period's end is seen, and rounding of the time decides nothing."""
    model.Simulation(mdl, ctrl).simulate(t_stop=duration + 0.25 * ctrl.T_s)


class _Watched:
    """What a model was at the starts of control periods."""

    def __init__(self, T_s: float) -> None:
        self.T_s = T_s
        self.rows: list[tuple[float, complex, float, complex]] = []  # t, i, tau_e, rotor as a unit vector

    def see(self, mdl: Any) -> None:
        machine, mechanics = mdl.machine, mdl.mechanics
        self.rows.append((mdl.t0, machine.i_s, machine.tau_M.real, mechanics.state.exp_j_theta_M))

    def course(self) -> Course:
        t, i, tau_e, rotor = (np.array(column) for column in zip(*self.rows, strict=True))
        omega_m = np.angle(rotor[1:] / rotor[:-1]) / self.T_s
        return Course(t[:-1], i[:-1], tau_e[:-1], omega_m)


class _Replay:
    """In the place of a control system: gives the voltages of a recording, period by period."""

    def __init__(self, voltages: Voltages, parts: int) -> None:
        self.voltages, self.parts = voltages, parts  # calls per period: a carrier comes up and goes down
        self.T_s = voltages.T_s
        self.watched = _Watched(voltages.T_s)
        self.calls = 0

    def __call__(self, mdl: Any) -> tuple[float, Any]:
        k, part = divmod(self.calls, self.parts)
        self.calls += 1
        if part == 0:
            self.watched.see(mdl)
        u = self.voltages.u[min(k, len(self.voltages.u) - 1)]
        phases = np.array([u.real, *(-0.5 * u.real + sign * 0.75**0.5 * u.imag for sign in (1.0, -1.0))])
        lift = -0.5 * (phases.max() + phases.min())
        return self.T_s / self.parts, 0.5 + (phases + lift) / self.voltages.u_dc

    def post_process(self) -> None:
        """Nothing: it keeps what it needs."""


class _References:
    """Current references: our direct current, and the quadrature current of the torque that is wanted."""

    def __init__(self, scenario: Any) -> None:
        self.i_d = scenario.excitation.i_d_ref
        self.k = 1.5 * scenario.motor.n_p * scenario.motor.psi_f

    def output(self, fbk: Any, ref: Any) -> Any:
        ref.i_s = complex(self.i_d, ref.tau_M / self.k)
        return ref

    def update(self, fbk: Any, ref: Any) -> None:
        """Nothing to remember."""


class _VectorControl(sm.CurrentVectorControl):
    """motulator's, with references of ours; looks at the model before each period."""

    def __init__(self, par: Any, references: Any, T_s: float, bandwidth: float, watched: _Watched) -> None:
        DriveControlSystem.__init__(self, par, T_s, sensorless=False)
        self.current_reference = references
        self.current_ctrl = sm.CurrentController(par, bandwidth)
        self.watched = watched
        self.T_s = T_s

    def __call__(self, mdl: Any) -> tuple[float, Any]:
        self.watched.see(mdl)
        return super().__call__(mdl)
