"""A drive with a concealed effect is recorded and diagnosed, the set goes into it, and it is recorded again.

Drive and diagnosis share no equation. What is told of the second recording is to have the effect no more, or far less.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest

from bench.diagnoses.diagnose import as_json, diagnose_recording
from bench.diagnoses.diagnosis_request import Request
from bench.machine_file import Nominal
from bench.parameters.compensation import electrical_turn
from bench.parameters.from_diagnosis import set_from_diagnosis
from bench.parameters.parameter_set import FLASHED, ParameterSet, as_toml, parse
from emulator.drive.virtual_drive import Column, VirtualDrive
from emulator.plant.physics.legs import Inverter
from emulator.plant.physics.saturation import Saturation
from emulator.plant.physics.sensing import AngleSensing, CurrentSensing, read_angle
from emulator.scenario.effects import NONE, MapFile
from emulator.scenario.motors import MOTORS
from emulator.scenario.scenarios import PAPER, Excitation, Run, Scenario, drive_for
from tests.peers.saturated import tabled

pytestmark = pytest.mark.thorough

pa: Any = pyarrow  # comes without types
pq: Any = pyarrow.parquet

M, COUNTS = PAPER.motor, 65536
SETTLING, PERIODS = 2_000, 20_000  # control periods
NOMINAL = Nominal(
    {"R_s": 1.04 * M.R_s, "L_d": 0.97 * M.L_d, "L_q": 1.03 * M.L_q, "psi_f": 0.98 * M.psi_f}, n_p=M.n_p,
    i_rated=M.i_rated, T_s=PAPER.drive.T_s, u_dc=PAPER.drive.u_dc, encoder_counts=COUNTS,
)  # fmt: skip


def drive_with(
    effects: Mapping[str, Any], settings: Mapping[str, float] | None = None, **connected: Any
) -> VirtualDrive:
    """Of several speeds and currents, under way."""
    bridge = "switched" if "inverter" in effects else "averaged"
    drive = VirtualDrive(replace(
        PAPER, effects=NONE._replace(**effects), settings=dict(settings or {}),
        drive=replace(PAPER.drive, encoder_counts=COUNTS, bridge=bridge, **connected),
        run=replace(PAPER.run, speed_rpm=900.0, swing_rpm=500.0),
        excitation=replace(PAPER.excitation, i_d_ref=-1.0, i_q_ref=1.0, i_d_step=2.5, i_q_step=3.5),
    ))  # fmt: skip
    drive.record(SETTLING)
    return drive


def diagnosed(columns: Mapping[str, Column], folder: Path, nominal: Nominal = NOMINAL) -> dict[str, Any]:
    pq.write_table(pa.table(dict(columns)), file := folder / "run.parquet")
    content = as_json(diagnose_recording(Request(file, nominal)))
    assert content["fit"] is not None
    return content


@dataclass(frozen=True)
class Loop:
    """Diagnoses before and after, and the set between them."""

    before: dict[str, Any]
    after: dict[str, Any]
    given: ParameterSet

    def size(self, name: str) -> tuple[float, float]:
        """Of what was found, before and after; nothing found is none."""
        first, second = (
            sum(finding["parameters"].get(name, {"value": 0.0})["value"] for finding in said["findings"])
            for said in (self.before, self.after)
        )
        return first, second

    def free_run(self) -> float:
        """Error of the free-running twin without effects, after over before."""
        first, second = (said["fit"]["free_run_rms_A"]["before"] for said in (self.before, self.after))
        return second / first


def closed(drive: VirtualDrive, folder: Path) -> Loop:
    image, connected = drive.values([signal.name for signal in FLASHED]), drive.scenario.drive
    read = read_angle(drive.scenario.effects.angle_sensing, drive.plant.theta_m)
    reading = (-read if connected.encoder_reversed else read) + connected.encoder_offset
    columns = drive.record(PERIODS)
    before = diagnosed(columns, folder)
    turn = electrical_turn(reading, float(columns["theta_e"][0]), image)
    made = set_from_diagnosis(before, image, electrical_turn=turn)
    assert made.remarks == ()
    assert {entry.status for entry in made.set.entries.values()} == {"ok"}
    given = parse(as_toml(made.set), "set.toml")
    for name, value in given.values.items():
        drive.write(name, value)
    drive.record(SETTLING)
    return Loop(before, diagnosed(drive.record(PERIODS), folder), given)


def test_unequal_gains_of_the_current_sensors_are_gone(tmp_path: Path) -> None:
    loop = closed(drive_with({"current_sensing": CurrentSensing(gain_a=1.03, gain_b=0.985)}), tmp_path)
    assert loop.size("gain_a") == pytest.approx((1.025, 0.0), abs=0.002)
    assert loop.after["verdict"] == "no_mismatch"
    assert loop.free_run() < 0.4


def test_offsets_of_the_current_sensors_are_gone(tmp_path: Path) -> None:
    loop = closed(drive_with({"current_sensing": CurrentSensing(offset_a=0.12, offset_b=-0.05)}), tmp_path)
    assert loop.after["verdict"] == "no_mismatch"
    assert loop.free_run() < 0.2


def test_an_offset_of_the_angle_is_gone(tmp_path: Path) -> None:
    loop = closed(drive_with({"angle_sensing": AngleSensing(offset=0.03)}, {"angle_offset": 0.05}), tmp_path)
    assert loop.given.values["angle_offset"] == pytest.approx(-0.03 * M.n_p, abs=1e-3)
    assert loop.after["verdict"] == "no_mismatch"
    assert loop.free_run() < 0.02


@pytest.mark.parametrize("connected", [
    {}, {"encoder_reversed": True, "encoder_offset": 0.7},
], ids=["as it counts", "reversed and mounted askew"])
def test_an_eccentric_encoder_is_far_less_eccentric(connected: dict[str, Any], tmp_path: Path) -> None:
    sensing = AngleSensing(once=0.01, once_phase=0.4, twice=0.004, twice_phase=1.0)
    settings = {"angle_reversed": 1.0, "angle_offset": 0.7 * M.n_p} if connected else {}
    loop = closed(drive_with({"angle_sensing": sensing}, settings, **connected), tmp_path)
    for name in ("once", "twice"):
        before, after = loop.size(name)
        assert after < 0.02 * before
    assert loop.free_run() < 0.05


def test_what_a_drive_made_up_for_wrongly_is_put_right(tmp_path: Path) -> None:
    """Of the offsets a common part, which no current shows, comes to light with the gains."""
    wrong = {
        "phases_swapped": 1.0, "i_b_gain": 1.03, "i_c_offset": 0.15, "angle_offset": 0.1,
    }
    loop = closed(drive_with({}, wrong, phases_crossed=True), tmp_path)
    assert len(loop.before["findings"]) == 3
    assert {finding["effect"] for finding in loop.after["findings"]} <= {"current_sensor_offset"}
    for name in ("offset_a", "offset_b", "offset_c"):
        assert abs(loop.size(name)[1]) < 3e-3
    assert loop.free_run() < 0.01


def test_three_errors_of_sensors_at_once_are_gone_at_the_second_time(tmp_path: Path) -> None:
    drive = drive_with({
        "current_sensing": CurrentSensing(gain_a=1.03, offset_b=0.1),
        "angle_sensing": AngleSensing(offset=0.02, once=0.01, once_phase=0.4),
    })
    first = closed(drive, tmp_path)
    assert len(first.before["findings"]) == 4
    assert first.free_run() < 0.01
    assert closed(drive, tmp_path).after["verdict"] == "no_mismatch"


@pytest.mark.parametrize("inverter", [
    Inverter(dead_time=2e-6), Inverter(dead_time=1.5e-6, u_transistor=1.0, u_diode=1.2),
], ids=["dead time", "dead time and drops"])
def test_an_inverters_lost_voltage_is_far_less(inverter: Inverter, tmp_path: Path) -> None:
    """What is left is near crossings of zero, which currents' ripple makes; it hides as no R_s.

    The dead time may be told, and beside it what the drive adds for it now.
    """
    loop = closed(drive_with({"inverter": inverter}), tmp_path)
    assert loop.given.values["dead_time"] == pytest.approx(inverter.dead_time, rel=0.05)
    drop = 0.5 * (inverter.u_transistor + inverter.u_diode)
    per_volt = loop.before["recording"]["T_s"] / loop.before["recording"]["u_dc"]
    told = {finding["effect"]: finding["parameters"] for finding in loop.after["findings"]}
    left = loop.size("dead_time")[1] + loop.size("u_drop")[1] * per_volt
    left -= told.get("dead_time_compensation", {"time": {"value": 0.0}})["time"]["value"]
    assert abs(left) < 0.1 * (inverter.dead_time + drop * per_volt)
    assert loop.free_run() < 0.3
    before, after = (said["machine"]["before"]["R_s"]["value"] for said in (loop.before, loop.after))
    assert abs(after - M.R_s) < 0.01 * abs(before - M.R_s)


def test_drops_that_are_soft_go_into_a_table(tmp_path: Path) -> None:
    soft = Inverter(dead_time=5e-7, u_transistor=2.0, u_diode=2.5, knee=0.6)
    loop = closed(drive_with({"inverter": soft}), tmp_path)
    assert loop.given.values["inverter_correction"] == 2.0
    assert loop.free_run() < 0.3
    before, after = (said["machine"]["before"]["R_s"]["value"] for said in (loop.before, loop.after))
    assert abs(after - M.R_s) < 0.01 * abs(before - M.R_s)


def test_saturation_stays_the_machines_and_is_off_the_control(tmp_path: Path) -> None:
    """A drive that knows of it decouples its axes by true flux linkages: less is left to the integral."""
    drive, held = drive_with({"saturation": Saturation(0.0, 0.25, 0.0)}), complex(-1.0, 4.0)
    before = left_to_the_integral(drive, held)
    loop = closed(drive, tmp_path)
    assert loop.size("L_q_drop") == pytest.approx((0.25, 0.25), abs=0.01)
    assert loop.given.values["saturation_correction"] == 1.0
    assert left_to_the_integral(drive, held) < 0.15 * before


@pytest.mark.slow
def test_a_measured_flux_map_is_in_the_tables_where_the_recording_has_been(tmp_path: Path) -> None:
    i, psi = tabled()
    np.savez(tmp_path / "map.npz", i_s_dq=i, psi_s_dq=psi)
    motor, u_dc = MOTORS["baldor_ecs101m"].machine, MOTORS["baldor_ecs101m"].u_dc
    drive = VirtualDrive(Scenario(
        "map.toml", motor, drive_for(motor, u_dc), Run(speed_rpm=300.0, rise_rpm=300.0, ramp_time=2.0),
        Excitation(-4.0, 0.0, 6.0, 8.0, 0.02, kind="staircase", i_d_levels=7, level_time=0.1),
        NONE._replace(flux_map=MapFile(str(tmp_path / "map.npz"))),
    ))  # fmt: skip
    sheet = Nominal(
        {"R_s": 0.6, "L_d": 20e-3, "L_q": 90e-3, "psi_f": 0.45}, n_p=motor.n_p, i_rated=motor.i_rated, T_s=1e-4,
        u_dc=u_dc,
    )
    image = drive.values([signal.name for signal in FLASHED])
    said = diagnosed(drive.record(25_000), tmp_path, sheet)
    assert said["flux_map"] is not None
    held = complex(-4.0, 5.0)
    before = left_to_the_integral(drive, held, motor.R_s)
    for name, value in set_from_diagnosis(said, image).set.values.items():
        drive.write(name, value)
    assert left_to_the_integral(drive, held, motor.R_s) < 0.07 * before


def left_to_the_integral(drive: VirtualDrive, i: complex, R_s: float = M.R_s) -> float:
    """Voltage (V) beyond R_s i that the current control's integral makes up for, at a steady current (A)."""
    moving = drive.values(["i_d_ref", "i_q_ref", "i_d_step", "i_q_step"])
    for name, value in {"i_d_step": 0.0, "i_q_step": 0.0, "i_d_ref": i.real, "i_q_ref": i.imag}.items():
        drive.write(name, value)
    drive.record(SETTLING)
    left = list[complex]()
    for _ in range(100):
        drive.record(100)
        left.append(drive._state.firmware.integral - R_s * i)
    for name, value in moving.items():
        drive.write(name, value)
    drive.record(SETTLING)
    return float(np.sqrt(np.mean(np.abs(left) ** 2)))
