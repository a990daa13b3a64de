"""Samples from the emulated drive, as the stream or as a recording of every control period."""

import math
from collections.abc import Mapping
from dataclasses import replace

from emulator.drive.virtual_drive import Column, StreamRows, VirtualDrive
from emulator.plant.machine import Machine as Motor
from emulator.scenario.scenarios import PAPER, Scenario
from estimator.diagnosis.angle.hall_edges import through_edges
from estimator.machine import Machine
from estimator.physics.rows import Rows, rows_of
from estimator.samples import Resolution, Samples


def resolution_of(drive: VirtualDrive) -> Resolution:
    """What its encoder resolves."""
    counts = drive.scenario.drive.encoder_counts
    return Resolution(theta_e=2.0 * math.pi * drive.scenario.motor.n_p / counts if counts else 0.0)


def samples_of_rows(rows: StreamRows, drive: VirtualDrive) -> Samples:
    """Stream rows in the estimator's terms."""
    return Samples(
        rows.theta_e, rows.omega_e, rows.i_d, rows.i_q, rows.u_d, rows.u_q, drive.T_s,
        int(drive.read("stream_periods")), rows.i_d_mean, rows.i_q_mean, int(rows.row_tick[0]) * drive.T_s,
        resolution_of(drive),
    )


def streamed(drive: VirtualDrive, rows: int) -> Samples:
    """The drive's next stream rows."""
    return samples_of_rows(drive.run(rows * int(drive.read("stream_periods"))), drive)


def recorded(drive: VirtualDrive, periods: int) -> Samples:
    """The drive's next control periods."""
    r = drive.record(periods)
    return Samples(
        r["theta_e"], r["omega_e"], r["i_d"], r["i_q"], r["u_d"], r["u_q"], drive.T_s, resolution=resolution_of(drive)
    )


def machine_of(motor: Motor) -> Machine:
    """An emulated motor in the estimator's terms."""
    return Machine(motor.R_s, motor.L_d, motor.L_q, motor.psi_f, motor.n_p, motor.i_rated)


def rows_of_columns(c: Mapping[str, Column], machine: Machine, T_s: float) -> Rows:
    """A recording's rows, by the course through its edges where its angle is made of such."""
    samples = Samples(
        c["theta_e"], c["omega_e"], c["i_d"], c["i_q"], c["u_d"], c["u_q"], T_s, u_dc=c["u_dc"], i_a=c["i_a"],
        i_b=c["i_b"], i_c=c["i_c"],
    )  # fmt: skip
    assert machine.i_rated is not None
    return rows_of(through_edges([samples]).runs, machine, machine.i_rated)


def noiseless(scenario: Scenario = PAPER) -> Scenario:
    """The scenario with ideal current sensors."""
    return replace(scenario, drive=replace(scenario.drive, noise_i=0.0, adc_bits=0))


def truth_of(drive: VirtualDrive) -> Mapping[str, float]:
    """The emulated machine's true parameters by name."""
    truth = drive.truth
    return {"R_s": truth.R_s, "L_d": truth.L_d, "L_q": truth.L_q, "psi_f": truth.psi_f}
