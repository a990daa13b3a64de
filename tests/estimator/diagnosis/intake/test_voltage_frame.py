"""Voltage frame: voltages that a drive turned on by its own speed are told as such, others are left as they are."""

from dataclasses import replace

import numpy as np
import pytest

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.angle_signal import AngleSignal
from emulator.scenario.scenarios import PAPER_RUN, Scenario
from estimator.diagnosis.intake.voltage_frame import in_own_frame
from estimator.samples import Samples
from tests.support.samples import machine_of

T_S = 1e-4
COLUMNS = ("theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q")
MACHINE = machine_of(PAPER_RUN.motor)
NOMINAL = replace(MACHINE, R_s=1.08 * MACHINE.R_s, L_d=0.93 * MACHINE.L_d, psi_f=0.96 * MACHINE.psi_f)


def run_of(signal: AngleSignal, counts: int = 0) -> Samples:
    """With the smooth speed of a drive, and voltages in the middle of its two angles."""
    drive = replace(PAPER_RUN.drive, bridge="averaged", encoder_counts=counts)
    effects = PAPER_RUN.effects._replace(angle_signal=signal)
    scenarios: list[Scenario] = [replace(PAPER_RUN, drive=drive, effects=each) for each in (effects, PAPER_RUN.effects)]
    r, ideal = (VirtualDrive(each).record(10_000) for each in scenarios)
    smooth = np.convolve(np.pad(ideal["omega_e"], 10, "edge"), np.ones(21) / 21.0, "valid")
    theta_e, _, i_d, i_q, u_d, u_q = (r[name] for name in COLUMNS)
    return Samples(theta_e, smooth, i_d, i_q, u_d, u_q, T_S)


def turned_by_speed(run: Samples) -> Samples:
    D = np.angle(np.exp(1j * np.diff(run.theta_e)))
    ahead = np.append(0.5 * (T_S * run.omega_e[:-1] - D), 0.0)
    u = (run.u_d + 1j * run.u_q) * np.exp(-1j * ahead)
    return replace(run, u_d=u.real.copy(), u_q=u.imag.copy())


@pytest.mark.parametrize("signal", [
    AngleSignal(quadrature=0.14), AngleSignal(gain=0.05, offset_sin=0.06), AngleSignal(second=0.08, third=0.03),
])  # fmt: skip
def test_voltages_turned_on_by_a_speed_are_turned_back_to_the_middle_of_two_angles(signal: AngleSignal) -> None:
    run = run_of(signal)
    (found,), (said,) = in_own_frame([turned_by_speed(run)], NOMINAL)
    assert found.u_d == pytest.approx(run.u_d, abs=1e-9)
    assert found.u_q == pytest.approx(run.u_q, abs=1e-9)
    assert "omega_e" in said


@pytest.mark.parametrize("counts", [0, 4096])
@pytest.mark.parametrize("signal", [AngleSignal(), AngleSignal(quadrature=0.14), AngleSignal(second=0.08)])
def test_voltages_in_the_middle_of_two_angles_are_left_as_they_are(signal: AngleSignal, counts: int) -> None:
    run = run_of(signal, counts)
    assert in_own_frame([run], NOMINAL) == ((run,), ())
    quarters = [run[k : k + 2500] for k in range(0, 10_000, 2500)]
    assert in_own_frame(quarters, NOMINAL).remarks == ()
